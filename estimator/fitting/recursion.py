"""A linear recursion over a signal's samples, at rest before the first. Knows no motor and no sampling rate.

SciPy's ``lfilter`` is the same, in a package whose import takes longer than the rest of a clean estimate's start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dtbtrs

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
    n = len(x)
    right = np.zeros(n)
    for late, factor in enumerate(b.tolist()):
        right[late:] += factor * x[: max(0, n - late)]
    # As a band of a lower triangular matrix whose diagonal is 1, it is solved from the first row on, without pivoting.
    band = np.empty((1 + len(a), n), order="F")
    band[0], band[1:] = 1.0, a[:, None]
    y, _ = dtbtrs(band, right[:, None], uplo="L", diag="U", overwrite_b=True)
    return np.asarray(y[:, 0])
