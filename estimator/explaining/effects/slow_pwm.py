"""A command that the drive switches so slowly that the motor follows: its pulses, in transients and in the speed, too.

What the file says of the voltage is its mean over a period. Of a linear model the rest adds its own response: a wave of
the switching's frequency and of its multiples, in proportion to the voltage, as large as the duty makes it; those that
are faster than the sampling, too. What is sharper still, behind each change of the command, is not known, and an
inductance that is small is told by that: such an estimate is doubtful. Where the instants of the switching are not
those of the clock, its lines show in the current alone (switching_ripple.py).
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import USUAL, Effect
from estimator.explaining.effects.shaft_order import standing_out
from estimator.explaining.effects.switching_ripple import STRETCH_ROWS, stretches_of_voltage, strongest_lines
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import as_late, held_for_wave, motor_values, response
from estimator.plans.part import LONG
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

NAME = "ripple v of"
LEAST_PART, MOST_PART = 0.1, 2.2  # of the voltage: the first wave of pulses that last 95 % of a period, or hardly any
WAVES = 2, 6, 16  # multiples of the frequency, as sharp as the pulses are seen
CYCLES = 2.0  # of a recording, by which what the sampling makes of a wave differs from rest and from another's
LEVELS = 4  # voltages of a recording that have a duty, and waves, of their own; of all recordings, at most


@dataclass(frozen=True)
class SlowPwm(Effect):
    """Cosine and sine of the switching's frequency and its multiples, parts of the voltage, at each of its levels."""

    name: str = "slow PWM"
    prior: float = USUAL / 1000  # of a thousand frequencies one
    doubt: str = "the motor's voltage is not the one in the recording: measure it at the motor, or switch faster"
    sharp: bool = True
    is_line: bool = True
    follows: bool = True

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the waves of the frequency that stands out in the current; none of a long recording, or no command."""
        s = fit.simulator
        if s.rows > LONG or motor_values(fit) is None or "i" not in s.outputs or "v" not in s.observed[0].inputs:
            return ()
        if any(o.is_measured for o in s.observed) or any(g.name.startswith("ripple v ") for g in fit.linear):
            return ()
        j, stretches = s.outputs.index("i"), stretches_of_voltage(fit)
        z = standing_out(fit)[:, j]
        parts = [(time, z[rows]) for rows, time in stretches]
        if not parts or not _levels(fit):
            return ()
        lines = strongest_lines(parts, s.clocks[0].step, (), 1)
        return [self._waves(fit, f, many) for f in lines if self._part(fit, f, j) > LEAST_PART for many in WAVES]

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the waves of the frequency that was found, as the motor follows them now."""
        f, many = group.name.split()[3:5]
        return dataclasses.replace(group, columns=self._waves(fit, float(f), int(many)).columns)

    def _part(self, fit: Fit, f: float, j: int) -> float:
        """Return which part of the voltage the first wave is, by an output, at the level where it is largest."""
        columns, own = self._waves(fit, f, 1).columns[:, j], np.where(fit.whitener.present, fit.residuals(), 0.0)[:, j]
        parts = [np.linalg.lstsq(columns[:, k : k + 2], own, rcond=None)[0] for k in range(0, columns.shape[1], 2)]
        return max((float(np.hypot(*part)) for part in parts), default=0.0)

    def _waves(self, fit: Fit, f: float, many: int) -> Linear:
        told, levels = _told_apart(fit, f, many), _levels(fit)
        voltage, torque = np.zeros((2, fit.simulator.rows, 2 * len(told) * len(levels)))
        late = [as_late(fit, level) for level in levels]
        for clock in fit.simulator.clocks:
            for c, (level, k) in enumerate(itertools.product(late, told)):
                for signal, held in zip((voltage, torque), held_for_wave(fit, clock, f * k), strict=True):
                    signal[clock.rows, 2 * c : 2 * c + 2] = level[clock.rows, None] * held
        columns = response(fit, voltage=voltage, torque=torque)
        return Linear(f"{NAME} {f:.8g} {many}", columns, ("",) * voltage.shape[1], least=-MOST_PART, most=MOST_PART)

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how fast it switches."""
        return f"the motor follows the drive's switching at {float(name.split()[3]):.6g} Hz, as sampled (PWM)"


def _told_apart(fit: Fit, f: float, many: int) -> list[int]:
    """Return the multiples of a frequency, of the first so many, that are not folded to rest, nor to another."""
    clock = min(fit.simulator.clocks, key=lambda clock: len(clock.time))
    turns, cycle = f * clock.step, CYCLES / len(clock.time)
    found: dict[int, float] = {}
    for k in range(1, many + 1):
        folded = abs(k * turns - round(k * turns))
        if folded > cycle and all(abs(folded - other) > cycle for other in found.values()):
            found[k] = folded
    return list(found)


def _levels(fit: Fit) -> list[FloatArray]:
    """Return the voltage where it has one of its levels and elsewhere 0, (rows,), of those that last longest."""
    s, v = fit.simulator, fit.simulator.inputs("v")
    found: list[tuple[int, int, FloatArray]] = []
    for clock in s.clocks:
        own = np.round(v[clock.rows], 9)
        for level, rows in zip(*np.unique(own, return_counts=True), strict=True):
            if level != 0 and rows >= STRETCH_ROWS:
                there = np.zeros(s.rows)
                there[clock.rows] = np.where(own == level, level, 0.0)
                found.append((-int(rows), len(found), there))
    return [there for _, _, there in sorted(found, key=lambda f: f[:2])[:LEVELS]]
