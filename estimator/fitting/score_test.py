"""Score test of further columns: how far z'z falls, to first order, all else fitted again. Knows no effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.projection import DEPENDENT, orthonormal
from estimator.fitting.simulator import CELLS
from estimator.fitting.whitener import Whitener

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ScoreTest:
    """Score test: how far z'z falls with further columns, to first order, all else fitted again (Rao 1948)."""

    whitener: Whitener
    basis: FloatArray
    left: FloatArray

    def across(self, columns: FloatArray) -> FloatArray:
        """Return (rows, q, c) columns whitened, without their part that the fit explains, (rows q, c)."""
        whitened = self.whitener.flat(columns)
        whitened -= self.basis @ (self.basis.T @ whitened)
        return whitened

    def rest(self, whitened: FloatArray) -> FloatArray:
        """Return whitened columns, (rows q, c), without their part that the fit explains."""
        return np.asarray(whitened - self.basis @ (self.basis.T @ whitened))

    def scores(self, columns: FloatArray, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Return the scores and the information, (c,) each, of (n, q, c) columns that are zero beside their rows."""
        rows, whitened = self.whitener.of_rows(columns, rows)
        q = columns.shape[1]
        along, power, _ = self.of_whitened(whitened, slice(rows.start * q, rows.stop * q))
        return along, power

    def of_whitened(self, whitened: FloatArray, at: slice = slice(None)) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return scores, information and squares, (c,) each, of whitened columns, (m, c), that are zero elsewhere."""
        known = self.basis[at].T @ whitened
        whole = np.einsum("nk,nk->k", whitened, whitened)
        power = whole - np.einsum("nk,nk->k", known, known)
        return whitened.T @ self.left[at], np.where(power > DEPENDENT * whole, power, 0.0), whole

    def scores_of(self, made: Callable[[FloatArray], FloatArray], values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return scores and information, (c,) each, of columns, (rows, q, c), made of c values, some at once."""
        many = max(1, CELLS // len(self.whitener.present))
        found = [self.scores(made(values[k : k + many])) for k in range(0, len(values), many)]
        along, power = (np.concatenate(part) for part in zip(*found, strict=True))
        return along, power

    def gain(self, across: FloatArray) -> tuple[float, FloatArray]:
        """Return the fall of z'z, and the coefficients, of a group of columns, (rows q, k), as `across` gives them."""
        q, r = orthonormal(across)
        size, norms = np.abs(np.diag(r)), np.linalg.norm(r, axis=0)
        if not np.all(size > 1e-6 * np.maximum(norms, 1e-300)) or not np.all(norms > 1e-9):
            return 0.0, np.zeros(across.shape[1])
        along = q.T @ self.left
        return float(along @ along), np.asarray(np.linalg.solve(r, along))


def likeliest(along: FloatArray, power: FloatArray) -> int:
    """Return which column lowers z'z most with a coefficient above 0, by `ScoreTest.scores`; 0 if none does."""
    return int(np.argmax(np.where((power > 1e-9) & (along > 0), along**2 / np.maximum(power, 1e-9), 0.0)))
