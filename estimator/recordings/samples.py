"""Signals with samples missing, NaN there: what is known of them, and what goes between. Knows no files, no motor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def filled(y: FloatArray) -> FloatArray:
    """Return a signal, (n,), with its missing samples on lines between the others; one at least must be there."""
    missing = np.isnan(y)
    if not missing.any():
        return y
    index = np.arange(len(y))
    return np.interp(index, index[~missing], y[~missing])


def mean_of_known(y: FloatArray) -> float:
    """Return the mean of the samples that are there; NaN where none is."""
    known = y[~np.isnan(y)]
    return float(np.mean(known)) if len(known) else float("nan")
