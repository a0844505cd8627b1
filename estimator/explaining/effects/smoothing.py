"""A signal that firmware smooths from sample to sample: each is moved a part of the way to the one that is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect, longest_lateness
from estimator.explaining.effects.low_pass import FORMS, TRIED
from estimator.fitting.simulator import Nuisance
from estimator.noise.recursion import behind
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]


def smoothed(y: FloatArray, tau: float, h: float) -> FloatArray:
    """Return the recursion x[k] = a x[k-1] + (1 - a) y[k], a = exp(-h / tau), at rest before the first."""
    if tau <= 0:
        return y
    a, shown = float(np.exp(-h / tau)), np.empty(len(y))
    behind((((1 - a,), (-a,)),), np.asarray(y, dtype=np.float64)[:, None], shown)
    return shown


@dataclass(frozen=True)
class Smoothing(Effect):
    """Exponential smoothing of one output's samples, its time constant in s."""

    name: str = "smoothing"
    sharp: bool = True
    lateness: float = 1.0

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each output without a declared filter."""
        h, longest = plan.shortest_step, longest_lateness(plan)
        return [
            Nuisance(
                f"{self.name} of {y}", "s", 0.0, longest, 0.0, h, output=y, act=smoothed,
                tries=tuple(n * h for n in TRIED if n * h < 0.5 * longest),
                excludes=(*(f"{form} of {y}" for form in FORMS), f"average {y}"),
            )
            for y in plan.outputs
            if f"filter {y}" not in plan.declared and y != "angle"
        ]  # fmt: skip

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say with which part."""
        y, part = name.rpartition(" ")[2], -np.expm1(-plan.shortest_step / value) if value > 0 else 1.0
        return f"{y} is smoothed from sample to sample: each is moved by {part:.3g} of the way to the one that is read"
