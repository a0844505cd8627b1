"""The figure of an estimate as a PNG, drawn in a sixth of the time that matplotlib takes to load. Knows the layout."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from estimator.results import figure_layout as layout
from estimator.results.canvas import Canvas, Field, font_of, mixed, width_of
from estimator.results.figure_layout import DPI
from estimator.results.numbers import number_text
from estimator.results.png import png_of
from estimator.results.reason import Place
from estimator.results.result import Comparison, FloatArray
from estimator.results.svg import runs_of, ticks

POINT = DPI / 72  # pixels
MEDIUM, SMALL, SMALLER = 10 * POINT, 8.33 * POINT, 6.94 * POINT  # sizes of letters
# Pixels: length of a tick, from it to its label, beside and below an axis; from a plot to what stands above it.
TICK, NEAR, BELOW, ABOVE = 6, 6, 8, 4
TICKS_UP = {**layout.TICKS, "input": 3}  # about so many
DIGIT = 0.36  # of a letter's size: half the height of a digit
HANDLE, ROW, APART = 1.4, 1.25, 1.2  # of a letter's size: a line in the legend, its rows, its columns


def comparison_png(
    comparisons: Sequence[Comparison], *, noise: Mapping[str, float] | None = None, places: Sequence[Place] = ()
) -> bytes:
    """Return the figure of recordings, which `figure_layout.laid_out` tells, as a PNG file's content.

    By matplotlib where its font is not found, as in a system whose packages share their fonts.
    """
    try:
        font_of(SMALL)
    except (OSError, ImportError):
        from estimator.results.plots import comparison_figure, png

        return png(comparison_figure(comparisons, noise=noise, places=places))
    return png_of(drawn(layout.laid_out(comparisons, noise=noise, places=places)).pixels(), dpi=DPI)


def drawn(found: layout.Layout) -> Canvas:
    """Return a figure as an image."""
    canvas = Canvas(*(int(round(DPI * inches, 6)) for inches in (layout.WIDTH, found.height)))
    for first, second in zip(found.columns[::2], found.columns[1::2], strict=True):
        _column(canvas, first)
        _column(canvas, second)
        _legend(canvas, second, beside=first)
    if found.below:
        canvas.text(DPI * layout.WIDTH / 2, DPI * (found.height - 0.12), found.below, size=SMALL, anchor="m")
    return canvas


def _column(canvas: Canvas, column: layout.Column) -> None:
    """Draw one column of a recording."""
    left, width = round(DPI * column.left), round(DPI * layout.COLUMN)
    scale = width / ((column.end - column.start) or 1.0)
    across = [(t, scale * (t - column.start)) for t in _ticks_across(column)]
    for plot in column.plots:
        top, height = round(DPI * plot.top), round(DPI * plot.height)
        ticks_up = ticks(plot.low, plot.high, TICKS_UP[plot.panel.kind])
        up = [(v, height * (plot.high - v) / (plot.high - plot.low)) for v in ticks_up]
        field = Field(width, height)
        _draw(field, plot, column, lines=([x for _, x in across], [y for _, y in up]))
        canvas.place(field, left, top)
        canvas.rule(left - 1, top, 1, height + 1)
        canvas.rule(left - 1, top + height, width + 1, 1)
        for value, y in up:
            at = min(round(top + y), top + height)
            canvas.rule(left - 1 - TICK, at, TICK, 1)
            canvas.text(left - 1 - TICK - NEAR, at + DIGIT * SMALL, _number(value), size=SMALL, anchor="r")
        if column.is_first:
            canvas.upright(left - DPI * layout.LABEL, top + height / 2, plot.label, size=SMALL)
    bottom = top + height
    for value, x in across:
        at = min(round(left + x), left + width - 1)
        canvas.rule(at, bottom + 1, 1, TICK)
        canvas.text(at, bottom + TICK + BELOW + 2 * DIGIT * SMALL, _number(value), size=SMALL, anchor="m")
    canvas.text(left + width / 2, bottom + 49, "time [s]", size=MEDIUM, anchor="m")
    canvas.text(left, round(DPI * column.plots[0].top) - 11, column.title, size=MEDIUM)


def _ticks_across(column: layout.Column) -> list[float]:
    """Return the ticks of the time axis: as many as have room for their labels."""
    scale = DPI * layout.COLUMN / ((column.end - column.start) or 1.0)
    for about in range(layout.TICKS_ACROSS, 1, -1):
        found = ticks(column.start, column.end, about)
        widest = max((width_of(_number(t), size=SMALL) for t in found), default=0.0)
        if len(found) < 2 or widest + SMALL < scale * (found[1] - found[0]):
            break
    return found


def _number(value: float) -> str:
    return number_text(value, digits=layout.TICK_DIGITS)


def _draw(
    field: Field, plot: layout.Plot, column: layout.Column, *, lines: tuple[Sequence[float], Sequence[float]]
) -> None:
    """Draw what is inside one plot, from back to front; `lines`: of its grid, pixels."""
    w, h = field.width, field.height
    x_scale, y_scale = w / ((column.end - column.start) or 1.0), h / (plot.high - plot.low)
    band = plot.panel.band
    if plot.panel.kind == "residual" and band > 0:
        top, bottom = ((plot.high - v) * y_scale for v in (band, -band))
        field.stripe(0, top, w, bottom, mixed(layout.RESIDUAL, layout.BAND_SHARE))
    for start, end in plot.shaded:
        edges = ((t - column.start) * x_scale for t in (start, end))
        field.stripe(next(edges), 0, next(edges), h, mixed(layout.PLACE, layout.PLACE_SHARE))
    for x in lines[0]:
        field.stripe(x, 0, x, h, layout.GRID)
    for y in lines[1]:
        field.stripe(0, y, w, y, layout.GRID)
    if plot.panel.kind == "residual":
        zero = plot.high * y_scale
        field.stripe(0, zero, w, zero, layout.INPUT)
    for drawn in plot.lines:
        look, time, values = drawn.look, drawn.line.time, drawn.line.values
        if look.held and len(time) > 1:
            time, values = np.repeat(time, 2)[1:], np.repeat(values, 2)[:-1]
        along = (time - column.start) * x_scale
        down = np.clip((plot.high - values) * y_scale, -h, 2 * h)
        known = np.isfinite(down)
        for run in runs_of(known) if drawn.line.style != "left out" else ():
            field.line(along[run], down[run], width=look.width * POINT, colour=look.colour)
        if drawn.marked:
            _mark(field, along[known], down[known], look)


def _mark(field: Field, x: FloatArray, y: FloatArray, look: layout.Look) -> None:
    if look.mark == "x":
        field.crosses(x, y, size=look.size * POINT, width=look.width * POINT, colour=look.colour)
    else:
        field.dots(x, y, size=look.size * POINT, colour=look.colour)


def _legend(canvas: Canvas, column: layout.Column, *, beside: layout.Column) -> None:
    """Name the lines of both columns above the right one, where nothing can be covered."""
    named = list(layout.named(column, beside).items())
    size = SMALL if len(named) < 3 else SMALLER
    rows = math.ceil(len(named) / 2)
    right = DPI * (column.left + layout.COLUMN)
    bottom = round(DPI * column.plots[0].top) - ABOVE
    for entries in (named[rows:], named[:rows]):
        if not entries:
            continue
        left = right - max(width_of(text, size=size) for text, _ in entries) - (HANDLE + 0.6) * size
        for k, (text, drawn) in enumerate(entries):
            y = bottom - (rows - k) * ROW * size
            canvas.text(left + (HANDLE + 0.6) * size, y + 0.9 * size, text, size=size)
            field = Field(round(HANDLE * size), round(size))
            _handle(field, drawn)
            canvas.place(field, round(left), round(y + 0.12 * size))
        right = left - APART * size


def _handle(field: Field, drawn: layout.Drawn | None) -> None:
    """Draw what a line looks like; None: a shade."""
    w, middle = field.width, field.height / 2
    if drawn is None:
        field.stripe(0, 0.15 * field.height, w, 0.85 * field.height, mixed(layout.PLACE, layout.PLACE_SHARE))
        return
    look = drawn.look
    if drawn.line.style != "left out":
        field.line(np.array([0.0, w]), np.full(2, middle), width=look.width * POINT, colour=look.colour)
    if drawn.marked:
        _mark(field, np.array([w / 2]), np.array([middle]), look)
