"""The motor turns, or carries a current, when the recording begins, without a voltage as cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import free_motion, motor_values
from estimator.fitting.simulator import per_recording
from estimator.plans.plan import Plan


@dataclass(frozen=True)
class StartingMotion(Effect):
    """Speed and current in the first row beyond the model's, rad/s and A."""

    name: str = "motion before the voltage"
    sharp: bool = True
    prior: float = 0.05

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the motor's free motion from the first row of each recording that begins at rest."""
        s = fit.simulator
        if motor_values(fit) is None:
            return ()
        found = []
        for o, clock, name in zip(s.observed, s.clocks, per_recording(s.plan, self.name), strict=True):
            if not o.lead:
                columns = np.zeros((s.rows, len(s.outputs), 2))
                columns[clock.rows] = free_motion(fit, clock)
                found.append(Linear(name, columns, ("rad/s", "A")))
        return found

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say so."""
        return f"{name}: the motor moves already in the first row; its speed and current there are estimated"
