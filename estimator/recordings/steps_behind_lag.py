"""A voltage that its sensor shows through a low-pass of first order: the levels that the motor had, and their edges.

A divider with a capacitor before the converter shows each step as an exponential that begins at once. A supply that
rises so slowly looks the same: what the motor does tells which it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.samples import median
from estimator.recordings.signal_noise import row_by_row

FloatArray = NDArray[np.float64]

MOVES = 7.0  # deviations of the noise, and LEAST_MOVE of the span: what moves more from row to row is in motion
LEAST_MOVE = 1e-3
CLEAR = 0.03  # of a change: what is left of it is read off down to this, and no nearer to a level than MOVES deviations
SETTLED = 5.0  # time constants after which the level is told
LEAST_ROWS = 3  # in which a change is on its way: fewer do not tell an exponential
AS_NOISY = 2.0  # times the noise, and PART of the change, by which an exponential may be off
PART = 0.01
ALIKE = 0.1  # of a time constant, by which those of changes differ at most
LEAST_NOISE = 1e-6  # of the span
MEDIAN_ERROR = 1.25  # of the median of n normal numbers, times sqrt n
MOST_CHANGES = 30  # of which each has two errors
BEGINS = 0.3  # of a row, by which the beginning may lie outside the row in which it is seen


class LaggedSteps(NamedTuple):
    """Levels that a sensor's low-pass has shown, held from row to row, (n,), and its time constant, s.

    In the row of an edge the voltage is its mean. `errors`, (n, k): what is not known of levels and edges, V, each of
    variance 1.
    """

    levels: FloatArray
    tau: float
    errors: FloatArray


class _Change(NamedTuple):
    """One change of level: when it begins, in rows, and its error; to which level, and its error; its tau in rows."""

    begins: float
    begins_error: float
    after: float
    after_error: float
    tau: float


def steps_behind_lag(v: FloatArray, step: float) -> LaggedSteps | None:
    """Return the steps that a voltage, (n,), shows as exponentials, `step` s from row to row; None: it shows none.

    All its changes have the same time constant, of a row or more, and it settles between them.
    """
    span = float(np.ptp(v)) if len(v) else 0.0
    noise = max(row_by_row(v), LEAST_NOISE * span)
    moving = np.flatnonzero(np.abs(np.diff(v)) > max(MOVES * noise, LEAST_MOVE * span)).tolist()
    if not span > 0 or not moving:
        return None
    begins, last = moving[:1], moving[0]
    for row in moving:
        if row - last > LEAST_ROWS + last - begins[-1]:  # what is still on its way does not pause for so long
            begins.append(row)
        last = row
    if len(begins) > MOST_CHANGES:
        return None
    changes = list[_Change]()
    first_level = before = median(v[: begins[0] + 1])
    for first, end in zip(begins, [*begins[1:], len(v) - 1], strict=True):
        change = _change(v[first : end + 1], before, noise)
        if change is None:
            return None
        changes.append(change._replace(begins=first + change.begins))
        before = change.after
    tau = float(np.median([c.tau for c in changes]))
    if any(abs(c.tau - tau) > ALIKE * tau for c in changes):
        return None
    levels, errors = np.full(len(v), first_level), np.zeros((len(v), 2 * len(changes)))
    for k, c in enumerate(changes):
        row = max(0, int(np.floor(c.begins)))
        size = c.after - levels[row]
        levels[row:] = c.after
        levels[row] -= size * max(c.begins - row, 0.0)
        errors[row:, : 2 * k] = 0.0
        errors[row:, 2 * k] = c.after_error
        errors[row, 2 * k + 1] = size * c.begins_error
    return LaggedSteps(levels, tau * step, errors)


def _change(v: FloatArray, before: float, noise: float) -> _Change | None:
    """Return the change of a voltage, (n,), from the level of its first row; None: it is no exponential."""
    n = len(v)
    after = median(v[n - max(1, n // 3) :])
    size = after - before
    if size == 0.0:
        return None
    left = (after - v) / size
    least = max(CLEAR, MOVES * noise / abs(size))
    on_its_way = np.append(False, np.cumprod(left[1:] > least) == 1) & (left < 1 - min(least, 0.5))
    rows = np.flatnonzero(on_its_way)
    if len(rows) < LEAST_ROWS:
        return None
    weights = left[rows]  # of a logarithm: the noise is as large anywhere
    (slope, begun), covariance = np.polyfit(rows, np.log(left[rows]), 1, w=weights * abs(size) / noise, cov="unscaled")
    if not slope < 0:
        return None
    tau, begins = -1 / float(slope), float(-begun / slope)
    if not (tau >= 1.0 and -BEGINS <= begins <= 1 + BEGINS and n > 2 * SETTLED * tau):
        return None
    shown = after - size * np.exp(-np.maximum(np.arange(1, n) - begins, 0.0) / tau)
    off = float(np.sqrt(np.mean((v[1:] - shown)[: int(SETTLED * tau)] ** 2)))
    if off > AS_NOISY * noise + PART * abs(size):
        return None
    along = np.array([begins, 1.0]) / slope  # by the slope and the logarithm at its beginning
    begins_error = float(np.sqrt(along @ covariance @ along))
    return _Change(begins, begins_error, after, MEDIAN_ERROR * noise / np.sqrt(max(1, n // 3)), tau)
