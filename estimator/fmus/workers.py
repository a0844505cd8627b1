"""FMUs live in worker processes: a crash, a hang or a leak stays there. Knows candidates and costs, no search.

Workers share one batch in memory (shared_memory.py); each takes the next candidate when it is free, so they are dealt
out evenly, and what a candidate costs does not depend on who simulated it. A worker that dies or exceeds the time limit
is replaced; its candidate costs infinity and is remembered with its reason.
"""

from __future__ import annotations

import contextlib
import dataclasses
import mmap
import os
import queue
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.errors import FmuError, SimulationError
from estimator.fmus.archive import extract
from estimator.fmus.fmu import FmuDescription, check_usable
from estimator.fmus.inside import Inside
from estimator.fmus.job import Batch, Failure, Job, laid_out, write_numbers
from estimator.fmus.mailbox import Mailbox
from estimator.fmus.process import IDLE, RUNNING, STARTING, Process, how_it_ended
from estimator.fmus.run_folder import RunFolder
from estimator.stepping.layout import (
    CRASHED,
    CUT_SHORT,
    FINISHED,
    MAX_SIGNALS,
    PENDING,
    TIMED_OUT,
    DescentLayout,
    FitsLayout,
    is_of_step,
    outcome_sentence,
)
from estimator.stepping.library import check_installed
from estimator.stepping.shared_memory import MAX_WORKERS, NO_CLAIM, SharedMemory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CAPACITY = 4096  # candidates a batch
SHOWN_VALUES = 4_000_000  # trajectory values a batch
BUSY_BEFORE_MORE = 0.3  # s of simulation before further workers are started
TICK = 0.05  # s between two looks at the clock
TIME_LIMIT = 60.0  # s a candidate
LOAD_LIMIT = 20.0  # s, at least, to start a process and load the FMU
MEMORY_LIMIT = 1 << 30  # bytes a worker
MOST_FAILURES = 100  # reasons that are kept
KEPT_JOBS = 4  # as in worker.py: those of late, which may be asked for again


@dataclasses.dataclass(frozen=True)
class _Loaded:
    """A job as the workers have it: the memory that they share, the order that loads it, and its files on a disk."""

    job: Job
    shared: SharedMemory
    memory: mmap.mmap
    order: dict[str, Any]
    files: tuple[Path, ...]
    descriptors: tuple[int, ...]

    def views(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the memory as arrays, by name."""
        shared = self.shared
        counts = {
            "values": (shared.values, shared.capacity * shared.experiments * shared.parameters, np.float64),
            "bounds": (shared.bounds, shared.capacity, np.float64),
            "costs": (shared.costs, shared.capacity, np.float64),
            "steps": (shared.steps, shared.capacity, np.int64),
            "outcomes": (shared.outcomes, shared.capacity, np.int64),
            "shown": (shared.shown, shared.shown_capacity * shared.rows * shared.outputs, np.float64),
        }
        return {
            name: np.frombuffer(self.memory, dtype=kind, count=count, offset=offset)
            for name, (offset, count, kind) in counts.items()
        }

    def release(self) -> None:
        """Remove the files: the memory goes when nobody uses it any more."""
        for descriptor in self.descriptors:
            os.close(descriptor)
        for file in self.files:
            with contextlib.suppress(OSError):  # still mapped: it goes with the folder
                file.unlink()


@dataclasses.dataclass
class _Watch:
    """How long workers have been waited for, and which claim each had when."""

    started: float = dataclasses.field(default_factory=time.monotonic)
    looked: float = dataclasses.field(default_factory=time.monotonic)
    claims: dict[int, tuple[int, float]] = dataclasses.field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Since it was started."""
        return time.monotonic() - self.started


class Workers:
    """The processes, and the memory that they share.

    The first process starts at once, so that it imports what it needs while the caller reads its recordings; the
    others start when there has been enough work to pay for them.

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
        self.count = max(1, min(count, MAX_WORKERS))
        self.time_limit = time_limit
        self.memory_limit = memory_limit
        self.simulations = 0
        self.steps = 0
        self.failures: list[Failure] = []
        self.failed = 0
        self.on_tick: Callable[[], None] | None = None
        self._folder = RunFolder()
        self._messages: Mailbox[Process] = Mailbox()
        self._processes: dict[int, Process] = {}
        self._job: Job | None = None
        self._order: dict[str, Any] = {}
        self._busy = 0.0
        self.busy_before_more = BUSY_BEFORE_MORE
        self._loads_died = 0
        self._words = ""
        self._reasons: dict[int, str] = {}  # of crashes and time limits, by candidate
        self._generation = 0
        self._jobs = 0
        self._kept: list[_Loaded] = []
        self._folders: dict[Path, Path] = {}
        self._inside = Inside() if inside else None
        self._here: Inside | None = None  # the same, if it has the job
        if not inside:
            self._spawn(0)

    def load(self, job: Job, *, keep_counts: bool = False) -> None:
        """Extract the FMU and put the job's numbers where the workers find them; counters start from zero.

        May be called again, with the next job: the processes stay. A job of late is not made ready anew.

        Raises
        ------
        FmuError
            The FMU cannot be stepped on this machine.
        """
        check_usable(job.description)
        for what, references in (("inputs", job.input_references), ("outputs", job.output_references)):
            if len(references) > MAX_SIGNALS:
                raise FmuError(f"{len(references)} {what} at once are more than {MAX_SIGNALS}; leave some out")
        known = next((k for k in self._kept if k.job is job), None)
        loaded = known or self._made_ready(job)
        self._kept = [loaded, *(k for k in self._kept if k is not loaded)]
        for old in self._kept[KEPT_JOBS:]:
            old.release()
        del self._kept[KEPT_JOBS:]
        self._jobs += 1
        self._job, self._shared, self._memory = job, loaded.shared, loaded.memory
        self._order = {**loaded.order, "number": self._jobs}
        self._views = loaded.views()
        self._counter = self._view(self._shared.next, 1, np.int64)
        self._claims = self._view(self._shared.claims, MAX_WORKERS, np.int64)
        self._claims[:] = NO_CLAIM
        if not keep_counts:
            self.simulations = self.steps = self.failed = 0
            self.failures = []
        self._words = ""
        own = job.description.is_bundled and not job.fresh_process
        self._here = self._inside if own else None
        if self._here is not None:
            self._here.load({**self._order, "index": 0})
        elif not self._processes:
            self._spawn(0)
        else:
            for process in self._processes.values():
                self._send_load(process)

    def _made_ready(self, job: Job) -> _Loaded:
        """Return a job whose FMU is extracted and whose numbers stand where the workers find them."""
        folder = self._extracted(job.description)
        rows = sum(len(e.measured) for e in job.experiments)
        outputs = len(job.output_references)
        shared = SharedMemory(
            capacity=CAPACITY,
            shown_capacity=max(1, min(CAPACITY, SHOWN_VALUES // max(1, rows * outputs))),
            experiments=len(job.experiments),
            parameters=len(job.parameter_references) + job.sensor_values,
            outputs=outputs,
            rows=rows,
        )
        key = self._jobs + 1
        memory, shared_file, own = _memory(shared.size, self._folder.path / f"shared-{key}")
        layouts, size = laid_out(job.experiments)
        numbers, numbers_file, beside = _memory(size, self._folder.path / f"numbers-{key}")
        write_numbers(numbers, job.experiments, layouts)
        layout = job.layout(str(folder), layouts)
        order = {
            "key": key,
            "job": {**vars(layout), "experiments": [vars(experiment) for experiment in layouts]},
            "shared": vars(shared),
            "shared_file": str(shared_file),
            "numbers_file": str(numbers_file),
            "memory_limit": self.memory_limit,
        }
        descriptors = *own, *beside
        return _Loaded(job, shared, memory, order, () if descriptors else (shared_file, numbers_file), descriptors)

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
        n = len(values)
        room = self._shared.shown_capacity if record else self._shared.capacity
        limits = np.full(n, np.inf) if bounds is None else np.asarray(bounds, dtype=float)
        batch = Batch(
            costs=np.empty(n),
            steps=np.empty(n, dtype=np.int64),
            failed=np.empty(n, dtype=bool),
            shown=np.empty((n, self._shared.rows, self._shared.outputs)) if record else None,
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
        idle = self._idle()
        parts = [dataclasses.replace(fits, starts=fits.starts[k :: len(idle)]) for k in range(len(idle))]
        orders = {p: {"fit": vars(part)} for p, part in zip(idle, parts, strict=True) if part.starts}
        found = self._done(orders)
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
        p, size = len(descent.x), weights.size
        if 1 + p > self._shared.shown_capacity:
            return None
        shown = self._views["shown"]
        idle = self._idle()[0]
        shown[:size] = weights.ravel()
        (found,) = self._done({idle: {"descend": vars(descent)}})
        if found is None:
            return None
        x, cost, ended, knows = found
        derivatives = shown[size : (1 + p) * size].reshape(p, *weights.shape).copy() if knows else None
        return x, cost, ended, shown[:size].reshape(weights.shape).copy(), derivatives

    def _idle(self) -> Sequence[Process | Inside]:
        """Return who may be asked, at least one."""
        if self._here is not None:
            return [self._here]
        watch = _Watch()
        while not (idle := [p for p in self._processes.values() if p.state == IDLE]):
            self._hear(watch)
        return idle

    def _done(self, orders: dict[Process | Inside, dict[str, Any]]) -> list[Any]:
        """Give orders, one a process, and return what each has found; None where a simulation has failed."""
        watch, found = _Watch(), dict[Process | Inside, Any]()
        self._claims[:] = NO_CLAIM
        for process, order in orders.items():
            if isinstance(process, Inside):
                found[process] = self._counted(process.answer(order))
                continue
            process.state = RUNNING
            process.send(order)
        while len(found) < len(orders):
            heard = self._hear(watch)
            if heard is None or heard[0] not in orders:
                continue
            process, message = heard
            found[process] = None if message is None else self._counted(message)
        self._busy += watch.seconds
        self._start_more(0.0)
        return [found[process] for process in orders]

    def _counted(self, message: dict[str, Any]) -> Any:
        """Return what was found, its simulations counted."""
        self.simulations += message["simulations"]
        self.steps += message["steps"]
        return message["found"]

    def reference(self, values: FloatArray, *, experiment: int = 0, refine: int = 1) -> FloatArray:
        """Simulate one candidate, (parameters,), by fmpy's methods alone; return (n, outputs)."""
        order = {"reference": True, "values": list(values), "experiment": experiment, "refine": refine}
        if self._here is not None:
            return np.array(self._here.answer({"run": order})["rows"])
        process = self._processes[0]
        while process.state != IDLE:
            self._handle(*self._messages.get(timeout=max(self.time_limit, LOAD_LIMIT)))
        process.send({"run": order})
        while True:
            sender, message = self._messages.get(timeout=max(self.time_limit, LOAD_LIMIT))
            if sender is process and message is not None and "rows" in message:
                return np.array(message["rows"])
            if sender is process and (message is None or "error" in message):
                raise SimulationError(str((message or {}).get("error", "the FMU crashed")))
            self._handle(sender, message)

    @property
    def job(self) -> Job | None:
        """The job that is loaded."""
        return self._job

    @property
    def pids(self) -> tuple[int, ...]:
        """Process identifiers of the workers that live now."""
        return tuple(p.popen.pid for p in self._processes.values())

    def all_ready(self) -> bool:
        """Whether every process that was started has loaded the FMU."""
        return all(p.state != STARTING for p in self._processes.values())

    def close(self) -> None:
        """End all workers and remove the run's folder."""
        for process in self._processes.values():
            process.end(politely=process.state == IDLE)
        self._processes.clear()
        if self._inside is not None:
            self._inside.close()
        for loaded in self._kept:
            loaded.release()
        self._kept = []
        self._folder.close()

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run_part(self, values: FloatArray, bounds: FloatArray, batch: Batch, *, refine: int) -> None:
        """Simulate candidates that the shared memory has room for; what comes of them is written to their batch."""
        n, record = len(values), batch.shown is not None
        self._views["values"][: values.size] = values.ravel()
        self._views["bounds"][:n] = bounds
        costs, steps, outcomes = (self._views[name][:n] for name in ("costs", "steps", "outcomes"))
        costs[:], steps[:], outcomes[:] = np.inf, 0, PENDING
        self._counter[0] = 0
        self._order["run"] = {"candidates": n, "refine": refine, "record": record}
        watch = _Watch()
        while self._here is not None and self._counter[0] < n:
            self._words = self._here.answer(self._order)["words"] or self._words
        while self._here is None:
            for process in list(self._processes.values()):
                if process.state == IDLE and self._counter[0] < n:
                    process.state = RUNNING
                    process.send({"run": self._order["run"]})
            if self._counter[0] >= n and not any(p.state == RUNNING for p in self._processes.values()):
                break
            self._hear(watch, outcomes)
        self._busy += watch.seconds
        self._start_more(0.0)
        self._collect(values, costs, steps, outcomes, batch, refine=refine)

    def _collect(
        self, values: FloatArray, costs: FloatArray, steps: IntArray, outcomes: IntArray, batch: Batch, *, refine: int
    ) -> None:
        self.simulations += len(values)
        self.steps += int(steps.sum())
        batch.costs[:], batch.steps[:], batch.failed[:] = costs, steps, False
        if batch.shown is not None:
            batch.shown[:] = self._views["shown"][: batch.shown.size].reshape(batch.shown.shape)
        kinds = outcomes % 256
        failed = (kinds != FINISHED) & (kinds != CUT_SHORT)
        if not failed.any():
            return
        self.failed += int(np.count_nonzero(failed))
        batch.costs[failed], batch.failed[failed] = np.inf, True
        for index in np.flatnonzero(failed).tolist():
            self._remember(index, int(outcomes[index]), values[index], done=int(steps[index]), refine=refine)
        if batch.shown is not None:
            batch.shown[failed] = np.nan

    def _remember(self, index: int, outcome: int, values: FloatArray, *, done: int, refine: int) -> None:
        """Keep the first candidate of each reason to fail."""
        assert self._job is not None
        reason = self._reasons.pop(index, None) if outcome % 256 in (CRASHED, TIMED_OUT) else None
        reason = reason or outcome_sentence(outcome, words=self._words, names=self._job.names)
        if len(self.failures) >= MOST_FAILURES or any(f.reason == reason for f in self.failures):
            return
        step = self._job.step(done - 1, refine=refine) if is_of_step(outcome) else None
        self.failures.append(Failure(reason, tuple(values.ravel().tolist()), step))

    def _hear(self, watch: _Watch, outcomes: IntArray | None = None) -> tuple[Process, dict[str, Any] | None] | None:
        """Wait a moment for an answer, heed and return it; None: there was none. Look at the clock now and then."""
        heard = None
        with contextlib.suppress(queue.Empty):
            heard = self._messages.get(timeout=TICK)
            self._handle(*heard, outcomes=outcomes)
        now = time.monotonic()
        if now - watch.looked >= TICK:
            watch.looked = now
            self._end_the_overdue(watch.claims, now)
            self._start_more(watch.seconds)
            if self.on_tick is not None:
                self.on_tick()
        return heard

    def _handle(self, process: Process, message: dict[str, Any] | None, *, outcomes: IntArray | None = None) -> None:
        if self._processes.get(process.slot) is not process:
            return  # the last words of a process that has been replaced
        if message is None:
            self._bury(process, outcomes)
        elif message.get("number") != self._jobs:
            return  # about a job that has been replaced
        elif "ready" in message:
            process.state = IDLE
            self._loads_died = 0
        elif "error" in message:
            raise FmuError(f"{self._name} cannot be loaded: {message['error']}")
        elif "done" in message:
            process.state = IDLE
            self._words = message["words"] or self._words
            self._reasons |= {int(candidate): how_it_ended(code) for candidate, code in message.get("ended", ())}
            if message["recycle"]:
                process.end(politely=True)
                self._spawn(process.slot)

    def _bury(self, process: Process, outcomes: IntArray | None) -> None:
        """Replace a process that has ended; its candidate has failed."""
        claim = int(self._claims[process.slot]) if self._job is not None else NO_CLAIM
        code = process.reap()
        how = process.ended_because or how_it_ended(code)
        if process.state == RUNNING and claim != NO_CLAIM and outcomes is not None:
            outcomes[claim] = TIMED_OUT if process.ended_because else CRASHED
            self._reasons[claim] = how
            self._claims[process.slot] = NO_CLAIM
        else:
            self._loads_died += 1
            if self._loads_died >= 3:
                raise FmuError(f"{self._name} cannot be loaded: {how}")
        self._spawn(process.slot)

    def _end_the_overdue(self, watch: dict[int, tuple[int, float]], now: float) -> None:
        for slot, process in self._processes.items():
            if process.has_ended():
                continue  # the mailbox is about to say so
            waiting = process.state == STARTING
            claim = int(self._claims[slot]) if process.state == RUNNING else (-2 - process.generation)
            if process.state == IDLE or (claim == NO_CLAIM and not waiting):
                watch.pop(slot, None)
                continue
            before = watch.get(slot)
            # A busy machine may take seconds to start an interpreter: that is not the FMU's time.
            limit = max(self.time_limit, LOAD_LIMIT) if waiting else self.time_limit
            if before is None or before[0] != claim:
                watch[slot] = (claim, now)
            elif now - before[1] > limit:
                what = "loading the FMU" if waiting else "the FMU"
                process.ended_because = f"{what} exceeded the time limit of {limit:g} s"
                process.kill()
                watch.pop(slot)

    def _start_more(self, running: float) -> None:
        if self._here is None and self._busy + running > self.busy_before_more and len(self._processes) < self.count:
            for slot in range(len(self._processes), self.count):
                self._spawn(slot)

    def _spawn(self, slot: int) -> None:
        self._generation += 1
        process = Process(slot, self._generation, self._folder.path, self._messages)
        self._processes[slot] = process
        if self._job is not None:
            self._send_load(process)

    def _extracted(self, description: FmuDescription) -> Path:
        if description.path not in self._folders:
            folder = self._folder.path / f"fmu-{len(self._folders) + 1}"
            folder.mkdir()
            extract(description.path, folder)
            self._folders[description.path] = folder
        return self._folders[description.path]

    def _send_load(self, process: Process) -> None:
        process.state = STARTING
        order = {k: v for k, v in self._order.items() if k != "run"}
        process.send({"load": {**order, "index": process.slot}})

    def _view(self, offset: int, count: int, kind: type[Any]) -> NDArray[Any]:
        return np.frombuffer(self._memory, dtype=kind, count=count, offset=offset)

    @property
    def _name(self) -> str:
        return self._job.description.path.name if self._job is not None else "the FMU"


def _memory(size: int, file: Path) -> tuple[mmap.mmap, Path, tuple[int, ...]]:
    """Return memory that is shared, the file by which workers find it, and what is to be closed after use.

    On Linux the file lies in memory, and goes with its owner: of one on a disk each page that is used is written there.
    """
    if hasattr(os, "memfd_create") and _is_found_by_others():
        descriptor = os.memfd_create("fmu-estimator", os.MFD_CLOEXEC)
        os.truncate(descriptor, size)
        return mmap.mmap(descriptor, size), Path(f"/proc/{os.getpid()}/fd/{descriptor}"), (descriptor,)
    with open(file, "w+b") as made:
        made.truncate(size)
        return mmap.mmap(made.fileno(), size), file, ()


@cache
def _is_found_by_others() -> bool:
    """Whether other processes can open a file that lies in this one's memory."""
    descriptor = os.memfd_create("fmu-estimator", os.MFD_CLOEXEC)
    try:
        return os.access(f"/proc/{os.getpid()}/fd/{descriptor}", os.R_OK | os.W_OK)
    finally:
        os.close(descriptor)
