"""Bounded nonlinear least squares by the trust-region reflective method, asked step by step. Knows arrays only.

    minimise  |r(x)|^2   over   low < x < high

(Branch, Coleman and Li 1999). It is the method of SciPy's ``least_squares``, and takes the same steps
(tests/test_trust_region.py), in a package whose import takes as long as a clean estimate. The steps are
``stepping/trust_region.h``'s, which a worker process takes by itself where it can.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.projection import triangle
from estimator.noise.kalman import filters

FloatArray = NDArray[np.float64]
Steps = Generator[tuple[FloatArray, bool], FloatArray, tuple[FloatArray, float] | None]

ASKS_RESIDUALS, ASKS_SLOPES, ENDED, ENDED_AT_KNOWN = range(4)  # as in trust_region.h


def steps(
    x: FloatArray,
    *,
    low: FloatArray,
    high: FloatArray,
    evaluations: int,
    ftol: float,
    xtol: float,
    known: tuple[FloatArray, float] | None = None,
) -> Steps:
    """Yield points at which residuals, or their derivatives, are asked; return the optimum and its sum of squares.

    So that whoever solves several problems can answer them all at once. Derivatives are asked at the point at which the
    residuals, (m,), were accepted last, as `triangle_of` them and these residuals.

    Parameters
    ----------
    x : (p,) array
        The start, inside the bounds.
    evaluations : int
        Of the residuals, at most.
    ftol, xtol : float
        The iteration ends when the sum of squares falls by less than ftol of itself, or x moves by less than xtol of
        itself.
    known : optional
        An optimum, (p,), and its sum of squares: a fit that comes next to it, or whose derivatives lead there, ends
        there and returns None, one that comes no nearer to its sum of squares ends where it stands.
    """
    p, c = len(x), filters()
    own = np.empty(c.fit_bytes(p) // 8 + 1)
    point = np.append(x, 0.0)
    low, high = (np.ascontiguousarray(bound, dtype=np.float64) for bound in (low, high))
    there, beside = (np.ascontiguousarray(known[0]), known[1]) if known is not None else (None, 0.0)
    where = None if there is None else there.ctypes.data
    place, end = own.ctypes.data, point.ctypes.data
    asked = c.fit_begin(place, p, evaluations, ftol, xtol, low.ctypes.data, high.ctypes.data, where, beside, end)
    while asked in (ASKS_RESIDUALS, ASKS_SLOPES):
        answer = yield point[:p].copy(), asked == ASKS_SLOPES
        if asked == ASKS_RESIDUALS:
            square = float(answer @ answer)
            asked = c.fit_take_cost(place, square if np.isfinite(square) else np.inf, len(answer), end)
        else:
            square_one = np.zeros((p + 1, p + 1))
            square_one[: len(answer)] = answer
            asked = c.fit_take_slopes(place, square_one.ctypes.data, len(answer), end)
    return None if asked == ENDED_AT_KNOWN else (point[:p].copy(), float(point[p]))


def triangle_of(jacobian: FloatArray, r: FloatArray) -> FloatArray:
    """Return R of [J r] = Q R, (k, p + 1), J (m, p): it has all scalar products of the columns and the residuals."""
    both = np.empty((len(r), jacobian.shape[1] + 1))
    both[:, :-1], both[:, -1] = jacobian, r
    return triangle(both)
