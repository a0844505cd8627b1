"""The drawings of the report, as SVG: recordings, residuals, cost. Knows the result; the page gives the colours."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from estimator.results.panels import LABELS, MARKERS_UP_TO, Kind, Line, Panel, Style, envelope, panels, transient
from estimator.results.reason import Place
from estimator.results.residuals import Whiteness
from estimator.results.result import Comparison, CostProfile, FloatArray, SearchHistory
from estimator.results.svg import Box, drawing, text

PIXEL_BINS = 260  # of an envelope, at most: two pixels each
LEFT, RIGHT, BOTTOM, HEAD = 58.0, 10.0, 40.0, 20.0  # pixels around and above each plot
HEIGHTS: Mapping[Kind, float] = {"input": 34.0, "signal": 118.0, "residual": 58.0}
ROOM: Mapping[Kind, float] = {"input": 0.06, "signal": 0.06, "residual": 0.12}  # of what a plot shows, beyond it
UPWARDS: Mapping[Kind, int] = {"input": 2, "signal": 4, "residual": 3}
MOST_CROSSES = 400  # of outliers in a drawing: more hide what they mark
WIDTH = 640.0
WIDE = 1080.0  # of a whole recording
SLIM = 380.0  # of the same for a phone
SHOWN_RISE = 10.0  # of a cost profile: a little over three standard errors


def recording_chart(
    comparison: Comparison,
    *,
    noise: Mapping[str, float] | None = None,
    window: tuple[float, float] | None = None,
    residuals: bool = True,
    places: Sequence[Place] = (),
    width: float = WIDTH,
) -> str:
    """Return measured against simulated signals of one recording over time.

    Parameters
    ----------
    noise : output → standard deviation of its residuals, SI
    window : (start, end) in s, optional
        Only this part, with the simulation on its finer grid.
    residuals : bool
        Draw them, too.
    places : where something is, which is marked
    """
    time = comparison.time
    start, end = window or (float(time[0]), float(time[-1]))
    rows = panels(comparison, noise=noise, enlarged=window is not None)
    rows = tuple(r for r in rows if residuals or r.kind != "residual")
    top, parts = 0.0, []
    for k, row in enumerate(rows):
        top += HEAD
        parts += _row(row, top, start, end, width=width, labels=k == len(rows) - 1, places=places)
        top += HEIGHTS[row.kind]
    parts.append(f'<path class="cursor" d="M0 {HEAD:g}V{top:g}"/>')
    what = "the enlarged part of " if window else ""
    name = f"Measured and simulated signals of {what}{comparison.name}, from {start:.4g} to {end:.4g} s"
    data = f' data-first="{start:.9g}" data-last="{end:.9g}" data-left="{LEFT:g}" data-width="{width - LEFT - RIGHT:g}"'
    return drawing(parts, width=width, height=top + BOTTOM, name=name, style="chart", data=data)


def transient_chart(comparison: Comparison, *, width: float = WIDTH, places: Sequence[Place] = ()) -> str:
    """Return the part of a recording that is worth enlarging, without residuals."""
    return recording_chart(comparison, window=transient(comparison), residuals=False, width=width, places=places)


def legend(comparisons: Iterable[Comparison], *, places: bool = False) -> list[tuple[str, str]]:
    """Return (style, name) of every kind of line that is drawn of some recordings."""
    drawn = [line.style for c in comparisons for row in panels(c) for line in row.lines]
    found = [(_style(style), LABELS[style]) for style in LABELS if style in drawn]
    return [*found, ("place", "where the reason lies")] if places else found


def _style(style: Style) -> str:
    return style.replace(" ", "-")


def _row(
    row: Panel, top: float, start: float, end: float, *, width: float, labels: bool, places: Sequence[Place]
) -> list[str]:
    """Return one row: grid, band, lines, marks, and its title above."""
    seen = [line.within(start, end) for line in row.lines]
    low, high = row.span(seen, room=ROOM)
    box = Box(LEFT, top, width - LEFT - RIGHT, HEIGHTS[row.kind], start, end, low, high)
    parts = [text(LEFT, top - 6, f"{row.title} [{row.unit or '-'}]", style="title")]
    for place in places:
        of_row = row.kind != "residual" and place.signal in ("", row.name)
        if of_row and place.end >= start and place.start <= end:
            parts.append(box.stripe(place.start, place.end, "place", least=6.0))
    if row.band > 0:
        parts.append(box.band(-row.band, row.band, "band"))
    parts.append(
        box.grid(
            across=6 if width > SLIM else 4, up=UPWARDS[row.kind], labels=labels, unit="time [s]" if labels else ""
        )
    )
    few = len(seen[0].time) <= MARKERS_UP_TO
    for line in seen:
        inside = _clipped(line, start, end)
        if row.kind == "residual":  # an outlier lies beyond the scale: marked at its edge
            inside = Line(line.style, inside.time, np.clip(inside.values, low, high))
        if line.style == "left out":
            parts.append(box.crosses(inside.time[:MOST_CROSSES], inside.values[:MOST_CROSSES], "left-out"))
            continue
        drawn = envelope(inside.time, inside.values, bins=min(PIXEL_BINS, round(box.width / 2)))
        told = f"{row.title}, {line.style}" if row.kind == "signal" else row.title
        told = f"{told} [{row.unit or '-'}]" if line.style != "taken out" else ""
        parts.append(box.line(*drawn, _style(line.style), held=line.style == "input", told=told))
        if few and line.style in ("measured", "residual"):
            parts.append(box.dots(*drawn, _style(line.style)))
    return parts


def _clipped(line: Line, start: float, end: float) -> Line:
    """Return a line that ends at the window's edges, interpolated there; an input holds."""
    inside = (line.time >= start) & (line.time <= end)
    time, values = line.time[inside], line.values[inside]
    if line.style == "left out" or not len(line.time):
        return Line(line.style, time, values)
    before, after = np.flatnonzero(line.time < start), np.flatnonzero(line.time > end)
    held = line.style == "input"
    if len(before) and (not len(time) or time[0] > start):
        value = line.values[before[-1]] if held else np.interp(start, line.time, line.values)
        time, values = np.append(start, time), np.append(value, values)
    if len(after) and (not len(time) or time[-1] < end):
        value = values[-1] if held and len(values) else np.interp(end, line.time, line.values)
        time, values = np.append(time, end), np.append(values, value)
    return Line(line.style, time, values)


def whiteness_charts(found: Sequence[Whiteness], *, interval: float) -> list[tuple[str, str, str]]:
    """Return (output, autocorrelation, histogram) of each output's residuals.

    Parameters
    ----------
    interval : s between samples, of the lags' axis
    """
    charts = []
    for w in found:
        lags = np.arange(len(w.correlation), dtype=np.float64) * interval
        low = min(float(w.correlation.min()), -0.2)
        box = Box(46, HEAD, 300, 110, 0.0, float(lags[-1]) or 1.0, low, 1.0)
        parts = [text(46, HEAD - 6, f"autocorrelation of the residuals of {w.output}", style="title")]
        parts += [box.band(-w.chance, w.chance, "band"), box.grid(across=5, up=4, unit="lag [s]")]
        stems = np.column_stack([np.zeros(len(lags)), w.correlation, np.full(len(lags), np.nan)]).ravel()
        parts.append(box.line(np.repeat(lags, 3), stems, "residual"))
        parts.append(box.dots(lags, w.correlation, "residual"))
        one = drawing(parts, width=360, height=HEAD + 110 + BOTTOM, name=f"Autocorrelation of {w.output}")
        middle = (w.edges[1:] + w.edges[:-1]) / 2
        normal = np.exp(-(middle**2) / 2) / math.sqrt(2 * math.pi)
        top = 1.1 * max(float(w.density.max()), float(normal.max()))
        box = Box(46, HEAD, 300, 110, float(w.edges[0]), float(w.edges[-1]), 0.0, top)
        parts = [text(46, HEAD - 6, f"histogram of the residuals of {w.output}", style="title")]
        parts.append(box.grid(across=5, up=3, unit="standard deviations"))
        parts.append(box.line(w.edges, np.append(w.density, 0.0), "residual", held=True))
        parts.append(box.line(middle, normal, "simulated"))
        two = drawing(parts, width=360, height=HEAD + 110 + BOTTOM, name=f"Histogram of {w.output}, and a normal one")
        charts.append((w.output, one, two))
    return charts


def profile_charts(profiles: Mapping[str, CostProfile], *, units: Mapping[str, str]) -> list[str]:
    """Return how the cost rises around each estimate, one drawing a parameter."""
    charts = []
    for name, profile in profiles.items():
        finite = profile.followed[np.isfinite(profile.followed)]
        top = max(SHOWN_RISE, 1.1 * float(finite.max(initial=1.0)))
        low = min(0.0, float(finite.min(initial=0.0))) - 0.04 * top
        box = Box(40, HEAD, 200, 110, float(profile.values[0]), float(profile.values[-1]), low, top)
        parts = [box.grid(across=3, up=4, unit=f"{name} [{units.get(name) or '-'}]")]
        parts.append(box.line(np.array([box.first, box.last]), np.ones(2), "bound"))
        for curve, style in ((profile.held, "measured"), (profile.followed, "simulated")):
            x, y = _smooth(profile.values, curve)
            parts.append(box.line(x, np.where(y > top, np.nan, y), style))
        parts.append(box.dots(profile.values, np.where(profile.followed > top, np.nan, profile.followed), "simulated"))
        charts.append(drawing(parts, width=256, height=HEAD + 110 + BOTTOM, name=f"Cost around the estimate of {name}"))
    return charts


def _smooth(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve through the points: the natural cubic spline, y'' = 0 at its ends."""
    known = np.isfinite(y) & np.concatenate([[True], np.diff(x) > 1e-6 * np.ptp(x)])  # as close as numbers are: one
    if known.sum() < 4 or np.ptp(x) == 0:
        return x, y
    t, v = x[known], y[known]
    h = np.diff(t)
    slopes = np.diff(v) / h
    inner = np.diag(2 * (h[1:] + h[:-1])) + np.diag(h[1:-1], 1) + np.diag(h[1:-1], -1)
    curved = np.zeros(len(t))
    curved[1:-1] = np.linalg.solve(inner / h.mean(), 6 * np.diff(slopes) / h.mean())
    fine = np.linspace(t[0], t[-1], 60)
    k = np.clip(np.searchsorted(t, fine, side="right") - 1, 0, len(h) - 1)
    a, b = (t[k + 1] - fine) / h[k], (fine - t[k]) / h[k]
    bend = ((a**3 - a) * curved[k] + (b**3 - b) * curved[k + 1]) * h[k] ** 2 / 6
    return fine, np.asarray(a * v[k] + b * v[k + 1] + bend)


def convergence_chart(history: SearchHistory) -> str:
    """Return the cost of the best and of the median nest over the simulations."""
    costs = [np.where(np.isfinite(c) & (c > 0), c, np.nan) for c in (history.median, history.best)]
    every = np.concatenate(costs)
    every = every[np.isfinite(every)]
    if not every.size:
        return ""
    low, high = float(every.min()), float(every.max())
    first, last = float(history.simulations[0]), float(history.simulations[-1])
    box = Box(LEFT, HEAD, 420, 150, first, last, low / 1.3, high * 1.3, log=True)
    parts = [text(LEFT, HEAD - 6, "cost", style="title"), box.grid(across=5, up=4, unit="FMU simulations")]
    for cost, style in zip(costs, ("measured", "simulated"), strict=True):
        parts.append(box.line(history.simulations.astype(float), cost, style))
    return drawing(parts, width=LEFT + 420 + RIGHT, height=HEAD + 150 + BOTTOM, name="Cost over the search")
