"""Columns of many rows, made some rows at a time when they are asked for, and never held. Knows arrays only.

What least squares asks of columns are products of them: sums over rows, which part after part adds up to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.noise.kalman import filters

FloatArray = NDArray[np.float64]

AT_ONCE = 20_000  # rows: their columns stay in a processor's cache
CHUNK = 512  # as in kalman.c


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
    """Columns, (n, c), that are others, (n,) each, less what they have in common, times a factor of each row, (n,).

    Their products are summed as they are read (kalman.c).

    Parameters
    ----------
    columns : sequence of (n,) arrays
    factors : (n,) array
    before : (n,) array, optional
        What is taken from each: they are its changes. Rows in which nothing changes cost nearly nothing; where the
        factor is 0, a number may be missing.
    """

    def __init__(self, columns: Sequence[FloatArray], factors: FloatArray, before: FloatArray | None = None) -> None:
        self.columns, self.factors, self.before = columns, np.ascontiguousarray(factors), before
        self.shape = len(factors), len(columns)

    def __getitem__(self, at: slice) -> FloatArray:
        factors = self.factors[at]
        result = np.empty((len(self.columns), len(factors)))
        firsts, strides = _places([column[at] for column in self.columns])
        before = None if self.before is None else self.before[at].ctypes.data
        for k in range(len(result)):
            filters().scaled_column(
                len(factors), factors.ctypes.data, int(firsts[k]), int(strides[k]), before, result[k].ctypes.data
            )
        return result.T

    def products(self, at: slice, others: FloatArray) -> FloatArray:
        """Return the same; the factors go to the others, which may be fewer."""
        if self.before is not None:
            return super().products(at, others)
        scaled = (others.T * self.factors[at]).T
        return np.array([own[at] @ scaled for own in self.columns])

    def gram(self) -> FloatArray:
        """Return the scalar products of all with each other, (c, c)."""
        c = len(self.columns)
        if self.before is not None:
            return np.asarray(sum((own.T @ own for own in (self[at] for at in parts(self))), np.zeros((c, c))))
        found, room, (first, strides) = np.empty((c, c)), np.empty((c, CHUNK)), _places(self.columns)
        arrays = (first, strides, room, found)
        filters().scaled_gram(len(self), self.factors.ctypes.data, c, *(a.ctypes.data for a in arrays))
        return found

    def beside(self, others: Scaled, left: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the scalar products of each with d others of the same factors, (d, c), with `left`, and with itself.

        Parameters
        ----------
        left : (n,) array, contiguous
        """
        d, (firsts, strides), (own, own_strides) = len(others.columns), _places(others.columns), _places(self.columns)
        found = np.empty((len(self.columns), d + 2))
        before = None if self.before is None else self.before.ctypes.data
        for k, told in enumerate(found):
            filters().scaled_products(
                len(self), self.factors.ctypes.data, int(own[k]), int(own_strides[k]), before, left.ctypes.data,
                d, firsts.ctypes.data, strides.ctypes.data, told.ctypes.data,
            )  # fmt: skip
        return found[:, :d].T, found[:, d], found[:, d + 1]

    def squares(self) -> FloatArray:
        """Return the scalar product of each with itself, (c,)."""
        return self.beside(Scaled([], self.factors), self.factors)[2]

    def chosen(self, which: NDArray[np.bool_]) -> Scaled:
        """Return some of the columns."""
        return Scaled([c for c, own in zip(self.columns, which, strict=True) if own], self.factors, self.before)

    def within(self, rows: NDArray[np.bool_]) -> Scaled:
        """Return the columns, zero beside some rows, (n,)."""
        return Scaled(self.columns, np.where(rows, self.factors, 0.0), self.before)


def _places(columns: Sequence[FloatArray]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the addresses of columns, (c,), and by how many numbers the rows of each are apart, (c,)."""
    firsts = np.array([column.ctypes.data for column in columns], dtype=np.int64)
    return firsts, np.array([column.strides[0] // column.itemsize for column in columns], dtype=np.int64)


Columns = FloatArray | Made


def parts(*columns: Columns) -> Iterator[slice]:
    """Yield the rows of columns of one length part by part; all at once where all of them are held."""
    rows = max(len(columns[0]), 1)
    return blocks(rows, AT_ONCE if any(isinstance(c, Made) for c in columns) else rows)


def blocks(rows: int, many: int = AT_ONCE) -> Iterator[slice]:
    """Yield so many rows after the other."""
    return (slice(k, min(k + many, rows)) for k in range(0, rows, many))


def among(columns: Columns, which: slice) -> Columns:
    """Return those of columns, (n, c), that a slice names."""
    if isinstance(columns, Scaled):
        return Scaled(columns.columns[which], columns.factors, columns.before)
    return Made(lambda at: columns[at][:, which], len(columns)) if isinstance(columns, Made) else columns[:, which]


def square(columns: Columns) -> float:
    """Return the sum of the squares of columns, (n, c)."""
    return (
        float(np.trace(products(columns, columns))) if isinstance(columns, Made) else float(np.vdot(columns, columns))
    )


def along(columns: Columns, at: slice, others: FloatArray) -> FloatArray:
    """Return the products, (c, d), of columns, (n, c), with others that are zero beside some rows, (rows, d)."""
    return columns.products(at, others) if isinstance(columns, Made) else np.asarray(columns[at].T @ others)


def products(some: Columns, others: Columns) -> FloatArray:
    """Return the scalar products, (c, d), of columns, (n, c) and (n, d) or (n,)."""
    if some is others and isinstance(some, Scaled):
        return some.gram()
    if some is others:
        found = [own.T @ own for own in (some[at] for at in parts(some))]
    else:
        found = [along(some, at, others[at]) for at in parts(some, others)]
    return np.asarray(found[0] if len(found) == 1 else np.sum(found, axis=0))
