"""A pseudo-terminal that a command runs on, as on a user's screen: its width, its resizes, its Ctrl-C."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from forked import Forked
from interrupts import takes_interrupts

READY = "ready\r\n"  # written by the child once Ctrl-C can be pressed, before it loads the command line
SCRIPT = """
import signal, sys
from estimator import door
signal.signal(signal.SIGINT, door.end_at_once)
sys.stderr.write("ready\\n")
sys.stderr.flush()
sys.exit(door.main())
"""
PATIENCE = 180.0  # s that a command may take


@dataclass(frozen=True)
class Screen:
    """What a command wrote on its terminal, after it was ready, and how it ended."""

    text: str
    status: int
    seconds: float

    @property
    def drawings(self) -> list[str]:
        """The drawings of the live line, without the spaces that cover the one before."""
        parts = [part.rstrip(" ") for part in self.text.replace("^C", "").split("\r") if not part.startswith("\n")]
        return [part for part in parts if "simulations" in part and "\n" not in part]


class Terminal:
    """A command on a terminal of its own, which it controls: Ctrl-C reaches it as a user's would.

    Parameters
    ----------
    columns : int
        Width of the window.
    term : str
        The environment variable TERM.
    loads : bool
        The program is started and loads itself; else it is forked from one that is loaded.
    """

    def __init__(self, *arguments: str, cwd: Path, columns: int = 80, term: str = "xterm", loads: bool = False) -> None:
        self._master, slave = pty.openpty()
        self.resize(columns)
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent), "TERM": term}
        environment.pop("COLUMNS", None)

        def own_terminal() -> None:
            takes_interrupts()
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

        self._process: Forked | subprocess.Popen[bytes]
        if loads:
            self._process = subprocess.Popen(
                [sys.executable, "-c", SCRIPT, *arguments],
                cwd=cwd,
                stdin=slave,
                stdout=slave,
                stderr=slave,
                env=environment,
                start_new_session=True,
                preexec_fn=own_terminal,
            )
        else:
            self._process = Forked(*arguments, cwd=cwd, streams=(slave,) * 3, env=environment, terminal=True)
        os.close(slave)

    def resize(self, columns: int) -> None:
        """Set the window's width; the kernel sends SIGWINCH to whoever the terminal controls."""
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))

    def interrupt(self) -> None:
        """Press Ctrl-C."""
        os.write(self._master, b"\x03")

    def run(self, *, after: float | None = None, on_text: Callable[[str], None] | None = None) -> Screen:
        """Read the screen until the command has ended.

        Parameters
        ----------
        after : float, optional
            s after the command was ready at which Ctrl-C is pressed.
        on_text : callable, optional
            Told the screen so far, whenever something was written.
        """
        raw, began, pressed = b"", None, after is None
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            due = None if began is None or pressed else began + (after or 0.0) - time.monotonic()
            if due is not None and due <= 0:
                self.interrupt()
                pressed = True
            wait = 0.1 if due is None else max(0.0, min(due, 0.1))
            if select.select([self._master], [], [], wait)[0]:
                try:
                    raw += os.read(self._master, 65536)
                except OSError:  # nobody holds the other end any more
                    break
                if began is None and READY.encode() in raw:
                    began = time.monotonic()
                elif on_text is not None:
                    on_text(raw.decode(errors="replace"))
        status = self._process.wait(timeout=PATIENCE)
        seconds = time.monotonic() - (began or 0.0)
        with contextlib.suppress(OSError):
            os.close(self._master)
        return Screen(raw.decode().partition(READY)[2], status, seconds)
