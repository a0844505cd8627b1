"""An angle that starts again with every turn → one that goes on. Knows angles in rad only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ONE_TURN = 2 * np.pi * 1.01  # rad: an angle that starts again spans no more
COUNTABLE = 0.8 * np.pi  # rad a sample: faster, and the way it went is a guess


def starts_again(angle: FloatArray) -> bool:
    """Return whether an angle, (n,) rad with NaN where it is missing, is shown within one turn and jumps by it."""
    known = angle[~np.isnan(angle)]
    return bool(len(known) > 1 and np.ptp(known) <= ONE_TURN and np.max(np.abs(np.diff(known))) > np.pi)


def with_turns(angle: FloatArray) -> FloatArray:
    """Return the angle with its turns added up, (n,) rad."""
    known = ~np.isnan(angle)
    whole = angle.copy()
    whole[known] = np.unwrap(angle[known])
    return whole


def is_countable(angle: FloatArray) -> bool:
    """Return whether an angle, (n,) rad, whose turns are added up, moves by far less than half a turn a sample."""
    return bool(np.max(np.abs(np.diff(angle[~np.isnan(angle)])), initial=0.0) < COUNTABLE)
