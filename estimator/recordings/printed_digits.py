"""Voltages of a command that a program printed with two decimals: what each level is off by. Knows signals alone.

So an Arduino prints what it has computed of a duty cycle. A command that was chosen, such as 6 V or 7.25 V, is exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.signal_noise import is_measured

FloatArray = NDArray[np.float64]

DIGIT, CHOSEN = 0.01, 0.05  # V: two decimals; levels that are all multiples of it were chosen
MOST_LEVELS = 12  # values that a command takes: of more the errors average out
ROUNDING = 1e-6  # of a digit, by which a printed number is no multiple of it


def errors_of_digits(v: FloatArray) -> FloatArray | None:
    """Return the deviation in V of each level of a voltage, (n, k), where it was rounded to two decimals; None: no."""
    levels = np.unique(v[: 2 * MOST_LEVELS])
    levels = np.unique(v) if len(levels) <= MOST_LEVELS else levels
    levels = levels[levels != 0]
    if not 0 < len(levels) <= MOST_LEVELS or _off(levels, DIGIT) > ROUNDING or _off(levels, CHOSEN) < ROUNDING:
        return None
    if is_measured(v):
        return None
    return np.asarray((v[:, None] == levels) * (DIGIT / np.sqrt(12)))


def _off(levels: FloatArray, step: float) -> float:
    """Return by which part of a step the levels, (k,), are no multiples of it, at most."""
    return float(np.max(np.abs(levels / step - np.rint(levels / step))))
