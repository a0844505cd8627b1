"""Over how many samples a resting signal is a running mean, as its noise tells. Knows signals alone.

Of a mean of n samples with white noise e each difference of neighbours is (e[k] - e[k-n]) / n: it correlates by -1/2
with the one n rows before, and with no other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ROWS = 100  # at rest: fewer tell no correlation
LONGEST = 50  # samples of a mean
BY_CHANCE = 4.5  # standard errors, 1 / sqrt n, of a correlation
LEAST, MOST = 0.15, 0.35  # of a correlation: by a smaller one others differ from none; a larger one is none of theirs


def samples_of_mean(y: FloatArray) -> int:
    """Return over how many samples a resting signal, (n,), is a running mean, as its noise tells; 1: it is none."""
    d = np.diff(y)
    most = min(LONGEST, len(d) // 4)
    power = float(d @ d)
    if len(y) < ROWS or power == 0:
        return 1
    r = np.array([float(d[lag:] @ d[: len(d) - lag]) / power for lag in range(1, most + 1)])
    by_chance = BY_CHANCE / float(np.sqrt(len(d)))
    n = 1 + int(np.argmin(r))
    others = float(np.max(np.abs(np.delete(r, n - 1)), initial=0.0))
    is_told = -0.5 - max(by_chance, LEAST) < r[n - 1] < -max(by_chance, MOST)
    return n if is_told and others < min(max(by_chance, LEAST), MOST) else 1
