"""Derivatives of weighted residuals by differences of candidates, whose simulations one batch holds. Knows no fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.plans.parameters import Box, unscaled

FloatArray = NDArray[np.float64]

DIFFERENCE_STEP = 1e-4  # of a parameter, or added to its logarithm


def beside(box: Box, x: FloatArray, *, central: bool) -> FloatArray:
    """Return the candidates, (..., p, p) or (..., 2 p, p), that differences at x, (..., p), need; some outside."""
    moved, x = _forward(box, x)[..., None] * np.eye(x.shape[-1]), x[..., None, :]
    return unscaled(np.concatenate([x + moved, x - moved], axis=-2) if central else x + moved, box.log)


def slopes(
    raw: FloatArray, box: Box, x: FloatArray, weights: FloatArray, at: FloatArray, *, central: bool
) -> FloatArray:
    """Return the derivatives of weighted residuals, (m, p), by the scaled parameters.

    Parameters
    ----------
    raw : (p, m) or (2 p, m) array
        Residuals of the candidates of `beside`.
    weights, at : (m,) array
        On the residuals, and the weighted ones at x.
    """
    p, forward = len(x), _forward(box, x)
    raw = raw * weights
    ahead = raw[:p]
    behind = raw[p:] if central else at[None, :]
    differences = ahead - behind
    if np.isfinite(differences).all():
        differences /= (forward * (2.0 if central else 1.0))[:, None]
        return np.ascontiguousarray(differences.T)
    behind = np.broadcast_to(behind, ahead.shape)
    columns = []
    for j in range(p):
        good_ahead, good_behind = np.isfinite(ahead[j]).all(), np.isfinite(behind[j]).all()
        if good_ahead and good_behind:
            columns.append((ahead[j] - behind[j]) / (forward[j] * (2.0 if central else 1.0)))
        elif good_ahead:
            columns.append((ahead[j] - at) / forward[j])
        elif good_behind and central:
            columns.append((at - behind[j]) / forward[j])
        else:
            columns.append(np.zeros_like(at))
    return np.column_stack(columns)


def _forward(box: Box, x: FloatArray) -> FloatArray:
    """Return the steps of differences, (..., p): ahead, or back where a bound is near."""
    steps = DIFFERENCE_STEP * np.where(box.log, 1.0, np.maximum(np.abs(x), 1e-3 * (box.high - box.low)))
    return np.asarray(np.where(x + steps <= box.high, 1.0, -1.0) * steps)
