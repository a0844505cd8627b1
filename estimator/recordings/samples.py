"""Signals with samples missing, NaN there: what is known of them, and what goes between. Knows no files, no motor."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
T = TypeVar("T")

REMEMBERED = 64  # signals of which something is told
LARGEST = 1e10  # in any unit: no sensor shows more, nor a counter of 32 bits
MULTIPLIED = 8  # numbers whose product has one logarithm: below 1e38 no double overflows


def filled(y: FloatArray) -> FloatArray:
    """Return a signal, (n,), with its missing samples on lines between the others; one at least must be there."""
    missing = np.isnan(y)
    if not missing.any():
        return y
    index = np.arange(len(y))
    return np.interp(index, index[~missing], y[~missing])


def median(y: FloatArray) -> float:
    """Return the median of (n,) numbers; NaN where one of them is, or none is there.

    As np.median does, which takes twice as long for some thousand and loads numpy.ma to look for masked arrays. About
    two numbers also where one is asked for: numpy's partition about one takes three to forty times as long, the most of
    numbers that nearly are alike, such as the steps of a clock.
    """
    if not len(y) or np.isnan(y).any():
        return float("nan")
    k = len(y) // 2
    part = np.partition(y, (k - 1, k))
    return float(part[k]) if len(y) % 2 else float((part[k - 1] + part[k]) / 2)


def median_of_known(y: FloatArray) -> float:
    """Return the median of the samples that are there; NaN where none is."""
    return median(y[~np.isnan(y)])


def medians(rows: FloatArray) -> FloatArray:
    """Return the median of each row, (m,), of (m, n) numbers that are all there."""
    k = rows.shape[1] // 2
    part = np.partition(rows, (k - 1, k), axis=1)
    return part[:, k] if rows.shape[1] % 2 else (part[:, k - 1] + part[:, k]) / 2


def quantile(y: FloatArray, part: float) -> float:
    """Return the quantile of those (n,) numbers that are there; NaN where none is.

    As np.nanquantile does, which loads numpy.ma to look for masked arrays.
    """
    known = y[~np.isnan(y)]
    if not len(known):
        return float("nan")
    at = part * (len(known) - 1)
    around = [int(at), min(int(at) + 1, len(known) - 1)]
    return float(np.interp(at, around, np.partition(known, around)[around]))


def sum_of_logs(numbers: FloatArray) -> FloatArray:
    """Return the sums of the logarithms of (m, n, ...) numbers, (m, ...): of products of a few, a logarithm is dear."""
    whole = numbers.shape[1] // MULTIPLIED * MULTIPLIED
    few = numbers[:, :whole].reshape(len(numbers), MULTIPLIED, -1, *numbers.shape[2:])
    together, rest = np.log(np.prod(few, axis=1)), np.log(numbers[:, whole:])
    return np.asarray(np.sum(together, axis=1) + np.sum(rest, axis=1))


def running_mean(y: FloatArray, *, width: int = 5) -> FloatArray:
    """Return the running mean over `width` samples, same length."""
    padded = np.pad(filled(y), width // 2, mode="edge")
    return np.convolve(padded, np.ones(width) / width, mode="valid")


def mean_of_known(y: FloatArray) -> float:
    """Return the mean of the samples that are there; NaN where none is."""
    known = y[~np.isnan(y)]
    return float(np.mean(known)) if len(known) else float("nan")


def told_once(told: Callable[[FloatArray], T]) -> Callable[[FloatArray], T]:
    """Decorate what tells something of a signal: each stage of an estimate asks for it again."""
    known: dict[tuple[int, int], T] = {}

    @wraps(told)
    def asked(y: FloatArray) -> T:
        key = len(y), hash(y.tobytes())
        if key not in known:
            if len(known) >= REMEMBERED:
                known.clear()
            known[key] = told(y)
        return known[key]

    return asked
