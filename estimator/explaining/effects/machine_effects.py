"""Changes of the machine during a recording: friction that drifts, a winding that warms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL
from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values, response, speed_of
from estimator.fitting.simulator import per_recording
from estimator.noise.recursion import recursion
from estimator.plans.plan import Plan
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]

USUAL_DRIFT = 0.1  # of the friction
SHARE = 1 / np.sqrt(12.0)  # deviation of what is anywhere between 0 and 1
LOSSES = (0.0, 0.5, 1.0, 2.0, 4.0)  # duration of the longest recording over the time in which heat is lost
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
    """A resistance that grows with the heat that the current has made and the winding not lost, Ohm from least to most.

    It begins cold, or as warm as R says: what it lost of an earlier heat is not known.
    """

    name: str = "winding warms"
    prior: float = 0.1
    sentence: str = "R rises by {value:.3g} Ohm over a recording: the winding warms; R stands for the mean"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings of a motor whose current is measured, of the likeliest loss of heat."""
        outputs, test = fit.simulator.outputs, fit.test()
        if "i" not in outputs or motor_values(fit) is None or not fit.simulator.inputs("v").any():
            return ()
        i = fit.explained[:, outputs.index("i")]
        forms = [self._of_current(fit, i, form) for form in range(len(LOSSES))]
        return [max(forms, key=lambda line: test.gain(test.across(line.columns)))]

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return it by the current that flows through the winding as it warms: so its response is exact."""
        j = fit.simulator.outputs.index("i")
        return self._of_current(fit, fit.explained[:, j] + (group.columns @ coefficients)[:, j], group.form)

    def reshaped(self, fit: Fit, group: Linear) -> Sequence[Linear]:
        """Return it with those other losses of heat that explain something beside its own."""
        i, test = fit.explained[:, fit.simulator.outputs.index("i")], fit.test()
        others = (self._of_current(fit, i, form) for form in range(len(LOSSES)) if form != group.form)
        return [other for other in others if test.gain(test.across(other.columns)) > LEAST_FALL]

    def _of_current(self, fit: Fit, i: FloatArray, form: int) -> Linear:
        """Return it by a current, (rows,), in A."""
        s, values = fit.simulator, motor_values(fit)
        assert values is not None
        voltage, still = np.zeros(s.rows), float(np.max(np.abs(s.inputs("v")))) / values["R"]
        longest = 0.0  # s of the current at standstill that make as much heat
        duration = max(float(clock.time[-1] - clock.time[0]) for clock in s.clocks)
        for clock in s.clocks:
            made = i[clock.rows] ** 2
            heat = recursion([1.0], [-np.exp(-LOSSES[form] * clock.step / duration)], made)
            longest = max(longest, float(np.sum(made)) * clock.step / still**2)
            voltage[clock.rows] = -i[clock.rows] * (heat - np.mean(heat)) / max(float(np.ptp(heat)), 1e-300)
        columns = response(fit, voltage=voltage)[:, :, None]
        size = USUAL_WARMING * longest * values["R"]
        return Linear(self.name, columns, ("Ohm",), least=0.0, size=size, form=form, one_of=len(LOSSES))

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
