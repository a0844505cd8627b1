"""Projection of columns of numbers on others. Knows arrays only."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import NDArray

from estimator.noise.in_parts import Columns, Made, parts, products
from estimator.noise.kalman import filters

FloatArray = NDArray[np.float64]

WELL_CONDITIONED, AT_ONCE = 1e-6, 1e-3  # least eigenvalue of a Gram matrix, its diagonal 1: by two steps, by one
BLOCK = 20_000  # rows whose triangular factor is found at once
DEPENDENT = 1e-12  # of a column's norm: a smaller remainder is rounding


class Projection:
    """Projection on columns, (n, m), by an orthonormal basis; columns that depend on earlier ones are left out.

    The basis is held, in `spanned`; of columns that are not held it is `spanned` @ `turned`, `spanned` the columns
    themselves, where their products lose few digits.
    """

    def __init__(self, columns: Columns) -> None:
        self.columns = self.spanned = columns
        self.turned: FloatArray | None = None
        if isinstance(columns, Made) and (factor := factor_of_products(columns)) is not None:
            self.factor, self.turned = factor, np.asarray(np.linalg.inv(factor))
            self.independent = np.arange(columns.shape[1])
            return
        basis, self.factor = orthonormal(columns[:])
        own = np.abs(np.diag(self.factor)) > DEPENDENT * np.linalg.norm(self.factor, axis=0)
        self.independent = np.flatnonzero(own)
        if not own.all():
            basis, self.factor = basis[:, own], self.factor[np.ix_(own, own)]
        self.spanned = basis

    def of_products(self, found: FloatArray) -> FloatArray:
        """Return products of the basis with columns, (k, c) or (k,), from those of `spanned`."""
        return found if self.turned is None else np.asarray(self.turned.T @ found)

    def along(self, others: Columns) -> FloatArray:
        """Return products of the basis, (k, c) or (k,), with others, (n, c) or (n,)."""
        return self.of_products(products(self.spanned, others))

    @overload
    def rest(self, others: FloatArray) -> FloatArray: ...

    @overload
    def rest(self, others: Columns) -> Columns: ...

    def rest(self, others: Columns) -> Columns:
        """Return the remainder of others, (n, c) or (n,), after projection on the columns."""
        spanned = self.spanned
        if not spanned.shape[1]:
            return others
        along = self.along(others)
        back = along if self.turned is None else self.turned @ along
        if isinstance(others, Made):
            return Made(lambda at: others[at] - spanned[at] @ back, len(others))
        result = np.empty(others.shape)
        for at in parts(spanned, others):
            np.subtract(others[at], spanned[at] @ back, out=result[at])
        return result

    def coefficients(self, r: FloatArray) -> FloatArray:
        """Return how much of each column, (m,), explains (n,) residuals best; 0 of dependent ones."""
        result = np.zeros(self.columns.shape[1])
        if len(self.independent):
            result[self.independent] = np.linalg.solve(self.factor, self.along(r))
        return result


def factor_of_products(columns: Columns) -> FloatArray | None:
    """Return the triangular factor, (m, m), of columns, (n, m), by their products; None where that loses digits."""
    if not 0 < columns.shape[1] < len(columns):
        return None
    return _factor(products(columns, columns), WELL_CONDITIONED)


def _factor(gram: FloatArray, least: float) -> FloatArray | None:
    """Return the triangular factor, (m, m), of a matrix of products, (m, m).

    None where that, its diagonal scaled to 1, has an eigenvalue that is not above `least`. For a small one LAPACK's
    routines cost a twentieth of what numpy spends around them.
    """
    gram = np.ascontiguousarray(gram)
    found = np.empty_like(gram)
    own = filters().gram_factor(len(gram), least, gram.ctypes.data, found.ctypes.data)
    return found if own else None


def triangle(columns: Columns) -> FloatArray:
    """Return the triangular factor r, (min(n, m), m), of columns, (n, m), = q r.

    By the Cholesky factor where that loses few digits; else, of many rows, block by block, and of the blocks' factors
    again, which copies no whole column (Demmel et al. 2012).
    """
    if (factor := factor_of_products(columns)) is not None:
        return factor
    blocks = [np.linalg.qr(columns[k : k + BLOCK], mode="r") for k in range(0, max(len(columns), 1), BLOCK)]
    return np.asarray(blocks[0] if len(blocks) == 1 else np.linalg.qr(np.vstack(blocks), mode="r"))


def orthonormal(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return q, (n, m), and triangular r, (m, m), of columns = q r; by the Cholesky factor where that loses no digits.

    For many columns it costs a quarter of Householder's method (Yamamoto et al. 2015).
    """
    n, m = columns.shape
    if m == 0:
        return columns, np.zeros((0, 0))
    gram = columns.T @ columns
    for least in (AT_ONCE, WELL_CONDITIONED) if m < n else ():
        if (r := _factor(gram, least)) is not None:
            q = columns @ np.linalg.inv(r)
            if least < AT_ONCE and (again := _factor(q.T @ q, least)) is not None:
                q, r = q @ np.linalg.inv(again), again @ r
            return np.asarray(q), np.asarray(r)
    q, r = np.linalg.qr(columns)
    return np.asarray(q), np.asarray(r)
