"""Where a sensor or its converter shows no more than its range. Knows one signal, no motor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, SECOND_DIFFERENCE
from estimator.recordings.quantum import quantum
from estimator.recordings.samples import filled, median
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

LEAST = 3  # noisy samples at the extreme value: two may be a logger's repeat
EACH = 0.9  # of a logger's samples, each shown the same number of times
REPEATS = 0.02  # of a signal's samples: a logger that repeats more than these says nothing at an extreme
LARGE = 0.2  # of the largest: a sample of a signal that is far from its rest
PAUSE = 2  # equal samples, at least
CARRIED, CARRIED_SPAN = 4.0, 0.01  # times the noise or the converter's step; of the span: so far it would have gone on
PAIR = 100.0  # times the digits, likewise: by chance two samples of such a slope are equal once in so many
JUMP = 1e-3  # of the span: a signal that comes nearer than that, as one that settles does, is not cut
HALF = 0.5
COARSE = 3.0  # times the converter's step: noise below that repeats values anyhow
TELLS_NOISE = 30  # samples between the extremes: fewer, of a coarse sensor's rise, seem to have noise
NEAR, SMOOTH = 3.0, 2  # deviations of the noise; samples on either side of a running median
FINE = 10.0  # times the digits: noise by which signals hardly have their extremes twice, and in common
AROUND_ZERO = 4  # samples on either side of one that is 0
OF_HALF = 0.25  # of samples around 0: so near to half are zeros; so many change to the next, at least
CUT = 0.05  # of the samples near the extreme: fewer are chance, and move their mean by 0.02 deviations of the noise


def shared_limits(signals: Sequence[FloatArray]) -> frozenset[float]:
    """Return the values at which one sensor's signals, (n,) each, are clipped: of one of them, or shared extremes.

    Each shows such an extreme twice or more, where noise is far above the digits: by chance one pair in 5 000 do.
    """
    if len(signals) < 2:
        return frozenset()
    found: list[float] = []
    for y in signals:
        extremes = float(np.nanmax(y)), float(np.nanmin(y))
        if (rows := clipped(y)).any():
            found += 2 * [v for v in extremes if np.any(rows & (y == v))]
        if _is_noisy(y, extremes, FINE):
            found += [v for v in extremes if v != 0 and np.count_nonzero(y == v) > 1]
    return frozenset(v for v in found if found.count(v) > 1)


def clipped(y: FloatArray, known: frozenset[float] = frozenset()) -> NDArray[np.bool_]:
    """Return which samples, (n,), of a signal are clipped, and those beside them, whose noise was cut.

    A clipped signal repeats its extreme value exactly where its noise would not, or enters and leaves it with slopes
    that would have carried it on. One that also pauses between its extremes, as a mean of what a slow encoder counts
    does, says nothing by it.

    Parameters
    ----------
    known : values at which the sensor is clipped in other recordings
    """
    shown = _shown_anew(y)
    if len(shown) < len(y):
        return np.repeat(clipped(y[shown], known), np.diff([*shown, len(y)]))
    result = np.zeros(len(y), dtype=bool)
    extremes = float(np.nanmax(y)), float(np.nanmin(y))
    ends = [(sign, value, y == value) for sign, value in zip((1.0, -1.0), extremes, strict=True) if value != 0]
    for sign, value, at in ends:
        if value in known:
            result |= _with_neighbours(sign * y, at)
    ends = [(sign, value, at) for sign, value, at in ends if np.count_nonzero(at) >= PAUSE]
    if not ends:  # most noise
        return result
    between = y[(y < extremes[0]) & (y > extremes[1])]
    noise, noisy = noise_deviation(between), _is_noisy(y, extremes, COARSE)
    paused = _pauses(y, digit=quantum(y), noise=noise)
    only_there = {*y[paused].tolist()} <= {*extremes}
    cut = set()
    for sign, value, at in ends:
        beside = (np.append(at[1:], False) | np.insert(at[:-1], 0, False)) & ~at & ~np.isnan(y)
        held = only_there and int(np.argmax(at)) in paused  # from when it is first there
        leaves = beside.any() and median(np.abs(y[beside] - value)) > JUMP * (extremes[0] - extremes[1])
        often = np.count_nonzero(at) > CUT * np.count_nonzero(sign * (value - y) < NEAR * noise)
        if (noisy and leaves and often and np.count_nonzero(at) >= LEAST) or held:
            cut.add(abs(value))
    for sign, value, at in ends:
        if abs(value) in cut:  # a range reaches as far on both sides
            result |= _with_neighbours(sign * y, at)
    return result


def _is_noisy(y: FloatArray, extremes: tuple[float, float], times: float) -> bool:
    """Whether a signal's noise, so many times its digits or more, keeps its samples between the extremes apart."""
    between = y[(y < extremes[0]) & (y > extremes[1])]
    if len(between) < TELLS_NOISE:
        return False
    large = np.abs(between) > LARGE * np.max(np.abs(extremes))  # at rest few digits repeat, too
    told = between[large] if np.count_nonzero(large) >= TELLS_NOISE else between
    if np.count_nonzero(np.diff(told) == 0) > REPEATS * len(told):
        return False
    bends = np.sign(np.diff(between, 2))
    turns = np.count_nonzero(bends[1:] * bends[:-1] < 0)  # of noise 73 %, of a smooth signal few
    return bool(turns > HALF * len(bends) and noise_deviation(between) > times * quantum(between))


def cut_at_zero(y: FloatArray) -> NDArray[np.bool_]:
    """Return which samples, (n,), of a signal are around 0 where its sensor shows nothing below, which cuts its noise.

    As that of a converter of one polarity does: zeros and small positive samples come in turn.
    """
    none = np.zeros(len(y), dtype=bool)
    zero = y == 0
    if np.nanmin(y, initial=0.0) < 0 or np.count_nonzero(zero) < TELLS_NOISE:
        return none
    noise = noise_deviation(y[y > LARGE * np.nanmax(y)])
    if not noise > COARSE * quantum(y):
        return none
    beside = np.lib.stride_tricks.sliding_window_view(np.pad(zero, AROUND_ZERO), 2 * AROUND_ZERO + 1).any(axis=1)
    around = beside & (y < NEAR * noise)
    turns, count = int(np.count_nonzero(np.diff(zero[around].astype(np.int8)))), int(np.count_nonzero(around))
    share = int(np.count_nonzero(zero)) / count
    is_cut = abs(share - HALF) < OF_HALF and turns > OF_HALF * count
    return around if is_cut else none


def limit(y: FloatArray, rows: NDArray[np.bool_]) -> float:
    """Return the value at which a signal's clipped samples are cut: that of most of them, of several the extreme."""
    values, counts = np.unique(y[rows], return_counts=True)
    often = values[counts == np.max(counts)]
    return float(often[np.argmax(np.abs(often - median(y[~np.isnan(y)])))])


def _pauses(y: FloatArray, *, digit: float, noise: float) -> NDArray[np.int64]:
    """Return the samples from which a signal stays though its slopes on both sides would have carried it on.

    A rounded top, and what settles, is entered or left too slowly for that; at 0 things stand still. Of a parabola n
    samples are equal to within a digit where its slopes would have carried it on by 2 n (n + 2) / (n - 1)^2 digits at
    most.
    """
    starts = np.flatnonzero(np.concatenate([[True], y[1:] != y[:-1]]))
    ends = np.append(starts[1:], len(y)) - 1
    inside = (ends - starts + 1 >= PAUSE) & (starts >= 2) & (ends < len(y) - 2) & (y[starts] != 0)
    starts, ends = starts[inside], ends[inside]
    into, out = y[starts - 1] - y[starts - 2], y[ends + 2] - y[ends + 1]
    on = (into * (y[starts] - y[starts - 1]) > 0) & (out * (y[ends + 1] - y[ends]) > 0)
    n, grain = ends - starts + 1, max(digit, noise)
    beyond = np.minimum(np.abs(into), np.abs(out)) * n / 2
    rounded = np.where(n == PAUSE, PAIR * digit, 2 * n * (n + 2) / (n - 1) ** 2 * grain)
    least = max(CARRIED * grain, CARRIED_SPAN * float(np.nanmax(y) - np.nanmin(y)))
    return np.asarray(starts[on & (beyond > np.maximum(rounded, least))])


def _shown_anew(y: FloatArray) -> NDArray[np.int64]:
    """Return the rows at which a logger that shows each sample so many times shows another; of others all rows."""
    starts = np.flatnonzero(np.concatenate([[True], y[1:] != y[:-1]]))
    lengths = np.diff(starts, append=len(y))
    if 2 * np.count_nonzero(lengths == 1) > len(lengths):  # their median is 1, which takes longer to find
        return np.arange(len(y))
    times = int(median(lengths)) if len(lengths) else 1
    if times < 2 or np.mean(lengths == times) < EACH:
        return np.arange(len(y))
    return np.concatenate([np.arange(a, a + n, times) for a, n in zip(starts, lengths, strict=True)])


def _with_neighbours(y: FloatArray, at: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return samples clipped at the largest value, with those around them that the noise may have brought below it."""
    top, low = float(np.nanmax(y)), float(np.nanmin(y))
    d = np.diff(np.where(at, np.nan, y), 2)[y[1:-1] > (top + low) / 2]
    d = d[~np.isnan(d)]
    noise = median(np.abs(d)) / MEDIAN_SIZE / SECOND_DIFFERENCE if len(d) else 0.0
    padded = np.pad(filled(y), SMOOTH, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * SMOOTH + 1), axis=1)
    near = at | (smooth > top - NEAR * noise)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
    result = np.zeros(len(y), dtype=bool)
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if at[first:last].any():
            result[max(0, first - 1) : last + 1] = True
    return result
