"""Outliers among a fit's whitened residuals, held down by Student's t. Knows no effect."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, T_FREEDOM
from estimator.fitting.fit import Fit
from estimator.recordings.samples import median

BoolArray = NDArray[np.bool_]

OUTLIER, OUTLIER_BESIDE = 4.5, 3.0  # standard deviations of an outlier, 1 of 147 000 normal values; of those beside one


def held_down(fit: Fit, onsets: BoolArray) -> Fit:
    """Return the fit with outliers, which stand alone or two together, weighted by Student's t.

    Parameters
    ----------
    onsets : (rows,) array
        Rows after edges: residuals there are a misfit of the response, and no outliers.
    """
    # As if no outlier had a lower weight yet.
    z = np.abs(fit.z.reshape(fit.shown.shape)) * np.sqrt(fit.whitener.inflate)
    present = fit.whitener.present
    usual = [median(own[here]) / MEDIAN_SIZE if here.any() else 1.0 for own, here in zip(z.T, present.T, strict=True)]
    least = np.where(fit.simulator.coarse, 1.0, 1e-3)  # the median of a few steps of a converter tells no size
    z = z / np.clip(usual, least, 1.0)  # the noise is too large if outliers were in it
    n = len(z)
    far = np.vstack([np.zeros((2, z.shape[1])), z, np.zeros((2, z.shape[1]))])
    one, *two = (np.maximum(far[2 + a : 2 + a + n], far[2 + b : 2 + b + n]) for a, b in ((-1, 1), (-2, 1), (-1, 2)))
    steady = np.abs(np.gradient(fit.shown, axis=0)) < fit.whitener.noise.deviation(fit.whitener.level)
    beside = np.where(steady, np.minimum(one, np.minimum(*two)), one)  # two neighbours in a transient may be a misfit
    alone = (z > OUTLIER) & ((beside < OUTLIER_BESIDE) | (z > 4 * beside))
    alone &= ~onsets[:, None]
    alone &= np.abs(np.nan_to_num(fit.residuals())) > fit.simulator.steps  # a sensor's resolution is no outlier
    inflate = np.where(alone, (T_FREEDOM + z * z) / (T_FREEDOM + 1), 1.0)
    return dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener, inflate=inflate))
