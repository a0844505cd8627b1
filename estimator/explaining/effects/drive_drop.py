"""The drive gives less than its command by a constant voltage: transistors and diodes, or a dead time of the bridge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import Effect
from estimator.explaining.effects.drive import is_of_one_size
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import late_response, motor_values

MOST_DROP = 0.5  # of the largest voltage
USUAL_DROP = 0.05  # of it
NONE = 5e-3  # of it: less is the rest of a measured voltage


@dataclass(frozen=True)
class DriveDrop(Effect):
    """A voltage, V, that every command except zero is reduced by. A brush drop has the sign of the current instead."""

    name: str = "drop of the drive"
    prior: float = 0.1
    sentence: str = "the drive gives {value:.3g} V less than its command"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings; at voltages of one size it is a gain of the voltage, which nothing tells."""
        if motor_values(fit) is None:
            return ()
        v = fit.simulator.inputs("v")
        if is_of_one_size(v):
            return ()
        largest = float(np.max(np.abs(v)))
        driven = np.where(np.abs(v) > NONE * largest, np.sign(v), 0.0)
        columns = late_response(fit, -driven)[:, :, None]
        most, usual = MOST_DROP * largest, USUAL_DROP * largest
        return [Linear(self.name, columns, ("V",), least=0.0, most=most, size=usual, moves=True)]
