"""Whether outputs answer to changes as it is explained: a score test of any further response. Knows no effect.

A channel that goes through a filter, a mean, a delay or a drive that nobody named shows

    y[k] + c0 (y[k] - y[k-1]) + c1 (y[k-1] - y[k-2]) + ...

of the explained signal y: some numbers c for any of them, as long as they act within the first samples after a change.
The differences of first to fifth order span the same, and depend on each other less.
These are where L is estimated, and where one sensor's filter stands for another's, or for the winding. z'z falls by a
chi-square number with as many degrees of freedom, if there is nothing (Rao 1948): of each channel, and of all together.
There the signals are largest, and how their noise grows is known worst: where what is left in these rows is larger than
the noise found, the test is Fisher's, by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.distributions import chi_square_limit, f_limit
from estimator.fitting.fit import Fit
from estimator.fitting.windows import find_windows

FloatArray = NDArray[np.float64]

RESPONSES = 5  # samples after a change, a number each
LEAST_OTHERS = 10  # samples: fewer do not tell how large the noise is there
DEPENDENT = 1e-6  # of the power of the columns, each of length 1: directions of less are not asked for


def unexplained_responses(fit: Fit, chance: float, channels: Sequence[int]) -> list[tuple[str, float]]:
    """Return the further responses that the residuals show; of an explanation that holds one with this chance.

    Each by its channel, "" for all together, and how much larger the root of its statistic is than its limit.

    Parameters
    ----------
    channels : those that are tested, whose residuals are noise; of counts that are right to the count they are none
    """
    outputs, test = [fit.simulator.outputs[j] for j in channels], fit.test()
    if not outputs:
        return []
    information, scores = test.together(fit.whitener.of_made(partial(_changes, fit, channels)))
    rows = find_windows(fit).sharp
    left = test.left.reshape(fit.shown.shape)[rows]
    present = fit.whitener.present[rows]
    groups = [(output, slice(RESPONSES * j, RESPONSES * (j + 1))) for j, output in enumerate(outputs)]
    if len(outputs) > 1:
        groups.append(("", slice(None)))
    found: list[tuple[str, float]] = []
    for output, own in groups:
        norms = np.sqrt(np.maximum(np.diag(information)[own], 0.0))  # rounding
        scale = np.where(norms > 0, 1 / np.where(norms > 0, norms, 1.0), 0.0)
        power, axes = np.linalg.eigh((information[own, own] * scale).T * scale)
        told = power > DEPENDENT
        along = axes[:, told].T @ (scale * scores[own])
        numbers, fall = max(1, int(told.sum())), float(np.sum(along**2 / power[told]))
        beside = [channels[outputs.index(output)]] if output else list(channels)
        ratio = float(np.sqrt(fall / _limit(left[:, beside][present[:, beside]], fall, numbers, chance / len(groups))))
        if ratio > 1 and (output or not found):
            found.append((output, ratio))
    return found


def _limit(left: FloatArray, fall: float, numbers: int, chance: float) -> float:
    """Return what a fall of z'z by so many numbers exceeds by this chance, with what is left where they act, (n,)."""
    others = len(left) - numbers
    limit = chi_square_limit(numbers, chance)
    square = (float(left @ left) - fall) / others if others >= LEAST_OTHERS else 1.0
    return max(limit, square * numbers * f_limit(numbers, others, chance)) if square > 1 else limit


def _changes(fit: Fit, channels: Sequence[int], rows: slice) -> FloatArray:
    """Return first, second, ... differences of each channel's explained signal, (n, q, all), at n rows."""
    result = np.zeros((rows.stop - rows.start, fit.shown.shape[1], RESPONSES * len(channels)))
    for clock in fit.simulator.clocks:
        first, last = max(rows.start, clock.rows.start), min(rows.stop, clock.rows.stop)
        begun = max(clock.rows.start, first - RESPONSES)  # the rows before of which differences are
        for at, j in enumerate(channels if first < last else ()):
            change = np.nan_to_num(fit.shown[begun:last, j])
            for k in range(RESPONSES):
                change = np.diff(change, prepend=change[:1])
                result[first - rows.start : last - rows.start, j, RESPONSES * at + k] = change[first - begun :]
    return result
