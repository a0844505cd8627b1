"""What least squares determine: (JᵀJ)⁻¹ of the directions that are seen, and of the others. Knows arrays only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.projection import triangle

FloatArray = NDArray[np.float64]

RANK_TOLERANCE = 1e-6  # of the largest singular value: smaller ones are the numerical noise of differences
OUTSIDE = 1e-3  # of a unit vector, in directions not determined: a smaller part is rounding


def information_parts(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (JᵀJ)⁻¹ in two parts, (p, p) each: of the directions that the data determine, and of the others.

    A direction is determined if its singular value, of the column-scaled Jacobian, is above RANK_TOLERANCE of the
    largest: below, the differences that the Jacobian is made of are noise. The second part is zero for parameters that
    lie in what is seen, and infinite where a column is zero.
    """
    scale, singular, rows = scaled_svd(jacobian)
    if not len(scale):
        return np.zeros((0, 0)), np.zeros((0, 0))
    floor = max(jacobian.shape) * np.finfo(float).eps * singular[0]
    inverse = 1 / np.maximum(singular, max(floor, 1e-150)) ** 2
    seen = singular > RANK_TOLERANCE * singular[0]

    def part(which: NDArray[np.bool_]) -> FloatArray:
        return np.asarray((rows[which].T * inverse[which]) @ rows[which] / np.outer(scale, scale))

    unseen = part(~seen)
    outside = np.linalg.norm(rows[~seen], axis=0) > OUTSIDE
    unseen *= np.outer(outside, outside)
    dead = ~jacobian.any(axis=0)
    unseen[dead, dead] = np.inf
    return part(seen), unseen


def scaled_svd(jacobian: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the columns' lengths, (p,), 1 for a zero one, and singular values and rows of J over them."""
    norms = np.sqrt(np.einsum("nk,nk->k", jacobian, jacobian))  # copies nothing
    scale = np.where(norms == 0, 1.0, norms)
    _, singular, rows = np.linalg.svd(triangle(jacobian) / scale)
    return scale, singular, rows
