"""Jitter: the instants at which samples were taken are not known, told from whitened residuals. Knows arrays only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL
from estimator.recordings.samples import sum_of_logs

FloatArray = NDArray[np.float64]

STEEP = 12  # samples, where the signals are steep, that tell a jitter
NEIGHBOURS_ALIKE = 3.0  # standard deviations of their correlation: more is a misfit, no jitter
CAPPED = 25.0  # square of a residual: a larger one counts as this
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
    tried = step * np.geomspace(3e-3, 0.5, 24)
    squares = z * z
    # Rows whose slope is too small to change a sum of doubles cost the same at every jitter.
    steep_rows = np.any((tried[-1] * slope) ** 2 > 1e-17 * NOISE_FACTORS[0] ** 2, axis=1)
    flat = squares[~steep_rows]
    level = np.array(
        [len(flat) * np.log(f**2) + np.sum(np.minimum(flat / f**2, CAPPED), axis=0) for f in NOISE_FACTORS]
    )
    moved, hit = slope[steep_rows], squares[steep_rows]
    many = max(1, TOGETHER // max(hit.size, 1))

    def misfits(jitter: float) -> FloatArray:
        steep, costs = (jitter * moved) ** 2, []
        for factors in (NOISE_FACTORS[k : k + many] for k in range(0, len(NOISE_FACTORS), many)):
            variance = factors[:, None, None] ** 2 + steep
            costs.append(sum_of_logs(variance) + np.sum(np.minimum(hit / variance, CAPPED), axis=1))
        return np.asarray(np.concatenate(costs) + level)  # (sizes, q)

    costs = [misfits(t) for t in tried]
    k = int(np.argmin([c.min(axis=0).sum() for c in costs]))
    best, sizes = float(tried[k]), NOISE_FACTORS[costs[k].argmin(axis=0)]
    gain = float(misfits(0.0).min(axis=0).sum() - costs[k].min(axis=0).sum())
    steep = best * slope > sizes
    both = steep[1:] & steep[:-1]
    scaled = np.clip(z / np.sqrt(sizes**2 + (best * slope) ** 2), -3, 3)
    alike = float(np.sum((scaled[1:] * scaled[:-1])[both])) / float(np.sqrt(max(1, int(np.sum(both)))))
    if np.count_nonzero(steep) < STEEP or gain < 2 * LEAST_FALL or abs(alike) > NEIGHBOURS_ALIKE:
        return 0.0, np.ones(z.shape[1]), 0.0
    return best, np.where(steep.any(axis=0), sizes, 1.0), gain
