"""A logger lost rows: the samples behind were taken later than the clock says, until the next change of the input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.simulator import CELLS
from estimator.fitting.windows import find_windows
from estimator.plans.plan import Plan

FEWEST_ROWS, MOST_ROWS = 0.7, 30.0  # rows: a logger loses whole ones
FloatArray = NDArray[np.float64]

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
            last = len(moving)
            for k in range(len(moving) - 1, -1, -1):  # the transient of a row ends where its rows settle
                last = k + 1 if not moving[k] else last
                ends[clock.rows.start + k] = clock.rows.start + last
        places = np.flatnonzero(~settled & ~windows.sharp)  # beside an edge it is the latency of the edge
        places = places[:: max(1, len(places) // PLACES)]
        if not len(places) or settled.all() or any(g.name.startswith(self.name) for g in fit.linear):
            return ()
        test = fit.test()
        found: list[tuple[float, int, FloatArray]] = []
        together = max(1, CELLS // fit.z.size)
        for many in TRIED_ROWS:
            for part in (places[k : k + together] for k in range(0, len(places), together)):
                columns = np.zeros((*fit.shown.shape, len(part)))
                for p, row in enumerate(part.tolist()):
                    end = max(int(ends[row]), row + 1)
                    later = np.minimum(np.arange(row, end) + many, end - 1)
                    columns[row:end, :, p] = (fit.shown[later] - fit.shown[row:end]) / many
                across = test.across(columns)
                power = np.einsum("nk,nk->k", across, across)
                along = across.T @ test.left
                gain = np.where(power > 1e-9, along**2 / np.maximum(power, 1e-9), 0.0)
                near = np.abs(along / np.maximum(power, 1e-9) / many - 1) < NEAR_TRIED  # it says what it was made for
                weighed = np.where(near, gain, 0.5 * gain)
                best = int(np.argmax(weighed))
                if not found or weighed[best] > found[0][0]:
                    found = [(float(weighed[best]), int(part[best]), columns[:, :, best : best + 1].copy())]
        _, place, own = found[0]
        clock = next(c for c in s.clocks if c.rows.start <= place < c.rows.stop)
        t = clock.time[place - clock.rows.start]
        return [Linear(f"{self.name} at t = {t:.4g} s", own, ("rows",), least=FEWEST_ROWS, most=MOST_ROWS)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how many, and where."""
        return f"{name}: some {value:.2g} rows seem to be missing there"
