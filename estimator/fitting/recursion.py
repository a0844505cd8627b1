"""A linear recursion over a signal's samples, at rest before the first. Knows no motor and no sampling rate.

SciPy's ``lfilter`` is the same, in a package whose import takes longer than the rest of a clean estimate's start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.fitting.kalman import filters

FloatArray = NDArray[np.float64]


def recursion(b: ArrayLike, a: ArrayLike, x: FloatArray) -> FloatArray:
    """Return y, (n,), of y[k] + a1 y[k-1] + a2 y[k-2] ... = b0 x[k] + b1 x[k-1] ..., all 0 before the first sample.

    Parameters
    ----------
    b : array
        b0, b1, ...
    a : array
        a1, a2, ...: without the 1 before y[k].
    x : (n,) array
        The signal.
    """
    b, a = np.asarray(b, dtype=np.float64), np.asarray(a, dtype=np.float64)
    x = np.ascontiguousarray(x, dtype=np.float64)
    y = np.empty_like(x)
    filters().recursion_run(len(x), len(b), len(a), b.ctypes.data, a.ctypes.data, x.ctypes.data, y.ctypes.data)
    return y
