"""A linear recursion over a signal's samples, at rest before the first. Knows no motor and no sampling rate.

SciPy's ``lfilter`` is the same, in a package whose import takes longer than the rest of a clean estimate's start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.noise.kalman import filters

FloatArray = NDArray[np.float64]


def recursion(b: ArrayLike, a: ArrayLike, x: FloatArray, *, in_place: bool = False) -> FloatArray:
    """Return y, (n,), of y[k] + a1 y[k-1] + a2 y[k-2] ... = b0 x[k] + b1 x[k-1] ..., all 0 before the first sample.

    Parameters
    ----------
    b : array
        b0, b1, ...; of several signals, (numbers, c), each signal's own, or the same of all.
    a : array
        a1, a2, ...: without the 1 before y[k]; likewise.
    x : (n,) array
        The signal; or (n, c), several, and y likewise.
    in_place : bool
        Of one signal, with up to three b and two a: y takes its place, which a long one has little room beside.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    b, a = (np.asarray(numbers, dtype=np.float64) for numbers in (b, a))
    if x.ndim == 2:
        wide = [numbers.reshape(len(numbers), -1) for numbers in (b, a)]
        b, a = (np.ascontiguousarray(np.broadcast_to(k, (len(k), x.shape[1]))) for k in wide)
    assert not in_place or (x.ndim == 1 and len(b) <= 3 and len(a) <= 2)
    y = x if in_place else np.empty_like(x)
    signals = 1 if x.ndim == 1 else x.shape[1]
    addresses = [array.ctypes.data for array in (b, a, x, y)]
    filters().recursion_run(len(x), signals, len(b), len(a), *addresses)
    return y
