"""A torque that does not turn with the motion: a weight, a spring, friction that differs by direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.machine_effects import USUAL_DRIFT, usual_friction
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values, response, speed_of

TURNS = 0.01  # of the largest speed: while it turns
BOTH_WAYS = 0.1  # of the largest speed, in either direction: else it is dry friction


@dataclass(frozen=True)
class LoadTorque(Effect):
    """A constant torque against the positive direction while the motor turns, N.m, of all recordings."""

    name: str = "load torque"
    prior: float = SELDOM
    sentence: str = (
        "a torque of {value:.3g} N.m acts against the positive direction while the motor turns: a load, or friction"
        " that differs by direction"
    )

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings of a motor that turns both ways."""
        values = motor_values(fit)
        w = speed_of(fit, fit.shown)
        if values is None or w is None:
            return ()
        top = float(np.max(np.abs(w), initial=0.0))
        if not top > 0 or min(float(np.max(w)), -float(np.min(w))) < BOTH_WAYS * top:
            return ()
        columns = response(fit, torque=(np.abs(w) > TURNS * top).astype(np.float64))[:, :, None]
        return [Linear(self.name, columns, ("N.m",), size=USUAL_DRIFT * usual_friction(fit, values))]
