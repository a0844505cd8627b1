"""The memory that the estimator and its workers share: one batch of candidates. Knows offsets only.

It is a file, mapped by every process. All entries are eight bytes: signed integers or doubles.
"""

from __future__ import annotations

from dataclasses import dataclass

ENTRY = 8  # bytes
MAX_WORKERS = 64
NO_CLAIM = -1


@dataclass(frozen=True)
class SharedMemory:
    """Offsets, in bytes, of the fields of the shared memory.

    Attributes
    ----------
    capacity : int
        Candidates that fit.
    shown_capacity : int
        Candidates whose trajectories fit.
    experiments, parameters, outputs : int
        Values a candidate: experiments × parameters.
    rows : int
        Samples of all experiments together.
    """

    capacity: int
    shown_capacity: int
    experiments: int
    parameters: int
    outputs: int
    rows: int

    @property
    def next(self) -> int:
        """Index of the next candidate to take, one atomic integer."""
        return 0

    @property
    def claims(self) -> int:
        """Candidate that each worker simulates now, `MAX_WORKERS` integers."""
        return ENTRY

    @property
    def values(self) -> int:
        """FMU parameters, (capacity, experiments, parameters) doubles."""
        return self.claims + MAX_WORKERS * ENTRY

    @property
    def bounds(self) -> int:
        """Cost at which a candidate may stop, (capacity,) doubles."""
        return self.values + self.capacity * self.experiments * self.parameters * ENTRY

    @property
    def costs(self) -> int:
        """(capacity,) doubles."""
        return self.bounds + self.capacity * ENTRY

    @property
    def steps(self) -> int:
        """Communication steps done, (capacity,) integers."""
        return self.costs + self.capacity * ENTRY

    @property
    def outcomes(self) -> int:
        """(capacity,) integers, see layout.py."""
        return self.steps + self.capacity * ENTRY

    @property
    def shown(self) -> int:
        """Trajectories, (shown_capacity, rows, outputs) doubles."""
        return self.outcomes + self.capacity * ENTRY

    @property
    def trajectory(self) -> int:
        """Bytes of one."""
        return self.rows * self.outputs * ENTRY

    @property
    def size(self) -> int:
        """Bytes of all of it."""
        return self.shown + self.shown_capacity * self.trajectory
