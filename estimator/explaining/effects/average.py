"""A logged signal is a mean: of the last n samples, or over the sampling interval as of differenced encoder counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import ChainSpec, Plan
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

SAMPLES = tuple(map(float, (2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50)))  # what lies between is found from these


def mean_of_last(y: FloatArray, n: float, h: float) -> FloatArray:
    """Return the running mean of the last n samples, the first repeated before the start."""
    k = round(n)
    sums = np.concatenate([[0.0], np.repeat(y[:1], k - 1), y])
    np.cumsum(sums, out=sums)
    mean = sums[k:] - sums[:-k]
    mean /= k
    return np.asarray(mean)


def mean_over_interval(y: FloatArray, n: float, h: float) -> FloatArray:
    """Return the mean over the last interval, of a signal on lines between its samples."""
    return np.concatenate([y[:1], 0.5 * (y[1:] + y[:-1])])


@dataclass(frozen=True)
class Average(Effect):
    """A running mean of one output over n samples."""

    name: str = "average"
    prior: float = 0.1
    sharp: bool = True
    sentence: str = "{channel} is a mean over the last {value:.0f} samples"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each output without a declared mean."""
        return [
            Nuisance(
                f"average {y}", "samples", 1.0, SAMPLES[-1], 1.0, 1.0,
                output=y, act=mean_of_last, tries=SAMPLES, whole=True, excludes=(f"delay of {y}",),
            )
            for y in plan.outputs
            if y != "angle" and f"average {y}" not in plan.declared and plan.chains.get(y, ChainSpec()).is_plain
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return one sample less, and one more."""
        n = round(fit.value(name))
        return [{name: float(k)} for k in (n - 1, n + 1) if 1 < k <= SAMPLES[-1]]


@dataclass(frozen=True)
class MeanSpeed(Effect):
    """A speed that is the mean over the sampling interval."""

    name: str = "mean over the interval"
    sharp: bool = True
    sentence: str = "{channel} is a mean over the sampling interval, as differenced encoder counts are"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return that of the speed."""
        if "w" not in plan.outputs or plan.sensors["w"] != layout.IDENTITY or "mean w" in plan.declared:
            return ()
        act = mean_over_interval
        return [Nuisance(f"{self.name} w", "", 0.0, 1.0, 0.0, 1.0, output="w", act=act, tries=(1.0,), whole=True)]
