"""An angle that starts again with every turn, a counter or a clock that overflows → one that goes on. Knows no file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ONE_TURN = 2 * np.pi * 1.01  # rad: an angle that starts again spans no more
COUNTERS = (16, 32)  # bits of a counter that overflows
OVERFLOW = "its counter of {} bits overflows, and is counted on"
CLOCK_UNITS = (1.0, 1e-3, 1e-6)  # of a clock's counts, as they are logged
LATE = 3.0  # usual steps: a clock that overflows goes on by less
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


def counted_on(counts: FloatArray) -> tuple[FloatArray, int | None]:
    """Return counts as a counter shows them that does not overflow, and the bits of the one that does.

    Parameters
    ----------
    counts : (n,) array
        What a signed or unsigned counter showed, NaN where it is missing.

    Returns
    -------
    (n,) array
        The counts added up, from near zero: 2³² − 5 is −5; as they are where nothing overflows.
    int or None
        16 or 32; None if nothing overflows: no motor turns by half of a counter's range within a sample.
    """
    known = ~np.isnan(counts)
    values = counts[known]
    if len(values) < 2 or np.any(values != np.round(values)):
        return counts, None
    jump, span = float(np.max(np.abs(np.diff(values)))), float(np.ptp(values))
    for bits in COUNTERS:
        if 2.0 ** (bits - 1) < jump and span < 2.0**bits:
            whole = counts.copy()
            whole[known] = np.unwrap(values, period=2.0**bits) - 2.0**bits * np.round(values[0] / 2.0**bits)
            return whole, bits
    return counts, None


def clock_counted_on(times: FloatArray) -> tuple[FloatArray, int | None]:
    """Return times as a clock shows them that does not overflow, and the bits of the one that does.

    An Arduino's microseconds begin anew every 71.6 minutes, a timer's of 16 bits every 65.5 ms: then a time falls by as
    much, but for a usual step. Where it falls by another time, the logger began anew.

    Parameters
    ----------
    times : (n,) array
        In whatever unit, NaN where they are missing.
    """
    steps = np.diff(times)
    forward, falls = steps[steps > 0], steps[steps < 0]
    if not len(falls) or not len(forward) or len(falls) > len(forward) or not np.isfinite(times).all():
        return times, None
    usual = float(np.median(forward))
    for bits in COUNTERS:
        for unit in CLOCK_UNITS:
            period = unit * 2.0**bits
            if np.all((falls + period > 0) & (falls + period < LATE * usual)):
                return times + period * np.concatenate([[0.0], np.cumsum(steps < 0)]), bits
    return times, None
