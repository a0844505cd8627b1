"""Speeds that are an encoder's counts, differenced: told by their steps, and by their errors. Knows signals alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.excitation import noise_deviation, quantum_and_error

FloatArray = NDArray[np.float64]

COUNTS, WHOLE = (16, 1e6), 0.02  # counts a turn of an encoder; by how much they may be no whole number
SIGMAS, NOT_TOLD = 3.0, 0.25  # standard errors of them, where few digits are printed; counts that are more tell nothing
MADE_UP, MADE_UP_ROWS, EDGE = (
    0.8,
    300,
    16.0,
)  # a ratio of variances; rows that tell it to a tenth; counts of an edge
BINOMIAL = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
FEW_COUNTS = 10  # noise of such a speed, in its steps: more noise was measured otherwise, and printed to 0.1 rpm


def are_differenced_counts(speeds: Sequence[FloatArray], intervals: Sequence[float]) -> bool:
    """Return whether speeds are an encoder's counts, differenced: in steps of 2π / (whole counts a turn) / interval.

    Few digits tell these steps roughly. Where any number of counts is nearly whole then, the samples' errors tell.

    Parameters
    ----------
    speeds : (n,) arrays
        Of one encoder, rad/s, NaN where a sample is missing.
    intervals : of each, s
    """
    found = []
    for w, interval in zip(speeds, intervals, strict=True):
        step, error = quantum_and_error(w)
        if step <= 0 or noise_deviation(w) > FEW_COUNTS * step:
            return False
        counts = 2 * np.pi / (step * interval)
        found.append((counts, max(counts * error / step, WHOLE / SIGMAS)))
    counts, errors = np.array(found).T
    mean, off = float(np.average(counts, weights=errors**-2)), SIGMAS * float(np.sum(errors**-2)) ** -0.5
    if not COUNTS[0] <= mean <= COUNTS[1]:
        return False
    whole = round(mean)
    is_whole = abs(mean - whole) < max(off, WHOLE) and bool(np.all(np.abs(counts - whole) < SIGMAS * errors))
    return is_whole if off <= NOT_TOLD else all(is_made_up_for(w / quantum_and_error(w)[0]) for w in speeds)


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
