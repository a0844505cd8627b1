"""Estimates under way: each the command `estimate` in a child process, with the progress that it tells. Knows no HTTP.

An FMU that crashes costs that process a candidate; a process that is killed costs its run, not the app.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from typing import IO, Any

from estimator.app import program
from estimator.app.place import RESULT, Place
from estimator.cases.case import Case
from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.errors import InputError
from estimator.fmus.process import signal_name

MOST_POINTS = 400  # of the history that the page draws
PATIENCE = 15.0  # s that a run may take to stop before it is killed


class Run:
    """One estimate, its process and what it has told.

    Parameters
    ----------
    name : str
        Of its case file and its result folder.
    case : Case
        As its case file says.
    place : Place
    """

    def __init__(self, name: str, case: Case, place: Place) -> None:
        self.name, self.case, self._place = name, case, place
        self.arguments = ["estimate", f"{name}{CASE_SUFFIX}", "-o", name, "--signals"]
        self._lock = threading.Lock()
        self._began, self._ended = time.monotonic(), 0.0
        self._progress: dict[str, Any] = {}
        self._history: list[dict[str, Any]] = []
        self._every, self._seen = 1, 0
        self._state, self._message = "running", ""
        self._verdict: str | None = None
        self._stopping = False
        reading, writing = os.pipe()
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the run)
        arguments = [*self.arguments, "--quiet", "--progress-json", f"/dev/fd/{writing}"]
        try:
            self._process: subprocess.Popen[bytes] = program.start(
                arguments, folder=place.path, errors=self._errors.fileno(), keep=(writing,)
            )
        finally:
            os.close(writing)
        self._thread = threading.Thread(target=self._follow, args=(reading,), name=f"run {name}", daemon=True)
        self._thread.start()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        with self._lock:
            return self._state == "running"

    @property
    def best(self) -> dict[str, float]:
        """Parameters of the best candidate so far; empty before there is one."""
        with self._lock:
            return dict(self._progress.get("parameters") or {})

    def state(self) -> dict[str, Any]:
        """Return all that the page shows of it."""
        with self._lock:
            seconds = (self._ended or time.monotonic()) - self._began
            return {
                "name": self.name,
                "state": self._state,
                "stopping": self._stopping and self._state == "running",
                "message": self._message,
                "verdict": self._verdict,
                "seconds": seconds,
                "command": program.shown(self.arguments),
                "progress": self._progress,
                "history": list(self._history),
                "method": self.case.search.method,
                "recordings": [self._place.name_of(path) for path in self.case.recordings],
            }

    def stop(self) -> None:
        """Ask it to stop; the best candidate so far stays known."""
        with self._lock:
            if self._state != "running":
                return
            self._stopping = True
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGINT)
        threading.Thread(target=self._insist, daemon=True).start()

    def end(self) -> None:
        """Stop it and wait until it has gone."""
        self.stop()
        self._thread.join(PATIENCE + 5)

    def _insist(self) -> None:
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def _follow(self, reading: int) -> None:
        """Read what it tells until it ends."""
        with open(reading, encoding="utf-8", errors="replace") as stream:
            for line in stream:
                with contextlib.suppress(ValueError):
                    self._take(json.loads(line))
        status = self._process.wait()
        self._errors.seek(0)
        said = program.sentence(self._errors.read().decode(errors="replace"))
        self._errors.close()
        with self._lock:
            self._ended = time.monotonic()
            if status in (0, 1) and (verdict := self._written()) is not None:
                self._state, self._verdict = "done", verdict
            elif self._stopping:
                self._state, self._message = "stopped", "stopped; the best candidate so far is kept"
            else:
                self._state = "failed"
                self._message = said or _ending(status)

    def _written(self) -> str | None:
        """Return the verdict of the result that it has written; None if it has not."""
        try:
            path = self._place.path / self.name / RESULT
            return str(json.loads(path.read_text(encoding="utf-8"))["verdict"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def _take(self, told: Mapping[str, Any]) -> None:
        with self._lock:
            self._progress = dict(told)
            if not told.get("parameters"):
                return
            if self._seen % self._every == 0:
                keys = ("simulations", "seconds", "phase", "best_cost", "parameters")
                self._history.append({key: told.get(key) for key in keys})
            self._seen += 1
            if len(self._history) > MOST_POINTS:
                self._history = self._history[::2]
                self._every *= 2


def _ending(status: int) -> str:
    """Say how a process ended that said nothing."""
    if status >= 0:
        return f"the process ended with status {status} and said nothing"
    return f"the process was killed ({signal_name(-status)})"


class Runs:
    """The estimates of this app, one at a time."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._lock = threading.Lock()
        self._runs: dict[str, Run] = {}

    def check_free(self) -> None:
        """See that none is running.

        Raises
        ------
        InputError
            One is.
        """
        for run in self._runs.values():
            if run.is_running:
                raise InputError(f"{run.name} is still running; stop it, or wait for it")

    def start(self, name: str, case: Case) -> Run:
        """Start an estimate of a case file that has been written."""
        with self._lock:
            self.check_free()
            run = self._runs[name] = Run(name, case, self._place)
            return run

    def run(self, name: str) -> Run:
        """Return a run.

        Raises
        ------
        InputError
            There is none of that name.
        """
        if name not in self._runs:
            raise InputError(f"no run {name!r} was started here")
        return self._runs[name]

    def listed(self) -> list[dict[str, Any]]:
        """Return name and state of every run, the last one first."""
        states = [run.state() for run in reversed(self._runs.values())]
        return [{key: state[key] for key in ("name", "state", "verdict", "message", "seconds")} for state in states]

    def close(self) -> None:
        """End all that are running."""
        for run in self._runs.values():
            if run.is_running:
                run.end()
