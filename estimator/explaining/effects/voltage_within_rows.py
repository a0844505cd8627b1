"""The voltage moves within each sampling interval, of which the recording shows the mean: a current loop's output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values, response_within_rows

FloatArray = NDArray[np.float64]

MOST = 4.0  # times the slope from row to row: a voltage that falls off within a part of a row falls faster there
LEAST_CHANGE = 1e-3  # of the largest voltage: what moves less from row to row is held, or as good as that


@dataclass(frozen=True)
class VoltageWithinRows(Effect):
    """How much the voltage moves within a row, over the smaller of its changes to the rows beside.

    The larger one holds an edge, which lies between two rows. Where a controller takes the voltage back while the
    current rises, much of that is done within the first row.
    """

    name: str = "voltage within rows"
    prior: float = 0.1
    sharp: bool = True  # delays and lags would explain a part of it
    sentence: str = (
        "the voltage moves within the sampling intervals, of which the recording shows the mean: {value:.2g} times as"
        " much as from one to the next"
    )

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings, where the voltage has slopes."""
        if motor_values(fit) is None:
            return ()
        s = fit.simulator
        v = s.inputs("v")
        least = LEAST_CHANGE * float(np.max(np.abs(v), initial=0.0))
        change = np.concatenate([_slopes(v[clock.rows], least) for clock in s.clocks])
        if not change.any():
            return ()
        return [Linear(self.name, response_within_rows(fit, change)[:, :, None], ("",), least=0.0, most=MOST, size=1.0)]


def _slopes(v: FloatArray, least: float) -> FloatArray:
    """Return by how much a voltage, (n,), moves from row to row at each: the smaller of both changes beside it, V."""
    change = np.diff(v)
    change[np.abs(change) < least] = 0.0
    before, after = np.append(0.0, change), np.append(change, 0.0)
    return np.where(np.abs(after) < np.abs(before), after, before)
