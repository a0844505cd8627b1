"""Progress of a long run, as one live line on a terminal. Knows no search and no FMU, only their events."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TextIO

from estimator.results.phases import PHASES

REDRAW = 0.1  # s, between two drawings of the live line
REPEAT = 1.0  # s, after which it is drawn again with the time that has passed, where nothing else happens
FALLBACK_WIDTH = 80  # columns, when the terminal does not say


@dataclass(frozen=True)
class Progress:
    """Where an estimation stands.

    Attributes
    ----------
    phase : str
        What is going on: "search", "polish", …
    simulations : int
        FMU runs started so far, all phases together.
    expected : int or None
        Runs started when the phase ends, all phases together, if that is known: at most so many of a search.
    best_cost : float or None
        Cost of the best candidate so far.
    parameters : name → float, or None
        The best candidate, SI units.
    """

    phase: str
    simulations: int
    expected: int | None = None
    best_cost: float | None = None
    parameters: Mapping[str, float] | None = None


def progress_line(event: Progress, *, seconds: float) -> str:
    """Return one line of text about an event, `seconds` after the start.

    >>> progress_line(Progress("search", 1200, 4000, 0.0125, {"R": 3.1}), seconds=3.0)
    'search  1200 of 4000 simulations  400/s  search ends in 7 s  cost 0.0125  R 3.1'
    >>> progress_line(Progress("nuisances", 1200), seconds=30.0)
    'bench effects  1200 simulations  40/s  30 s so far, time left not known'
    """
    known_end = event.expected is not None and event.expected >= event.simulations
    parts = [
        PHASES.get(event.phase, event.phase),
        f"{event.simulations}{f' of {event.expected}' if known_end else ''} simulations",
    ]
    rate = event.simulations / seconds if seconds > 0.5 else 0.0
    if rate > 0:
        parts.append(f"{rate:.0f}/s" if rate >= 10 else f"{rate:.1f}/s")
    if rate > 0 and known_end and event.expected is not None:
        parts.append(f"{event.phase} ends in {_duration((event.expected - event.simulations) / rate)}")
    else:
        parts.append(f"{f'{_duration(seconds)} so far, ' if seconds >= 1 else ''}time left not known")
    if event.best_cost is not None and math.isfinite(event.best_cost):
        parts.append(f"cost {event.best_cost:.3g}")
    parts += [f"{name} {value:.4g}" for name, value in (event.parameters or {}).items()]
    return "  ".join(parts)


def fitted(line: str, width: int) -> str:
    """Return as many whole items of a line as `width` columns hold; a value is never cut in two.

    >>> fitted("search  100 simulations  cost 0.0125", 30)
    'search  100 simulations'
    """
    if len(line) <= width:
        return line
    cut = line.rfind("  ", 0, width + 2)
    return line[: cut if cut > 0 else width]


def batch_line(*, done: int, total: int, kept: int, verdicts: Mapping[str, int], seconds: float) -> str:
    """Return one line of text about a batch, `seconds` after its start; `kept` cases were done before that.

    >>> batch_line(done=120, total=1000, kept=20, verdicts={"ok": 118, "failed": 2}, seconds=50)
    '120 of 1000 cases  2.0/s  7 min left  118 ok  2 failed'
    """
    parts = [f"{done} of {total} cases"]
    if done == kept:
        parts = [stage_line(parts[0], seconds=seconds)]
    elif seconds > 0.5:
        rate = (done - kept) / seconds
        parts.append(f"{rate:.0f}/s" if rate >= 10 else f"{rate:.1f}/s" if rate >= 1 else f"{60 * rate:.1f}/min")
        if total > done:
            parts.append(f"{_duration((total - done) / rate)} left")
    return "  ".join([*parts, *(f"{count} {verdict}" for verdict, count in verdicts.items())])


def stage_line(what: str, *, seconds: float) -> str:
    """Return one line of text about a stage whose end nobody knows, `seconds` after the start of all.

    >>> stage_line("connection with tcp://10.0.0.5:8786", seconds=7)
    'connection with tcp://10.0.0.5:8786  7 s so far'
    """
    return f"{what}  {_duration(seconds)} so far" if seconds >= 1 else what


class LiveLine:
    """One line of a terminal, drawn over and over and wiped at the end. Use in a ``with`` statement.

    Parameters
    ----------
    stream : text stream
        The terminal; nothing else may be written there inside the ``with`` statement.
    clock : () → float, s
        Monotonic time.
    """

    def __init__(self, stream: TextIO, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._start = clock()
        self._drawn = -math.inf
        self._shown = 0
        self._line_after: Callable[[float], str] = lambda seconds: ""
        self._lock = threading.RLock()
        self._over = threading.Event()

    def __call__(self, event: Progress) -> None:
        """Draw an event, unless the last one was drawn a moment ago."""
        self.draw(lambda seconds: progress_line(event, seconds=seconds))

    def draw(self, line_after: Callable[[float], str]) -> None:
        """Draw a line that depends on the seconds since the start, unless the last was drawn a moment ago.

        It is drawn again each second, until another comes or it is wiped: the calculation between two
        simulations may take long.
        """
        with self._lock:
            self._line_after = line_after
            self._draw(after=REDRAW)

    def wipe(self) -> None:
        """Make room for something else; the line comes back when it is drawn next."""
        with self._lock:
            if self._shown:
                self._write("\r" + " " * min(self._shown, _width(self._stream) - 1) + "\r")
                self._shown = 0

    def __enter__(self) -> LiveLine:
        """Start the clock."""
        self._start = self._clock()
        threading.Thread(target=self._repeat, daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        """Wipe the line."""
        self._over.set()
        self.wipe()

    def _draw(self, *, after: float) -> None:
        now = self._clock()
        if now - self._drawn < after:
            return
        self._drawn = now
        room = _width(self._stream) - 1
        line = fitted(self._line_after(now - self._start), room)
        self._write("\r" + line + " " * (min(self._shown, room) - len(line)))  # the window may be narrower than before
        self._shown = len(line)

    def _repeat(self) -> None:
        with contextlib.suppress(OSError, ValueError):  # the terminal has gone: who draws the next line is told
            while not self._over.wait(REPEAT):
                with self._lock:
                    if self._shown and not self._over.is_set():
                        self._draw(after=REPEAT)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether somebody can be watching `stream`."""
    try:
        return stream is not None and stream.isatty()
    except ValueError:  # closed
        return False


def is_live(stream: TextIO | None) -> bool:
    """Return whether a line can be drawn over and over on `stream`; a terminal that says TERM=dumb cannot."""
    return is_terminal(stream) and os.environ.get("TERM") != "dumb"


def _width(stream: TextIO) -> int:
    try:
        return os.get_terminal_size(stream.fileno()).columns or FALLBACK_WIDTH
    except (OSError, ValueError):
        return FALLBACK_WIDTH


def _duration(seconds: float) -> str:
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    if seconds < 99.5 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
