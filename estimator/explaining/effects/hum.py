"""Hum of the mains in a sensor: a line of 50 or 60 Hz, or a multiple, as large at rest as while the motor runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, StandingLine
from estimator.explaining.effects.shaft_order import standing_out
from estimator.explaining.effects.switching_ripple import EVEN, sharpened
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.windows import find_windows
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MAINS = 50.0, 60.0  # Hz
MULTIPLES = 1, 2, 3  # times the mains: a rectifier leaves twice, a transformer three times
NEAR = 0.005  # part by which the clock of a logger may be off, and the mains
CYCLES = 2.0  # of a line that the rows at rest show, at least
ALIKE = 0.35  # part of its amplitude by which a hum at rest may differ from that while the motor runs, beside noise
SIGNIFICANT = 2.0  # deviations of its amplitude at rest: less may be none there
LEAST = 4.0  # of z'z: a line that explains less is none
IN_PHASE = 0.3  # turns by which a line at its usual frequency may be off in the end: further off it explains little
ALWAYS = "always"  # the last word of such a line's name
FASTEST = 0.45  # of the sampling rate


@dataclass(frozen=True)
class Hum(StandingLine):
    """Cosine and sine of one frequency over all of each recording, in one output."""

    name: str = "hum"
    prior: float = SELDOM

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the strongest line of each output, where the motor at rest shows it too."""
        s, windows = fit.simulator, find_windows(fit)
        if any(np.ptp(np.diff(clock.time)) > 2 * EVEN * clock.step for clock in s.clocks):
            return ()
        z = np.where(windows.settled[:, None], standing_out(fit), 0.0)  # zero where a sample is missing, too
        found = []
        for j, (y, f) in enumerate(zip(s.outputs, _usual_lines(fit, z), strict=True)):
            known = (g.name for g in fit.linear if g.name.startswith(f"ripple {y} at "))
            if f == 0 or y == "angle" or any(name.endswith(ALWAYS) for name in known):
                continue
            parts = [(clock.time, z[clock.rows, j]) for clock in s.clocks]
            f = sharpened(f, NEAR * f, parts)
            if not _is_alike(fit, j, windows.settled & fit.whitener.present[:, j], f):
                continue
            columns = np.zeros((s.rows, len(s.outputs), 2 * len(s.clocks)))
            for e, clock in enumerate(s.clocks):
                phase = 2 * np.pi * f * clock.time
                columns[clock.rows, j, 2 * e], columns[clock.rows, j, 2 * e + 1] = np.cos(phase), np.sin(phase)
            found.append(Linear(f"ripple {y} at {f:.6g} Hz {ALWAYS}", columns, (s.plan.unit(y),) * columns.shape[2]))
        return found

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say where the line lies, and how large it is."""
        _, y, _, f, *_ = name.split()
        return f"{y} has a hum of {f} Hz, of amplitude {value:.3g} {plan.unit(y)}, at rest too: the mains"


def _usual_lines(fit: Fit, z: FloatArray) -> FloatArray:
    """Return the usual frequency, Hz, that explains most of each output, (rows, q), whitened; 0 where none can."""
    clocks = fit.simulator.clocks
    fastest = FASTEST / max(clock.step for clock in clocks)
    usual = np.array([f * k for f in MAINS for k in MULTIPLES])
    power = np.zeros((len(usual), z.shape[1]))
    for clock in clocks:
        own, n = z[clock.rows], len(clock.time)
        for m, f in enumerate(MAINS):
            once = np.exp(2j * np.pi * f * clock.time)
            wave = once.copy()
            for k, _ in enumerate(MULTIPLES):
                power[m * len(MULTIPLES) + k] += ((wave.real @ own) ** 2 + (wave.imag @ own) ** 2) / n
                wave *= once
    power[usual > fastest] = 0.0
    best = np.argmax(power, axis=0)
    near = NEAR * usual[best] * max(clock.time[-1] - clock.time[0] for clock in clocks) < IN_PHASE
    told = power[best, np.arange(z.shape[1])] > np.where(near, LEAST, 0.0)
    return np.where(told, usual[best], 0.0)


def _is_alike(fit: Fit, j: int, seen: BoolArray, f: float) -> bool:
    """Whether an output shows a line, Hz, at rest and while the motor runs, as large and in one phase."""
    left, deviation = fit.residuals()[:, j], fit.whitener.deviation()[:, j]
    moving = fit.whitener.moving
    power, apart, by_chance = 0.0, 0.0, 0.0
    for clock in fit.simulator.clocks:
        own, variance = left[clock.rows], deviation[clock.rows] ** 2
        wave = 2 * np.exp(2j * np.pi * f * clock.time)
        rests, runs = (np.flatnonzero((seen & state)[clock.rows]) for state in (~moving, moving))
        if f * len(rests) * clock.step < CYCLES or not len(runs):
            continue
        at_rest, running = (np.mean(own[rows] * wave[rows]) for rows in (rests, runs))
        power += float(abs(at_rest)) ** 2
        apart += float(abs(at_rest - running)) ** 2
        by_chance += sum(4.0 * float(np.mean(variance[rows])) / len(rows) for rows in (rests, runs))
    return bool(power > SIGNIFICANT**2 * by_chance and apart < ALIKE**2 * power + SIGNIFICANT**2 * by_chance)
