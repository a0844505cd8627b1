"""A job as its workers have it: the memory that they share, the order that loads it, its files. Knows no process."""

from __future__ import annotations

import contextlib
import mmap
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.errors import FmuError
from estimator.fmus.fmu import check_usable
from estimator.fmus.job import Job, have_same_numbers, laid_out, write_numbers
from estimator.stepping.layout import MAX_SIGNALS
from estimator.stepping.shared_memory import MAX_WORKERS, NO_CLAIM, SharedMemory

CAPACITY = 4096  # candidates a batch
SHOWN_VALUES = 4_000_000  # trajectory values a batch
LONG_TRAJECTORY = 1 << 20  # bytes: to have the memory of shorter ones anew costs more than it is


class LoadedJob:
    """A job whose numbers stand where the workers find them.

    Parameters
    ----------
    fmu : Path
        The folder with the extracted FMU.
    folder : Path
        Takes the files of what is shared, where it needs any.
    key : int
        By which workers know the job again.
    others : sequence of LoadedJob
        The numbers of one that has the same ones, such as a rival FMU's, serve again: workers do not change them.
    """

    def __init__(self, job: Job, *, fmu: Path, folder: Path, key: int, others: Sequence[LoadedJob] = ()) -> None:
        self.job = job
        self._numbers: tuple[int, ...]  # the descriptor of the memory that they lie in, if they lie in one
        rows = sum(len(e.measured) for e in job.experiments)
        outputs = len(job.output_references)
        shared = self.shared = SharedMemory(
            capacity=CAPACITY,
            shown_capacity=max(1, min(CAPACITY, SHOWN_VALUES // max(1, rows * outputs))),
            experiments=len(job.experiments),
            parameters=len(job.parameter_references) + job.sensor_values,
            outputs=outputs,
            rows=rows,
        )
        memory, shared_file, own = _memory(shared.size, folder / f"shared-{key}")
        layouts, size = laid_out(job.experiments)
        same = (o._numbers for o in others if o._numbers and have_same_numbers(o.job.experiments, job.experiments))
        numbers_file, self._numbers = _again(next(same, ()))
        if not self._numbers:
            numbers, numbers_file, self._numbers = _memory(size, folder / f"numbers-{key}")
            write_numbers(numbers, job.experiments, layouts)
        self._memory, self._descriptors = memory, (*own, *self._numbers)
        self._files = () if self._descriptors else (shared_file, numbers_file)
        layout = job.layout(str(fmu), layouts)
        self.order: dict[str, Any] = {
            "key": key,
            "job": {**vars(layout), "experiments": [vars(experiment) for experiment in layouts]},
            "shared": vars(shared),
            "shared_file": str(shared_file),
            "numbers_file": str(numbers_file),
        }

        def view(offset: int, count: int, kind: type[Any] = np.float64) -> NDArray[Any]:
            return np.frombuffer(memory, dtype=kind, count=count, offset=offset)

        self.next = view(shared.next, 1, np.int64)
        self.claims = view(shared.claims, MAX_WORKERS, np.int64)
        self.values = view(shared.values, shared.capacity * shared.experiments * shared.parameters)
        self.bounds = view(shared.bounds, shared.capacity)
        self.costs = view(shared.costs, shared.capacity)
        self.steps = view(shared.steps, shared.capacity, np.int64)
        self.outcomes = view(shared.outcomes, shared.capacity, np.int64)
        self.shown = view(shared.shown, shared.shown_capacity * rows * outputs)

    @property
    def name(self) -> str:
        """The FMU's file."""
        return self.job.description.path.name

    def rest(self) -> None:
        """Give up the memory of long trajectories, which have been read: another job is asked next."""
        first = -(-self.shared.shown // mmap.PAGESIZE) * mmap.PAGESIZE
        if self._descriptors and hasattr(mmap, "MADV_REMOVE") and self.shared.trajectory >= LONG_TRAJECTORY:
            self._memory.madvise(mmap.MADV_REMOVE, first, self.shared.size - first)

    def forget_claims(self) -> None:
        """No worker simulates a candidate."""
        self.claims[:] = NO_CLAIM

    def close(self) -> None:
        """Remove the files: the memory goes when nobody uses it any more."""
        for descriptor in self._descriptors:
            os.close(descriptor)
        for file in self._files:
            with contextlib.suppress(OSError):  # still mapped: it goes with the folder
                file.unlink()


def check_loadable(job: Job) -> None:
    """Raise `FmuError` for a job that cannot be stepped on this machine, or has more signals than the stepper takes."""
    check_usable(job.description)
    for what, references in (("inputs", job.input_references), ("outputs", job.output_references)):
        if len(references) > MAX_SIGNALS:
            raise FmuError(f"{len(references)} {what} at once are more than {MAX_SIGNALS}; leave some out")


def _again(descriptors: tuple[int, ...]) -> tuple[Path, tuple[int, ...]]:
    """Return the file of memory that another job has, and what is to be closed after use."""
    own = tuple(map(os.dup, descriptors))
    return (_place(own[0]) if own else Path()), own


def _memory(size: int, file: Path) -> tuple[mmap.mmap, Path, tuple[int, ...]]:
    """Return memory that is shared, the file by which workers find it, and what is to be closed after use.

    On Linux the file lies in memory, and goes with its owner: of one on a disk each page that is used is written there.
    """
    if hasattr(os, "memfd_create") and _is_found_by_others():
        descriptor = os.memfd_create("fmu-estimator", os.MFD_CLOEXEC)
        os.truncate(descriptor, size)
        return mmap.mmap(descriptor, size), _place(descriptor), (descriptor,)
    with open(file, "w+b") as made:
        made.truncate(size)
        return mmap.mmap(made.fileno(), size), file, ()


def _place(descriptor: int) -> Path:
    """Return where other processes find a file that lies in this one's memory."""
    return Path(f"/proc/{os.getpid()}/fd/{descriptor}")


@cache
def _is_found_by_others() -> bool:
    """Whether other processes can open a file that lies in this one's memory."""
    descriptor = os.memfd_create("fmu-estimator", os.MFD_CLOEXEC)
    try:
        return os.access(_place(descriptor), os.R_OK | os.W_OK)
    finally:
        os.close(descriptor)
