"""Figures of an estimate: measured against simulated, residuals, an enlarged part. Knows only the result.

Colours are told apart by the colour blind and in grey print (Okabe and Ito 2008). Matplotlib's objects are
used without pyplot, so that nothing global is touched and no display is needed. Axes are placed in inches by
hand: that takes half the time of a layout engine, and every figure has the same geometry.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.results.numbers import number_text
from estimator.results.panels import LABELS, MARKERS_UP_TO, Kind, Panel, Style, envelope, panels, transient
from estimator.results.reason import Place
from estimator.results.result import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED = "#9a9a9a"
SIMULATED = "#0072b2"  # Okabe-Ito blue
RESIDUAL = "#d55e00"  # Okabe-Ito vermillion
TAKEN_OUT = "#009e73"  # Okabe-Ito bluish green
LEFT_OUT = "#cc79a7"  # Okabe-Ito reddish purple
INPUT = "#000000"
GRID, THIN = "#e3e3e3", 0.6  # points
LOOKS: Mapping[Style, Mapping[str, Any]] = {
    "input": {"color": INPUT, "lw": 1.0, "drawstyle": "steps-post"},
    "measured": {"color": MEASURED, "lw": 2.2},
    "simulated": {"color": SIMULATED, "lw": 1.3},
    "residual": {"color": RESIDUAL, "lw": 0.6},
    "taken out": {"color": TAKEN_OUT, "lw": 0.8},
    "left out": {"color": LEFT_OUT, "ls": "", "marker": "x", "ms": 4, "mew": 0.8},
}
TICKS: Mapping[Kind, int] = {"input": 2, "signal": 5, "residual": 4}
TICK_DIGITS = 10  # at most: the differences of neighbouring ticks are round

# inch
WIDTH, COLUMN = 11.0, 4.4  # of the figure, of the axes
LEFT, BETWEEN = 1.1, 0.8  # room for labels and tick labels
INPUT_HEIGHT, SIGNAL_HEIGHT, RESIDUAL_HEIGHT = 0.55, 1.7, 0.85
GAP, TOP, BOTTOM = 0.14, 0.4, 0.62  # between rows; above and below a recording
LABEL = 0.77  # from the axes to their label

DPI = 130
COMPRESSED = 3  # of 9: beyond, a PNG takes twice the time to be a tenth smaller
PLACE, LEAST_SHADE = "#e69f00", 0.01  # colour; width, of what is shown
MOST_RECORDINGS = 4  # in one figure


def comparison_figure(
    comparisons: Sequence[Comparison], *, noise: Mapping[str, float] | None = None, places: Sequence[Place] = ()
) -> Figure:
    """Return measured against simulated signals and residuals: the whole record left, the transient right.

    Parameters
    ----------
    comparisons : one a recording
        Drawn below each other; those beyond the first `MOST_RECORDINGS` are only counted.
    noise : output name → standard deviation, SI units
        Drawn as a band of two standard deviations behind the residuals.
    places : where reasons lie, which is shaded
    """
    from matplotlib.figure import Figure

    shown = comparisons[:MOST_RECORDINGS]
    rest = len(comparisons) - len(shown)
    height = sum(_height(comparison) for comparison in shown) + (0.3 if rest else 0.0)
    fig = Figure(figsize=(WIDTH, height))
    top = height
    for comparison in shown:
        own = [place for place in places if place.recording == comparison.name]
        _draw(fig, comparison, top=top, noise=noise or {}, places=own)
        top -= _height(comparison)
    if rest:
        text = "one more recording is" if rest == 1 else f"{rest} more recordings are"
        fig.text(0.5, 0.1 / height, f"{text} not shown", ha="center", va="bottom", fontsize="small")
    return fig


def warm_up() -> None:
    """Load all that drawing takes, fonts included, so that the first figure takes no longer than the next."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(1, 1))
    fig.add_axes((0.3, 0.3, 0.6, 0.6)).set_xlabel("time [s]", fontsize="small")
    png(fig)


def png(fig: Figure, *, dpi: float = DPI) -> bytes:
    """Return a figure as a PNG file's content; the same figure gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas, stream, own = FigureCanvasAgg(fig), io.BytesIO(), fig.get_dpi()
    fig.set_dpi(dpi)
    canvas.draw()  # type: ignore[no-untyped-call]
    drawn = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    fig.set_dpi(own)
    Image.fromarray(drawn).convert("RGB").save(stream, format="png", compress_level=COMPRESSED, dpi=(dpi, dpi))
    return stream.getvalue()


def rendered(fig: Figure, kind: str) -> bytes:
    """Return a figure as the content of a file of some kind, "png", "svg" or "pdf"; the same figure, the same bytes."""
    if kind == "png":
        return png(fig)
    from matplotlib import rc_context

    stream = io.BytesIO()
    dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}}
    with rc_context({"svg.hashsalt": "fmu-estimator", "pdf.fonttype": 42}):
        fig.savefig(stream, format=kind, metadata=dated[kind])
    return stream.getvalue()


def _height_of(panel: Panel) -> float:
    return {"input": INPUT_HEIGHT, "signal": SIGNAL_HEIGHT, "residual": RESIDUAL_HEIGHT}[panel.kind]


def _height(comparison: Comparison) -> float:
    rows = panels(comparison)
    return sum(_height_of(panel) for panel in rows) + (len(rows) - 1) * GAP + TOP + BOTTOM


def _draw(
    fig: Figure, comparison: Comparison, *, top: float, noise: Mapping[str, float], places: Sequence[Place]
) -> None:
    """Draw one recording; `top` is its upper edge, in inch from the lower edge of the figure."""
    left: list[Axes] = []
    windows = [(float(comparison.time[0]), float(comparison.time[-1])), transient(comparison)]
    for column, (start, end) in enumerate(windows):
        rows = panels(comparison, noise=noise, enlarged=column == 1)
        axes = _column(fig, rows, column=column, top=top)
        for ax, panel in zip(axes, rows, strict=True):
            _draw_panel(ax, panel, start, end)
            _shade(ax, panel, places, start, end)
        if end > start:
            axes[0].set_xlim(start, end)
        axes[-1].set_xlabel("time [s]")
        axes[-1].locator_params(axis="x", nbins=6)
        for ax in axes:
            finish(ax)
        _rule_as(axes[-1], axes[:-1])
        if column == 0:
            _name_rows(axes, rows, title=comparison.name)
            left = axes
        else:
            axes[0].set_title("enlarged", fontsize="medium", loc="left")
            _legend(axes, beside=left)


def _column(fig: Figure, rows: Sequence[Panel], *, column: int, top: float) -> list[Axes]:
    """Return empty axes for one column of a recording, with a common time axis."""
    height = float(fig.get_figheight())
    left = LEFT + column * (COLUMN + BETWEEN)
    axes: list[Axes] = []
    upper = top - TOP
    for panel in rows:
        own = _height_of(panel)
        rectangle = (left / WIDTH, (upper - own) / height, COLUMN / WIDTH, own / height)
        axes.append(fig.add_axes(rectangle, sharex=axes[0] if axes else None))
        upper -= own + GAP
    return axes


def _rule_as(lowest: Axes, others: Sequence[Axes]) -> None:
    """Draw the lines of the common time axis in the others; axes of their own take a quarter of the drawing."""
    from matplotlib.collections import LineCollection

    first, last = lowest.get_xlim()
    lines = [((t, 0.0), (t, 1.0)) for t in lowest.get_xticks() if first <= t <= last]
    for ax in others:
        ax.xaxis.set_visible(False)
        ruled = LineCollection(lines, colors=GRID, linewidths=THIN, zorder=0.5, transform=ax.get_xaxis_transform())
        ax.add_collection(ruled, autolim=False)


def _name_rows(axes: Sequence[Axes], rows: Sequence[Panel], *, title: str) -> None:
    """Label the left column: title, quantity, name and unit."""
    axes[0].set_title(short(title, 55), fontsize="medium", loc="left")
    for ax, panel in zip(axes, rows, strict=True):
        ax.set_ylabel(f"{short(panel.title, 26)}\n[{panel.unit or '-'}]", fontsize="small")
        ax.yaxis.set_label_coords(-LABEL / COLUMN, 0.5)


def _legend(axes: Sequence[Axes], *, beside: Sequence[Axes]) -> None:
    """Name the lines of both columns above the right one, where nothing can be covered, each once."""
    named: dict[str, Any] = {}
    for ax in (*axes, *beside):
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True):
            named.setdefault(text, handle)
    if named:
        axes[0].legend(
            list(named.values()),
            list(named),
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.2,
            columnspacing=1.2,
            handlelength=1.4,
            ncols=2,
            frameon=False,
            fontsize="small" if len(named) < 3 else "x-small",
        )


def _draw_panel(ax: Axes, panel: Panel, start: float, end: float) -> None:
    """Draw what of a row is seen between two times."""
    seen = [line.within(start, end) for line in panel.lines]
    if panel.kind == "residual":
        if panel.band > 0:
            ax.axhspan(-panel.band, panel.band, color=RESIDUAL, alpha=0.13, lw=0)
        ax.axhline(0.0, color=INPUT, lw=0.5)
    for line in seen:
        marker = "." if len(panel.lines[0].within(start, end).time) <= MARKERS_UP_TO else ""
        look = dict(LOOKS[line.style])
        if line.style in ("measured", "residual") and marker:
            look |= {"marker": marker, "ms": 7 if line.style == "measured" else 4}
        drawn = (line.time, line.values) if line.style == "left out" else envelope(line.time, line.values)
        if panel.kind == "residual" and line.style == "left out":  # beyond the row's scale: marked at its edge
            edge = 1.08 * panel.largest(seen)
            drawn = (line.time, np.clip(line.values, -edge, edge))
        label = LABELS.get(line.style)
        ax.plot(*drawn, label=label if panel.kind == "signal" or line.style == "taken out" else None, **look)
    if panel.kind == "input":
        values = seen[0].values
        low, high = min(0.0, float(np.nanmin(values))), max(0.0, float(np.nanmax(values)))
        margin = 0.25 * (high - low) or 1.0
        ax.set_ylim(low - margin, high + margin)
    elif panel.kind == "residual":
        largest = 1.15 * panel.largest(seen)
        ax.set_ylim(-largest, largest)
    else:
        ax.margins(y=0.08)
    ax.locator_params(axis="y", nbins=TICKS[panel.kind])


def _shade(ax: Axes, panel: Panel, places: Sequence[Place], start: float, end: float) -> None:
    """Shade where reasons lie, no narrower than can be seen."""
    for place in places:
        if panel.kind == "residual" or place.signal not in ("", panel.name) or place.end < start or place.start > end:
            continue
        spare = max(0.0, LEAST_SHADE * (end - start) - (place.end - place.start)) / 2
        ax.axvspan(place.start - spare, place.end + spare, color=PLACE, alpha=0.33, lw=0, label="where the reason lies")


def finish(ax: Axes) -> None:
    """Give an axes its look: a light grid, no box, plain numbers (an offset text would overlap)."""
    from matplotlib.ticker import FuncFormatter

    ax.grid(True, color=GRID, lw=THIN)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize="small")
    plain = FuncFormatter(lambda value, _: number_text(value, digits=TICK_DIGITS))
    ax.xaxis.set_major_formatter(plain)
    if ax.get_yscale() == "linear":
        ax.yaxis.set_major_formatter(plain)


def short(text: str, longest: int) -> str:
    """Return a text, cut where it is longer."""
    return text if len(text) <= longest else text[: longest - 1] + "…"
