"""A torque that goes round with the shaft, once a turn: a weight beside its axis, an arm, a pendulum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.load_torque import TURNS
from estimator.explaining.effects.machine_effects import usual_friction
from estimator.explaining.effects.shaft_order import angle_of
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values, response, speed_of
from estimator.fitting.shaft_angle import LINE_CYCLES
from estimator.plans.plan import Plan

USUAL = 0.3  # of the friction
LEAST_TURN = 0.1  # of the shaft in a recording: with less it is constant


@dataclass(frozen=True)
class Unbalance(Effect):
    """A torque as the cosine and the sine of the shaft's angle from its first row, N.m.

    Of several recordings of one motor it is as large in all, each from an angle of its own: in one alone it would make
    up for something else, and is not looked for.
    """

    name: str = "unbalance"
    prior: float = SELDOM

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return both, of one recording in which the shaft turns."""
        s = fit.simulator
        values, theta = motor_values(fit), angle_of(fit, "w") if "w" in s.outputs else None
        w = speed_of(fit, fit.shown)
        if len(s.clocks) > 1 or values is None or theta is None or w is None:
            return ()
        turned = theta - theta[0]
        if not LEAST_TURN < float(np.ptp(turned)) / (2 * np.pi) < LINE_CYCLES:  # with more it is a line of the speed
            return ()
        moved = np.logical_or.accumulate(np.abs(w) > TURNS * float(np.max(np.abs(w))))  # it is held before
        torque = np.column_stack([np.cos(turned), np.sin(turned)]) * moved[:, None]
        size = USUAL * usual_friction(fit, values)
        return [Linear(self.name, response(fit, torque=torque), ("N.m", "N.m"), size=size)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say that there is one."""
        return "a torque goes round with the shaft, once a turn: a weight beside its axis, or an arm"
