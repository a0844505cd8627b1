"""Rows of a table that are the row before once more, noise and all. Knows signals, no file and no plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.quantum import quantum
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

BY_CHANCE = 1e-3  # such rows in a recording by chance, at most
FARTHEST, MOST_COMPARED = 100, 10_000_000  # rows between others that are compared; samples that are, at most
MOST = 0.02  # of the rows: more are a sensor that is read more often than it measures


def repeated_rows(inputs: Mapping[str, FloatArray], outputs: Mapping[str, FloatArray]) -> NDArray[np.int64]:
    """Return the rows, (k,), in which every signal is as in the row before; none where noise may do that by chance.

    Signals with independent noise of deviation s and steps of q are both as before with a chance of q / (2 √π s) each,
    or as often as one of them is where another is not, as a signal that is held is. If two rows that are not neighbours
    are alike, chance makes rows alike: then neighbours alone are, of 100 distances, with a chance of 1 in 100 at most.

    Parameters
    ----------
    inputs, outputs : name → (n,) array
        NaN where a sample is missing, which repeats nothing.
    """
    if len(outputs) < 2:
        return np.zeros(0, dtype=np.int64)
    signals = [*inputs.values(), *outputs.values()]
    again = np.array([np.concatenate([[False], y[1:] == y[:-1]]) for y in signals])
    both = np.asarray(again.all(axis=0))
    n, told = len(both), range(len(inputs), len(signals))
    expected = float(n)
    for j in told:
        others = np.asarray(~again[[k for k in told if k != j]].all(axis=0))
        others[0] = False
        alone = float(np.mean(again[j, others])) if others.any() else 1.0
        expected *= max(_chance(signals[j]), alone)
    usual = 0 < int(both.sum()) <= MOST * n and expected < BY_CHANCE
    return (
        np.flatnonzero(both) if usual and not _alike_apart([y[~both] for y in signals]) else np.zeros(0, dtype=np.int64)
    )


def _alike_apart(signals: Sequence[FloatArray]) -> bool:
    """Return whether two rows that are not neighbours are alike in all signals, (n,) each; neighbours are not."""
    n = len(signals[0])
    for apart in range(2, min(FARTHEST, n - 1, 2 + MOST_COMPARED // n) + 1):
        alike = np.ones(n - apart, dtype=bool)
        for y in signals:
            alike &= y[apart:] == y[:-apart]
        if alike.any():
            return True
    return False


def _chance(y: FloatArray) -> float:
    """Return the chance of a sample to be as the one before by its noise."""
    noise = noise_deviation(y)
    return min(1.0, quantum(y) / (2 * np.sqrt(np.pi) * noise)) if noise > 0 else 1.0


def written_once(time: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
    """Return the times, (n,), s, at which rows were taken if some were written twice and the clock counted them.

    What follows a row that is written twice was taken a step earlier than its clock says. The second one, which is
    left out, stands within the step.
    """
    steps = np.diff(time)
    taken = np.zeros(len(time))
    taken[rows] = 1.0
    counted = time - np.concatenate([[0.0], np.cumsum(steps * taken[1:])])
    kept = np.flatnonzero(taken == 0)
    within = np.interp(np.arange(len(time)), kept, counted[kept])
    last = kept[-1]  # behind it nothing is measured
    within[last + 1 :] = counted[last] + np.arange(1, len(time) - last) * 1e-3 * float(np.median(steps))
    return np.asarray(within)
