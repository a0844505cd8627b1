"""The voltage dips, or overshoots, at each change and comes back: a regulator or a cable that the log does not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, TAU_RATIO, Effect, time_constants
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import EDGE, MOST_EDGES
from estimator.fitting.motor_response import late_response, motor_values
from estimator.fitting.score_test import likeliest
from estimator.noise.recursion import recursion
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

NAMES = ("voltage dip", "voltage overshoot")
LONGEST_TRANSIENT = 0.3  # of the recording: the longest time constant
LEAST_PART, MOST_PART = 0.005, 0.5  # of a change: less is like other errors, more is another voltage
PROMISING = 4.0  # of z'z: what lowers it by less is not added
BETWEEN = np.arange(-3, 4) / 4  # of the steps of the time constants that are tried: those asked about the best of them


@dataclass(frozen=True)
class VoltageTransient(Effect):
    """A part of each change of the voltage that is missing at first, and comes back with one time constant.

    Attributes
    ----------
    sign : 1 or -1
        Missing, or too much.
    """

    name: str = NAMES[0]
    prior: float = SELDOM
    doubt: str = "something acts as if the motor's voltage were not the one in the recording: measure it at the motor"
    sign: int = 1

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the time constant whose transient explains most of the residuals."""
        if motor_values(fit) is None or any(g.name.startswith(NAMES) for g in fit.linear):
            return ()
        taus, along, power = fit.once(_missing)
        if not len(along):
            return ()
        best = likeliest(self.sign * along, power)
        tau = float(taus[best])
        if self.sign * along[best] > 0 and along[best] ** 2 > PROMISING * power[best]:
            between = tau * TAU_RATIO**BETWEEN
            between = between[between <= max(_longest(fit), tau)]
            along, power = fit.test().scores_of(lambda some: _response(fit, some), between)
            tau = float(between[likeliest(self.sign * along, power)])
        name = f"{self.name} of {tau:.3g} s"
        size = max(0.02 * self.sign, 0.0)
        return [
            Linear(
                name,
                self.sign * _response(fit, np.array([tau])),
                ("",),
                least=LEAST_PART,
                most=MOST_PART,
                size=size,
                one_of=len(taus),
                moves=True,
            )
        ]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say in which direction, by how much, and for how long."""
        way = "too low" if self.sign > 0 else "too high"
        return f"{name}: after each change the motor's voltage is {way} at first, by {100 * value:.2g} % of it"


def _missing(fit: Fit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time constants, s, and scores and information, (c,) each, of a voltage that is missing at first.

    No scores where the voltage has no levels.
    """
    s = fit.simulator
    v = s.inputs("v")
    taus = time_constants(s.clocks[0].step, _longest(fit))
    if not any(np.any(_changes(v[c.rows], float(np.ptp(v)))) for c in s.clocks):
        return taus, np.zeros(0), np.zeros(0)
    return taus, *fit.test().scores_of(lambda some: _response(fit, some), taus)


def _longest(fit: Fit) -> float:
    """Return the longest time constant, s: what takes longer is a drift."""
    return LONGEST_TRANSIENT * max(float(clock.time[-1] - clock.time[0]) for clock in fit.simulator.clocks)


def _response(fit: Fit, taus: FloatArray) -> FloatArray:
    """Return the signals' change, (rows, q, c), by a voltage that is missing at first and comes back with c taus, s."""
    s = fit.simulator
    v = s.inputs("v")
    span, missing = float(np.ptp(v)), np.zeros((s.rows, len(taus)))
    for clock in s.clocks:  # all of each change is missing at first
        change = np.repeat(_changes(v[clock.rows], span)[:, None], len(taus), axis=1)
        missing[clock.rows] = recursion([1.0], [-np.exp(-clock.step / taus)], change)
    return late_response(fit, -missing)


def _changes(u: FloatArray, span: float) -> FloatArray:
    """Return the changes of a voltage, (n,), from level to level; 0 if it has no levels."""
    change = np.diff(u, prepend=u[:1])
    change[np.abs(change) <= EDGE * span] = 0.0
    return np.zeros(len(u)) if np.count_nonzero(change) > MOST_EDGES else change
