"""Columns of many rows, made some rows at a time when they are asked for, and never held. Knows arrays only.

What least squares asks of columns are products of them: sums over rows, which part after part adds up to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

AT_ONCE = 20_000  # rows: their columns stay in a processor's cache


class Made:
    """Columns, (n, c), that are made when they are asked for.

    Parameters
    ----------
    make : callable
        A slice of rows, both ends given -> (rows, c) array.
    rows : int
        n.
    """

    def __init__(self, make: Callable[[slice], FloatArray], rows: int) -> None:
        self._make, self.shape = make, (rows, make(slice(0, 0)).shape[1])

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, at: slice) -> FloatArray:
        return self._make(slice(at.start or 0, len(self) if at.stop is None else min(at.stop, len(self))))

    def products(self, at: slice, others: FloatArray) -> FloatArray:
        """Return the scalar products, (c, d), with others that are zero beside some rows, (rows, d) or (rows,)."""
        return np.asarray(self[at].T @ others)


class Scaled(Made):
    """Columns, (n, c), that are rows of others, (n, k) each, times a factor of each row, (n,)."""

    def __init__(self, columns: Sequence[FloatArray], factors: FloatArray) -> None:
        self._columns, self._factors = columns, factors
        self.shape = len(factors), sum(own.shape[1] for own in columns)

    def __getitem__(self, at: slice) -> FloatArray:
        factors = self._factors[at]
        result = np.empty((self.shape[1], len(factors)))
        for k, column in enumerate(column for own in self._columns for column in own.T):
            np.multiply(column[at], factors, out=result[k])
        return result.T

    def products(self, at: slice, others: FloatArray) -> FloatArray:
        """Return the same; the factors go to the others, which may be fewer."""
        scaled = (others.T * self._factors[at]).T
        if others.ndim == 2 and others.shape[1] == 1:  # one vector is multiplied quicker than one column
            return np.concatenate([own[at].T @ scaled[:, 0] for own in self._columns])[:, None]
        return np.concatenate([own[at].T @ scaled for own in self._columns])


Columns = FloatArray | Made


def parts(*columns: Columns) -> Iterator[slice]:
    """Yield the rows of columns of one length part by part; all at once where all of them are held."""
    rows = max(len(columns[0]), 1)
    step = AT_ONCE if any(isinstance(c, Made) for c in columns) else rows
    yield from (slice(k, min(k + step, rows)) for k in range(0, rows, step))


def along(columns: Columns, at: slice, others: FloatArray) -> FloatArray:
    """Return the products, (c, d), of columns, (n, c), with others that are zero beside some rows, (rows, d)."""
    return columns.products(at, others) if isinstance(columns, Made) else np.asarray(columns[at].T @ others)


def products(some: Columns, others: Columns) -> FloatArray:
    """Return the scalar products, (c, d), of columns, (n, c) and (n, d) or (n,)."""
    if some is others:
        found = [own.T @ own for own in (some[at] for at in parts(some))]
    else:
        found = [along(some, at, others[at]) for at in parts(some, others)]
    return np.asarray(found[0] if len(found) == 1 else np.sum(found, axis=0))
