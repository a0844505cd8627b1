"""Outputs that the model explains worse than their means would: their fit is below 0 %. Knows no motor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MISFIT
from estimator.plans.free_parameters import MOST_HELD, never_named
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]


NOTHING = 0.95  # of a signal's deviation is left: the model says nothing of it that its mean does not


def worse_than_means(plan: Plan, rmse: FloatArray, noise: FloatArray, spread: FloatArray) -> list[str]:
    """Return a sentence for each output whose mean would explain it better than the model does, beyond its noise.

    Parameters
    ----------
    rmse, noise, spread : (q,) arrays
        What is left of each output, the deviation of its noise as the data show it, and of the signal.
    """
    return [
        f"the model explains {name} worse than its mean would (fit {_fit(error, width)}): it is off by {error:.3g}"
        f" {plan.unit(name)} of a signal that spreads by {width:.3g} {plan.unit(name)}; {_held(plan)}check columns,"
        " units, clock and bounds, or estimate with another model"
        for name, error, width, own in zip(plan.outputs, rmse, spread, noise, strict=True)
        if error > max(width, MISFIT * own)
    ]


def describes_nothing(
    plan: Plan, rmse: FloatArray, noise: FloatArray, spread: FloatArray, *, held: Sequence[str]
) -> list[str]:
    """Return a sentence where no output is explained better than by its mean, and one worse; none elsewhere.

    Parameters
    ----------
    rmse, noise, spread
        As of `worse_than_means`.
    held
        Parameters at a bound that the case gives.
    """
    if not worse_than_means(plan, rmse, noise, spread) or np.any(rmse < NOTHING * spread):
        return []
    fits = [f"{name} {_fit(e, width)}" for name, e, width in zip(plan.outputs, rmse, spread, strict=True)]
    bounds = f"widen the bounds of {', '.join(held)}, which it would leave; or " if held else ""
    return [
        "the model does not describe the recording: its best fit is no better than the mean of each output (fit:"
        f" {', '.join(fits)}); {bounds}{_held(plan)}check columns, units and clock, or estimate"
        " with another model"
    ]


def _held(plan: Plan) -> str:
    """Return what to do about parameters that nobody named: the FMU's own values of another motor, or another load."""
    held = never_named(plan.binding)
    more = f" and {len(held) - MOST_HELD} more" if len(held) > MOST_HELD else ""
    named = f"{', '.join(held[:MOST_HELD])}{more}"
    return f"name under [parameters] what the FMU holds at its own value, {named}; or " if held else ""


def _fit(error: float, width: float) -> str:
    return f"{100 * (1 - error / width):.3g} %"
