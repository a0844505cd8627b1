"""An input that moves smoothly, and what it is without its noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.on_lines import on_lines
from estimator.recordings.samples import told_once
from estimator.recordings.signal_noise import row_by_row

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LIKE_THE_LAST = 0.5  # correlation of each change with the one before, at least
JUMPED = 4.0  # times the changes beside it: more does no input that moves smoothly
NO_NOISE = 10.0  # times the noise: seven deviations of a change
SELDOM = 0.05  # of the rows: jumps are no more
BLOCKS, LEAST_BLOCKS = (1, 4, 16), 20  # rows whose means are compared; blocks of them
MOVED = 36.0  # times the noise's variance and the root of the rows: six deviations of what noise alone would show
WINDOWS, CUBIC = (5, 7, 11, 15, 21, 31, 43, 61, 87, 123, 175, 247, 351, 497), 3  # rows of a local polynomial
AGREED = 2.5  # deviations of what each number of them tells
CORNERS = 0.05  # of the rows


@told_once
def moves_smoothly(v: FloatArray) -> bool:
    """Whether an input, (n,), goes on as it went, beside its noise: no levels, whose edges are each a change alone.

    From row to row, or from block to block of them, where its noise hides what it does from row to row.
    """
    noise = row_by_row(v)
    for rows in BLOCKS if noise > 0 else BLOCKS[:1]:
        means = np.mean(v[: len(v) - len(v) % rows].reshape(-1, rows), axis=1)
        if len(means) < LEAST_BLOCKS:
            break
        moved, turned = _moves_and_turns(means, np.zeros(len(means), dtype=bool), noise / np.sqrt(rows))
        if moved > MOVED * noise**2 / rows * np.sqrt(len(means)):
            return turned < 2 * (1 - LIKE_THE_LAST) * moved
    return False


@told_once
def jumps(v: FloatArray) -> BoolArray:
    """Return the rows, (n,), at which an input jumps that moves smoothly else: by far more than before and after.

    All at which it changes where it goes from level to level.
    """
    jumped = np.zeros(len(v), dtype=bool)
    size = np.abs(np.diff(v))
    beside = np.maximum(np.append(0.0, size[:-1]), np.append(size[1:], 0.0))
    jumped[1:] = size > np.maximum(JUMPED * beside, NO_NOISE * row_by_row(v))
    if moves_smoothly(v):
        return jumped
    moved, turned = _moves_and_turns(v, jumped, row_by_row(v))
    if (
        np.mean(jumped) > SELDOM
        or moved < MOVED * row_by_row(v) ** 2 * np.sqrt(len(v))
        or turned > 2 * (1 - LIKE_THE_LAST) * moved
    ):
        jumped[1:] = size > 0
    return jumped


def _moves_and_turns(v: FloatArray, jumped: BoolArray, noise: float) -> tuple[float, float]:
    """Return the sums of squared changes of an input, and of their changes, without noise and without its jumps."""
    goes, variance = ~jumped[1:], noise**2
    change = np.diff(v)
    turn = np.diff(change)[goes[1:] & goes[:-1]]
    change = change[goes]
    return float(change @ change) - 2 * variance * len(change), float(turn @ turn) - 6 * variance * len(turn)


class Smoothed(NamedTuple):
    """An input without its noise, (n,), the deviation of that, and how many rows tell each row of it.

    Of one that goes along a few lines what is not known of it, (n, k), of a noise of 1, too.
    """

    signal: FloatArray
    noise: float
    rows: float
    errors: FloatArray | None = None


@told_once
def smoothed(v: FloatArray) -> Smoothed:
    """Return an input that moves smoothly, (n,), without its noise: by a few lines, or by local cubics.

    Cubics (Savitzky and Golay 1964) over as many rows as generalised cross-validation finds, corners left out (Craven
    and Wahba 1979); beside a corner over as many as agree with what fewer tell, within the noise (Goldenshluger and
    Nemirovski 1997).
    """
    from scipy.signal import savgol_coeffs, savgol_filter

    if (lines := on_lines(v, row_by_row(v))) is not None:
        return Smoothed(lines.signal, row_by_row(v), len(v) / lines.errors.shape[1], lines.errors)
    windows = [rows for rows in WINDOWS if rows < len(v)]
    smooth = [savgol_filter(v, rows, CUBIC, mode="interp") for rows in windows]
    own = [float(savgol_coeffs(rows, CUBIC)[rows // 2]) for rows in windows]  # a sample's part in what is told of it
    scores = [_without_largest((v - s) ** 2) / (1 - part) ** 2 for s, part in zip(smooth, own, strict=True)]
    quiet, noise = v.copy(), row_by_row(v)
    low, high = v - AGREED * noise, v + AGREED * noise
    agreed = np.ones(len(v), dtype=bool)
    for k in range(int(np.argmin(scores)) + 1 if scores else 0):
        error = AGREED * noise * np.sqrt(own[k])
        low, high = np.maximum(low, smooth[k] - error), np.minimum(high, smooth[k] + error)
        agreed &= low <= high
        quiet[agreed] = smooth[k][agreed]
    return Smoothed(quiet, noise, 1 / own[int(np.argmin(scores))] if scores else 1.0)


def _without_largest(squares: FloatArray) -> float:
    """Return the mean of squares without the largest of them."""
    kept = len(squares) - int(CORNERS * len(squares))
    return float(np.mean(np.partition(squares, kept - 1)[:kept]))
