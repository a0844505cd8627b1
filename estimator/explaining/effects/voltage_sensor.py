"""A filter before the converter of the voltage: its steps are shown as exponentials, and the motor had the steps.

A supply that rises as slowly looks the same in the voltage alone; which it is the motor tells, by a first fit.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import Effect
from estimator.plans.plan import Plan
from estimator.recordings.steps_behind_lag import steps_behind_lag


@dataclass(frozen=True)
class VoltageSensorLag(Effect):
    """A first-order low-pass that a measured voltage is shown through; told by the voltage's own steps."""

    name: str = "voltage sensor lag"


def before_sensor(plan: Plan) -> tuple[Plan, str]:
    """Return a plan whose voltages are the steps before their sensor's low-pass, and words; "": none has one."""
    if not plan.binding.is_motor or "v" not in plan.observed[0].inputs:
        return plan, ""
    found = [steps_behind_lag(o.inputs["v"], o.recording.step) if o.is_measured else None for o in plan.observed]
    taus = [own.tau for own in found if own is not None]
    if not taus:
        return plan, ""
    observed = tuple(
        o
        if own is None
        else dataclasses.replace(o, inputs={**o.inputs, "v": own.levels}, is_quiet=True, uncertain=own.errors)
        for o, own in zip(plan.observed, found, strict=True)
    )
    tau = 1e3 * float(np.median(taus))
    told = f"the voltage goes in steps, which its sensor shows through a low-pass of first order of {tau:.3g} ms"
    return dataclasses.replace(plan, observed=observed), told
