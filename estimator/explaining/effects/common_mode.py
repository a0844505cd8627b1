"""A current's sensor that shows a part of the motor's voltage: a shunt's amplifier of finite common-mode rejection.

A resistor beside the motor, or a divider that measures its voltage, draws a current of the same form. The motor's own
current cannot jump as the voltage does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.slow_pwm import NAME as PULSES
from estimator.explaining.effects.voltage_noise import around_of
from estimator.explaining.effects.voltage_rise import NOISY
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import as_current, motor_values
from estimator.recordings.signal_noise import input_noise

FloatArray = NDArray[np.float64]

USUAL = 0.01  # of the largest current at the largest voltage: an amplifier by resistors of 0.1 %
MOST = 0.3  # likewise: what shows more of the voltage than that is no sensor of a current
ROWS_LATE = (0, 1)  # a sample is taken behind the voltage's change in its row, or before it


@dataclass(frozen=True)
class CommonMode(Effect):
    """A current that is shown for each volt of the motor's, A/V."""

    name: str = "common mode of i"
    prior: float = SELDOM
    doubt: str = "check its common-mode rejection, and what beside the motor draws a current"
    sharp: bool = True  # delays and lags would explain a part of it
    sentence: str = "{value:.3g} A/V of the voltage shows in the current: its sensor's common mode, or a resistor"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one of all recordings, in two forms."""
        s = fit.simulator
        if motor_values(fit) is None or "i" not in s.outputs or any(g.name.startswith(PULSES) for g in fit.linear):
            return ()  # the voltage that the sensor sees is not the recorded one
        if all(o.excitation.kind == "step" and not o.excitation.running for o in s.plan.observed):
            return ()  # nothing tells it from B
        v = s.inputs("v") - fit.once(around_of)
        largest = float(np.max(np.abs(v), initial=0.0))
        if not largest > 0 or any(input_noise(v[clock.rows]) > NOISY * largest for clock in s.clocks):
            return ()  # a controller of the current answers to the noise of its sensor by such a voltage
        whole, found = s.plan.largest("i") / largest, []
        for late in ROWS_LATE:
            shown = as_current(fit, v, rows_late=late)[:, :, None]
            found.append(
                Linear(
                    self.name, shown, ("A/V",), least=-MOST * whole, most=MOST * whole, size=USUAL * whole,
                    one_of=len(ROWS_LATE), form=late,
                )
            )  # fmt: skip
        return found

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the same form by what the sensors do now."""
        return next((g for g in self.linear(fit) if g.form == group.form), None)
