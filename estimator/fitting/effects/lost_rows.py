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
from estimator.plans.part import LONG
from estimator.plans.plan import Plan

FEWEST_ROWS, MOST_ROWS = 0.7, 30.0  # rows: a logger loses whole ones
FloatArray = NDArray[np.float64]

TRIED_ROWS = (1, 2, 4, 6, 9, 14, 20)
NEAR_TRIED = 0.35  # of the tried rows: how near to them the answer must be
PLACES = 60  # that are tested, at most
MEMORY = 1000  # rows over which a noise remembers, at most


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
        for clock in s.clocks:  # the transient of a row ends where its rows settle
            row = np.arange(clock.rows.start, clock.rows.stop)
            last = np.where(settled[clock.rows], row + 1, clock.rows.stop)
            ends[clock.rows] = np.minimum.accumulate(last[::-1])[::-1]
        places = np.flatnonzero(~settled & ~windows.sharp)  # beside an edge it is the latency of the edge
        places = places[:: max(1, len(places) // PLACES)]
        if not len(places) or settled.all() or any(g.name.startswith(self.name) for g in fit.linear):
            return ()
        test = fit.test()
        best: tuple[float, int, int] | None = None
        for many in TRIED_ROWS:
            for rows, part in _together(fit, places, ends):
                columns = np.zeros((rows.stop - rows.start, len(s.outputs), len(part)))
                for p, row in enumerate(part.tolist()):
                    own, end = _later(fit, row, int(ends[row]), many)
                    columns[row - rows.start : end - rows.start, :, p] = own
                power, along = test.powers(columns, rows)
                gain = np.where(power > 1e-9, along**2 / np.maximum(power, 1e-9), 0.0)
                near = np.abs(along / np.maximum(power, 1e-9) / many - 1) < NEAR_TRIED  # it says what it was made for
                weighed = np.where(near, gain, 0.5 * gain)
                k = int(np.argmax(weighed))
                if best is None or weighed[k] > best[0]:
                    best = float(weighed[k]), int(part[k]), many
        assert best is not None
        _, place, many = best
        column = np.zeros((*fit.shown.shape, 1))
        own, end = _later(fit, place, int(ends[place]), many)
        column[place:end, :, 0] = own
        clock = next(c for c in s.clocks if c.rows.start <= place < c.rows.stop)
        t = clock.time[place - clock.rows.start]
        return [Linear(f"{self.name} at t = {t:.4g} s", column, ("rows",), least=FEWEST_ROWS, most=MOST_ROWS)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how many, and where."""
        return f"{name}: some {value:.2g} rows seem to be missing there"


def _later(fit: Fit, row: int, end: int, many: int) -> tuple[FloatArray, int]:
    """Return the change of the signals, (n, q), a lost row, in the rows of a transient from one on; and its end."""
    end = max(end, row + 1)
    later = np.minimum(np.arange(row, end) + many, end - 1)
    return (fit.shown[later] - fit.shown[row:end]) / many, end


def _together(fit: Fit, places: NDArray[np.int64], ends: NDArray[np.int64]) -> list[tuple[slice, NDArray[np.int64]]]:
    """Return places that are tested at once, and the rows that are whitened for them.

    These are all rows; of a long recording those of the transient, and some before and behind for the noise's memory.
    """
    rows = fit.simulator.rows
    if rows <= LONG:
        together = max(1, CELLS // fit.z.size)
        return [(slice(0, rows), places[k : k + together]) for k in range(0, len(places), together)]
    found = []
    for part in np.split(places, np.flatnonzero(np.diff(ends[places])) + 1):
        clock = next(c.rows for c in fit.simulator.clocks if part[0] < c.rows.stop)
        first, last = max(clock.start, int(part[0]) - MEMORY), min(clock.stop, int(ends[part[-1]]) + MEMORY)
        found.append((slice(first, last), part))
    return found
