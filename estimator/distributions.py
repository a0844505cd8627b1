"""Chances and quantiles of the normal, the chi-square and the F distribution. Knows numbers only.

SciPy's ``special`` has them too, in a package whose import takes as long as a fifth of a clean estimate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ITERATIONS, LONGEST = 100, 1.0  # of a quantile; longest step of its logarithm
EXACT, CLOSE = 1e-15, 1e-12  # relative; of a limit, before its last step, which squares it
TERMS = 10_000  # of a continued fraction, at most: it needs some root of the degrees of freedom


def normal_chance(x: FloatArray) -> FloatArray:
    """Return the chances that standard normal numbers are below x, of any shape."""
    erfc, root = math.erfc, math.sqrt(2)
    flat = [0.5 * erfc(-value / root) for value in x.ravel().tolist()]
    return np.array(flat).reshape(x.shape)


def normal_quantile(chance: float) -> float:
    """Return what a standard normal number is below by a chance between 0 and 1."""
    if chance == 0.5:
        return 0.0
    tail, x = min(chance, 1 - chance), 0.0
    for _ in range(ITERATIONS):  # Newton's, from below the root of a convex function
        step = (0.5 * math.erfc(x / math.sqrt(2)) - tail) * math.sqrt(2 * math.pi) * math.exp(0.5 * x * x)
        x += step
        if abs(step) <= EXACT * x:
            break
    return x if chance > 0.5 else -x


def chi_square_beyond(degrees: int, x: float) -> float:
    """Return the chance that chi-square of whole degrees of freedom, 1 or more, is above x."""
    if x <= 0:
        return 1.0
    half, log_half = 0.5 * x, math.log(0.5 * x)
    total = math.erfc(math.sqrt(half)) if degrees % 2 else 0.0
    order = 0.5 if degrees % 2 else 0.0
    while order < 0.5 * degrees:  # Q(a + 1, x) = Q(a, x) + x^a e^-x / Gamma(a + 1)
        total += math.exp(order * log_half - half - math.lgamma(order + 1))
        order += 1
    return min(total, 1.0)


@lru_cache(maxsize=256)
def chi_square_limit(degrees: int, chance: float) -> float:
    """Return what chi-square is above by a chance."""

    def slope(x: float) -> float:
        return x * math.exp((0.5 * degrees - 1) * math.log(0.5 * x) - 0.5 * x - math.lgamma(0.5 * degrees)) / 2

    return _limit(lambda x: chi_square_beyond(degrees, x), slope, chance, float(degrees))


def f_beyond(above: float, below: float, x: float) -> float:
    """Return the chance that F, of degrees of freedom of its numerator and of its denominator, is above x."""
    a, b = 0.5 * below, 0.5 * above
    share = below / (below + above * x)
    if share < (a + 1) / (a + b + 2):
        return _beta_part(a, b, share)
    return 1 - _beta_part(b, a, above * x / (below + above * x))


@lru_cache(maxsize=256)
def f_limit(above: float, below: float, chance: float) -> float:
    """Return what F is above by a chance."""
    a, b = 0.5 * above, 0.5 * below
    log_beta = math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)

    def slope(x: float) -> float:
        ratio = above * x / below
        return math.exp(a * math.log(ratio) - (a + b) * math.log1p(ratio) - log_beta)

    z = normal_quantile(1 - chance)  # near the root: of the logarithm's normal approximation (Cornish and Fisher)
    start = math.exp(z * math.sqrt(2 / above + 2 / below))
    return _limit(lambda x: f_beyond(above, below, x), slope, chance, start)


def _limit(beyond: Callable[[float], float], slope: Callable[[float], float], chance: float, x: float) -> float:
    """Return where the chance to be beyond is as given; `slope`: by how much it falls for a unit of ln x."""
    for _ in range(ITERATIONS):  # Newton's, of the logarithms, whose function is concave
        there = beyond(x)
        step = (math.log(max(there, 1e-300)) - math.log(chance)) * there / max(slope(x), 1e-300)
        x *= math.exp(min(max(step, -LONGEST), LONGEST))
        if abs(step) <= CLOSE:
            break
    return x


def _beta_part(a: float, b: float, x: float) -> float:
    """Return the incomplete beta function I_x(a, b) for x < (a + 1) / (a + b + 2), by its continued fraction.

    Lentz's method; DLMF 8.17.22.
    """
    if x <= 0:
        return 0.0
    front = a * math.log(x) + b * math.log1p(-x) + math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    above, below = 1.0, 1 / _away(1 - (a + b) * x / (a + 1))
    value = below
    for m in range(1, TERMS):
        before = value
        for d in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            below, above = 1 / _away(1 + d * below), _away(1 + d / above)
            value *= above * below
        if abs(value - before) <= EXACT * abs(value):
            break
    return math.exp(front) * value / a


def _away(x: float) -> float:
    """Return a number that is not zero."""
    return x if abs(x) > 1e-300 else 1e-300
