"""FMUs live in worker processes: a crash, a hang or a leak stays there. Knows candidates and costs, no search.

Workers share one batch in memory (loaded_job.py); each takes the next candidate when it is free, so they are dealt
out evenly, and what a candidate costs does not depend on who simulated it. The candidate of a worker that dies or
exceeds the time limit costs infinity and is remembered with its reason.
"""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.errors import SimulationError
from estimator.fmus.archive import extract
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.inside import Inside
from estimator.fmus.job import Batch, Failure, Job
from estimator.fmus.loaded_job import LoadedJob, check_loadable
from estimator.fmus.process_pool import Order, ProcessPool
from estimator.fmus.run_folder import RunFolder
from estimator.stepping.layout import (
    CUT_SHORT,
    FINISHED,
    PENDING,
    DescentLayout,
    FitsLayout,
    is_of_step,
    outcome_sentence,
)
from estimator.stepping.library import check_installed

FloatArray = NDArray[np.float64]

TIME_LIMIT = 60.0  # s a candidate
MEMORY_LIMIT = 1 << 30  # bytes a worker
MOST_FAILURES = 100  # reasons that are kept
KEPT_JOBS = 4  # as in worker.py: those of late, which may be asked for again


class _Extracted(NamedTuple):
    """An FMU's files: where, of which file (its time and size), and whether it is the package's own."""

    folder: Path
    stamp: tuple[int, int]
    is_bundled: bool


class Workers:
    """What worker processes simulate, of the job that is loaded: batches of candidates, and whole fits.

    Parameters
    ----------
    count : int
        Processes at most.
    time_limit : float
        s a candidate may take.
    memory_limit : int
        Bytes above which a worker is replaced.
    inside : bool
        Whoever asks is a process that may crash, and has no other: the package's own FMUs are loaded into it. A process
        starts where another FMU is asked for.
    """

    def __init__(
        self,
        count: int,
        *,
        time_limit: float = TIME_LIMIT,
        memory_limit: int = MEMORY_LIMIT,
        inside: bool = False,
    ) -> None:
        check_installed()
        self.simulations = 0
        self.steps = 0
        self.failures: list[Failure] = []
        self.failed = 0
        self._folder = RunFolder()
        self.pool = ProcessPool(
            count, self._folder.path, time_limit=time_limit, memory_limit=memory_limit, begins=not inside
        )
        self._inside = Inside(memory_limit) if inside else None
        self._asked: ProcessPool | Inside = self.pool  # who has the job that is loaded
        self._jobs = 0  # made ready
        self._kept: list[LoadedJob] = []  # the one that is loaded first
        self._folders: dict[Path, _Extracted] = {}
        self._rested: dict[Path, _Extracted] = {}  # of an earlier estimation: the same if its file is
        self._extractions = 0

    def load(self, job: Job, *, keep_counts: bool = False) -> None:
        """Extract the FMU and put the job's numbers where the workers find them; counters start from zero.

        May be called again, with the next job: the processes stay. A job of late is not made ready anew.

        Raises
        ------
        FmuError
            The FMU cannot be stepped on this machine.
        """
        check_loadable(job)
        known = next((k for k in self._kept if k.job is job), None)
        if self._kept and self._kept[0] is not known:
            self._kept[0].rest()
        loaded = known or self._made_ready(job)
        self._kept = [loaded, *(k for k in self._kept if k is not loaded)]
        for old in self._kept[KEPT_JOBS:]:
            old.close()
        del self._kept[KEPT_JOBS:]
        if not keep_counts:
            self.simulations = self.steps = self.failed = 0
            self.failures = []
        own = job.description.is_bundled and not job.fresh_process
        self._asked = self._inside if self._inside is not None and own else self.pool
        self._asked.load(loaded)

    def _made_ready(self, job: Job) -> LoadedJob:
        self._jobs += 1
        fmu = self._extracted(job.description)
        return LoadedJob(job, fmu=fmu, folder=self._folder.path, key=self._jobs, others=self._kept)

    def run(
        self, values: FloatArray, *, bounds: FloatArray | None = None, refine: int = 1, record: bool = False
    ) -> Batch:
        """Simulate candidates.

        Parameters
        ----------
        values : (n, experiments, parameters) array
            FMU parameters, in the FMU's units.
        bounds : (n,) array, optional
            A candidate may stop once its cost exceeds its bound; it then costs infinity.
        refine : int
            Communication steps are this many times finer than the job says.
        record : bool
            Keep the trajectories.

        Raises
        ------
        SimulationError
            The FMU cannot even be loaded.
        """
        n, shared = len(values), self._loaded.shared
        room = shared.shown_capacity if record else shared.capacity
        limits = np.full(n, np.inf) if bounds is None else np.asarray(bounds, dtype=float)
        batch = Batch(
            costs=np.empty(n),
            steps=np.empty(n, dtype=np.int64),
            failed=np.empty(n, dtype=bool),
            shown=np.empty((n, shared.rows, shared.outputs)) if record else None,
        )
        for part in (slice(i, min(i + room, n)) for i in range(0, n, room)):
            self._run_part(values[part], limits[part], batch.of(part), refine=refine)
        return batch

    def fit(self, fits: FitsLayout) -> list[tuple[list[float], float, int]] | None:
        """Do whole least-squares fits of the job, each in one process.

        Returns
        -------
        Where each ended, its cost and how (`trust_region.h`); None where a simulation has failed, which a run of
        candidates would tell.

        Raises
        ------
        SimulationError
            The FMU cannot even be loaded.
        """
        idle = self._asked.idle()
        parts = [dataclasses.replace(fits, starts=fits.starts[k :: len(idle)]) for k in range(len(idle))]
        found = self._found({p: {"fit": vars(part)} for p, part in zip(idle, parts, strict=True) if part.starts})
        if any(of_one is None for of_one in found):
            return None
        return [found[k % len(idle)][k // len(idle)] for k in range(len(fits.starts))]

    def descend(
        self, descent: DescentLayout, weights: FloatArray
    ) -> tuple[list[float], float, int, FloatArray, FloatArray | None] | None:
        """Do a descent of the job, of samples that are weighed, (rows, outputs), in one process.

        Returns
        -------
        Where it ended, its cost, how (`gauss_newton.h`), what is shown there, (rows, outputs), and the derivatives of
        that, (parameters, rows, outputs), or None; None altogether as `fit`, or where memory has no room.
        """
        p, size, shown = len(descent.x), weights.size, self._loaded.shown
        if 1 + p > self._loaded.shared.shown_capacity:
            return None
        process = self._asked.idle()[0]
        shown[:size] = weights.ravel()
        (found,) = self._found({process: {"descend": vars(descent)}})
        if found is None:
            return None
        x, cost, ended, knows = found
        derivatives = shown[size : (1 + p) * size].reshape(p, *weights.shape).copy() if knows else None
        return x, cost, ended, shown[:size].reshape(weights.shape).copy(), derivatives

    def _found(self, orders: dict[Any, Order]) -> list[Any]:
        """Give orders, one a process, and return what each has found; None where a simulation has failed."""
        answers = self._asked.ask(orders)
        for answer in answers:
            if answer is not None:
                self.simulations += answer["simulations"]
                self.steps += answer["steps"]
        return [None if answer is None else answer["found"] for answer in answers]

    def reference(self, values: FloatArray, *, experiment: int = 0, refine: int = 1) -> FloatArray:
        """Simulate one candidate, (parameters,), by fmpy's methods alone; return (n, outputs)."""
        order = {"reference": True, "values": list(values), "experiment": experiment, "refine": refine}
        answer = self._asked.ask_one({"run": order})
        if answer is None or "error" in answer:
            raise SimulationError(str((answer or {}).get("error", "the FMU crashed")))
        return np.array(answer["rows"])

    @property
    def job(self) -> Job | None:
        """The job that is loaded."""
        return self._kept[0].job if self._kept else None

    def rest(self) -> None:
        """Forget all jobs and FMUs, whose files may change, but those of the package's own; the processes stay."""
        self.pool.rest()
        for loaded in self._kept:
            loaded.close()
        for file, extracted in self._folders.items():
            if extracted.is_bundled:
                self._rested[file] = extracted
            else:
                shutil.rmtree(extracted.folder, ignore_errors=True)
        self._kept, self._folders = [], {}

    def are_sound(self) -> bool:
        """Whether all processes live, and the run's folder, which may lie where old files are removed."""
        return self._folder.path.is_dir() and self.pool.lives()

    def close(self) -> None:
        """End all workers and remove the run's folder."""
        self.pool.close()
        if self._inside is not None:
            self._inside.close()
        for loaded in self._kept:
            loaded.close()
        self._kept = []
        self._folder.close()

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def _loaded(self) -> LoadedJob:
        return self._kept[0]

    def _run_part(self, values: FloatArray, bounds: FloatArray, batch: Batch, *, refine: int) -> None:
        """Simulate candidates that the shared memory has room for; what comes of them is written to their batch."""
        n, loaded, record = len(values), self._loaded, batch.shown is not None
        loaded.values[: values.size] = values.ravel()
        loaded.bounds[:n] = bounds
        costs, steps, outcomes = loaded.costs[:n], loaded.steps[:n], loaded.outcomes[:n]
        costs[:], steps[:], outcomes[:] = np.inf, 0, PENDING
        loaded.next[0] = 0
        order = {"run": {"candidates": n, "refine": refine, "record": record}}
        lost = self._asked.deal(order, is_left=lambda: bool(loaded.next[0] < n))
        for candidate, (outcome, _) in lost.items():
            outcomes[candidate] = outcome
        self.simulations += n
        self.steps += int(steps.sum())
        batch.costs[:], batch.steps[:], batch.failed[:] = costs, steps, False
        if batch.shown is not None:
            batch.shown[:] = loaded.shown[: batch.shown.size].reshape(batch.shown.shape)
        kinds = outcomes % 256
        failed = (kinds != FINISHED) & (kinds != CUT_SHORT)
        if not failed.any():
            return
        self.failed += int(np.count_nonzero(failed))
        batch.costs[failed], batch.failed[failed] = np.inf, True
        for k in np.flatnonzero(failed).tolist():
            _, ended = lost.get(k, (0, ""))
            self._remember(ended, int(outcomes[k]), values[k], done=int(steps[k]), refine=refine)
        if batch.shown is not None:
            batch.shown[failed] = np.nan

    def _remember(self, ended: str, outcome: int, values: FloatArray, *, done: int, refine: int) -> None:
        """Keep the first candidate of each reason to fail: how its process ended, or what its outcome says."""
        job = self._loaded.job
        reason = ended or outcome_sentence(outcome, words=self._asked.words, names=job.names)
        if len(self.failures) >= MOST_FAILURES or any(f.reason == reason for f in self.failures):
            return
        step = job.step(done - 1, refine=refine) if is_of_step(outcome) else None
        self.failures.append(Failure(reason, tuple(values.ravel().tolist()), step))

    def _extracted(self, description: FmuDescription) -> Path:
        path = description.path
        if path not in self._folders:
            file = path.stat()
            extracted = self._rested.pop(path, None)
            if extracted is not None and extracted.stamp != (file.st_mtime_ns, file.st_size):
                shutil.rmtree(extracted.folder, ignore_errors=True)
                extracted = None
            if extracted is None:
                self._extractions += 1
                folder = self._folder.path / f"fmu-{self._extractions}"
                folder.mkdir()
                extract(path, folder)
                extracted = _Extracted(folder, (file.st_mtime_ns, file.st_size), description.is_bundled)
            self._folders[path] = extracted
        return self._folders[path].folder
