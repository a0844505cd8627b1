"""One case of a batch, from the case to what the table says of it; and the process that does many. Knows no folder.

A case worker keeps its FMU process from case to case: starting one costs 0.3 s. Started as a process it takes pickled
tasks on standard input and gives pickled outcomes on what was standard output when it started; when standard input
ends, its owner is gone and it ends at once, whatever it is doing.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import socket
import sys
import threading
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from estimator.cases.case import Case
from estimator.cases.expectation import Check, checks
from estimator.cases.nameplate import QUANTITIES, plate_checks, plate_values
from estimator.errors import EstimatorError, InputError, SimulationError, is_build_error

if TYPE_CHECKING:
    from estimator.batches.drawn import Drawn
    from estimator.estimating.checkpoint import Journal, JournalledWorkers
    from estimator.fmus.fmu import FmuDescription
    from estimator.recordings.recording import Recording
    from estimator.results.result import Estimate

DEBUG = "FMU_ESTIMATOR_DEBUG"  # environment variable: a case worker says on stderr what went wrong inside
FAILED = "failed"  # the verdict of a case without any estimate


@dataclass(frozen=True)
class Task:
    """One case of a batch.

    Attributes
    ----------
    name : unique in the batch
    report : write report.html and figure.png too, some 0.1 s
    drawn : what makes the recordings, instead of the case's own; or None
    checkpoint : where a long search is journalled, and the digest of what it depends on; or None
    fmu_path : what the result says of where the FMU is; None: where it is
    """

    name: str
    case: Case
    report: bool = False
    drawn: Drawn | None = None
    checkpoint: tuple[Path, str] | None = None
    fmu_path: str | None = None


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes
    ----------
    row : plain data; what the table says, the same on every run
    files : name → content, for the case's folder
    timing : plain data; what differs from run to run
    final : False where another run may end otherwise: a file that was missing, a process that was killed
    """

    row: dict[str, Any]
    files: dict[str, bytes] = field(default_factory=dict)
    timing: dict[str, Any] = field(default_factory=dict)
    final: bool = True


class CaseWorker:
    """Estimates cases one after the other by the same FMU processes, one by default. Use as a context manager.

    Parameters
    ----------
    processes : int
    inside : bool
        As of `Workers`: this process is there for the cases only.
    """

    def __init__(self, *, processes: int = 1, inside: bool = False) -> None:
        self._processes, self._inside = processes, inside
        self._crew: JournalledWorkers | None = None
        self._descriptions: dict[tuple[str, int, int], FmuDescription] = {}

    def run(self, task: Task) -> Outcome:
        """Estimate one case; whatever goes wrong becomes its outcome."""
        started = time.monotonic()
        try:
            outcome = self._estimated(task)
        except EstimatorError as error:
            self.close()
            outcome = failed(task, str(error), final=isinstance(error, SimulationError))
        except Exception as error:
            self.close()
            if os.environ.get(DEBUG):
                sys.excepthook(*sys.exc_info())
            if is_build_error(error):
                outcome = failed(task, str(error), final=False)
            else:
                outcome = failed(task, f"internal error, {type(error).__name__}: {error}", final=False)
        timing = {"seconds": round(time.monotonic() - started, 6), "host": socket.gethostname(), **outcome.timing}
        return replace(outcome, timing=timing)

    def estimate(
        self, case: Case, *, recordings: tuple[Recording, ...] | None = None, journal: Journal | None = None
    ) -> Estimate:
        """Estimate one case; with a journal, go on where an earlier search was cut off.

        Raises
        ------
        InputError, SimulationError
            As `estimator.estimating.estimate.estimate`.
        """
        from estimator.estimating.checkpoint import JournalledWorkers
        from estimator.estimating.estimate import estimate_by

        if self._crew is None:
            self._crew = JournalledWorkers(self._processes, inside=self._inside)
        self._crew.journal = journal
        return estimate_by(self._crew, case, description=self._description(case.fmu), recordings=recordings)

    def close(self) -> None:
        """End the FMU process; the next case starts another."""
        if self._crew is not None:
            self._crew.close()
        self._crew = None

    def __enter__(self) -> CaseWorker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _estimated(self, task: Task) -> Outcome:
        with self._journal(task) as journal:
            recordings = None if task.drawn is None else task.drawn.recordings()
            estimate = self.estimate(task.case, recordings=recordings, journal=journal)
        if task.fmu_path is not None:
            estimate = replace(estimate, fmu={**estimate.fmu, "path": task.fmu_path})
        started = time.monotonic()
        row = row_of(task, estimate)
        files = files_of(task, estimate)
        timing = {"search_seconds": round(estimate.seconds, 6), "files_seconds": round(time.monotonic() - started, 6)}
        return Outcome(row, files, timing)

    def _journal(self, task: Task) -> contextlib.AbstractContextManager[Journal | None]:
        if task.checkpoint is None:
            return contextlib.nullcontext()
        from estimator.estimating.checkpoint import Journal

        path, digest = task.checkpoint
        return Journal(path, digest=digest)

    def _description(self, fmu: str) -> FmuDescription:
        """Read an FMU's description once, and again when the file has changed."""
        from estimator.fmus.fmu import describe

        if not os.path.isabs(fmu):
            key = (fmu, 0, 0)
        else:
            try:
                at = os.stat(fmu)
            except OSError:
                raise InputError(f"there is no FMU {fmu}; give the path of an .fmu file") from None
            key = (fmu, at.st_mtime_ns, at.st_size)
        if key not in self._descriptions:
            self._descriptions[key] = describe(fmu)
        return self._descriptions[key]


def case_checks(case: Case, estimate: Estimate) -> tuple[Check, ...]:
    """Hold an estimate against all that its case expects, the nameplate included."""
    found = checks(case.expect, case.limits, estimate)
    if case.nameplate is None:
        return found
    return (*found, *plate_checks(case.nameplate, estimate, confidence=case.limits.confidence))


def row_of(task: Task, estimate: Estimate) -> dict[str, Any]:
    """Return what the table says of an estimate: no times, no host names, no absolute paths."""
    from estimator.results.result_json import json_ready

    case = task.case
    voltage = case.nameplate.voltage if case.nameplate else None
    plate = plate_values(estimate, voltage=voltage) if case.nameplate else {}
    return {
        **_who(task),
        "verdict": estimate.verdict,
        "reasons": list(estimate.reasons),
        "parameters": {
            name: {
                "value": p.value,
                "standard_error": p.standard_error,
                "unit": p.unit,
                "at_bound": p.at_bound,
                "status": p.status,
            }
            for name, p in estimate.parameters.items()
        },
        "rmse": json_ready(estimate.rmse),
        "fit_percent": json_ready(estimate.fit_percent),
        "nameplate": {
            name: {"value": p.value, "standard_error": p.standard_error, "unit": QUANTITIES[name][0]}
            for name, p in plate.items()
        },
        "checks": {check.name: check.outcome for check in case_checks(case, estimate)},
        "method": estimate.method,
        "seed": estimate.seed,
        "simulations": estimate.simulations,
        "failed_simulations": estimate.failed_simulations,
    }


def files_of(task: Task, estimate: Estimate) -> dict[str, bytes]:
    """Return the content of the case's result files."""
    from estimator.results.export import parameter_set, result_files
    from estimator.results.result_json import to_json

    if task.report:
        sources = [
            s for s in (task.case.path, estimate.fmu.get("path"), *task.case.recordings) if s and Path(s).exists()
        ]
        return result_files(estimate, command=f"fmu-estimator batch {task.name}", sources=sources)
    files = {"result.json": to_json(estimate).encode()}
    if estimate.parameters and estimate.verdict != "refused":
        files["parameters.ssv"] = parameter_set(estimate)
    return files


def failed(task: Task, reason: str, *, final: bool = False) -> Outcome:
    """Return the outcome of a case without any estimate."""
    search = task.case.search
    row = {**_who(task), "verdict": FAILED, "reasons": [" ".join(reason.split())], "parameters": {}, "rmse": {}}
    row |= {"fit_percent": {}, "nameplate": {}, "checks": {}, "method": search.method, "seed": search.seed}
    return Outcome({**row, "simulations": 0, "failed_simulations": 0}, final=final)


def _who(task: Task) -> dict[str, Any]:
    case = task.case
    return {"case": task.name, "motor": case.motor, "recordings": [file.name for file in case.recordings]}


def main() -> None:
    """Serve until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the owner's business
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks,), daemon=True).start()
    case_worker = CaseWorker(inside=True)
    while True:
        outcome = case_worker.run(tasks.get())
        try:
            pickle.dump(outcome, answers)
            answers.flush()
        except OSError:
            os._exit(0)


def _listen(tasks: queue.SimpleQueue[Task]) -> None:
    orders = os.fdopen(os.dup(0), "rb")
    while True:
        try:
            tasks.put(pickle.load(orders))
        except EOFError:
            os._exit(0)
