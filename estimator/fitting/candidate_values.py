"""From candidates to the values a simulation takes: the FMU's parameters, its sensors' settings. Simulates nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.winding_temperature import warmth
from estimator.plans.parameters import Box
from estimator.plans.plan import ChainSpec, Plan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SETTINGS = ("gain", "offset", "delay")  # of each output's sensor
OF_ALL = (slice(None), 0)  # place of a delay of all recordings, which is added to theirs


class CandidateValues:
    """Where the free parameters of a plan go, recording by recording.

    The values of a candidate are the FMU's parameters, free ones and then fixed ones, and, where any sensor is not
    plain, the inputs' delay and each output's `SETTINGS`.

    Attributes
    ----------
    variables : the FMU's variables that are set, as the values follow
    sensors : how many values the sensors have, 0 or 1 + 3 an output
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._outputs = plan, plan.outputs
        targets = list(dict.fromkeys(t for p in plan.parameters for t in p.targets))
        taken = [plan.binding.target(name) for name in targets]
        held = {name: plan.binding.target(name) for name in plan.fixed if name not in targets}
        held = {name: v for name, v in held.items() if v.is_real and v.causality != "input"}
        self.variables = (*taken, *held.values())
        self._column, self._gain = self._destinations(targets)
        self._gain /= np.array([v.factor for v in taken])
        taken_nowhere = self._column < 0  # of a recording that no parameter is for: as the FMU begins
        self._gain[taken_nowhere] = 0.0
        starts = [v.start if isinstance(v.start, float) else 0.0 for v in taken]
        self._shift = np.where(taken_nowhere, starts, [-v.offset / v.factor for v in taken])
        self._constant = np.array([(plan.fixed[n] - v.offset) / v.factor for n, v in held.items()])
        is_plain = (
            all(p.place is None for p in plan.parameters)
            and all(o.delay == 0 for o in plan.observed)
            and all(c.is_straight for c in plan.chains.values())
        )
        self.sensors = 0 if is_plain else 1 + len(SETTINGS) * len(self._outputs)
        self._usual, self._placed = self._sensors() if self.sensors else (np.zeros((0, 0)), [])

    @property
    def names(self) -> tuple[str, ...]:
        """The FMU's own names of its parameters, as the values follow."""
        return tuple(v.name for v in self.variables)

    def of(self, candidates: FloatArray, *, late: FloatArray | None = None) -> FloatArray:
        """Return the values, (n, recordings, values), of (n, p) candidates.

        Parameters
        ----------
        late : (n, recordings) array, optional
            By how much the inputs of each candidate come later, s; only where a sensor is not plain.
        """
        recordings, free = self._column.shape
        held = free + len(self._constant)
        values = np.empty((len(candidates), recordings, held + self.sensors))
        values[:, :, :free] = candidates[:, np.maximum(self._column, 0)] * self._gain + self._shift
        values[:, :, free:held] = self._constant
        if self.sensors:
            values[:, :, held:] = self._sensor_values(candidates)
        if late is not None:
            values[:, :, held] += late
        return values

    def placing(self, candidate: FloatArray, free: Sequence[int], box: Box) -> dict[str, Any] | None:
        """Return where what is free of a candidate, (p,), goes, as `Placing` says; None where it is not in its values.

        An output's own delay also moves the others, where it is below 0; and one of all recordings is added to theirs.
        """
        if not np.all(box.high > box.low):
            return None
        shift = self.of(candidate[None, :])[0]
        column, gain = np.full(shift.shape, -1), np.zeros(shift.shape)
        many, held = self._column.shape[1], self._column.shape[1] + len(self._constant)
        place = np.full(len(self._plan.parameters), -1)
        place[list(free)] = np.arange(len(free))
        column[:, :many] = np.where(self._column >= 0, place[self._column], -1)
        own = column[:, :many] >= 0
        gain[:, :many] = np.where(own, self._gain, 0.0)
        shift[:, :many] = np.where(own, self._shift, shift[:, :many])
        for j, where, at in self._placed:
            if j in free and ((at % len(SETTINGS) == 0 and at > 0) or np.any(column[where, held + at] >= 0)):
                return None
            if j in free:
                column[where, held + at], gain[where, held + at] = list(free).index(j), 1.0
                shift[where, held + at] -= candidate[j]
        return {
            "low": tuple(box.low.tolist()),
            "high": tuple(box.high.tolist()),
            "lower": tuple(box.lower.tolist()),
            "upper": tuple(box.upper.tolist()),
            "log": tuple(box.log.tolist()),
            "column": tuple(column.ravel().tolist()),
            "gain": tuple(gain.ravel().tolist()),
            "shift": tuple(shift.ravel().tolist()),
        }

    def _destinations(self, targets: Sequence[str]) -> tuple[IntArray, FloatArray]:
        """Return which parameter each recording and variable takes, or -1, times what, (recordings, variables) each."""
        column = np.full((len(self._plan.observed), len(targets)), -1)
        gain = np.ones(column.shape)
        for j, p in enumerate(self._plan.parameters):
            where = slice(None) if p.recording is None else p.recording
            for name, factor in zip(p.targets, p.gains or (1.0,) * len(p.targets), strict=True):
                column[where, targets.index(name)] = j
                gain[where, targets.index(name)] = factor
                if (p.quantity or p.name) == "R" and p.recording is None:
                    gain[:, targets.index(name)] *= warmth(self._plan)
        return column, gain

    def _sensors(self) -> tuple[FloatArray, list[tuple[int, slice, int]]]:
        """Return the sensors' values where none is free, (recordings, values), and the place of each that is."""
        plan = self._plan
        usual = np.zeros((len(plan.observed), self.sensors))
        chains = [plan.chains.get(y, ChainSpec()) for y in self._outputs]
        usual[:, 0] = [o.delay for o in plan.observed]
        usual[:, 1:] = [getattr(chain, name) for chain in chains for name in SETTINGS]
        placed = []
        for j, p in enumerate(plan.parameters):
            if p.place is None:
                continue
            where = slice(None) if p.place.recording is None else slice(p.place.recording, p.place.recording + 1)
            at = 0
            if p.place.output:
                at = 1 + len(SETTINGS) * self._outputs.index(p.place.output) + SETTINGS.index(p.place.kind)
            placed.append((j, where, at))
        return usual, placed

    def _sensor_values(self, candidates: FloatArray) -> FloatArray:
        """Return the inputs' delay, then the settings of every output, (n, recordings, values)."""
        values = np.repeat(self._usual[None], len(candidates), axis=0)
        for j, where, at in self._placed:
            if (where, at) != OF_ALL:
                values[:, where, at] = candidates[:, j, None]
        values[:, :, 0] += candidates[:, [j for j, *place in self._placed if (*place,) == OF_ALL]].sum(axis=1)[:, None]
        delays = values[:, :, len(SETTINGS) :: len(SETTINGS)]
        earliest = np.minimum(delays.min(axis=2), 0.0)  # an output is shown late, never early
        values[:, :, 0] += earliest
        delays -= earliest[:, :, None]
        return values
