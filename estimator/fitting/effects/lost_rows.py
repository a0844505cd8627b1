"""A logger lost rows: the samples behind were taken later than the clock says, until the next change of the input."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.clock import Clock
from estimator.fitting.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.simulator import CELLS
from estimator.fitting.windows import find_windows
from estimator.plans.plan import Plan

FEWEST_ROWS, MOST_ROWS = 0.7, 30.0  # rows: a logger loses whole ones
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TRIED_ROWS = (1, 2, 4, 6, 9, 14, 20)
NEAR_TRIED = 0.35  # of the tried rows: how near to them the answer must be
PLACES = 60  # that are tested, at most


@dataclass(frozen=True)
class LostRows(Effect):
    """Rows that are missing before one row of a transient."""

    name: str = "lost rows"
    prior: float = SELDOM / 10 / PLACES
    doubt: str = "rows are missing, or the clock is wrong: check the logger"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the place where lost rows explain most of the residuals in the transients."""
        s = fit.simulator
        windows = find_windows(fit)
        settled = windows.settled
        ends = np.zeros(s.rows, dtype=np.int64)
        for clock in s.clocks:
            moving = ~settled[clock.rows]
            own = np.where(moving, len(moving), np.arange(1, len(moving) + 1))
            # The transient of a row ends where its rows settle.
            ends[clock.rows] = clock.rows.start + np.minimum.accumulate(own[::-1])[::-1]
        places = np.flatnonzero(~settled & ~windows.sharp)  # beside an edge it is the latency of the edge
        places = places[:: max(1, len(places) // PLACES)]
        if not len(places) or settled.all() or any(g.name.startswith(self.name) for g in fit.linear):
            return ()
        test = fit.test()
        best, where = -1.0, (0, 0)
        together = max(1, CELLS // fit.z.size)
        for many in TRIED_ROWS:
            for part in _parts(places, s.clocks, together):
                rows = slice(int(part[0]), int(ends[part].max()))
                along, power = test.scores(_columns(fit.shown, part, ends, many), rows)
                gain = np.where(power > 1e-9, along**2 / np.maximum(power, 1e-9), 0.0)
                near = np.abs(along / np.maximum(power, 1e-9) / many - 1) < NEAR_TRIED  # it says what it was made for
                weighed = np.where(near, gain, 0.5 * gain)
                k = int(np.argmax(weighed))
                if weighed[k] > best:
                    best, where = float(weighed[k]), (int(part[k]), many)
        place, many = where
        own = np.zeros((*fit.shown.shape, 1))
        own[place : ends[place]] = _columns(fit.shown, np.array([place]), ends, many)
        clock = next(c for c in s.clocks if c.rows.start <= place < c.rows.stop)
        t = clock.time[place - clock.rows.start]
        return [Linear(f"{self.name} at t = {t:.4g} s", own, ("rows",), least=FEWEST_ROWS, most=MOST_ROWS)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how many, and where."""
        return f"{name}: some {value:.2g} rows seem to be missing there"


def _parts(places: IntArray, clocks: Sequence[Clock], most: int) -> Iterator[IntArray]:
    """Yield the places of each recording, so many at most at once."""
    for clock in clocks:
        own = places[(places >= clock.rows.start) & (places < clock.rows.stop)]
        yield from (own[k : k + most] for k in range(0, len(own), most))


def _columns(shown: FloatArray, places: IntArray, ends: IntArray, many: int) -> FloatArray:
    """Return the change of the signals, (rows, q, places), by one row lost, from the first place to the last end.

    Parameters
    ----------
    shown : (n, q) array
    places, ends : rows before which some are lost; of every row, (n,), where its transient ends
    many : int
        Rows lost, over which the change is taken.
    """
    rows = np.arange(places[0], ends[places].max())
    columns = np.zeros((len(rows), shown.shape[1], len(places)))
    for end in np.unique(ends[places]).tolist():
        inside, own = rows[rows < end], ends[places] == end
        change = (shown[np.minimum(inside + many, end - 1)] - shown[inside]) / many
        after = inside[:, None] >= places[own]
        columns[: len(inside), :, own] = change[:, :, None] * after[:, None, :]
    return columns
