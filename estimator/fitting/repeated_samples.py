"""Samples that a logger shows again, and whether most are: a channel is held, or quantised. Knows recordings alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.plans.plan import Observed
from estimator.recordings.quantum import quantum

FloatArray = NDArray[np.float64]

STANDSTILL_ROWS = 8  # rows without a count after which an encoder is taken to stand still: its error is constant there
LONGEST_HOLD = 20  # rows for which a logger may repeat a sample
HELD_PART = 0.98  # of the changes of a quantised channel, at every n-th row: it is held between
BY_CHANCE = 1e-6  # as many changes are at every n-th row of any n, by an encoder that the logger does not hold


def mostly_repeats(signals: Iterable[FloatArray]) -> bool:
    """Return whether most samples of signals, (n,) each, are as the one before."""
    changes = np.concatenate([np.diff(y[~np.isnan(y)]) for y in signals])
    return 2 * int(np.count_nonzero(changes == 0)) > len(changes)


def without_repeats(o: Observed, outputs: Sequence[str]) -> FloatArray:
    """Return the outputs, (n, q), NaN where a logger shows a sample again, noise and all.

    A channel that repeats values for a few rows, and is not quantised by a converter or an encoder, is held by the
    logger. A value that stays for longer is constant.
    """
    rows = o.compared[o.before :]
    held = np.zeros(rows.shape, dtype=bool)
    for j in range(rows.shape[1]):
        again = np.concatenate([[False], rows[1:, j] == rows[:-1, j]])
        lattice = again.any() and quantum(rows[:, j]) > 0
        if lattice:
            held[:, j] = _held(again)
        if not again.any() or held[:, j].any() or (lattice and outputs[j] != "w"):
            continue
        edges = np.flatnonzero(np.diff(np.concatenate([[False], again, [False]]).astype(np.int8)))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            stands = lattice and last - first >= STANDSTILL_ROWS and rows[first, j] == 0
            if stands or (not lattice and last - first <= LONGEST_HOLD):
                held[first:last, j] = True
    return np.where(held, np.nan, rows) if held.any() else rows


def _held(again: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the rows, (n,), that a logger shows again of a quantised channel: it changes every few rows only.

    Parameters
    ----------
    again : (n,) array
        Which rows are as the one before.
    """
    changes, rows = np.flatnonzero(~again[1:]) + 1, np.arange(len(again))
    for every in range(LONGEST_HOLD + 1, 1, -1):
        counts = np.bincount(changes % every, minlength=every)
        chance = LONGEST_HOLD * float(every) ** (1 - counts.max())
        if counts.max() >= HELD_PART * len(changes) and chance < BY_CHANCE:
            return np.asarray(rows % every != counts.argmax())
    return np.zeros(len(again), dtype=bool)
