"""The logged voltage has an offset: a converter's zero, a ground that floats. The motor stands where it shows one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import as_late, motor_values, response

MOST_OFFSET = 0.2  # of the largest voltage
USUAL_OFFSET = 0.01  # of it


@dataclass(frozen=True)
class VoltageOffset(Effect):
    """A voltage, V, that the log shows more than the motor has, the same in all recordings."""

    name: str = "voltage offset"
    prior: float = SELDOM
    sentence: str = "the logged voltage is {value:.3g} V more than the motor's"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings, where the voltage has several values: rest, and another."""
        if motor_values(fit) is None:
            return ()
        v = fit.simulator.inputs("v")
        if not np.ptp(v) > 0:
            return ()
        largest = float(np.max(np.abs(v)))
        columns = response(fit, voltage=as_late(fit, -np.ones_like(v)))[:, :, None]
        most = MOST_OFFSET * largest
        return [Linear(self.name, columns, ("V",), least=-most, most=most, size=USUAL_OFFSET * largest)]
