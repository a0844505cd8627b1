"""Variances of parameters that change while they are recorded, about the mean that is estimated. Fits nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.explanation import Explanation
from estimator.fitting.fit import Fit

FloatArray = NDArray[np.float64]


def changes_during(explanation: Explanation) -> FloatArray:
    """Return the variances, (p,), of a plan's parameters, on their scales, about their means over the recordings."""
    fit = explanation.fit
    names = fit.simulator.plan.names
    variances = np.zeros(len(names))
    groups: dict[str, list[float]] = {}
    for a in explanation.additions:
        own = [x for n, x in zip(fit.names, fit.estimates.tolist(), strict=True) if n == a.name]
        for name, change in (a.effect.changes(fit, own[0]) if own else {}).items():
            groups.setdefault(name, []).append(change)
    for name, changes in groups.items():
        if name in names:
            k = names.index(name)
            variances[k] = max(x * x for x in changes) / 12 / _scale(fit, k) ** 2  # any value on the way is as good
    return np.where(fit.at_bound[: len(names)] == 0, variances, 0.0)


def _scale(fit: Fit, k: int) -> float:
    return float(fit.values[k]) if fit.simulator.log[k] else 1.0
