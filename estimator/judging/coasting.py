"""Whether a motor turned before its recording began: the model starts at rest where the first voltage is 0."""

from __future__ import annotations

import numpy as np

from estimator.motor.names import has_motor
from estimator.plans.plan import Plan
from estimator.recordings.signal_noise import noise_deviation

ENDS = 5  # samples whose means are compared
FALLS = 8.0  # standard deviations of their difference, 1 in 1e15 of white noise


def coasting(plan: Plan) -> list[str]:
    """Return where a speed falls while there is no voltage yet: an offset of its sensor would be constant."""
    if not has_motor({*plan.names, *plan.fixed}):
        return []
    reasons = []
    for o in plan.observed:
        k = o.excitation.index
        if not o.excitation.running or o.lead or o.excitation.kind == "none" or k < 2 * ENDS or "w" not in o.outputs:
            continue
        w = o.outputs["w"][:k]
        if any(np.any(u[: k - 1] != 0) for u in o.inputs.values()) or np.isnan([*w[:ENDS], *w[-ENDS:]]).any():
            continue
        first, last = float(np.mean(w[:ENDS])), float(np.mean(w[-ENDS:]))
        if abs(first) - abs(last) > FALLS * noise_deviation(o.outputs["w"]) * np.sqrt(2 / ENDS):
            reasons.append(
                f"{o.recording.title}: the motor turns already at {first:.4g} rad/s in the first rows, without voltage;"
                " the model begins at rest: record from standstill, or begin later with a window"
            )
    return reasons
