"""The figure of an estimate in matplotlib's objects, for notebooks and print. Knows only the layout.

They are used without pyplot, so that nothing global is touched and no display is needed. Axes are placed in inches by
hand: that takes half the time of a layout engine, and the picture (picture.py) has the same geometry.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.results import figure_layout as layout
from estimator.results.figure_layout import COLUMN, DPI, GRID, LABEL, THIN
from estimator.results.numbers import number_text
from estimator.results.png import png_of
from estimator.results.reason import Place
from estimator.results.result import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def comparison_figure(
    comparisons: Sequence[Comparison], *, noise: Mapping[str, float] | None = None, places: Sequence[Place] = ()
) -> Figure:
    """Return the figure of recordings, which `layout.laid_out` tells."""
    from matplotlib.figure import Figure

    found = layout.laid_out(comparisons, noise=noise, places=places)
    fig = Figure(figsize=(layout.WIDTH, found.height))
    for first, second in zip(found.columns[::2], found.columns[1::2], strict=True):
        left, right = (_column(fig, column, height=found.height) for column in (first, second))
        _legend(right, beside=left)
    if found.below:
        fig.text(0.5, 0.1 / found.height, found.below, ha="center", va="bottom", fontsize="small")
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

    canvas, own = FigureCanvasAgg(fig), fig.get_dpi()
    fig.set_dpi(dpi)
    canvas.draw()  # type: ignore[no-untyped-call]
    drawn = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    fig.set_dpi(own)
    return png_of(drawn[:, :, :3], dpi=dpi)


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


def _column(fig: Figure, column: layout.Column, *, height: float) -> list[Axes]:
    """Draw one column of a recording in a figure of some height, inch; return its axes, with a common time axis."""
    axes: list[Axes] = []
    for plot in column.plots:
        lower = height - plot.top - plot.height
        rectangle = (column.left / layout.WIDTH, lower / height, COLUMN / layout.WIDTH, plot.height / height)
        ax = fig.add_axes(rectangle, sharex=axes[0] if axes else None)
        _draw(ax, plot)
        axes.append(ax)
        if column.is_first:
            ax.set_ylabel(plot.label, fontsize="small")
            ax.yaxis.set_label_coords(-LABEL / COLUMN, 0.5)
    if column.end > column.start:
        axes[0].set_xlim(column.start, column.end)
    axes[0].set_title(column.title, fontsize="medium", loc="left")
    axes[-1].set_xlabel("time [s]")
    axes[-1].locator_params(axis="x", nbins=layout.TICKS_ACROSS)
    for ax in axes:
        finish(ax)
    _rule_as(axes[-1], axes[:-1])
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
            labelspacing=0.5 if len(named) < 5 else 0.1,
            columnspacing=1.2,
            handlelength=1.4,
            ncols=2,
            frameon=False,
            fontsize="small" if len(named) < 3 else "x-small",
        )


def _draw(ax: Axes, plot: layout.Plot) -> None:
    """Draw one plot."""
    band = plot.panel.band
    if plot.panel.kind == "residual":
        if band > 0:
            ax.axhspan(-band, band, color=layout.RESIDUAL, alpha=layout.BAND_SHARE, lw=0)
        ax.axhline(0.0, color=layout.INPUT, lw=0.5)
    for drawn in plot.lines:
        look, alone = drawn.look, drawn.line.style == "left out"
        ax.plot(
            drawn.line.time,
            drawn.line.values,
            color=look.colour,
            lw=look.width,
            ls="" if alone else "-",
            drawstyle="steps-post" if look.held else "default",
            marker=look.mark if drawn.marked else "",
            ms=look.size,
            mew=look.width if alone else 0.0,
            label=drawn.label or None,
        )
    for start, end in plot.shaded:
        ax.axvspan(start, end, color=layout.PLACE, alpha=layout.PLACE_SHARE, lw=0, label=layout.WHERE)
    ax.set_ylim(plot.low, plot.high)
    ax.locator_params(axis="y", nbins=layout.TICKS[plot.panel.kind])


def finish(ax: Axes) -> None:
    """Give an axes its look: a light grid, no box, plain numbers (an offset text would overlap)."""
    from matplotlib.ticker import FuncFormatter

    ax.grid(True, color=GRID, lw=THIN)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize="small")
    plain = FuncFormatter(lambda value, _: number_text(value, digits=layout.TICK_DIGITS))
    ax.xaxis.set_major_formatter(plain)
    if ax.get_yscale() == "linear":
        ax.yaxis.set_major_formatter(plain)
