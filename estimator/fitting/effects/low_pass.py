"""A low-pass of first or second order in a channel: an amplifier, an anti-aliasing filter, an observer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import Fit
from estimator.fitting.recursion import recursion
from estimator.fitting.simulator import Nuisance
from estimator.motor.winding import time_constant
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

LONGEST_LAG = 60.0  # samples


def lagged(y: FloatArray, tau: float, h: float) -> FloatArray:
    """Return y behind tau x' + x = y, exact for a signal on lines between its samples, at rest before the first."""
    if tau <= 0:
        return y
    a = np.exp(-h / tau)
    b0, b1 = 1 - (1 - a) * tau / h, (1 - a) * tau / h - a
    level = float(y[0])
    return level + recursion([b0, b1], [-a], y - level)  # the gain is 1: what was constant before is shown as it is


def lagged_twice(y: FloatArray, tau: float, h: float) -> FloatArray:
    """Return y behind two equal lags."""
    return lagged(lagged(y, tau, h), tau, h)


@dataclass(frozen=True)
class LowPass(Effect):
    """A low-pass of one output, its time constant in s."""

    name: str = "lag"
    sharp: bool = True
    order: int = 1

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each output without a declared filter."""
        h = min(o.recording.step for o in plan.observed)
        return [
            Nuisance(
                f"{self.name} of {y}", "s", 0.0, LONGEST_LAG * h, 0.0, h,
                output=y, act=lagged if self.order == 1 else lagged_twice, between=True,
                tries=(0.3 * h, 1.5 * h, 6 * h), excludes=(f"lag of {y}", f"second-order lag of {y}"),
            )
            for y in plan.outputs
            if f"filter {y}" not in plan.declared and y != "angle"
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return the sensor's lag as the winding's, and the winding's as the sensor's, which is of first order."""
        s = fit.simulator
        if not name.endswith(" i") or not {"R", "L"} <= set(fit.free):
            return ()
        R, L, tau = (float(fit.values[s.index[n]]) for n in ("R", "L", name))
        first = name.removeprefix("second-order ")
        if tau <= 0 or first not in s.index:
            return ()
        return ({"L": R * self.order * tau, name: 0.0, first: time_constant(R, L)},)

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say which."""
        y = name.rpartition(" ")[2]
        order = "first" if self.order == 1 else "second"
        return f"{y} is shown through a low-pass of {order} order with a time constant of {1e3 * value:.3g} ms"
