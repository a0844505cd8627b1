"""A linear recursion over a signal's samples, at rest before the first. Knows no motor and no sampling rate.

SciPy's ``lfilter`` is the same, in a package whose import takes longer than the rest of a clean estimate's start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.noise.kalman import filters

FloatArray = NDArray[np.float64]


Sections = Sequence[tuple[Sequence[float], Sequence[float]]]  # b and a of each: up to three numbers, and two

MOST_SECTIONS = 2  # as in recursions.h


def behind(sections: Sections, x: FloatArray, shown: FloatArray) -> None:
    """Show a signal behind the sections of a filter, one after the other, each with a gain of 1.

    What was constant before the first number is shown as it is.

    Parameters
    ----------
    x : (n, c) array
        The signal, c numbers a row; of any strides, as no long signal is laid out anew.
    shown : (n,) array
        Takes what is shown with the last number of each row; it may lie where x does.
    """
    assert len(sections) <= MOST_SECTIONS and x.dtype == shown.dtype == np.float64 and len(x) == len(shown)
    given = np.zeros((len(sections), 5))
    for section, (b, a) in zip(given, sections, strict=True):
        section[: len(b)], section[3 : 3 + len(a)] = b, a
    apart = [stride // x.itemsize for stride in (*x.strides, *shown.strides)]
    addresses = given.ctypes.data, x.ctypes.data
    filters().sections_run(*x.shape, len(sections), *addresses, *apart[:2], shown.ctypes.data, apart[2])


def recursion(b: ArrayLike, a: ArrayLike, x: FloatArray) -> FloatArray:
    """Return y, (n,), of y[k] + a1 y[k-1] + a2 y[k-2] ... = b0 x[k] + b1 x[k-1] ..., all 0 before the first sample.

    Parameters
    ----------
    b : array
        b0, b1, ...; of several signals, (numbers, c), each signal's own, or the same of all.
    a : array
        a1, a2, ...: without the 1 before y[k]; likewise.
    x : (n,) array
        The signal; or (n, c), several, and y likewise.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    b, a = (np.asarray(numbers, dtype=np.float64) for numbers in (b, a))
    if x.ndim == 2:
        wide = [numbers.reshape(len(numbers), -1) for numbers in (b, a)]
        b, a = (np.ascontiguousarray(np.broadcast_to(k, (len(k), x.shape[1]))) for k in wide)
    y = np.empty_like(x)
    signals = 1 if x.ndim == 1 else x.shape[1]
    addresses = [array.ctypes.data for array in (b, a, x, y)]
    filters().recursion_run(len(x), signals, len(b), len(a), *addresses)
    return y
