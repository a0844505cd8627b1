"""Ripple of a rectified supply: a part of the voltage, at twice the mains or a multiple, in current and speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, StandingLine
from estimator.explaining.effects.hum import FASTEST, MAINS, NEAR
from estimator.explaining.effects.shaft_order import standing_out
from estimator.explaining.effects.switching_ripple import EVEN, sharpened
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import as_late, held_for_wave, motor_values, response
from estimator.fitting.windows import find_windows
from estimator.plans.part import LONG
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

PULSES = 2, 6  # of a rectifier with one phase or three, a period of the mains
MOST_PART = 0.3  # of the voltage: more is no ripple
USUAL_PART = 0.02


@dataclass(frozen=True)
class SupplyRipple(StandingLine):
    """Cosine and sine of one frequency, parts of the voltage, in each recording."""

    name: str = "supply ripple"
    prior: float = SELDOM

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the line of the supply that the current shows most, of a motor; none of a long recording."""
        s = fit.simulator
        if s.rows > LONG:
            return ()
        if motor_values(fit) is None or "i" not in s.outputs or any(g.name.startswith("ripple v ") for g in fit.linear):
            return ()
        if any(np.ptp(np.diff(clock.time)) > 2 * EVEN * clock.step for clock in s.clocks):
            return ()
        j = s.outputs.index("i")
        z = np.where(fit.whitener.moving & ~find_windows(fit).sharp, standing_out(fit)[:, j], 0.0)  # a misfit is slow
        parts = [(clock.time, z[clock.rows]) for clock in s.clocks]
        fastest = FASTEST / max(clock.step for clock in s.clocks)
        usual = [f * k for f in MAINS for k in PULSES if f * k < fastest]
        if not usual:
            return ()
        powers = [sum(abs(np.exp(2j * np.pi * f * t) @ own) ** 2 / len(t) for t, own in parts) for f in usual]
        f = usual[int(np.argmax(powers))]
        f = sharpened(f, NEAR * f, parts)
        v, own = as_late(fit, s.inputs("v")), np.zeros((2, s.rows, 2 * len(s.clocks)))
        for e, clock in enumerate(s.clocks):
            for signal, held in zip(own, held_for_wave(fit, clock, f), strict=True):
                signal[clock.rows, 2 * e : 2 * e + 2] = v[clock.rows, None] * held
        columns = response(fit, voltage=own[0], torque=own[1])
        return [
            Linear(
                f"ripple v at {f:.6g} Hz",
                columns,
                ("",) * columns.shape[2],
                least=-MOST_PART,
                most=MOST_PART,
                size=USUAL_PART,
            )
        ]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say where the line lies, and how large it is."""
        return f"the supply has a ripple of {name.split()[3]} Hz, of amplitude {100 * value:.2g} % of the voltage"
