"""A copper winding's resistance and its temperature. Knows a plan's temperatures, no file and no FMU."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.motor.winding import relative_resistance
from estimator.plans.plan import Plan
from estimator.results.result import DerivedQuantity

FloatArray = NDArray[np.float64]


def warmth(plan: Plan) -> FloatArray:
    """Return the factors, (recordings,), on a winding's resistance in each, over that for which a shared R stands.

    Ones where a temperature is not known.
    """
    known = [t for t in plan.temperatures if t is not None]
    if plan.stands_at is None or len(known) != len(plan.observed):
        return np.ones(len(plan.observed))
    return np.array([relative_resistance(t) for t in known]) / relative_resistance(plan.stands_at)


def cold_resistances(
    plan: Plan, values: FloatArray, polish: LeastSquaresFit, budget: Callable[[FloatArray], dict[str, float]]
) -> dict[str, DerivedQuantity]:
    """Return the resistance at 25 °C where the winding's temperature is known.

    Parameters
    ----------
    budget : of what has this (p,) gradient by the plan's scaled parameters
    """
    found = {}
    for j, parameter in enumerate(plan.parameters):
        if (parameter.quantity or parameter.name) != "R" or polish.at_bound[j] or not plan.temperatures:
            continue
        temperature = plan.temperatures[parameter.recording or 0]
        error = float(polish.standard_errors[j])
        if temperature is not None and np.isfinite(error):
            cold = 1 / relative_resistance(temperature)
            name = f"{parameter.name.replace('R', 'R_at_25_C', 1)}"
            gradient = np.zeros(len(plan.parameters))
            gradient[j] = cold * (float(values[j]) if parameter.log else 1.0)
            found[name] = DerivedQuantity(float(values[j]) * cold, error * cold, parameter.unit, budget(gradient))
    return found
