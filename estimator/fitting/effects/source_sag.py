"""The voltage of the source falls with the current, with a capacitor beside its resistance, at every voltage."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.effects.base import SELDOM, Effect, time_constants
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values, response
from estimator.fitting.recursion import recursion
from estimator.fitting.score_test import likeliest
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

LONGEST_SAG = 0.1  # s: the longest time constant of a supply's capacitors
STEPS_BESIDE = 1  # steps of time constants between rivals
LEAST_SAG = 0.01  # of the winding's resistance: a smaller one is not distinguished from other errors
USUAL_SAG = 0.05  # of the winding's resistance: a usual source's


@dataclass(frozen=True)
class SourceSag(Effect):
    """A resistance of the source, Ohm, whose voltage drop follows the current with one time constant, also at 0 V.

    `drive.Sag` is a supply behind a bridge: its sag has no effect while the bridge is off.
    """

    name: str = "sag of the source"
    prior: float = SELDOM / 2
    is_one: bool = True

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the time constant whose sag explains most of the residuals, and its neighbours as rivals."""
        s, values = fit.simulator, motor_values(fit)
        if values is None or "i" not in s.outputs or any(g.name.startswith(self.name) for g in fit.linear):
            return ()
        if "supply_resistance" in fit.free:
            return ()
        taus = time_constants(s.clocks[0].step, LONGEST_SAG)
        current = fit.explained[:, s.outputs.index("i")]
        best = likeliest(*fit.test().scores_of(lambda some: _response(fit, current, some), taus))
        near = {max(0, best - STEPS_BESIDE), best, min(len(taus) - 1, best + STEPS_BESIDE)}
        r = values["R"]
        return [
            Linear(f"{self.name}, {taus[k]:.3g} s", _response(fit, current, taus[k : k + 1]), ("Ohm",),
                   least=LEAST_SAG * r, most=r, size=USUAL_SAG * r, one_of=len(taus))
            for k in sorted(near, key=lambda k: abs(k - best))
        ]  # fmt: skip

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the sag by the current of the last fit."""
        explained = fit.explained + group.columns @ coefficients
        current = explained[:, fit.simulator.outputs.index("i")]
        tau = float(group.name.split(", ")[1].removesuffix(" s"))
        return dataclasses.replace(group, columns=_response(fit, current, np.array([tau])))

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how large, and how fast."""
        return f"the source sags by the current: its resistance is {value:.3g} Ohm, time constant{name.split(',')[1]}"


def _response(fit: Fit, current: FloatArray, taus: FloatArray) -> FloatArray:
    """Return the change of the signals, (rows, q, c), by 1 Ohm of the source with c time constants, s."""
    taken = np.zeros((len(current), len(taus)))
    for clock in fit.simulator.clocks:
        a = np.exp(-clock.step / taus)
        own = np.nan_to_num(current[clock.rows])
        away = np.repeat((own - own[0])[:, None], len(taus), axis=1)
        taken[clock.rows] = own[0] + recursion([0.5 * (1 - a), 0.5 * (1 - a)], [-a], away)
    return response(fit, voltage=-taken)
