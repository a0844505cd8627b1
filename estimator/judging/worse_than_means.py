"""Outputs that the model explains worse than their means would: their fit is below 0 %. Knows no motor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MISFIT
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]


def worse_than_means(plan: Plan, rmse: FloatArray, noise: FloatArray, spread: FloatArray) -> list[str]:
    """Return a sentence for each output whose mean would explain it better than the model does, beyond its noise.

    Parameters
    ----------
    rmse, noise, spread : (q,) arrays
        What is left of each output, the deviation of its noise as the data show it, and of the signal.
    """
    return [
        f"the model explains {name} worse than its mean would (fit {100 * (1 - error / width):.3g} %): it is off by"
        f" {error:.3g} {plan.unit(name)} of a signal that spreads by {width:.3g} {plan.unit(name)}; check columns,"
        " units, clock and bounds, or estimate with another model"
        for name, error, width, own in zip(plan.outputs, rmse, spread, noise, strict=True)
        if error > max(width, MISFIT * own)
    ]
