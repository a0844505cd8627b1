"""Score test of further columns: how far z'z falls, to first order, all else fitted again. Knows no effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.information import information_parts
from estimator.fitting.projection import DEPENDENT, Projection, triangle
from estimator.noise.in_parts import Columns, Scaled, along, parts, products
from estimator.noise.whitener import Whitener

FloatArray = NDArray[np.float64]

TOGETHER = 250_000  # rows of columns that are made at once, at most


@dataclass(frozen=True)
class ColumnScores:
    """Scores, information and squares, (c,) each, of whitened columns; their products with others, (f, c), if asked."""

    along: FloatArray
    power: FloatArray
    whole: FloatArray
    explained: FloatArray | None


@dataclass(frozen=True)
class ScoreTest:
    """Score test: how far z'z falls with further columns, to first order, all else fitted again (Rao 1948).

    Attributes
    ----------
    known : Projection
        On what the fit explains, whitened.
    left : (rows q,) array
        Whitened residuals, without what the fit explains.
    inside : (f,) array, optional
        Which of the fit's names that is, off their bounds; without, all.
    """

    whitener: Whitener
    known: Projection
    left: FloatArray
    inside: NDArray[np.bool_] | None = None

    def moves(self, explained: FloatArray) -> FloatArray:
        """Return by how much columns move the fit, (f, c), if they are there and left out.

        Parameters
        ----------
        explained : (f, c) array
            Their products with the fit's derivatives: those of this test, as parameters that stand in for each other
            make much of a small difference.
        """
        own = np.arange(len(explained)) if self.inside is None else np.flatnonzero(self.inside)
        own, result = own[self.known.independent], np.zeros_like(explained)
        result[own] = self._covariance @ explained[own]
        return result

    @cached_property
    def _covariance(self) -> FloatArray:
        return information_parts(self.known.factor)[0]

    def across(self, columns: FloatArray) -> FloatArray:
        """Return (rows, q, c) columns whitened, without their part that the fit explains, (rows q, c)."""
        return self.known.rest(self.whitener.flat(columns))

    def scores(self, columns: FloatArray, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Return the scores and the information, (c,) each, of (n, q, c) columns that are zero beside their rows."""
        if rows == slice(None):
            told = self.of_whitened(self.whitener.whitened(columns))
        else:
            rows, whitened = self.whitener.of_rows(columns, rows)
            told = self.of_whitened(whitened, first=rows.start * columns.shape[1])
        return told.along, told.power

    def of_whitened(self, whitened: Columns, *, first: int = 0, jacobian: Columns | None = None) -> ColumnScores:
        """Return what the test says of each of whitened columns, (m, c), that are zero beside m rows from the first.

        Parameters
        ----------
        jacobian : (rows q, f) columns, optional
            Whose products with them are told, too.
        """
        c, spanned = whitened.shape[1], self.known.spanned
        explained = None if jacobian is None else np.zeros((jacobian.shape[1], c))
        if isinstance(whitened, Scaled) and isinstance(spanned, Scaled) and isinstance(jacobian, Scaled | None):
            products, scores, whole = whitened.beside(spanned, self.left)
            if jacobian is not None and jacobian is not spanned:
                explained = whitened.beside(jacobian, self.left)[0]
        else:
            products, scores, whole = np.zeros((spanned.shape[1], c)), np.zeros(c), np.zeros(c)
            for at in parts(whitened):
                own, there = whitened[at], slice(first + at.start, first + at.stop)
                if not own.any():  # settled, whatever a delay or a filter is
                    continue
                products += along(spanned, there, own)
                scores += own.T @ self.left[there]
                whole += np.einsum("nk,nk->k", own, own)
                if explained is not None and jacobian is not None and jacobian is not spanned:
                    explained += along(jacobian, there, own)
        known = self.known.of_products(products)
        power = whole - np.einsum("nk,nk->k", known, known)
        power = np.where(power > DEPENDENT * whole, power, 0.0)
        return ColumnScores(scores, power, whole, products if jacobian is spanned else explained)

    def together(self, whitened: Columns) -> tuple[FloatArray, FloatArray]:
        """Return the information, (c, c), and the scores, (c,), of whitened columns, (rows q, c)."""
        c, spanned = whitened.shape[1], self.known.spanned
        information, products, scores = np.zeros((c, c)), np.zeros((spanned.shape[1], c)), np.zeros(c)
        for at in parts(whitened):  # each is made once
            own = whitened[at]
            information += own.T @ own
            products += along(spanned, at, own)
            scores += own.T @ self.left[at]
        known = self.known.of_products(products)
        return information - known.T @ known, scores

    def scores_of(
        self, made: Callable[[FloatArray], FloatArray], values: FloatArray, rows: slice = slice(None)
    ) -> tuple[FloatArray, FloatArray]:
        """Return scores and information, (c,) each, of columns, (n, q, c), made of c values, some at once.

        They are zero beside their rows.
        """
        many = max(1, TOGETHER // len(self.whitener.present[rows]))
        found = [self.scores(made(values[k : k + many]), rows) for k in range(0, len(values), many)]
        along, power = (np.concatenate(part) for part in zip(*found, strict=True))
        return along, power

    def gain(self, across: Columns) -> float:
        """Return the fall of z'z by a group of columns, (rows q, k), as `across` gives them."""
        r = triangle(across)
        size, norms = np.abs(np.diag(r)), np.linalg.norm(r, axis=0)
        if not np.all(size > 1e-6 * np.maximum(norms, 1e-300)) or not np.all(norms > 1e-9):
            return 0.0
        along = np.linalg.solve(r.T, products(across, self.left))
        return float(along @ along)


def likeliest(along: FloatArray, power: FloatArray) -> int:
    """Return which column lowers z'z most with a coefficient above 0, by `ScoreTest.scores`; 0 if none does."""
    return int(np.argmax(np.where((power > 1e-9) & (along > 0), along**2 / np.maximum(power, 1e-9), 0.0)))
