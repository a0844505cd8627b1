"""A logger lost rows: the samples behind were taken later than the clock says, until the next change of the input."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE
from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear, misfit, refreshed
from estimator.fitting.simulator import CELLS
from estimator.fitting.windows import find_windows
from estimator.noise.clock import Clock
from estimator.recordings.samples import medians

FEWEST_ROWS, MOST_ROWS = 0.7, 30.0  # rows: a logger loses whole ones
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TRIED_ROWS = (1, 2, 4, 6, 9, 14, 20)
NEAR_TRIED = 0.35  # of the tried rows: how near to them the answer must be
NEARBY = 3  # rows, by which the number that explains most may differ from the last
BESIDE = 2  # rows on each side of a jump that tell its height, and as many that tell the slopes
NEAR = 50  # rows before and behind that tell the noise of such steps
HIDDEN_JUMP, VISIBLE_JUMP = 2.0, 4.0  # standard deviations: a smaller one tells nothing, a larger one would be seen
PLACES = 60  # that are tested, at most; beside the likeliest FINER ones, again and again
FINER = 8


@dataclass(frozen=True)
class LostRows(Effect):
    """Rows that are missing before one row of a transient."""

    name: str = "lost rows"
    prior: float = SELDOM / 10 / PLACES
    doubt: str = "rows are missing, or the clock is wrong: check the logger"
    sentence: str = "{name}: some {value:.2g} rows seem to be missing there"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the place where lost rows explain most of the residuals in the transients."""
        windows, ends = find_windows(fit), _ends(fit)
        settled = windows.settled
        places = np.flatnonzero(~settled & ~windows.sharp)  # beside an edge it is the latency of the edge
        stride = max(1, len(places) // PLACES)
        if not len(places) or settled.all() or any(g.name.startswith(self.name) for g in fit.linear):
            return ()
        place, many = _likeliest(fit, places[::stride], ends, TRIED_ROWS)
        while stride > 1:
            reach, stride = stride, max(1, stride // FINER)
            place, many = _likeliest(fit, places[np.abs(places - place) < reach][::stride], ends, (many,))
        clock = _clock_at(fit, place)
        t = clock.time[place - clock.rows.start]
        own = _column(fit, place, ends, many)
        if not _may_jump(fit, place, own, many):
            return ()
        return [Linear(f"{self.name} at t = {t:.4g} s", own, ("rows",), least=FEWEST_ROWS, most=MOST_ROWS)]

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the change of the signals over as many rows as explain most, by the last fit, before the same row."""
        place, ends = int(np.argmax(group.columns.any(axis=(1, 2)))), _ends(fit)
        if ends[place] <= place:  # it has settled there
            return None
        few = max(1, round(float(np.clip(coefficients[0], 1.0, MOST_ROWS))) - NEARBY)
        tried = range(few, min(few + 2 * NEARBY, int(MOST_ROWS)) + 1)
        _, many = _likeliest(refreshed(fit, fit.whitener), np.array([place]), ends, tried)
        return dataclasses.replace(group, columns=_column(fit, place, ends, many))


def _likeliest(fit: Fit, places: IntArray, ends: IntArray, tried: Sequence[int]) -> tuple[int, int]:
    """Return the row before which, and how many, lost rows explain most of the residuals."""
    test, best, where = fit.test(), -1.0, (0, 0)
    together, q = max(1, CELLS // fit.z.size), fit.shown.shape[1]
    for part in _parts(places, fit.simulator.clocks, together):
        rows = slice(int(part[0]), int(ends[part].max()))
        few = max(1, CELLS // ((rows.stop - rows.start) * q * len(part)))
        for numbers in (tried[k : k + few] for k in range(0, len(tried), few)):
            columns = [_columns(fit.shown, part, ends, many) for many in numbers]
            along, power = test.scores(columns[0] if len(columns) == 1 else np.concatenate(columns, axis=2), rows)
            gain = np.where(power > 1e-9, along**2 / np.maximum(power, 1e-9), 0.0)
            made_for = np.repeat(numbers, len(part))
            near = np.abs(along / np.maximum(power, 1e-9) / made_for - 1) < NEAR_TRIED
            weighed = np.where(near, gain, 0.5 * gain)
            k = int(np.argmax(weighed))
            if weighed[k] > best:
                best, where = float(weighed[k]), (int(part[k % len(part)]), int(made_for[k]))
    return where


def _may_jump(fit: Fit, place: int, column: FloatArray, many: int) -> bool:
    """Whether the measured signals jump before a row as they do where rows are lost; a jump in the noise may be one.

    What the model does not explain, such as a shaft that falls into a detent as it comes to rest, drifts. So does a
    friction that wanders: no row tells it from rows lost where these would hardly move the signals.
    """
    clock = _clock_at(fit, place)
    at = place - clock.rows.start - 2 * BESIDE
    if at < 0 or place + 2 * BESIDE > clock.rows.stop:
        return True
    measured = _steps(misfit(fit, fit.explained)[clock.rows])
    deviation = medians(np.abs(measured[max(0, at - NEAR) : at + NEAR]).T) / MEDIAN_SIZE
    deviation = np.maximum(deviation, fit.simulator.steps)
    known = fit.whitener.present[place - 2 * BESIDE : place + 2 * BESIDE].all(axis=0) & (deviation > 0)
    deviation = np.where(known, deviation, np.inf)
    expected = many * _steps(column[clock.rows, :, 0])[at] / deviation
    seen = float(expected @ expected)
    if seen < VISIBLE_JUMP**2:
        return seen >= HIDDEN_JUMP**2
    return float(expected @ (measured[at] / deviation)) > 0.5 * seen


def _clock_at(fit: Fit, row: int) -> Clock:
    """Return the clock of the recording that a row belongs to."""
    return next(c for c in fit.simulator.clocks if c.rows.start <= row < c.rows.stop)


def _steps(signals: FloatArray) -> FloatArray:
    """Return the steps, (n - 7, q), of (n, q) signals behind 2 BESIDE rows and before as many, slopes left out."""
    weights = np.repeat([0.5, -1.5, 1.5, -0.5], BESIDE) / BESIDE
    return np.stack([np.convolve(signal, weights[::-1], "valid") for signal in signals.T], axis=1)


def _ends(fit: Fit) -> IntArray:
    """Return of every row where its transient ends, (rows,): a row that has settled is one."""
    settled = find_windows(fit).settled
    ends = np.zeros(len(settled), dtype=np.int64)
    for clock in fit.simulator.clocks:
        moving = ~settled[clock.rows]
        own = np.where(moving, len(moving), np.arange(1, len(moving) + 1))
        ends[clock.rows] = clock.rows.start + np.minimum.accumulate(own[::-1])[::-1]
    return ends


def _column(fit: Fit, place: int, ends: IntArray, many: int) -> FloatArray:
    """Return the change by one row lost before a place, (rows, q, 1), up to the end of its transient."""
    column = np.zeros((*fit.shown.shape, 1))
    column[place : ends[place]] = _columns(fit.shown, np.array([place]), ends, many)
    return column


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
    for end in sorted(set(ends[places].tolist())):
        inside, own = rows[rows < end], ends[places] == end
        change = (shown[np.minimum(inside + many, end - 1)] - shown[inside]) / many
        after = inside[:, None] >= places[own]
        columns[: len(inside), :, own] = change[:, :, None] * after[:, None, :]
    return columns
