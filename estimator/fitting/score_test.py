"""Score test of further columns: how far z'z falls, to first order, all else fitted again. Knows no effect."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.projection import DEPENDENT
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

    def scores(self, columns: FloatArray, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Return the scores and the information, (c,) each, of (n, q, c) columns that are zero beside their rows."""
        rows, whitened = self.whitener.of_rows(columns, rows)
        q = columns.shape[1]
        at = slice(rows.start * q, rows.stop * q)
        known = self.basis[at].T @ whitened
        whole = np.einsum("nk,nk->k", whitened, whitened)
        power = whole - np.einsum("nk,nk->k", known, known)
        return whitened.T @ self.left[at], np.where(power > DEPENDENT * whole, power, 0.0)

    def scores_of(self, columns: Iterable[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the scores and the information, (c,) each, of c columns, (rows, q), some of them at once."""
        rows, along, power = len(self.whitener.present), [], []
        rest = iter(columns)
        while first := list(islice(rest, max(1, CELLS // rows))):
            found = self.scores(np.stack(first, axis=2))
            along.append(found[0])
            power.append(found[1])
        return (np.concatenate(along), np.concatenate(power)) if along else (np.zeros(0), np.zeros(0))

    def gain(self, across: FloatArray) -> tuple[float, FloatArray]:
        """Return the fall of z'z, and the coefficients, of a group of columns, (rows q, k), as `across` gives them."""
        r = np.asarray(np.linalg.qr(np.column_stack([across, self.left]), mode="r"))
        k = across.shape[1]
        size = np.abs(np.diag(r)[:k])
        norms = np.linalg.norm(across, axis=0)
        if not np.all(size > 1e-6 * np.maximum(norms, 1e-300)) or not np.all(norms > 1e-9):
            return 0.0, np.zeros(k)
        return float(r[:k, k] @ r[:k, k]), np.asarray(np.linalg.solve(r[:k, :k], r[:k, k]))


def likeliest(along: FloatArray, power: FloatArray) -> int:
    """Return which column lowers z'z most with a coefficient above 0, by `ScoreTest.scores`; 0 if none does."""
    return int(np.argmax(np.where((power > 1e-9) & (along > 0), along**2 / np.maximum(power, 1e-9), 0.0)))
