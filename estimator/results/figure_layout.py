"""Where everything stands in the figure of an estimate, in inches, and how it looks. Knows no drawing library.

Each recording has two columns, the whole record left and its transient enlarged right, of one plot a row of `panels`.
Every figure has the same geometry. Colours are told apart by the colour blind and in grey print (Okabe and Ito 2008).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.results.panels import LABELS, MARKERS_UP_TO, Kind, Line, Panel, Style, envelope, panels, transient
from estimator.results.reason import Place
from estimator.results.result import Comparison

MEASURED = "#9a9a9a"
SIMULATED = "#0072b2"  # Okabe-Ito blue
RESIDUAL = "#d55e00"  # Okabe-Ito vermillion
TAKEN_OUT = "#009e73"  # Okabe-Ito bluish green
LEFT_OUT = "#cc79a7"  # Okabe-Ito reddish purple
INPUT = "#000000"
GRID, THIN = "#e3e3e3", 0.6  # points
PLACE, PLACE_SHARE = "#e69f00", 0.33  # of the colour, over white
BAND_SHARE = 0.13

# inch
WIDTH, COLUMN = 11.0, 4.4  # of the figure, of a plot
LEFT, BETWEEN = 1.1, 0.8  # room for labels and tick labels
HEIGHTS: Mapping[Kind, float] = {"input": 0.55, "signal": 1.7, "residual": 0.85}
GAP, TOP, BOTTOM = 0.14, 0.4, 0.62  # between rows; above and below a recording
BELOW = 0.3  # for a line of text under all
LABEL = 0.77  # from a plot to its label

DPI = 130
TICKS: Mapping[Kind, int] = {"input": 2, "signal": 5, "residual": 4}  # about so many
TICKS_ACROSS = 6
TICK_DIGITS = 10  # at most: the differences of neighbouring ticks are round
ROOM: Mapping[Kind, float] = {"input": 0.25, "signal": 0.08, "residual": 0.15}  # of what a plot shows, beyond it
EDGE = 0.94  # of the height of a residual's plot: where outliers beyond it are marked
LEAST_SHADE = 0.01  # of the width of what is shown
MOST_RECORDINGS = 4  # in one figure
LONGEST_TITLE, LONGEST_NAME = 55, 26  # letters
WHERE = "where the reason lies"


@dataclass(frozen=True)
class Look:
    """How a line is drawn: colour, width and size of its marks in points, the mark, stairs."""

    colour: str
    width: float
    mark: str = ""
    size: float = 0.0
    held: bool = False


LOOKS: Mapping[Style, Look] = {
    "input": Look(INPUT, 1.0, held=True),
    "measured": Look(MEASURED, 2.2, "o", 4.5),
    "simulated": Look(SIMULATED, 1.3),
    "residual": Look(RESIDUAL, 0.6, "o", 3.0),
    "taken out": Look(TAKEN_OUT, 0.8),
    "left out": Look(LEFT_OUT, 1.0, "x", 4.5),
}


@dataclass(frozen=True)
class Drawn:
    """A line as it is drawn: no more points than are seen; `marked`: its samples, too, or alone if they were left out.

    Attributes
    ----------
    label : in the legend; "": it is not named there
    """

    line: Line
    marked: bool
    label: str

    @property
    def look(self) -> Look:
        """How it is drawn."""
        return LOOKS[self.line.style]


@dataclass(frozen=True)
class Plot:
    """One row of a column.

    Attributes
    ----------
    top, height : inch, from the upper edge of the figure
    low, high : of its vertical axis
    lines : from back to front
    shaded : (start, end), s, where reasons lie
    """

    panel: Panel
    top: float
    height: float
    low: float
    high: float
    lines: tuple[Drawn, ...]
    shaded: tuple[tuple[float, float], ...]

    @property
    def label(self) -> str:
        """What it shows, and in what unit: two lines."""
        return f"{short(self.panel.title, LONGEST_NAME)}\n[{self.panel.unit or '-'}]"


@dataclass(frozen=True)
class Column:
    """The plots of one recording between two times, s, with a common time axis; the first one has their labels.

    Attributes
    ----------
    left : inch, from the left edge of the figure
    """

    title: str
    is_first: bool
    left: float
    start: float
    end: float
    plots: tuple[Plot, ...]


@dataclass(frozen=True)
class Layout:
    """A figure: its height in inches, its columns, and a line of text below all of them."""

    height: float
    columns: tuple[Column, ...]
    below: str


def laid_out(
    comparisons: Sequence[Comparison], *, noise: Mapping[str, float] | None = None, places: Sequence[Place] = ()
) -> Layout:
    """Lay out measured against simulated signals and residuals: the whole record left, the transient right.

    Parameters
    ----------
    comparisons : one a recording
        Drawn below each other; those beyond the first `MOST_RECORDINGS` are only counted.
    noise : output name → standard deviation, SI units
        Drawn as a band of two standard deviations behind the residuals.
    places : where reasons lie, which is shaded
    """
    columns: list[Column] = []
    top = 0.0
    for comparison in comparisons[:MOST_RECORDINGS]:
        own = [place for place in places if place.recording == comparison.name]
        windows = (float(comparison.time[0]), float(comparison.time[-1])), transient(comparison)
        for k, (start, end) in enumerate(windows):
            upper, plots = top + TOP, []
            for panel in panels(comparison, noise=noise, enlarged=k == 1):
                plots.append(_plot(panel, upper, start, end, own))
                upper += plots[-1].height + GAP
            title = "enlarged" if k else short(comparison.name, LONGEST_TITLE)
            columns.append(Column(title, k == 0, LEFT + k * (COLUMN + BETWEEN), start, end, tuple(plots)))
        top = upper - GAP + BOTTOM
    rest = len(comparisons) - MOST_RECORDINGS
    below = "one more recording is not shown" if rest == 1 else f"{rest} more recordings are not shown"
    return Layout(top + (BELOW if rest > 0 else 0.0), tuple(columns), below if rest > 0 else "")


def _plot(panel: Panel, top: float, start: float, end: float, places: Sequence[Place]) -> Plot:
    """Return what of a row is seen between two times."""
    seen = [line.within(start, end) for line in panel.lines]
    low, high = panel.span(seen, room=ROOM)
    few = len(seen[0].time) <= MARKERS_UP_TO
    lines = tuple(_drawn(line, panel.kind, few=few, edge=EDGE * high) for line in seen)
    shaded = []
    for place in places:
        if panel.kind != "residual" and place.signal in ("", panel.name) and place.end >= start and place.start <= end:
            spare = max(0.0, LEAST_SHADE * (end - start) - (place.end - place.start)) / 2
            shaded.append((place.start - spare, place.end + spare))
    return Plot(panel, top, HEIGHTS[panel.kind], low, high, lines, tuple(shaded))


def _drawn(line: Line, kind: Kind, *, few: bool, edge: float) -> Drawn:
    """Return a line as it is drawn; an outlier's residual beyond the edge is marked there."""
    label = LABELS.get(line.style, "") if kind == "signal" or line.style == "taken out" else ""
    if line.style != "left out":
        few = few and line.style in ("measured", "residual")
        return Drawn(Line(line.style, *envelope(line.time, line.values)), few, label)
    values = np.clip(line.values, -edge, edge) if kind == "residual" else line.values
    return Drawn(Line(line.style, line.time, values), True, label)


def named(column: Column, beside: Column) -> dict[str, Drawn | None]:
    """Return the lines that are named above a column, for it and the one beside it: each once; None for a shade."""
    found: dict[str, Drawn | None] = {}
    for plot in (*column.plots, *beside.plots):
        found |= {drawn.label: drawn for drawn in plot.lines if drawn.label and drawn.label not in found}
        if plot.shaded:
            found.setdefault(WHERE, None)
    return found


def short(text: str, longest: int) -> str:
    """Return a text, cut where it is longer."""
    return text if len(text) <= longest else text[: longest - 1] + "…"
