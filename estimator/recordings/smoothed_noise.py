"""How a resting signal was smoothed, sample by sample, as its noise tells. Knows signals alone.

White noise e that is smoothed has an autocorrelation of its own. Of a mean of n samples each difference of neighbours
is (e[k] - e[k-n]) / n: it correlates by -1/2 with the one n rows before, and with no other. Of exponential smoothing,
y[k] = a y[k-1] + (1 - a) e[k], neighbours correlate by a, and by nothing else beside that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ROWS = 100  # at rest: fewer tell no correlation
LONGEST = 50  # samples of a mean
BY_CHANCE = 4.5  # standard errors, 1 / sqrt n, of a correlation
LEAST = 0.15  # of a correlation: a smaller one is none


def samples_of_mean(y: FloatArray) -> int:
    """Return over how many samples a resting signal, (n,), is a running mean, as its noise tells; 1: it is none."""
    d = np.diff(y)
    most = min(LONGEST, len(d) // 4)
    power = float(d @ d)
    if len(y) < ROWS or power == 0:
        return 1
    r = np.array([float(d[lag:] @ d[: len(d) - lag]) / power for lag in range(1, most + 1)])
    error = max(BY_CHANCE / np.sqrt(len(d)), LEAST)
    n = 1 + int(np.argmin(r))
    others = np.delete(r, n - 1)
    is_mean = n > 1 and abs(r[n - 1] + 0.5) < error and np.max(np.abs(others), initial=0.0) < min(error, 0.35)
    return n if is_mean else 1


def part_kept(y: FloatArray) -> tuple[float, float]:
    """Return a of the exponential smoothing of a resting signal, (n,), and its standard error; (0, inf): it is none."""
    if len(y) < ROWS:
        return 0.0, np.inf
    off = y - np.mean(y)
    power = float(off @ off)
    if power == 0:
        return 0.0, np.inf
    one, two = (float(off[lag:] @ off[:-lag]) / power for lag in (1, 2))
    error = 1 / np.sqrt(len(y))
    beyond = (two - one**2) / (1 - one**2) if one < 1 else np.inf  # partial correlation over two rows
    if one < max(BY_CHANCE * error, LEAST) or abs(beyond) > BY_CHANCE * error:
        return 0.0, np.inf
    return one, float(np.sqrt(1 - one**2) * error)
