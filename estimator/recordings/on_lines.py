"""A noisy input that goes along a few lines, as ramps do: where their corners are, and what is known of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MOST_CORNERS = 6
PLACES, COARSE = 60, 500  # places at which the next corner is looked for, by the means of so many blocks of rows
LONGEST = 20_000  # rows
GROWING, ROUNDS, NEAR = 6, 30, 1e-4  # rounds in which corners are moved while there are more to come; until they stay
LEAST = 4.0  # rows between two corners
WORTH = 20.0  # of the misfit over the noise's variance: a corner brings more, of noise less than once in 10⁴
SEEN = 1e-9  # of the largest singular value: what differs from the others
NOISE_ALONE = 8.0  # standard errors of the misfit of noise alone, whose size is known half as well


class OnLines(NamedTuple):
    """An input on lines, (n,), and the deviations of what is not known of it, (n, k), of a noise of 1."""

    signal: FloatArray
    errors: FloatArray


def on_lines(v: FloatArray, noise: float) -> OnLines | None:
    """Return an input, (n,), with white noise of a deviation, on the lines that it goes along; None: it goes otherwise.

    Corners are added where they explain most, and moved together by Gauss and Newton's method, until noise is left.
    """
    n = len(v)
    if not noise > 0 or n > LONGEST:
        return None
    rows = np.arange(n, dtype=np.float64)
    blocks = max(1, n // COARSE)
    some = slice(0, n - n % blocks)
    few, few_rows = (np.mean(x[some].reshape(-1, blocks), axis=1) for x in (v, rows))
    fitted = _fitted(v, rows, np.zeros(0))
    while len(fitted.corners) < MOST_CORNERS:
        tried = np.linspace(0, n - 1, PLACES + 2)[1:-1]
        more = [np.sort(np.append(fitted.corners, c)) for c in tried if np.all(np.abs(fitted.corners - c) > LEAST)]
        if not more:
            break  # so few rows hold no more
        best = min((_moved(few, few_rows, corners, rounds=2) for corners in more), key=lambda f: f.misfit)
        best = _moved(v, rows, best.corners, rounds=GROWING)
        if fitted.misfit - best.misfit < WORTH * noise**2:
            break
        fitted = best
    if fitted.misfit > (n + NOISE_ALONE * np.sqrt(2 * n)) * noise**2:
        return None
    fitted = _moved(v, rows, fitted.corners)
    basis, sizes, _ = np.linalg.svd(fitted.columns, full_matrices=False)
    return OnLines(fitted.signal, basis[:, sizes > SEEN * sizes[0]])


class _Fitted(NamedTuple):
    signal: FloatArray
    corners: FloatArray
    columns: FloatArray  # derivatives by its numbers: lines, then places of corners
    misfit: float


def _fitted(v: FloatArray, rows: FloatArray, corners: FloatArray) -> _Fitted:
    """Return the likeliest lines with corners at these rows."""
    behind = rows[:, None] > corners
    lines = np.column_stack([np.ones_like(rows), rows, np.where(behind, rows[:, None] - corners, 0.0)])
    scale = np.max(np.abs(lines), axis=0)
    found = np.linalg.lstsq(lines / np.where(scale > 0, scale, 1.0), v, rcond=1e-12)[0]
    found = found / np.where(scale > 0, scale, 1.0)
    signal, bends = lines @ found, found[2:]
    left = v - signal
    return _Fitted(signal, corners, np.column_stack([lines, np.where(behind, -bends, 0.0)]), float(left @ left))


def _moved(v: FloatArray, rows: FloatArray, corners: FloatArray, *, rounds: int = ROUNDS) -> _Fitted:
    """Return the likeliest lines with corners near these rows."""
    best = _fitted(v, rows, corners)
    for _ in range(rounds):
        scale = np.max(np.abs(best.columns), axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        step = np.linalg.lstsq(best.columns / scale, v - best.signal, rcond=1e-9)[0] / scale
        by = step[len(step) - len(corners) :]
        share = 1.0
        while share > 1e-3:
            moved = np.sort(np.clip(best.corners + share * by, rows[1], rows[-2]))
            now = _fitted(v, rows, moved)
            if now.misfit < best.misfit:
                break
            share *= 0.5
        else:
            return best
        stays = float(np.max(np.abs(now.corners - best.corners))) < NEAR
        best = now
        if stays:
            break
    return best
