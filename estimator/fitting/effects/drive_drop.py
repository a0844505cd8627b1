"""The drive gives less than its command by a constant voltage: transistors and diodes, or a dead time of the bridge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import as_late, motor_values, response
from estimator.plans.plan import Plan

MOST_DROP = 0.5  # of the largest voltage
USUAL_DROP = 0.05  # of it
ONE_SIZE = 0.01  # voltages that differ by less, in parts, are of one size


@dataclass(frozen=True)
class DriveDrop(Effect):
    """A voltage, V, that every command except zero is reduced by. A brush drop has the sign of the current instead."""

    name: str = "drop of the drive"
    prior: float = 0.1

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings; at voltages of one size it is a gain of the voltage, which nothing tells."""
        if motor_values(fit) is None:
            return ()
        v = fit.simulator.inputs("v")
        sizes = np.abs(v[v != 0])
        if not len(sizes) or float(np.std(sizes)) < ONE_SIZE * float(np.mean(sizes)):
            return ()
        largest = float(np.max(sizes))
        columns = response(fit, voltage=as_late(fit, -np.sign(v)))[:, :, None]
        return [Linear(self.name, columns, ("V",), least=0.0, most=MOST_DROP * largest, size=USUAL_DROP * largest)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how large."""
        return f"the drive gives {value:.3g} V less than its command"
