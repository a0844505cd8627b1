"""Changes of the machine during a recording: friction that drifts, a winding that warms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values, response, speed_of
from estimator.fitting.simulator import per_recording
from estimator.noise.clock import over_steps
from estimator.plans.plan import Plan
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]

USUAL_DRIFT = 0.1  # of the friction
SHARE = 1 / np.sqrt(12.0)  # deviation of what is anywhere between 0 and 1
USUAL_WARMING = 0.5  # of R in a second of the current at standstill: copper at 160 A/mm2, no heat lost


@dataclass(frozen=True)
class FrictionDrift(Effect):
    """A friction torque that changes along a line over the recording, N.m from its first to its last row.

    It is zero in the middle of the turns: B stands for the mean of all of them. How much of it is dry, and how much
    grows with the speed, is not known: any share is as likely.
    """

    name: str = "friction drift"
    prior: float = 0.1

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for each recording of a motor."""
        s = fit.simulator
        values, w = motor_values(fit), speed_of(fit, fit.shown)
        if values is None or w is None:
            return ()
        size, speed = USUAL_DRIFT * usual_friction(fit, values), _usual_speed(fit)
        found = []
        for clock, name in zip(s.clocks, per_recording(s.plan, self.name), strict=True):
            dry, t = np.sign(w[clock.rows]), clock.time
            viscous = w[clock.rows] / speed if speed > 0 else dry
            line, turned = (t - t[0]) / (t[-1] - t[0]), np.abs(w[clock.rows])
            line -= float(turned @ line / turned.sum()) if turned.any() else 0.5
            torques = np.zeros((2, s.rows))  # a mean of dry and viscous, and how far it is known
            torques[0, clock.rows], torques[1, clock.rows] = (
                0.5 * (viscous + dry) * line,
                SHARE * (viscous - dry) * line,
            )
            columns, uncertain = (response(fit, torque=torque)[:, :, None] for torque in torques)
            found.append(Linear(name, columns, ("N.m",), size=size, uncertain=uncertain))
        return found

    def changes(self, fit: Fit, coefficient: float) -> Mapping[str, float]:
        """Return the change of the friction at the usual speed."""
        usual = _usual_speed(fit)
        return {"B": coefficient / usual} if usual > 0 else {}

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say in which direction."""
        way = "rises" if value > 0 else "falls"
        size = f"{abs(value):.3g} N.m over the recording"
        return f"{name}: the friction {way} by {size}; the parameters stand for the mean"


@dataclass(frozen=True)
class WindingWarms(Effect):
    """A resistance that grows with the heat that the current has made, Ohm from the first to the last row.

    None falls: a winding cools within minutes, and while no current shows it.
    """

    name: str = "winding warms"
    prior: float = 0.1
    sentence: str = "R rises by {value:.3g} Ohm over a recording: the winding warms; R stands for the mean"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings of a motor whose current is measured."""
        outputs = fit.simulator.outputs
        return self._of_current(fit, fit.explained[:, outputs.index("i")]) if "i" in outputs else ()

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return it by the current that flows through the winding as it warms: so its response is exact."""
        j = fit.simulator.outputs.index("i")
        own = (group.columns @ coefficients)[:, j]
        return next(iter(self._of_current(fit, fit.explained[:, j] + own)), None)

    def _of_current(self, fit: Fit, i: FloatArray) -> Sequence[Linear]:
        """Return it by a current, (rows,), in A."""
        s, values = fit.simulator, motor_values(fit)
        if values is None:
            return ()
        voltage, still = np.zeros(s.rows), float(np.max(np.abs(s.inputs("v")))) / values["R"]
        if still == 0:
            return ()
        flows = over_steps(i, s.clocks)
        longest = 0.0  # s of the current at standstill that make as much heat
        for clock in s.clocks:
            heat = np.cumsum(flows[clock.rows] ** 2)
            longest = max(longest, float(heat[-1]) * clock.step / still**2)
            voltage[clock.rows] = -flows[clock.rows] * (heat / max(heat[-1], 1e-300) - 0.5)
        columns = response(fit, voltage=voltage)[:, :, None]
        return [Linear(self.name, columns, ("Ohm",), least=0.0, size=USUAL_WARMING * longest * values["R"])]

    def changes(self, fit: Fit, coefficient: float) -> Mapping[str, float]:
        """Return the change of the resistance."""
        return {"R": coefficient}


def usual_friction(fit: Fit, values: Mapping[str, float]) -> float:
    """Return the usual torque, N.m, of all friction by a motor's values, a dry part among it."""
    return values["B"] * _usual_speed(fit) + values.get("friction", 0.0)


def _usual_speed(fit: Fit) -> float:
    """Return the usual speed, rad/s, while a voltage drives the motor."""
    s = fit.simulator
    shown, driven = speed_of(fit, fit.shown), s.inputs("v") != 0
    w = np.zeros(s.rows) if shown is None else np.abs(shown)
    return median(w[driven] if driven.any() else w)
