"""Candidates → costs and residuals over all recordings, through one FMU. Knows no search.

A candidate is an array of the free parameters in their units, in the order of `Problem.parameters`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.candidate_values import CandidateValues
from estimator.fitting.job_of_plan import job_of
from estimator.fmus.job import Batch
from estimator.fmus.workers import Workers
from estimator.plans.parameters import Box
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SIGMA_FLOOR = 1e-3  # of a signal's deviation: the least noise that the search assumes


class Problem:
    """A plan, with its FMU loaded into workers.

    Parameters
    ----------
    plan : Plan
    workers : Workers
        Loaded by this constructor.
    sigma : output → float
        Deviations that weigh the outputs in `costs`, in their units.
    """

    def __init__(self, plan: Plan, workers: Workers, *, sigma: Mapping[str, float], keep_counts: bool = False) -> None:
        self.plan, self.workers = plan, workers
        self.parameters = plan.parameters
        self.box = Box.of(plan.parameters)
        self.outputs = plan.outputs
        self.sigma = dict(sigma)
        self.values = CandidateValues(plan)
        self._job = job_of(plan, self.values, sigma=sigma)
        workers.load(self._job, keep_counts=keep_counts)
        assert all(tuple(o.outputs) == tuple(self.outputs) for o in plan.observed)  # as they are laid out
        lengths = [o.before + len(o.recording.time) for o in plan.observed]
        self._edges = np.cumsum([0, *lengths])
        self._phased = self._without_phase()
        self._used = ~np.isnan(self._compared)

    @property
    def steps_a_row(self) -> int:
        """How many communication steps a row takes: several where an input goes on lines."""
        return max(e.substeps for e in self._job.experiments)

    @property
    def _compared(self) -> FloatArray:
        """What is compared, (rows, outputs), NaN where a sample is missing; not to be changed."""
        each = [o.compared for o in self.plan.observed]
        return each[0] if len(each) == 1 else np.concatenate(each)

    @cached_property
    def spread(self) -> FloatArray:
        """The deviation of each measured output, (q,): its scale; of a constant one its size."""
        spreads = []
        for column in self._compared.T:
            known = column[~np.isnan(column)]
            spread = float(np.std(known))
            spreads.append(spread if spread > 0 else max(abs(float(np.mean(known))), 1e-12))
        return np.array(spreads)

    @cached_property
    def output_of_residual(self) -> NDArray[np.int16]:
        """The output of each residual, (m,)."""
        outputs = np.arange(len(self.outputs), dtype=np.int16)
        return np.asarray(np.broadcast_to(outputs, self._used.shape)[self._used])

    @cached_property
    def _measured_rows(self) -> FloatArray:
        """What is compared, (rows, outputs); 0 where a sample is missing."""
        return self._compared if self._used.all() else np.asarray(np.nan_to_num(self._compared))

    def costs(self, candidates: FloatArray, bounds: FloatArray | None = None) -> FloatArray:
        """Return the weighted sums of squares, (n,), of (n, p) candidates; infinity where cut short or failed."""
        return self.loaded().run(self.values.of(candidates), bounds=bounds).costs

    def trajectories(self, candidates: FloatArray, *, refine: int = 1) -> Batch:
        """Simulate (n, p) candidates to the end and keep what the sensors show."""
        return self.loaded().run(self.values.of(candidates), refine=refine, record=True)

    def signals(self, candidates: FloatArray, *, refine: int = 1, late: FloatArray | None = None) -> FloatArray:
        """Return what the sensors show, (n, rows, outputs), of (n, p) candidates; NaN where one failed.

        A recording is simulated once for all candidates that ask the same of it: what moves a parameter of one
        recording leaves the others as they are.

        Parameters
        ----------
        late : (n, recordings) array, optional
            By how much the inputs of each candidate come later, s: for signals between two rows.
        """
        values = self.values.of(candidates, late=late)
        if len(values) > 1 and len(self.plan.observed) > 1 and len((asked := _packed(values))[0]) < len(values):
            packed, which = asked
            batch = self.loaded().run(packed, refine=refine, record=True)
            if not batch.failed.any():
                assert batch.shown is not None
                shown = np.empty((len(values), *batch.shown.shape[1:]))
                for e, (first, last) in enumerate(zip(self._edges[:-1], self._edges[1:], strict=True)):
                    shown[:, first:last] = batch.shown[which[:, e], first:last]
                return shown
        shown_by_each = self.loaded().run(values, refine=refine, record=True).shown
        assert shown_by_each is not None
        return shown_by_each

    @property
    def has_free_phase(self) -> bool:
        """Whether an angle is compared without its mean, as its phase is not known."""
        return bool(self._phased)

    @property
    def has_sensors(self) -> bool:
        """Whether the stepper shows outputs through sensors, delays among them."""
        return self.values.sensors > 0

    def residuals(self, candidates: FloatArray) -> FloatArray:
        """Return simulated minus measured, (n, m), in the outputs' units, missing samples left out; NaN if failed."""
        return self.compared(self.signals(candidates))

    def compared(self, shown: FloatArray) -> FloatArray:
        """Return (c, rows, outputs) trajectories minus the measured ones, (c, m), as `residuals` does."""
        return self._picked(shown - self._measured_rows)

    def loaded(self) -> Workers:
        """Return the workers; this problem is loaded again if they have served another since."""
        if self.workers.job is not self._job:
            self.workers.load(self._job, keep_counts=True)
        return self.workers

    def shown(self, batch: Batch) -> list[FloatArray]:
        """Split the first candidate's trajectories by recording, (n, outputs) each, without the lead."""
        assert batch.shown is not None
        shown = batch.shown[0]
        return [shown[self._edges[e] + o.before : self._edges[e + 1]] for e, o in enumerate(self.plan.observed)]

    def _without_phase(self) -> list[int]:
        """Return the outputs whose phase is not known, neither free nor declared."""
        plan = self.plan
        if "angle" not in self.outputs or "offset angle" in plan.declared:
            return []
        freed = any(p.place is not None and p.place.output == "angle" for p in plan.parameters)
        return [self.outputs.index("angle")] if any(o.has_phase for o in plan.observed) and not freed else []

    def _picked(self, rows: FloatArray) -> FloatArray:
        """Pick from (c, rows, outputs) what is compared, (c, m); an angle whose phase is not known without its mean."""
        for j in self._phased:
            rows = rows.copy()
            for first, last in zip(self._edges[:-1], self._edges[1:], strict=True):
                turned, turning = rows[:, first:last, j], self._used[first:last, j]
                rows[:, first:last, j] = turned - np.mean(turned[:, turning], axis=1, keepdims=True)
        return rows.reshape(len(rows), -1) if self._used.all() else np.asarray(rows[:, self._used])

    def used(self, rows: FloatArray) -> FloatArray:
        """Pick from (rows, outputs) trajectories the samples that are compared, (m,)."""
        return np.asarray(rows[self._used])


def _packed(values: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return values, (m, recordings, values), that hold those of n candidates, and which each has, (n, recordings).

    The fewest: of every recording what is asked of it once.
    """
    recordings = values.shape[1]
    found = [distinct(values[:, e]) for e in range(recordings)]
    packed = np.empty((max(len(asked) for asked, _ in found), *values.shape[1:]))
    for e, (asked, _) in enumerate(found):
        packed[:, e] = asked[0]
        packed[: len(asked), e] = asked
    return packed, np.array([which for _, which in found], dtype=np.int64).T


def distinct(rows: FloatArray) -> tuple[FloatArray, list[int]]:
    """Return the rows, (n, p), that differ, in their order, and which of them each is."""
    places: dict[bytes, int] = {}
    which = [places.setdefault(row.tobytes(), len(places)) for row in rows]
    return rows[[which.index(k) for k in range(len(places))]], which
