"""Where a sensor or its converter shows no more than its range. Knows one signal, no motor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, SECOND_DIFFERENCE
from estimator.recordings.excitation import noise_deviation, quantum, saturation
from estimator.recordings.samples import filled, median

FloatArray = NDArray[np.float64]

LEAST = 3  # samples at the extreme value: two may be a logger's repeat
EACH = 0.9  # of a logger's samples, each shown the same number of times
REPEATS = 0.02  # of a signal's samples: a logger that repeats more than these says nothing at an extreme
JUMP = 1e-3  # of the span: a signal that comes nearer than that, as one that settles does, is not cut
HALF = 0.5
COARSE = 3.0  # times the converter's step: noise below that repeats values anyhow
NEAR, SMOOTH = 3.0, 2  # deviations of the noise; samples on either side of a running median


def clipped(y: FloatArray) -> NDArray[np.bool_]:
    """Return which samples, (n,), of a signal are clipped, and those beside them, whose noise was cut.

    A clipped signal repeats its extreme value exactly where its noise would not, or enters and leaves it with slopes
    that would have carried it on.
    """
    shown = _shown_anew(y)
    if len(shown) < len(y):
        return np.repeat(clipped(y[shown]), np.diff([*shown, len(y)]))
    result = np.zeros(len(y), dtype=bool)
    top = saturation(y)
    extremes = float(np.nanmax(y)), float(np.nanmin(y))
    between = y[(y < extremes[0]) & (y > extremes[1])]
    repeats = np.count_nonzero(np.diff(between) == 0) > REPEATS * len(y)
    bends = np.sign(np.diff(between, 2))
    turns = np.count_nonzero(bends[1:] * bends[:-1] < 0) > HALF * len(bends)  # of noise 73 %, of a smooth signal few
    noisy = turns and not repeats and noise_deviation(between) > COARSE * quantum(between)
    for value in extremes:
        at = y == value
        beside = (np.append(at[1:], False) | np.insert(at[:-1], 0, False)) & ~at & ~np.isnan(y)
        leaves = beside.any() and median(np.abs(y[beside] - value)) > JUMP * (extremes[0] - extremes[1])
        if (
            np.count_nonzero(at) >= LEAST
            and value != 0
            and ((noisy and leaves) or (top is not None and top[2] == value))
        ):
            result |= at
    return _with_neighbours(y, result) if result.any() else result


def _shown_anew(y: FloatArray) -> NDArray[np.int64]:
    """Return the rows at which a logger that shows each sample so many times shows another; of others all rows."""
    starts = np.flatnonzero(np.concatenate([[True], y[1:] != y[:-1]]))
    lengths = np.diff(starts, append=len(y))
    times = int(median(lengths)) if len(lengths) else 1
    if times < 2 or np.mean(lengths == times) < EACH:
        return np.arange(len(y))
    return np.concatenate([np.arange(a, a + n, times) for a, n in zip(starts, lengths, strict=True)])


def _with_neighbours(y: FloatArray, at: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return clipped samples with those around them that the noise may have brought below the limit."""
    size, limit = np.abs(y), float(np.nanmax(np.abs(y[at])))
    d = np.diff(np.where(at, np.nan, size), 2)[size[1:-1] > limit / 2]
    d = d[~np.isnan(d)]
    noise = median(np.abs(d)) / MEDIAN_SIZE / SECOND_DIFFERENCE if len(d) else 0.0
    padded = np.pad(filled(size), SMOOTH, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * SMOOTH + 1), axis=1)
    near = at | (smooth > limit - NEAR * noise)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
    result = np.zeros(len(y), dtype=bool)
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if at[first:last].any():
            result[max(0, first - 1) : last + 1] = True
    return result
