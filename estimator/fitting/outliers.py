"""Outliers among a fit's whitened residuals, held down by Student's t. Knows no effect."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, T_FREEDOM
from estimator.fitting.fit import Fit
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

OUTLIER, OUTLIER_BESIDE = 4.5, 3.0  # standard deviations of an outlier, 1 of 147 000 normal values; of those beside one
SOME = 1000  # rows that show how large the noise is
NEAR = 2  # rows: what shows in one row alone after an edge is no more than the signal changes in these


def held_down(fit: Fit, onsets: BoolArray) -> Fit:
    """Return the fit with outliers, which stand alone or two together, weighted by Student's t.

    Parameters
    ----------
    onsets : (rows,) array
        Rows after edges: residuals there are a misfit of the response, and no outliers, but for those of a single
        sample beyond what is simulated near it, or beyond both its neighbours where that only rises, or falls: no
        delay and no filter shows that.
    """
    # As if no outlier had a lower weight yet.
    z = np.abs(fit.z.reshape(fit.shown.shape)) * np.sqrt(fit.whitener.inflate)
    present = fit.whitener.present
    usual = [median(own[here]) / MEDIAN_SIZE if here.any() else 1.0 for own, here in zip(z.T, present.T, strict=True)]
    some = slice(None, None, max(1, len(z) // SOME))
    is_step = fit.simulator.steps > np.median(fit.whitener.deviation(some), axis=0)
    least = np.where(is_step, 1.0, 1e-3)  # the median of a few steps of a converter tells no size
    z /= np.clip(usual, least, 1.0)  # the noise is too large if outliers were in it
    inflate = np.ones_like(z)
    for j in range(z.shape[1]):
        far = np.flatnonzero(z[:, j] > OUTLIER)
        own, shown = z[far, j], fit.shown[:, j]
        before2, before, after, after2 = (_beside(z[:, j], far + k) for k in (-2, -1, 1, 2))
        one = np.maximum(before, after)
        two = np.minimum(np.maximum(before2, after), np.maximum(before, after2))
        first, last = np.maximum(far - 1, 0), np.minimum(far + 1, len(shown) - 1)
        deviation = fit.whitener.deviation(far)[:, j]
        steady = np.abs(shown[last] - shown[first]) / np.maximum(last - first, 1) < deviation
        beside = np.where(steady, np.minimum(one, two), one)  # two neighbours in a transient may be a misfit
        alone = (beside < OUTLIER_BESIDE) | (own > 4 * beside)
        for k in np.flatnonzero(alone & onsets[far]):
            away = _beyond(fit.simulator.measured[:, j], shown, int(far[k]))
            alone[k] = (one[k] < OUTLIER_BESIDE or own[k] > 4 * one[k]) and away > OUTLIER * deviation[k]
        if fit.simulator.steps[j] > 0:  # a sensor's resolution is no outlier
            alone &= np.abs(np.nan_to_num(fit.residuals()[far, j])) > fit.simulator.steps[j]
        inflate[far[alone], j] = (T_FREEDOM + own[alone] ** 2) / (T_FREEDOM + 1)
    return dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener, inflate=inflate))


def _beyond(measured: FloatArray, shown: FloatArray, k: int) -> float:
    """Return by how much a sample is beyond what is simulated near it, or its neighbours in a response that goes on."""
    near = shown[max(k - NEAR, 0) : k + NEAR + 1]
    away = max(near.min() - measured[k], measured[k] - near.max())
    rises, around = np.diff(near), measured[max(k - 1, 0) : k + 2 : 2]
    if np.all(rises >= 0) or np.all(rises <= 0):
        away = max(away, float(np.min(around)) - measured[k], measured[k] - float(np.max(around)))
    return float(away)


def _beside(z: FloatArray, at: NDArray[np.int64]) -> FloatArray:
    """Return residuals, (n,), at some rows; 0 beyond the first and the last."""
    return np.where((at >= 0) & (at < len(z)), z[np.clip(at, 0, len(z) - 1)], 0.0)
