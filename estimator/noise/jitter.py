"""Jitter: the instants at which samples were taken are not known, told from whitened residuals. Knows arrays only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL
from estimator.recordings.samples import sum_of_logs

FloatArray = NDArray[np.float64]

SOME = 3  # every one of so many jitters is tried first
STEEP = 12  # samples, where the signals are steep, that tell a jitter
NEIGHBOURS_ALIKE = 3.0  # standard deviations of their correlation: more is a misfit, no jitter
CAPPED = 25.0  # square of a residual: a larger one counts as this
RESPONSE = 12  # samples after an edge in which something that is alike after all edges is no jitter
KNOWN = 0.9  # leverage: a residual of which so much is taken away tells nothing
FAINT = 1e-4  # of the least variance: the largest variance by jitter that a series of two terms tells to 1e-12
FEWER = 0.7  # of the rows: below it the others are left out of the sums
TOGETHER = 1_000_000  # numbers that factors are tried on at once
NOISE_FACTORS = np.geomspace(0.35, 1.2, 16)  # tried factors on a noise that was estimated with a jitter in it


def find_jitter(z: FloatArray, slope: FloatArray, step: float) -> tuple[float, FloatArray, float]:
    """Return the deviation of the samples' instants, s, factors on the rest of the noise, and the fall of -2 log L.

    A jitter makes residuals larger where the signals are steep, and leaves them independent: correlated neighbours are
    a misfit. 0 s where the instants are known.

    Parameters
    ----------
    z : (rows, q) array
        Whitened residuals without any jitter.
    slope : (rows, q) array
        Of the signals, in deviations of their noise a second; 0 where a sample is missing.
    step : float
        The sampling interval, s.
    """
    tried, none = step * np.geomspace(3e-3, 0.5, 24), (0.0, np.ones(z.shape[1]), 0.0)
    if np.count_nonzero(tried[-1] * np.abs(slope) > NOISE_FACTORS[0]) < STEEP:
        return none
    coarse = _costs(z, slope, tried[SOME - 1 :: SOME])
    if coarse[-1].min(axis=0).sum() - min(c.min(axis=0).sum() for c in coarse) < LEAST_FALL:
        return none  # between two of these it falls hardly further, and not by twice as much
    costs = _costs(z, slope, tried)
    k = int(np.argmin([c.min(axis=0).sum() for c in costs[-2::-1]]))
    found = costs[-2 - k]
    best, sizes = float(tried[k]), NOISE_FACTORS[found.argmin(axis=0)]
    gain = float(costs[-1].min(axis=0).sum() - found.min(axis=0).sum())
    steep = best * np.abs(slope) > sizes
    both = steep[1:] & steep[:-1]
    scaled = np.clip(z / np.sqrt(sizes**2 + (best * slope) ** 2), -3, 3)
    alike = float(np.sum((scaled[1:] * scaled[:-1])[both])) / float(np.sqrt(max(1, int(np.sum(both)))))
    if np.count_nonzero(steep) < STEEP or gain < 2 * LEAST_FALL or abs(alike) > NEIGHBOURS_ALIKE:
        return none
    return best, np.where(steep.any(axis=0), sizes, 1.0), gain


def _costs(z: FloatArray, slope: FloatArray, tried: FloatArray) -> list[FloatArray]:
    """Return -2 log L of each channel by each noise factor, (c, q), at tried jitters, the largest first, and at 0.

    Parameters
    ----------
    z, slope : as `find_jitter`
    tried : (n,) array
        Increasing, s.
    """
    factors = NOISE_FACTORS[:, None] ** 2
    # Rows whose slope is too small to change a sum of doubles cost the same at every jitter.
    ratio = np.maximum.reduce([own * own for own in slope.T]) / factors.min()
    moving = ratio * tried[-1] ** 2 > 1e-17
    ratio, v = ratio.compress(moving), _squares(slope, moving)  # channel by channel: sums are quicker
    level, x = _capped(_squares(z, ~moving), factors), _squares(z, moving)
    ratio[np.maximum.reduce(list(x)) > CAPPED * factors.min()] = np.inf
    moments, costs = np.zeros((2, 2, z.shape[1])), []
    for u in np.append(tried[::-1], 0.0) ** 2:
        # Of small slopes, as they are at every smaller jitter, a series of two terms: their moments are what counts.
        exact = ratio > FAINT / max(u, 1e-300)
        if np.count_nonzero(exact) < FEWER * len(exact):
            few, own = v.compress(~exact, axis=1), x.compress(~exact, axis=1)
            level = level + few.shape[1] * np.log(factors) + own.sum(axis=1) / factors
            moments += [[(w * few).sum(axis=1) for w in (1.0, own)], [(w * few * few).sum(axis=1) for w in (0.5, own)]]
            ratio, v, x = (rest.compress(exact, axis=-1) for rest in (ratio, v, x))
        (v1, x1), (v2, x2) = moments
        cost, many = [], max(1, TOGETHER // max(len(ratio), 1))
        for some in (factors[k : k + many] for k in range(0, len(factors), many)):
            told = []
            for square, by_slope in zip(x, u * v, strict=True):
                variance = some + by_slope
                told.append(sum_of_logs(variance) + np.minimum(square / variance, CAPPED).sum(axis=1))
            cost.append(np.stack(told, axis=1))
        series = u * (v1 - x1 / factors) / factors + u * u * (x2 / factors - v2) / factors**2
        costs.append(np.concatenate(cost) + level + series)  # (sizes, q)
    return costs


def _squares(signals: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
    """Return the squares of some rows of (n, q) signals, (q, m)."""
    found = signals.T.compress(rows, axis=1)
    found *= found
    return found


def without_responses(
    z: FloatArray, slope: FloatArray, transients: Sequence[NDArray[np.int32]]
) -> tuple[FloatArray, FloatArray]:
    """Return whitened residuals, and slopes, (rows, q) each, in their place, without what is alike after all edges.

    A filter that nobody named leaves residuals in proportion to the slope as well, in the k-th sample after every edge
    the same share of it: that mean is no jitter, and is taken away. What it takes of the variance is made up for
    (studentized residuals, Cook and Weisberg 1982); a single edge tells no jitter in the samples that follow.
    """
    firsts = [t[:RESPONSE] for t in transients]
    there = np.arange(RESPONSE) < np.array([len(rows) for rows in firsts], dtype=np.int64)[:, None]
    rows = np.concatenate([*firsts, np.zeros(0, dtype=np.int64)])
    steep, own = np.zeros((2, *there.shape, z.shape[1]))
    steep[there], own[there] = slope[rows], z[rows]
    power = np.sum(steep**2, axis=0)
    power = np.where(power > 0, power, 1.0)
    leverage = steep**2 / power
    left = own - steep * (np.sum(steep * own, axis=0) / power)
    told = leverage < KNOWN
    z[rows] = np.where(told, left / np.sqrt(np.maximum(1 - leverage, 1 - KNOWN)), 0.0)[there]
    slope[rows] = np.where(told, steep, 0.0)[there]
    return z, slope


def _capped(squares: FloatArray, factors: FloatArray) -> FloatArray:
    """Return what squares, (q, n), cost at variances, (c, 1), that are theirs without a jitter, (c, q)."""
    whole, result = squares.sum(axis=1), np.zeros((len(factors), len(squares)))
    for j, own in enumerate(squares):
        large = own[own > CAPPED * factors.min()]
        for k, (f,) in enumerate(factors):
            beyond = large[large > CAPPED * f]
            result[k, j] = (whole[j] - beyond.sum()) / f + CAPPED * len(beyond)
    return np.asarray(result + squares.shape[1] * np.log(factors))
