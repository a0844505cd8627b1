"""The mixture of what is possible, and the covariance that covers it.

Each explanation is possible with each addition or without any: of independent ones the weights multiply. About the
value that is printed their covariance is  sum w_m (C_m + d_m d_m')  (Buckland, Burnham and Augustin 1997; Hoeting et
al. 1999), each parameter scaled to hold 95 % of the mixture.

An addition that leaves a parameter where it is, is left out of that parameter's mixture: with it and without it the
parameter is the same, so that its weight belongs to both. Many such ones would make the few that move it look less
likely. So the weights differ from parameter to parameter; correlations are those of one weight for all.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import CONFIDENCE
from estimator.distributions import normal_chance, normal_quantile

FloatArray = NDArray[np.float64]

LITTLE = 0.1  # of a standard error: an addition that moves a parameter by less leaves it where it is
TAIL = 0.01  # of the mixture: what weighs less together is left out
FAR = 40.0  # standard deviations, beyond which there is nothing
FOUND, NEAR = 1e-14, 1e-9  # of half an interval, relative, and of what it holds: it is found


class Mixture:
    """Explanations, each with one of the additions or with none, on the parameters' scales about a value.

    Parameters
    ----------
    covariance : (p, p) array
        Of the explanation whose values are printed.
    """

    def __init__(self, covariance: FloatArray) -> None:
        nothing = np.zeros(len(covariance))
        self._explanations = [(0.0, nothing, covariance)]
        self._additions = [(0.0, nothing, np.zeros_like(covariance))]

    def add(self, behind: float, off: FloatArray, wider: FloatArray) -> None:
        """Note an addition that is `behind` in the evidence, moves the parameters by `off`, (p,), and adds `wider`."""
        self._additions.append((max(behind, 0.0), off, wider))

    def add_rival(self, behind: float, off: FloatArray, covariance: FloatArray) -> None:
        """Note another explanation whose parameters lie `off`, (p,), and have this covariance, (p, p)."""
        self._explanations.append((max(behind, 0.0), off, covariance))

    def weights(self) -> FloatArray:
        """Return what each explanation weighs, first the one whose values are printed, then the rivals as noted."""
        odds = np.exp(-0.5 * np.array([c for c, _, _ in self._explanations]))
        return np.asarray(odds / odds.sum())

    def covariance(self) -> FloatArray:
        """Return the covariance, (p, p), that covers the mixture."""
        own = np.diag(self._explanations[0][2])
        moves = np.array([off**2 + np.abs(np.diag(wider)) > LITTLE**2 * own for _, off, wider in self._additions])
        moves[0] = True
        off = np.array([d + more for _, d, _ in self._explanations for _, more, _ in self._additions])
        spread = np.array([c + wider for _, _, c in self._explanations for _, _, wider in self._additions])
        alike = self._of_all(np.asarray(moves.any(axis=1))[:, None])[:, 0]  # one weight for all keeps the correlations
        total = np.einsum("n,nab->ab", alike, spread + off[:, :, None] * off[:, None, :])
        return covering(total, self._of_all(moves), off, np.diagonal(spread, axis1=1, axis2=2))

    def _of_all(self, moves: NDArray[np.bool_]) -> FloatArray:
        """Return the weight of each explanation with each addition, (n, p), of those that move something, (a, p)."""
        odds = moves * np.exp(-0.5 * np.array([c for c, _, _ in self._additions]))[:, None]
        weights = self.weights()[:, None, None] * odds / odds.sum(axis=0)
        return _without_tail(weights.reshape(-1, moves.shape[1]))


def _without_tail(weights: FloatArray) -> FloatArray:
    """Return weights, (n, p), without the smallest: many small ones would change all correlations."""
    order = np.argsort(weights, axis=0)
    rising = np.take_along_axis(weights, order, axis=0)
    kept = np.empty_like(weights)
    np.put_along_axis(kept, order, np.where(np.cumsum(rising, axis=0) < TAIL, 0.0, rising), axis=0)
    return np.asarray(kept / kept.sum(axis=0))


def covering(total: FloatArray, weights: FloatArray, mean: FloatArray, variances: FloatArray) -> FloatArray:
    """Return a mixture's covariance scaled so that 1.96 standard errors hold 95 % of it, as those of a normal one do.

    Otherwise an unlikely rival far away would widen the interval without bound, and a likely one not enough.

    Parameters
    ----------
    total : (p, p) array
    weights, mean, variances : (n, p) arrays
        Of each parameter the parts; `mean` off the value that is printed.
    """
    some = weights.any(axis=1)  # the others add nothing
    weights, mean, deviation = weights[some], mean[some], np.sqrt(np.maximum(variances[some], 1e-300))
    quantile = normal_quantile(0.5 + CONFIDENCE / 2)
    low, high = np.zeros(len(total)), np.max(np.where(weights > 0, np.abs(mean) + 10 * deviation, 0.0), axis=0)
    wide = np.minimum(quantile * np.sqrt(np.maximum(np.diag(total), 1e-300)), high)
    for _ in range(100):  # Newton's; where that leaves what is known to hold it, halves of that
        ahead, behind = (np.clip(x / deviation, -FAR, FAR) for x in (wide - mean, wide + mean))
        inside = np.sum(weights * (normal_chance(ahead) - normal_chance(-behind)), axis=0)
        density = (np.exp(-0.5 * ahead**2) + np.exp(-0.5 * behind**2)) / (deviation * math.sqrt(2 * math.pi))
        slope = np.sum(weights * density, axis=0)
        low, high = np.where(inside < CONFIDENCE, wide, low), np.where(inside < CONFIDENCE, high, wide)
        step = (CONFIDENCE - inside) / np.maximum(slope, 1e-300)
        still = np.abs(step) <= FOUND * wide
        there = (still & (np.abs(inside - CONFIDENCE) < NEAR)) | (high - low <= FOUND * high)
        if there.all():
            break
        lost = still | ~((wide + step >= low) & (wide + step <= high))
        wide = np.where(there, wide, np.where(lost, 0.5 * (low + high), wide + step))
    wanted = wide / quantile
    now = np.sqrt(np.maximum(np.diag(total), 1e-300))
    scale = np.where(np.diag(total) > 0, wanted / now, 1.0)
    return np.asarray(total * np.outer(scale, scale))
