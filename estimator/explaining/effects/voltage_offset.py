"""The logged voltage has an offset: a converter's zero, a ground that floats. The motor stands where it shows one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import edges_of
from estimator.fitting.motor_response import late_response, motor_values

MOST_OFFSET = 0.2  # of the largest voltage
USUAL_OFFSET = 0.01  # of it
LEAST_ROWS, STANDS = 5, 0.01  # rows at rest; of the largest speed: less is none
TOLD, ALIKE = 5.0, 0.2  # standard errors that a voltage at rest has to be off zero; part by which recordings may differ


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
        columns = late_response(fit, -np.ones_like(v))[:, :, None]
        most = MOST_OFFSET * largest
        shown = _at_rest(fit, most)
        usual = max(USUAL_OFFSET * largest, shown)
        return [Linear(self.name, columns, ("V",), least=-most, most=most, size=usual, moves=True, foretold=shown > 0)]


def _at_rest(fit: Fit, most: float) -> float:
    """Return the size of the voltage that all recordings show, V, before their first change, while the motor stands.

    0 where one begins with another, shows none, or no speed.
    """
    s = fit.simulator
    if "w" not in s.outputs:
        return 0.0
    v, w = s.inputs("v"), s.measured[:, s.outputs.index("w")]
    span, fastest, shown = float(np.ptp(v)), float(np.nanmax(np.abs(w))), list[float]()
    for o, clock in zip(s.observed, s.clocks, strict=True):
        first = int(next(iter(edges_of(v[clock.rows], span)), 0))
        at = slice(clock.rows.start, clock.rows.start + first)
        if first < LEAST_ROWS or not abs(float(np.nanmean(w[at]))) < STANDS * fastest:
            return 0.0
        known = 0.0 if o.uncertain is None else float(np.linalg.norm(o.uncertain[0]))  # of a mean in the noise's place
        error = np.hypot(float(np.std(v[at])) / np.sqrt(first), known)
        level = float(np.mean(v[at]))
        if not TOLD * error < abs(level) <= most:
            return 0.0
        shown.append(level)
    alike = np.ptp(shown) <= ALIKE * np.max(np.abs(shown))
    return float(np.max(np.abs(shown))) if alike else 0.0
