"""The logged voltage has a sensor's noise that the motor's voltage does not have: no input of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import EDGE
from estimator.fitting.motor_response import as_late, motor_values, response
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

LOCAL = 15  # rows of a local mean
MOST_CHANGES = 3000  # changes, at most: more are a signal


@dataclass(frozen=True)
class VoltageNoise(Effect):
    """The part of the voltage's noise that the motor does not see, 0 to 1."""

    name: str = "voltage noise"
    prior: float = 0.1
    sharp: bool = True  # delays and lags would explain a part of it

    is_one: bool = True

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the responses, with opposite sign, to the logged voltage's deviations from its levels and local means.

        Means are right where the voltage itself changes between its edges: of a motor that coasts, a supply that sags.
        """
        s = fit.simulator
        if motor_values(fit) is None or any(g.name.startswith(self.name) for g in fit.linear):
            return ()
        v = s.inputs("v")
        found = []
        for name, rows in ((self.name, 0), (f"{self.name} about local means", LOCAL)):
            around = np.zeros(s.rows)
            for clock in s.clocks:
                around[clock.rows] = _around(v[clock.rows], rows)
            if np.max(np.abs(around)) > 1e-6 * np.max(np.abs(v)):
                column = response(fit, voltage=as_late(fit, -around))[:, :, None]
                found.append(Linear(name, column, ("",), least=0.3, most=1.3))
        return found

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say so."""
        return f"the logged voltage's noise does not reach the motor ({100 * value:.0f} % of it is the sensor's)"


def _around(u: FloatArray, local: int) -> FloatArray:
    """Return a voltage, (n,), less the means of its levels, or of so many rows; zero where it has too many levels."""
    jumps = np.flatnonzero(np.abs(np.diff(u)) > EDGE * max(float(np.ptp(u)), 1e-300)) + 1
    if len(jumps) > MOST_CHANGES:
        return np.zeros(len(u))
    result = np.empty(len(u))
    for first, last in zip([0, *jumps], [*jumps, len(u)], strict=True):
        part, n = u[first:last], last - first
        if not local or n <= local:
            result[first:last] = part - np.mean(part)
            continue
        sums = np.concatenate([[0.0], np.cumsum(part - part[0])])
        low = np.clip(np.arange(n) - local // 2, 0, n - local)  # windows of one length, also at the ends
        result[first:last] = part - part[0] - (sums[low + local] - sums[low]) / local
    return result
