"""Each change of the command reaches the motor with its own latency, as of a controller that reads it periodically."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import MOST_EDGES, edges_of
from estimator.fitting.motor_response import motor_values, pulse_response

FloatArray = NDArray[np.float64]

ROWS_AFTER = 8  # rows between an edge and the end, at least
LEAST_DIFFERENCE = 1e-3  # of a row: the time difference of a derivative


@dataclass(frozen=True)
class EdgeLatency(Effect):
    """Further delays, s, of the changes of the voltage after the first.

    A column is the change of the signals by a later edge, over the time by which it is later. It is exact for a linear
    motor at the latency that it is computed at, and is computed again when the latency is better known. No edge comes
    later than the next, or earlier than the one before.
    """

    name: str = "latency of each edge"
    prior: float = 0.05
    follows: bool = True
    sentence: str = "the changes of the voltage reach the motor at delays of their own"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one group if the voltage has a few levels."""
        if motor_values(fit) is None:
            return ()
        edges = _edges(fit)
        return [self._group(fit, edges, np.zeros(len(edges)))] if edges else []

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the group at the latencies of the last fit."""
        edges = _edges(fit)
        return self._group(fit, edges, coefficients) if len(edges) == len(coefficients) else None

    def _group(self, fit: Fit, edges: Sequence[tuple[int, int, float, int]], late: FloatArray) -> Linear:
        s = fit.simulator
        columns = np.zeros((s.rows, len(s.outputs), len(edges)))
        most = min(apart * s.clocks[e].step for e, _, _, apart in edges)
        late = np.clip(late, -most, most)
        for k, (e, row, change, _) in enumerate(edges):
            clock = s.clocks[e]
            by = late[k] if abs(late[k]) > LEAST_DIFFERENCE * clock.step else LEAST_DIFFERENCE * clock.step
            at = clock.time[0] + row * clock.step + fit.delay(e)
            columns[clock.rows, :, k] = -change / by * pulse_response(fit, clock, at, at + by)
        return Linear(self.name, columns, ("s",) * len(edges), least=-most, most=most, size=s.clocks[0].step)


def _edges(fit: Fit) -> list[tuple[int, int, float, int]]:
    """Return recording, row, size in V and rows to the nearest other change of each after the first of a recording."""
    s = fit.simulator
    v, found = s.inputs("v"), []
    for e, clock in enumerate(s.clocks):
        rest = s.observed[e].rest  # a voltage that is on from the first row begins there
        u = np.concatenate([np.zeros(rest), v[clock.rows]])
        jumps = edges_of(u, float(np.ptp(v)))
        jumps = jumps[jumps <= len(u) - ROWS_AFTER]
        if 2 <= len(jumps) <= MOST_EDGES:
            apart = np.diff(jumps, append=len(u))
            nearest = np.minimum(apart[1:], apart[:-1])
            found += [
                (e, int(k) - rest, float(u[k] - u[k - 1]), int(by)) for k, by in zip(jumps[1:], nearest, strict=True)
            ]
    return found
