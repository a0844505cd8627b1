"""A short autoregression of whitened residuals, or of a filter: its coefficients. Knows series of numbers only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL

FloatArray = NDArray[np.float64]

ORDERS = (1, 2, 3, 4, 6, 8, 12, 16, 24)
FLOORS = tuple(10.0 ** (0.25 * k) for k in range(-48, -2))  # of the variance behind a filter: white noise beside it
PLAINLY = 0.5  # of the fall that an order must bring: squares of correlations that are together no more bring none


def autoregression(series: Sequence[FloatArray], count: int) -> tuple[FloatArray, float]:
    """Return coefficients and innovation deviation of `count` samples, zeros between, by Burg's method (1975) and BIC.

    It resolves a spectrum over many decades, as of filtered noise, where the Yule-Walker equations are biased.
    """
    most = max(ORDERS)
    power = sum(float(x @ x) for x in series) / max(count, 1)
    if count < 10 * most or power <= 0:
        return np.zeros(0), float(np.sqrt(power)) if power > 0 else 1.0
    if _is_white(series, count, power):
        return np.zeros(0), float(np.sqrt(power))
    best: tuple[float, FloatArray, float] = (0.0, np.zeros(0), power)
    a, error = np.zeros(0), power
    ahead, behind = list(series), list(series)
    for order in range(1, most + 1):
        pairs = [(f[1:], b[:-1]) for f, b in zip(ahead, behind, strict=True) if len(f) > 1]
        size = sum(float(f @ f + b @ b) for f, b in pairs)
        reflection = 2 * sum(float(f @ b) for f, b in pairs) / size if size > 0 else 0.0
        if not 0 < abs(reflection) < 1:
            break
        ahead, behind = [f - reflection * b for f, b in pairs], [b - reflection * f for f, b in pairs]
        a = np.concatenate([a - reflection * a[::-1], [reflection]])
        error *= 1 - reflection**2
        score = count * np.log(error / power) + order * np.log(count)
        if order in ORDERS and score < best[0] - LEAST_FALL:
            best = (float(score), a.copy(), error)
    return best[1], float(np.sqrt(best[2]))


def autoregressions_of_filter(response: FloatArray) -> list[tuple[FloatArray, float]]:
    """Return coefficients and innovation deviation of white noise behind a filter, of variance 1, with white noise.

    With each of `FLOORS` of it: that of digits, or of a sensor behind the filter. By the Yule-Walker equations of the
    filter's response to an impulse, (n,).
    """
    most = max(ORDERS)
    padded = np.concatenate([response, np.zeros(most + 1)])
    covariance = np.array([response @ padded[k : k + len(response)] for k in range(most + 1)])
    covariance /= covariance[0]
    apart = np.abs(np.subtract.outer(np.arange(most), np.arange(most)))
    found = []
    for floor in FLOORS:
        a = np.linalg.solve(covariance[apart] + floor * np.eye(most), covariance[1:])
        innovation = 1 + floor - float(a @ covariance[1:])
        if np.isfinite(a).all() and innovation > 0:
            found.append((a, float(np.sqrt(innovation / (1 + floor)))))
    return found


def innovations(series: Sequence[FloatArray], coefficients: FloatArray) -> FloatArray:
    """Return what an autoregression leaves of series, (n,) each, all together, where all that it needs is there.

    Missing samples of the series are NaN.
    """
    kernel = np.concatenate([[1.0], -coefficients])
    whole = [np.convolve(x, kernel, mode="valid") for x in series if len(x) >= len(kernel)]
    left = np.concatenate([np.zeros(0), *whole])
    return np.asarray(left[~np.isnan(left)])


def _is_white(series: Sequence[FloatArray], count: int, power: float) -> bool:
    """Whether correlations over few samples are so small that no order can bring what it must.

    Of small ones the squares are those of the reflections, each of which lowers -2 log L by so much a sample.
    """
    lags = np.arange(1, max(ORDERS) + 1)
    products = np.sum([np.correlate(np.append(x, np.zeros(len(lags))), x)[1:] for x in series], axis=0)
    falls = count * np.cumsum((products / (count * power)) ** 2)
    return bool(np.all(falls < PLAINLY * (LEAST_FALL + lags * np.log(count))))
