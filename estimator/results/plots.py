"""Figures of an estimate: measured against simulated, residuals, an enlarged part. Knows only the result.

Colours are told apart by the colour blind and in grey print (Okabe and Ito 2008). Matplotlib's objects are
used without pyplot, so that nothing global is touched and no display is needed. Axes are placed in inches by
hand: that takes half the time of a layout engine, and every figure has the same geometry.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from estimator.results.result import Comparison, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED = "#9a9a9a"
SIMULATED = "#0072b2"  # Okabe-Ito blue
RESIDUAL = "#d55e00"  # Okabe-Ito vermillion
INPUT = "#000000"

# inch
WIDTH, COLUMN = 11.0, 4.4  # of the figure, of the axes
LEFT, BETWEEN = 1.1, 0.8  # room for labels and tick labels
INPUT_HEIGHT, SIGNAL_HEIGHT, RESIDUAL_HEIGHT = 0.55, 1.7, 0.85
GAP, TOP, BOTTOM = 0.14, 0.4, 0.62  # between rows; above and below a recording
LABEL = 0.77  # from the axes to their label

DPI = 130
BINS = 600  # of an envelope: about one for each pixel of a column
MOST_RECORDINGS = 4  # in one figure
MARKERS_UP_TO = 160  # samples in view: then each is shown
MOVEMENT = 0.985  # share of all movement that the enlarged part holds
LONGEST = 0.4  # of the record; beyond that only a piece of the movement is enlarged
PIECE = 0.08  # of the record, enlarged when the signals move all the time
QUANTITIES = {
    "A": "current",
    "V": "voltage",
    "rad/s": "speed",
    "rad": "angle",
    "N.m": "torque",
    "K": "temperature",
    "W": "power",
}


def comparison_figure(comparisons: Sequence[Comparison], *, noise: Mapping[str, float] | None = None) -> Figure:
    """Return measured against simulated signals and residuals: the whole record left, the transient right.

    Parameters
    ----------
    comparisons : one a recording
        Drawn below each other; those beyond the first `MOST_RECORDINGS` are only counted.
    noise : output name → standard deviation, SI units
        Drawn as a band of two standard deviations behind the residuals.
    """
    from matplotlib.figure import Figure

    shown = comparisons[:MOST_RECORDINGS]
    rest = len(comparisons) - len(shown)
    height = sum(_height(comparison) for comparison in shown) + (0.3 if rest else 0.0)
    fig = Figure(figsize=(WIDTH, height))
    top = height
    for comparison in shown:
        _draw(fig, comparison, top=top, noise=noise or {})
        top -= _height(comparison)
    if rest:
        text = "one more recording is" if rest == 1 else f"{rest} more recordings are"
        fig.text(0.5, 0.1 / height, f"{text} not shown", ha="center", va="bottom", fontsize="small")
    return fig


def png(fig: Figure, *, dpi: float = DPI) -> bytes:
    """Return a figure as a PNG file's content; the same figure gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    stream = io.BytesIO()
    FigureCanvasAgg(fig)
    fig.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
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

    That is where nearly all movement of the simulated signals (they have no noise) takes place; when they
    move all the time, it is the short piece in which they move most.
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
    if time[last] - time[first] > LONGEST * (time[-1] - time[0]):
        width = max(int(PIECE * n), 3)
        first = int(np.argmax(moved[width:] - moved[:-width]))
        last = first + width
    margin = 0.15 * (time[last] - time[first])
    return float(max(time[first] - margin, time[0])), float(min(time[last] + margin, time[-1]))


def _rows(comparison: Comparison) -> list[tuple[str, str, float]]:
    """Return what is drawn from top to bottom: kind, name and height in inch of every row."""
    rows = [("input", name, INPUT_HEIGHT) for name in comparison.inputs if comparison.inputs[name].any()]
    for name in comparison.measured:
        rows += [("signal", name, SIGNAL_HEIGHT), ("residual", name, RESIDUAL_HEIGHT)]
    return rows


def _height(comparison: Comparison) -> float:
    rows = _rows(comparison)
    return sum(height for _, _, height in rows) + (len(rows) - 1) * GAP + TOP + BOTTOM


def _draw(fig: Figure, comparison: Comparison, *, top: float, noise: Mapping[str, float]) -> None:
    """Draw one recording; `top` is its upper edge, in inch from the lower edge of the figure."""
    time = comparison.time
    windows = [(float(time[0]), float(time[-1])), transient(comparison)]
    for column, (start, end) in enumerate(windows):
        first, beyond = np.searchsorted(time, [start, end]).tolist()
        seen = slice(max(first - 1, 0), beyond + 2)
        axes = _column(fig, comparison, column=column, top=top)
        for ax, (kind, name, _) in zip(axes, _rows(comparison), strict=True):
            if kind == "input":
                _draw_input(ax, time[seen], comparison.inputs[name][seen])
                continue
            measured = comparison.measured[name][seen]
            simulated = comparison.simulated.get(name, np.full(len(time), np.nan))[seen]
            if kind == "signal":
                _draw_signal(ax, time[seen], measured, simulated)
            else:
                _draw_residual(ax, time[seen], measured - simulated, noise=noise.get(name))
        if end > start:
            axes[0].set_xlim(start, end)
        axes[-1].set_xlabel("time [s]")
        axes[-1].locator_params(axis="x", nbins=6)
        for ax in axes:
            finish(ax)
        if column == 0:
            _name_rows(axes, comparison)
        else:
            axes[0].set_title("enlarged", fontsize="medium", loc="left")
            _legend(axes)


def _column(fig: Figure, comparison: Comparison, *, column: int, top: float) -> list[Axes]:
    """Return empty axes for one column of a recording, with a common time axis."""
    height = float(fig.get_figheight())
    left = LEFT + column * (COLUMN + BETWEEN)
    axes: list[Axes] = []
    upper = top - TOP
    for _, _, rows_height in _rows(comparison):
        rectangle = (left / WIDTH, (upper - rows_height) / height, COLUMN / WIDTH, rows_height / height)
        axes.append(fig.add_axes(rectangle, sharex=axes[0] if axes else None))
        upper -= rows_height + GAP
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    return axes


def _name_rows(axes: Sequence[Axes], comparison: Comparison) -> None:
    """Label the left column: title, quantity, name and unit."""
    axes[0].set_title(_short(comparison.name, 55), fontsize="medium", loc="left")
    for ax, (kind, name, _) in zip(axes, _rows(comparison), strict=True):
        unit = comparison.units.get(name, "")
        what = "residual" if kind == "residual" else f"{QUANTITIES.get(unit, '')} {_short(name, 18)}".strip()
        ax.set_ylabel(f"{what}\n[{unit or '-'}]", fontsize="small")
        ax.yaxis.set_label_coords(-LABEL / COLUMN, 0.5)


def _legend(axes: Sequence[Axes]) -> None:
    """Name the lines above the right column, where nothing can be covered."""
    for ax in axes:
        handles, texts = ax.get_legend_handles_labels()
        if handles:
            axes[0].legend(
                handles,
                texts,
                loc="lower right",
                bbox_to_anchor=(1.0, 1.0),
                borderaxespad=0.2,
                ncols=2,
                frameon=False,
                fontsize="small",
            )
            return


def _draw_input(ax: Axes, time: FloatArray, values: FloatArray) -> None:
    """Draw a held input as stairs, zero included."""
    ax.plot(*envelope(time, values), color=INPUT, lw=1.0, drawstyle="steps-post")
    low, high = min(0.0, float(np.nanmin(values))), max(0.0, float(np.nanmax(values)))
    margin = 0.25 * (high - low) or 1.0
    ax.set_ylim(low - margin, high + margin)
    ax.locator_params(axis="y", nbins=2)


def _draw_signal(ax: Axes, time: FloatArray, measured: FloatArray, simulated: FloatArray) -> None:
    """Draw a measured signal wide and grey, and the simulated one thin on top of it."""
    marker = "." if len(time) <= MARKERS_UP_TO else ""
    ax.plot(*envelope(time, measured), color=MEASURED, lw=2.2, marker=marker, ms=7, label="measured")
    ax.plot(*envelope(time, simulated), color=SIMULATED, lw=1.3, label="simulated with the estimate")
    ax.margins(y=0.08)
    ax.locator_params(axis="y", nbins=5)


def _draw_residual(ax: Axes, time: FloatArray, residual: FloatArray, *, noise: float | None) -> None:
    """Draw measured minus simulated around zero, over a band of two standard deviations of the noise."""
    sigma = noise if noise is not None and np.isfinite(noise) else 0.0
    if sigma > 0:
        ax.axhspan(-2 * sigma, 2 * sigma, color=RESIDUAL, alpha=0.13, lw=0)
    ax.axhline(0.0, color=INPUT, lw=0.5)
    marker = "." if len(time) <= MARKERS_UP_TO else ""
    ax.plot(*envelope(time, residual), color=RESIDUAL, lw=0.6, marker=marker, ms=4)
    sizes = np.abs(residual[np.isfinite(residual)])
    largest = max(float(sizes.max()) if sizes.size else 0.0, 2 * sigma) or 1.0
    ax.set_ylim(-1.15 * largest, 1.15 * largest)
    ax.locator_params(axis="y", nbins=4)


def finish(ax: Axes) -> None:
    """Give an axes its look: a light grid, no box, plain numbers (an offset text would overlap)."""
    from matplotlib.ticker import FuncFormatter

    ax.grid(True, color="#e3e3e3", lw=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize="small")
    plain = FuncFormatter(lambda value, _: _tick_text(value))
    ax.xaxis.set_major_formatter(plain)
    if ax.get_yscale() == "linear":
        ax.yaxis.set_major_formatter(plain)


def _tick_text(value: float) -> str:
    """Return a number without offset and, unless that gets long, without a power of ten."""
    text = f"{value:.10g}"
    if len(text) > 7:
        mantissa, _, exponent = f"{value:.9e}".partition("e")
        text = min(text, f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}", key=len)
    return text.replace("-", "\u2212")


def _short(text: str, longest: int) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"
