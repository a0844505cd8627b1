"""The times of one recording's rows, and its place among the rows of all. Knows no signal and no noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Clock:
    """The times, s, of one recording's rows, and its place among the rows of all."""

    time: FloatArray
    rows: slice

    @cached_property
    def step(self) -> float:
        """The usual sampling interval, s."""
        return median(np.diff(self.time)) if len(self.time) > 1 else 1.0

    @cached_property
    def steps(self) -> tuple[FloatArray, NDArray[np.int64] | None]:
        """The different steps, s, and which leads to each row; None: all are alike."""
        dt = np.diff(self.time)
        if not len(dt) or np.ptp(dt) < 1e-3 * self.step:
            return np.array([self.step]), None
        ticks = np.round(dt / (0.02 * self.step)) * (0.02 * self.step)  # to 2 % of a step
        steps, index = np.unique(np.maximum(ticks, 0.02 * self.step), return_inverse=True)
        return steps, np.concatenate([[0], index]).astype(np.int64)


def over_steps(signal: FloatArray, clocks: Sequence[Clock]) -> FloatArray:
    """Return the mean of each row of a signal, (rows,), and the next: what it is while an input is held."""
    later, last = np.append(signal[1:], signal[-1:]), [clock.rows.stop - 1 for clock in clocks]
    later[last] = signal[last]
    return np.asarray(0.5 * (signal + later))


def interval_shown(shown: NDArray[np.bool_]) -> int:
    """Return the usual distance of the rows, (n,), that show a signal: a logger may hold it for some."""
    rows = np.flatnonzero(shown)
    return round(median(np.diff(rows))) if len(rows) > 1 else 1
