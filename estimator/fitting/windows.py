"""Windows of the recordings: edges of the inputs, transients, settled stretches. Knows rows, no effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.fitting.latency import EDGE, edges_of

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

SETTLED = 0.02  # of a response: closer to its final value is settled
MARGIN = 1.3  # times the time to settle
BEFORE = 3  # rows before an edge, whose time is not known to a row, that may show the next response already
EARLY_PART, EARLY_ROWS = 0.15, 4  # of a transient; rows: its first part, with the electrical response
FEW_EDGES = 6  # edges of a recording: if there are no more, each has a window of its own
SETTLED_ROWS = 200  # settled rows that the noise is estimated from; with fewer all rows are


@dataclass(frozen=True)
class Window:
    """Rows of one recording that belong together."""

    name: str
    rows: NDArray[np.int32]


@dataclass(frozen=True)
class Windows:
    """The windows of all recordings, and kinds of rows, (rows,).

    Attributes
    ----------
    settled : rows that the noise is estimated from
    sharp : the first parts of transients
    onsets : the first few rows after each edge
    transients : of each recording the rows of each, from its edge to where it has settled
    enough : there are enough settled rows
    """

    windows: tuple[Window, ...]
    settled: BoolArray
    sharp: BoolArray
    onsets: BoolArray
    transients: tuple[tuple[NDArray[np.int32], ...], ...]
    enough: bool = True


def find_windows(fit: Fit) -> Windows:
    """Return a fit's windows, from its inputs and what it simulates."""
    return fit.once(_windows)


def _windows(fit: Fit) -> Windows:
    s = fit.simulator
    settled, sharp, onsets = np.zeros((3, s.rows), dtype=bool)
    windows: list[Window] = []
    transients: list[tuple[NDArray[np.int32], ...]] = []
    span = _spans(fit.shown)
    for e, (o, clock) in enumerate(zip(s.observed, s.clocks, strict=True)):
        n = len(o.recording.time)
        late = round(fit.delay(e) / clock.step)
        edges = _edges(o.inputs, n, late)
        bounds = [0, *edges, n]
        of = f" of {o.recording.title}" if len(s.observed) > 1 else ""
        early, rest, whole = [], [], []
        for k, (first, last) in enumerate(zip(bounds[:-1], bounds[1:], strict=True)):
            part = fit.shown[clock.rows][first:last]
            if not len(part):
                continue
            last_row = part[max(0, len(part) - 1 - (BEFORE if last < n else 0))]
            away = np.abs(part - last_row) > SETTLED * np.maximum(_spans(part), 0.02 * span)
            moving = np.flatnonzero(np.logical_or.reduce(list(away[: len(part) - BEFORE if last < n else None].T)))
            end = min(len(part), int(MARGIN * (moving[-1] + 1))) if len(moving) else 0
            reached = end < len(part) or not len(moving)
            rows = np.arange(clock.rows.start + first, clock.rows.start + last, dtype=np.int32)
            settled[rows[end:] if reached else rows[:0]] = True
            cut = max(EARLY_ROWS, int(EARLY_PART * end)) if end else 0
            if k:
                onsets[rows[0] - 1 : rows[0] + EARLY_ROWS] = True
            if k and end:
                early.append(rows[:cut])
                rest.append(rows[cut:end])
                whole.append(rows[:end])
                if len(edges) <= FEW_EDGES:
                    t = o.recording.time[min(max(first - late, 0), n - 1)]  # of the input
                    windows.append(Window(f"the response to the edge at t = {t:.4g} s{of}", rows[:end]))
        transients.append(tuple(whole))
        if early:
            windows.append(Window(f"the first part of the transients{of}", np.concatenate(early)))
            sharp[windows[-1].rows] = True
            windows.append(Window(f"the rest of the transients{of}", np.concatenate(rest)))
        own = np.arange(clock.rows.start, clock.rows.stop, dtype=np.int32)
        if settled[own].any():
            windows.append(Window(f"the settled part{of}", own[settled[own]]))
        windows.append(Window(f"all{of or ' of the recording'}", own))
    enough = bool(settled.sum() >= min(SETTLED_ROWS, 0.5 * s.rows))
    if not enough:
        settled[:] = True
    tested = tuple(w for w in windows if len(w.rows) >= EARLY_ROWS)
    return Windows(tested, settled, sharp, onsets, tuple(transients), enough)


def _edges(inputs: Mapping[str, FloatArray], n: int, late: int) -> list[int]:
    """Return the rows at which an input has changed by much, `late` rows later; the first is after row 0."""
    found: set[int] = set()
    for u in inputs.values():
        jumps = edges_of(u)
        found |= {int(k) for j, k in enumerate(jumps) if j == 0 or k - jumps[j - 1] > 2}
        if u[0] != 0 and np.ptp(u) <= EDGE * abs(float(u[0])):
            found.add(1)  # switched on before the first row
    return sorted({min(max(k + late, 1), n - 1) for k in found})


def _spans(signals: FloatArray) -> FloatArray:
    """Return how far each of (n, q) signals goes, (q,): one by one, which is quicker than along rows of a few."""
    return np.array([np.ptp(signal) for signal in signals.T])
