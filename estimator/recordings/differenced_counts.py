"""Speeds that are an encoder's counts, differenced: told by their steps, and by their errors. Knows signals alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.quantum import quantum
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

COUNTS, WHOLE = (16, 1e6), 0.02  # counts a turn of an encoder; by how much they may be no whole number
NOT_TOLD = 0.1  # counts: where more are possible one of them is whole by chance
QUADRATURE = (
    4  # edges of an encoder's two channels a line: nearly all counts a turn are a multiple, by chance one of four
)
FINE = 5000  # counts a turn: more come of an encoder's two channels
SIGNIFICANT = (6, 5, 4, 3)  # digits behind the first that values are printed with, which is 1 where they are off most
EXACT, HALF = 1e-4, 0.51  # of a step: all digits are there, of single precision too; of a digit, that a value is off
MADE_UP, MADE_UP_ROWS = 0.8, 300  # a ratio of variances; rows that tell it to a tenth
EDGE = 16.0  # counts: a larger difference is no noise
BINOMIAL = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
NEARLY_WHOLE = 0.02  # counts: a speed that is printed with four digits more is off by less
TOLD_ROWS, MOST_ROWS = 12, 1000  # that tell counts of rows of their own intervals: 1e6 numbers pass by (2 * 0.02)^12
AT_ONCE = 20_000  # numbers that are tried
FEW_COUNTS = 10  # noise of such a speed, in its steps: more noise was measured otherwise, and printed to 0.1 rpm


def counts_a_turn(speeds: Sequence[FloatArray], intervals: Sequence[float]) -> float:
    """Return the counts a turn of an encoder, of whose differenced counts speeds are; 0: they are none.

    They are in steps of 2π / (whole counts a turn) / interval. Few digits tell these steps roughly: where one number of
    counts or another would nearly always be possible, the errors of neighbours tell.

    Parameters
    ----------
    speeds : (n,) arrays
        Of one encoder, rad/s, NaN where a sample is missing.
    intervals : of each, s
    """
    low, high = map(float, COUNTS)
    for w, interval in zip(speeds, intervals, strict=True):
        smallest, largest = _step_between(w)
        if not 0 < smallest <= largest or noise_deviation(w) > FEW_COUNTS * smallest:
            return 0.0
        turn = 2 * np.pi / interval
        low, high = max(low, turn / largest - WHOLE), min(high, turn / smallest + WHOLE)
    whole = np.arange(np.ceil(low), np.floor(high) + 1) if low <= high else np.zeros(0)
    if len(whole) == 0:
        return 0.0
    likely = QUADRATURE if whole[0] % QUADRATURE == 0 else 1.0 if whole[0] <= FINE else 0.0
    if high - low < likely * NOT_TOLD:
        return float(whole[0])
    turned = [w * interval * whole.mean() / (2 * np.pi) for w, interval in zip(speeds, intervals, strict=True)]
    return float(whole.mean()) if all(is_made_up_for(counts) for counts in turned) else 0.0


def counts_of_uneven_rows(w: FloatArray, time: FloatArray) -> float:
    """Return the counts a turn of an encoder, of whose counts over each row's own interval a speed is; 0: of none.

    As a loop tells it that divides the counts since its last round by the time since then, and prints that time: the
    least number by which all rows are whole counts. By chance another would be, once in 1e10 recordings.

    Parameters
    ----------
    w, time : (n,) arrays
        rad/s, NaN where a sample is missing; s.
    """
    turned = np.abs(w[1:]) * np.diff(time) / (2 * np.pi)
    turned = turned[np.isfinite(turned) & (turned > 0)]
    if len(turned) < TOLD_ROWS or len(np.unique(w)) < TOLD_ROWS:
        return 0.0
    few, many = turned[:: len(turned) // TOLD_ROWS], turned[:: max(1, len(turned) // MOST_ROWS)]
    for first in np.arange(*COUNTS, AT_ONCE):
        whole = np.arange(first, min(first + AT_ONCE, COUNTS[1]))
        for some in (few, many):
            counts = some[:, None] * whole
            whole = whole[np.max(np.abs(counts - np.rint(counts)), axis=0) < NEARLY_WHOLE]
        beside = whole[whole < 1.5 * np.min(whole, initial=np.inf)]  # of few counts a row one more a turn is as near
        if len(beside):
            counts = many[:, None] * beside
            return float(beside[np.argmin(np.sum((counts - np.rint(counts)) ** 2, axis=0))])
    return 0.0


def _step_between(w: FloatArray) -> tuple[float, float]:
    """Return the smallest and the largest step of whose multiples values, (n,), are printed; 0: there is none."""
    w = w[np.isfinite(w)]
    step = quantum(w)
    if step <= 0:
        return 0.0, 0.0
    levels = np.unique(np.abs(w))
    levels = levels[levels > 0.5 * step]
    if not len(levels):
        return step, step
    times = np.rint(levels / step)
    of_all = float(levels @ times / (times @ times))
    off = float(np.max(np.abs(levels - of_all * times)))
    if off < EXACT * step:  # six digits of some values leave the step to five
        reach = 2 * off / float(times[-1])
        return of_all - reach, of_all + reach
    digit = quantum(np.diff(w))
    decimals = [np.full(len(levels), digit)] if digit <= 0.5 * step else []
    decimals += [0.1**digits * levels for digits in SIGNIFICANT]  # then small values have finer ones
    for digits in decimals:
        low, high = _multiples_between(levels, step, digits)
        if low <= high:
            return low, high
    return step, step


def _multiples_between(levels: FloatArray, step: float, digits: FloatArray) -> tuple[float, float]:
    """Return between which steps values, (n,), rising, are multiples, about a step; each is off by up to half a digit.

    The first is the larger one where there is none.
    """
    low, high = step - digits[0], step + digits[0]
    for level, digit in zip(levels.tolist(), digits.tolist(), strict=True):
        middle = 0.5 * (low + high)
        k = round(level / middle)
        if k * (high - low) > 0.5 * middle:
            break  # its multiple is not known
        low, high = max(low, (level - HALF * digit) / k), min(high, (level + HALF * digit) / k)
        if low > high:
            break
    return low, high


def as_counted(w: FloatArray, interval: float, counts: float) -> FloatArray:
    """Return a speed, (n,), rad/s, as the counts that it was printed from: the digits of a level are all off alike."""
    step = 2 * np.pi / (counts * interval)
    printed = step * np.rint(w / step)
    return w if np.nanmax(np.abs(printed - w), initial=0.0) < EXACT * step else printed


def is_made_up_for(counts: FloatArray) -> bool:
    """Return whether what a sample of counts, (n,), has too many, its neighbour has too few, as differences have.

    By fourth differences, which leave little of the motion, over one row and over two: the variance of the second is
    140/252 of the first's where a sample is a whole number of counts less the last one, and as large where each is
    rounded by itself. Too few rows do not tell.
    """
    near = np.convolve(counts, BINOMIAL, "valid")[2:-2]
    far = np.convolve(counts, np.insert(BINOMIAL, range(1, 5), 0.0), "valid")
    largest = np.maximum(np.abs(near), np.abs(far))
    there = (largest > 0.5) & (largest < EDGE)  # what moves, and is no edge; a missing sample is neither
    is_less = float(far[there] @ far[there]) < MADE_UP * float(near[there] @ near[there])
    return is_less and int(np.count_nonzero(there)) >= MADE_UP_ROWS
