"""A channel has a wrong gain, which fixed parameters or another channel show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.plans.plan import Plan

MOST_ERROR = 0.3  # part by which a scale may be wrong

EXPLAINED_BY = {"i": ("R", "L", "J", "B"), "w": ("K", "J", "B")}  # of a motor, which explain a gain if they are free


@dataclass(frozen=True)
class Gain(Effect):
    """A gain of one output, as the difference from 1; not tested where free parameters explain the same."""

    name: str = "gain"
    prior: float = SELDOM
    doubt: str = "the signals, or what is held fixed, contradict each other: check the sensors' scales"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for each output but an encoder's angle, whose counts a turn are known."""
        plan, found = fit.simulator.plan, []
        for j, y in enumerate(fit.simulator.outputs):
            if y == "angle" or f"gain {y}" in plan.declared:
                continue
            if "angle" not in fit.simulator.outputs and set(EXPLAINED_BY.get(y, ("",))) <= set(fit.free):
                continue  # exactly, whatever derivatives say where an FMU switches
            columns = np.zeros((fit.simulator.rows, len(fit.simulator.outputs), 1))
            columns[:, j, 0] = fit.shown[:, j]
            found.append(
                Linear(f"gain {y}", columns, ("",), least=-MOST_ERROR, most=MOST_ERROR, told_from=1.0, size=0.02)
            )
        return found

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how large."""
        return f"{name.split(' ')[1]} is shown with a gain of {1 + value:.4g}"
