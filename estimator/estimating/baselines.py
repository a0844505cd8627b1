"""The methods without a search: integral least squares, Steiglitz-McBride. Knows plans, no FMU.

They go straight from the recording to the five parameters of a motor, without any simulation, so they apply to one
recording of voltage, current and speed, from rest, with nothing but the load fixed.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.fitting.steiglitz_mcbride import steiglitz_mcbride
from estimator.motor.integral_least_squares import integral_estimate
from estimator.motor.names import MOTOR
from estimator.motor.transfer_functions import NoMotorError
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

DIRECT = ("integral", "steiglitz-mcbride")


def direct_values(plan: Plan, noise: Mapping[str, float]) -> FloatArray | str:
    """Return what a direct method finds, (p,), or why no motor fits.

    Parameters
    ----------
    noise : output → deviation of its noise

    Raises
    ------
    InputError
        The method does not apply to this case.
    """
    method = plan.case.search.method
    _check_applies(plan, method)
    o = plan.observed[0]
    inputs, outputs = o.in_time()
    v, i, w = inputs["v"], outputs["i"], outputs["w"]
    loads = inputs.get("load", np.zeros(1))
    if method == "integral":
        found = integral_estimate(v, i, w, step=o.recording.step, load=float(loads[0]))
    else:
        if o.lead:
            v, i, w = v - v[0], i - i[~np.isnan(i)][0], w - w[~np.isnan(w)][0]
        sigma = (max(noise["i"], 1e-12), max(noise["w"], 1e-12))
        try:
            found = steiglitz_mcbride(v, i, w, step=o.recording.step, sigma=sigma)
        except NoMotorError as error:
            return str(error)
    wrong = [f"{name} = {found[name]:.4g}" for name in MOTOR if not (np.isfinite(found[name]) and found[name] > 0)]
    if wrong:
        return (
            f"{method} finds {', '.join(wrong)}, which no motor has: the noise is too strong for it;"
            " use method 'cuckoo'"
        )
    return np.array([found[name] for name in plan.names])


def _check_applies(plan: Plan, method: str) -> None:
    if set(plan.names) != set(MOTOR):
        missing = [n for n in MOTOR if n not in plan.names]
        what = (
            f"{', '.join(missing)} fixed" if missing else f"{', '.join(n for n in plan.names if n not in MOTOR)} free"
        )
        raise InputError(f"method {method!r} finds R, K, L, J and B together, but here is {what}; use method 'cuckoo'")
    if len(plan.observed) != 1:
        raise InputError(f"method {method!r} takes one recording; use method 'cuckoo' for several")
    o = plan.observed[0]
    missing = [n for n in ("v",) if n not in o.inputs] + [n for n in ("i", "w") if n not in o.outputs]
    if missing:
        raise InputError(
            f"method {method!r} needs voltage, current and speed, but {missing[0]!r} is missing; use method 'cuckoo'"
        )
    load = o.inputs.get("load", np.zeros(1))
    if np.ptp(load) > 0 or (method == "steiglitz-mcbride" and np.any(load != 0)):
        what = "a changing load" if np.ptp(load) > 0 else "load"
        raise InputError(f"method {method!r} does not apply under {what}; use method 'cuckoo'")
