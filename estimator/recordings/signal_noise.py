"""How large the noise of a signal is, of an input too, told by its neighbours in time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, SECOND_DIFFERENCE, STEP_DEVIATION
from estimator.recordings.quantum import quantum
from estimator.recordings.samples import median, told_once

FloatArray = NDArray[np.float64]

# Deviations of second, fourth, sixth and eighth differences of white noise of 1.
EVEN_DIFFERENCES = tuple(math.sqrt(math.comb(2 * order, order)) for order in (2, 4, 6, 8))
FEW_DIFFERENCES = 3  # fewer of a higher order tell nothing
LEAST_NOISE = 1e-6  # of the largest of an input: less is the rounding of a command
AT_SIGHT, FEW_LEVELS, APART = 100, 8, 0.1  # rows, levels of a command, and parts of its span that these are apart
FEW_MOVES = 50  # from value to value: fewer tell nothing
NEXT = 1.5  # times their median: larger ones are of the signal
BACK, AT_ONCE = 0.7, 0.2  # of these moves: those that go back, and in the next row; of noise at least 0.75 and 0.4
NORMAL_SPAN = 4.0  # standard deviations: normal noise spans more, a pseudo-random signal less


@told_once
def noise_deviation(y: FloatArray) -> float:
    """Return the standard deviation of a signal's white noise, from its second differences.

    Robust against the transient and outliers (median absolute deviation); a resting encoder, whose samples repeat
    exactly, is left out unless nothing else is there. Quantisation counts as noise of step/√12.
    """
    y = y[~np.isnan(y)]
    if len(y) < 5:
        return 0.0
    second = y[2:] - 2 * y[1:-1] + y[:-2]
    resting = (y[2:] == y[1:-1]) & (y[1:-1] == y[:-2])
    moving = second[~resting]
    if len(moving) < max(10, 0.05 * len(second)):
        moving = second
    deviation = median(np.abs(moving)) / MEDIAN_SIZE / SECOND_DIFFERENCE
    return max(float(deviation), quantum(y) / STEP_DEVIATION)


def is_measured(v: FloatArray) -> bool:
    """Whether an input has noise, as what is measured has, and no command."""
    return input_noise(v) > LEAST_NOISE * float(np.max(np.abs(v), initial=0.0))


def input_noise(v: FloatArray) -> float:
    """Return the deviation of an input's noise; 0 for levels that repeat exactly, and where it moves in every row."""
    noise = row_by_row(v)
    return 0.0 if is_restless(v, noise) else noise


def row_by_row(v: FloatArray) -> float:
    """Return the deviation of what an input does from row to row, be it noise or not.

    Rows of exactly none show no noise: a converter's at rest, or those in which the voltage is the motor's own. What
    goes between a few levels has none, however often it does.
    """
    if _goes_between_levels(v):
        return 0.0
    x = v[v != 0]
    sizes: list[float] = []
    for of_white in EVEN_DIFFERENCES:  # a wave of few rows has large second differences
        x = x[2:] - 2 * x[1:-1] + x[:-2]
        if len(x) < (FEW_DIFFERENCES if sizes else 1):
            break
        sizes.append(median(np.abs(x)) / MEDIAN_SIZE / of_white)
    return min(sizes, default=0.0) or _between_neighbours(v)


def _between_neighbours(v: FloatArray) -> float:
    """Return the deviation of what goes back and forth between values beside each other, (n,); 0: it does not.

    As a converter's samples of a noise that is smaller than its steps: most of them are alike.
    """
    changes = np.diff(v[v != 0])
    moves = changes[changes != 0]
    if len(moves) < FEW_MOVES:
        return 0.0
    one_step = NEXT * median(np.abs(moves))
    small = np.where(np.abs(changes) < one_step, changes, 0.0)
    at = np.flatnonzero(small)
    goes_back = small[at][1:] * small[at][:-1] < 0  # a ramp in steps goes on
    if np.mean(goes_back) < BACK or np.mean(np.diff(at) == 1) < AT_ONCE:  # a signal that is held goes back later
        return 0.0
    return float(np.sqrt(0.5 * np.mean(small * small)))


def _goes_between_levels(v: FloatArray) -> bool:
    """Whether an input, (n,), has a few levels, which are further apart than noise would take it."""
    if len(np.unique(v[:AT_SIGHT])) > FEW_LEVELS:
        return False
    levels = np.unique(v)
    return 1 < len(levels) <= FEW_LEVELS and bool(np.min(np.diff(levels)) > APART * (levels[-1] - levels[0]))


def is_restless(v: FloatArray, noise: float) -> bool:
    """Return whether an input moves in every row: no noise around a level spans so little of its own deviation."""
    return float(np.ptp(v)) < NORMAL_SPAN * noise
