"""How far a cost lets each parameter go, where a model that switches makes it no parabola. Knows one fit, no effect.

A standard error is the curvature at the least cost. Where a limit or a friction begins to act between two samples, that
is of a kink, and the cost hardly rises beyond it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.explanation import ROUGH
from estimator.fitting.fit import Fit
from estimator.fitting.gauss_newton import placed, solved

FloatArray = NDArray[np.float64]

FAR = 4.0  # standard errors, at which the cost should have risen by their square
FLAT = 0.5  # of that: a smaller rise is no parabola's
DOUBLINGS = 5  # of the distance, until the cost has risen enough


def profile_widths(fit: Fit, parameters: int) -> FloatArray:
    """Return factors, (parameters,), at least 1, on the standard errors of the first names.

    With each a parameter reaches as far as its cost, all else fitted again, rises by FAR squared.
    """
    covariance = fit.covariance_parts()[0]
    deviation = np.sqrt(np.diag(covariance))
    factors = np.ones(parameters)
    for k in range(parameters):
        if deviation[k] > 0 and fit.at_bound[k] == 0:
            sides = [_reach(fit, k, side, covariance[:, k] / deviation[k]) for side in (-1.0, 1.0)]
            factors[k] = max(1.0, *sides)
    return factors


def _reach(fit: Fit, k: int, side: float, along: FloatArray) -> float:
    """Return how many times FAR standard errors a name goes to a side; `along`: by one of them all names move."""
    low, high = fit.bounds
    x = fit.simulator.scaled(fit.values)[fit.where]
    free = tuple(name for name in fit.free if name != fit.free[k])
    here, reached = fit, 1.0
    for doubling in range(DOUBLINGS + 1):
        far = FAR * 2.0**doubling
        there = np.clip(x[k] + side * far * along[k], low[k], high[k])
        moved = fit.simulator.scaled(here.values)[fit.where]
        if doubling == 0:
            moved = np.clip(x + side * far * along[: len(x)], low, high)
        moved[k] = there
        values = placed(fit, moved)
        here = solved(dataclasses.replace(here, values=values, free=free), iterations=ROUGH)
        rise = max(here.cost - fit.cost, 0.0)
        if rise >= FLAT * FAR**2:
            break
        reached = far / np.sqrt(max(rise, 1.0))
        if not low[k] < there < high[k]:
            break
    return float(reached)
