"""What a figure of measured against simulated shows: rows, lines, the enlarged part. Knows no drawing library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.results.result import Comparison, FloatArray

Kind = Literal["input", "signal", "residual"]
Style = Literal["input", "measured", "simulated", "residual", "taken out", "left out"]

BINS = 600  # of an envelope: about one for each pixel of a column
MARKERS_UP_TO = 160  # samples in view: then each is shown
MOVEMENT = 0.985  # share of all movement that the enlarged part holds
LONGEST = 0.4  # of the record; beyond that only a piece of the movement is enlarged
PIECE = 0.08  # of the record, enlarged when the signals move all the time
MARGIN = 0.15  # of the enlarged part, before and after it
BAND = 2.0  # standard deviations of the noise, drawn behind the residuals
LABELS: Mapping[Style, str] = {
    "measured": "measured",
    "simulated": "simulated with the estimate",
    "taken out": "ripple or drift, taken out",
    "left out": "outlier, weighted down",
}
QUANTITIES = {
    "A": "current",
    "V": "voltage",
    "rad/s": "speed",
    "rad": "angle",
    "N.m": "torque",
    "K": "temperature",
    "W": "power",
}


@dataclass(frozen=True)
class Line:
    """One line, or marks alone where it is of samples that were left out.

    Attributes
    ----------
    time, values : (n,) arrays, s and SI; NaN marks a gap
    """

    style: Style
    time: FloatArray
    values: FloatArray

    def within(self, start: float, end: float) -> Line:
        """Return what of the line is seen between two times, and one sample more on either side."""
        first, beyond = np.searchsorted(self.time, [start, end]).tolist()
        seen = slice(max(first - 1, 0), beyond + 2)
        return Line(self.style, self.time[seen], self.values[seen])


@dataclass(frozen=True)
class Panel:
    """One row of a figure.

    Attributes
    ----------
    name, unit : of the signal
    lines : from back to front
    band : half the height of the noise's band around zero, 0 for none
    """

    kind: Kind
    name: str
    unit: str
    lines: tuple[Line, ...]
    band: float = 0.0

    def largest(self, seen: Sequence[Line]) -> float:
        """Return what the scale of a residual's row has to hold, of the lines seen: the band, and all but outliers."""
        marked = np.concatenate([np.zeros(0), *(line.time for line in seen if line.style == "left out")])
        rest = [
            np.abs(line.values[np.isfinite(line.values) & ~np.isin(line.time, marked)])
            for line in seen
            if line.style != "left out"
        ]
        return max([self.band, *(float(y.max()) for y in rest if y.size)]) or 1.0

    def span(self, seen: Sequence[Line], *, room: Mapping[Kind, float]) -> tuple[float, float]:
        """Return the ends of the vertical axis that shows the lines seen, with so much room beyond them."""
        if self.kind == "residual":
            largest = (1 + room[self.kind]) * self.largest(seen)
            return -largest, largest
        every = np.concatenate([line.values[np.isfinite(line.values)] for line in seen] or [np.zeros(0)])
        low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 1.0)
        if self.kind == "input":
            low, high = min(low, 0.0), max(high, 0.0)
        beyond = room[self.kind] * (high - low) or 0.5 * (abs(high) or 1.0)
        return low - beyond, high + beyond

    @property
    def title(self) -> str:
        """What the row shows, in words: "current i", "residual"."""
        quantity = QUANTITIES.get(self.unit, "")
        if self.kind == "residual":
            return "residual"
        return self.name if self.name == quantity else f"{quantity} {self.name}".strip()


def panels(
    comparison: Comparison, *, noise: Mapping[str, float] | None = None, enlarged: bool = False
) -> tuple[Panel, ...]:
    """Return the rows of a recording's figure from top to bottom: inputs, then each signal with its residual.

    Parameters
    ----------
    noise : output name → standard deviation of its residuals, SI units
    enlarged : bool
        Take the simulation on its finer grid where there is one.
    """
    time = comparison.time
    rows = [
        Panel("input", name, comparison.units.get(name, ""), (Line("input", time, values),))
        for name, values in comparison.inputs.items()
        if values.any()
    ]
    fine = comparison.fine if enlarged else None
    for name, measured in comparison.measured.items():
        unit = comparison.units.get(name, "")
        simulated = comparison.simulated.get(name, np.full(len(time), np.nan))
        lines = [Line("measured", time, measured)]
        if fine is not None and name in fine.simulated:
            lines.append(Line("simulated", *joined(time, simulated, fine.time, fine.simulated[name])))
        elif np.isfinite(simulated).any():
            lines.append(Line("simulated", time, simulated))
        left_out = comparison.left_out.get(name, np.zeros(0, dtype=bool))
        if left_out.any():
            lines.append(Line("left out", time[left_out], measured[left_out]))
        rows.append(Panel("signal", name, unit, tuple(lines)))
        if not np.isfinite(simulated).any():
            continue
        residual = measured - simulated
        lines = [Line("residual", time, residual)]
        taken_out = comparison.taken_out.get(name)
        if taken_out is not None and taken_out.any():
            lines.append(Line("taken out", time, taken_out))
        if left_out.any():
            lines.append(Line("left out", time[left_out], residual[left_out]))
        sigma = (noise or {}).get(name, 0.0)
        rows.append(Panel("residual", name, unit, tuple(lines), band=BAND * sigma if np.isfinite(sigma) else 0.0))
    return tuple(rows)


def joined(
    time: FloatArray, values: FloatArray, fine_time: FloatArray, fine: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a line that takes the finer grid where there is one, and its samples elsewhere."""
    outside = (time < fine_time[0]) | (time > fine_time[-1])
    every = np.concatenate([time[outside], fine_time])
    order = np.argsort(every, kind="stable")
    return every[order], np.concatenate([values[outside], fine])[order]


def envelope(time: FloatArray, values: FloatArray, *, bins: int = BINS) -> tuple[FloatArray, FloatArray]:
    """Return a line that looks like ``values`` over ``time`` when it is drawn `bins` pixels wide.

    Parameters
    ----------
    time, values : (n,) arrays
        NaN marks a missing sample.
    bins : int
        Of each, the first sample, the smallest, the largest and the last are kept, in their order.

    Returns
    -------
    time, values : (m,) arrays
        m ≤ 4 bins; the given arrays themselves when n is not larger than that.
    """
    n = len(values)
    if n <= 4 * bins:
        return time, values
    edges = np.linspace(0, n, bins + 1).astype(int)
    starts, lasts = edges[:-1], edges[1:] - 1
    index = np.minimum(starts[:, None] + np.arange(int(np.diff(edges).max())), lasts[:, None])
    block = values[index]  # (bins, longest bin)
    missing = np.isnan(block)
    lowest = starts + np.where(missing, np.inf, block).argmin(axis=1)
    highest = starts + np.where(missing, -np.inf, block).argmax(axis=1)
    keep = np.unique(np.concatenate([starts, np.minimum(lowest, lasts), np.minimum(highest, lasts), lasts]))
    return time[keep], values[keep]


def transient(comparison: Comparison) -> tuple[float, float]:
    """Return start and end, in s, of the part of a recording that is worth enlarging.

    That is where nearly all movement of the simulated signals (they have no noise) takes place, from the change of
    the input that caused it; when they move all the time, it is the short piece in which they move most.
    """
    time = comparison.time
    n = len(time)
    movement = np.zeros(max(n - 1, 0))
    for signal in (comparison.simulated or comparison.measured).values():
        steps = np.abs(np.diff(signal))
        steps[~np.isfinite(steps)] = 0.0
        if steps.sum() > 0:
            movement += steps / steps.sum()
    if n < 4 or not movement.any():
        return float(time[0]), float(time[-1])
    moved = np.concatenate([[0.0], np.cumsum(movement)]) / movement.sum()
    first = max(int(np.searchsorted(moved, 1e-6, side="right")) - 1, 0)
    last = min(int(np.searchsorted(moved, MOVEMENT)), n - 1)
    first = _cause(comparison, first)
    if time[last] - time[first] > LONGEST * (time[-1] - time[0]):
        width = max(int(PIECE * n), 3)
        first = int(np.argmax(moved[width:] - moved[:-width]))
        last = first + width
    margin = MARGIN * (time[last] - time[first])
    return float(max(time[first] - margin, time[0])), float(min(time[last] + margin, time[-1]))


def _cause(comparison: Comparison, first: int) -> int:
    """Return the last sample up to `first` at which an input changed; `first` where none did."""
    changes = [np.flatnonzero(np.diff(values[: first + 1])) + 1 for values in comparison.inputs.values()]
    return max((int(found[-1]) for found in changes if len(found)), default=first)
