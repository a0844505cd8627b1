"""One worker process, seen from its owner: started, spoken to, listened to, ended. Knows orders and answers only.

The process is started from the same interpreter by ``subprocess``, on every platform alike.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from estimator.fmus.mailbox import Mailbox
from estimator.stepping.descendants import MARK, descendants, end_all

STARTING, IDLE, RUNNING = range(3)


class Process:
    """One worker process; its answers come into a mailbox."""

    def __init__(
        self,
        slot: int,
        generation: int,
        folder: Path,
        mailbox: Mailbox[Process],
    ) -> None:
        self.slot = slot
        self.generation = generation
        self.state = STARTING
        self.ended_because = ""
        root = str(Path(__file__).resolve().parents[2])
        code = f"import sys; sys.path.insert(0, {root!r}); from estimator.stepping.worker import main; main()"
        self._mark = f"{folder}:{slot}:{generation}"
        self._started: set[int] = set()  # by the FMU, as far as it was seen
        self.popen = subprocess.Popen(
            [sys.executable, "-P", "-c", code, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", MARK: self._mark},
            start_new_session=os.name == "posix",  # so that what an FMU starts ends with it
        )
        assert self.popen.stdout is not None
        self._mailbox = mailbox
        mailbox.join(self, self.popen.stdout)

    def send(self, order: dict[str, Any]) -> None:
        """Send one order; of a process that is gone the mailbox tells."""
        assert self.popen.stdin is not None
        with contextlib.suppress(OSError):
            self.popen.stdin.write((json.dumps(order) + "\n").encode())
            self.popen.stdin.flush()

    def end(self, *, politely: bool) -> None:
        """End the process: by its own hand when it is idle, else by force."""
        if politely:
            self.send({"quit": True})
            self.reap()
        else:
            self.kill()
            self.reap()

    def kill(self) -> None:
        """End the process, and those that the FMU has started, by force."""
        if os.name != "posix":
            self.popen.kill()
            return
        if self.popen.returncode is None:
            self._started |= descendants(self.popen.pid)
        with contextlib.suppress(OSError):
            os.killpg(self.popen.pid, signal.SIGKILL)
        end_all(self._mark, self._started)

    def has_ended(self) -> bool:
        """Whether the process itself is gone; what it has started, which holds on to its answers, is ended then."""
        if self.popen.poll() is None:
            return False
        end_all(self._mark, self._started)
        return True

    def reap(self, *, patience: float = 1.0) -> int:
        """Wait for a process that is ending, `patience` seconds at most; return its exit code."""
        assert self.popen.stdin is not None
        try:
            self.popen.wait(timeout=patience)
        except subprocess.TimeoutExpired:
            self.kill()
            self.popen.wait()
        else:
            self.kill()  # what it has left behind
        with contextlib.suppress(OSError):
            self.popen.stdin.close()
        self._mailbox.leave(self)
        return int(self.popen.returncode)


def how_it_ended(code: int) -> str:
    """Say how a process ended, from its exit code."""
    if code < 0:
        return f"the FMU crashed ({signal_name(-code)})"
    return f"the FMU ended its process (exit status {code})"


def signal_name(number: int) -> str:
    """Return what a signal is called; most real-time ones have no name."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
