"""Progress as lines of JSON, for a program that watches an estimation. Knows no search, only its events."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from estimator.errors import InputError
from estimator.estimating.progress import Progress

INTERVAL = 0.1  # s, between two lines of one phase


class ProgressStream:
    """Writes an object a line: phase, simulations done and at its end, seconds, the best candidate and its cost.

    Use in a ``with`` statement. Whoever reads may go away: then nothing more is written, and the estimation goes on.

    Parameters
    ----------
    path : path
        A file, a named pipe, or such as /dev/fd/3.
    clock : () → float, s
        Monotonic time.

    Raises
    ------
    InputError
        It cannot be opened.
    """

    def __init__(self, path: str | Path, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._start = clock()
        self._written = -math.inf
        self._phase: str | None = None
        self._open = True
        try:
            self._stream = open(path, "w", encoding="utf-8", buffering=1)  # noqa: SIM115 (closed on exit)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error}); give another file") from error

    def __call__(self, event: Progress) -> None:
        """Write an event, unless the last one of its phase was written a moment ago."""
        now = self._clock()
        if not self._open or (event.phase == self._phase and now - self._written < INTERVAL):
            return
        self._written, self._phase = now, event.phase
        try:
            self._stream.write(json.dumps(progress_mapping(event, seconds=now - self._start)) + "\n")
        except OSError:
            self._open = False

    def __enter__(self) -> ProgressStream:
        """Start the clock."""
        self._start = self._clock()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        try:
            self._stream.close()
        except OSError:
            self._open = False


def progress_mapping(event: Progress, *, seconds: float) -> dict[str, Any]:
    """Return an event, `seconds` after the start, as plain data; "seconds_left", of the phase, is None where not known.

    >>> progress_mapping(Progress("search", 300, 400), seconds=3.0)["seconds_left"]
    1.0
    """
    plain = {f.name: getattr(event, f.name) for f in dataclasses.fields(event)}
    left = None
    if event.expected is not None and event.expected > event.simulations > 0:
        left = seconds * (event.expected - event.simulations) / event.simulations
    cost = event.best_cost
    plain["best_cost"] = cost if cost is not None and math.isfinite(cost) else None
    plain["parameters"] = None if event.parameters is None else dict(event.parameters)
    return {**plain, "seconds": round(seconds, 3), "seconds_left": left}
