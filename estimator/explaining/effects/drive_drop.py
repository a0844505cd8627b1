"""The drive gives less than its command by a constant voltage: transistors and diodes, or a dead time of the bridge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.explaining.effects.drive import is_of_one_size
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import late_response, motor_values

FloatArray = NDArray[np.float64]

MOST_DROP = 0.5  # of the largest voltage
USUAL_DROP = 0.05  # of it
NONE = 5e-3  # of it: less is the rest of a measured voltage


@dataclass(frozen=True)
class DriveDrop(Effect):
    """A voltage, V, that every command is reduced by, and smaller ones to none. A brush drop has the current's sign."""

    name: str = "drop of the drive"
    prior: float = 0.1
    sentence: str = "the drive gives {value:.3g} V less than its command"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings; at commands of one size it is a gain of the voltage, which nothing tells."""
        if motor_values(fit) is None:
            return ()
        s = fit.simulator
        v, alike = s.inputs("v"), False
        if is_of_one_size(v):
            alike = not any(o.is_measured for o in s.plan.observed)
            if not alike:
                return ()
        largest = float(np.max(np.abs(v)))
        most, usual = MOST_DROP * largest, USUAL_DROP * largest
        columns = _missing(fit, usual)
        return [Linear(self.name, columns, ("V",), least=0.0, most=most, size=usual, moves=True, untold=alike)]

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the group at what is missing now: of a ramp it is the command itself up to there."""
        drop = float(np.clip(coefficients[0], NONE * group.size / USUAL_DROP, group.most))
        return replace(group, columns=_missing(fit, drop))


def _missing(fit: Fit, drop: float) -> FloatArray:
    """Return what signals are less, (rows, q, 1), for a volt of a drop in V."""
    v = fit.simulator.inputs("v")
    least = max(drop, NONE * float(np.max(np.abs(v))))
    return late_response(fit, -np.clip(v / least, -1.0, 1.0))[:, :, None]
