"""Pieces of drawings as SVG text: boxes with axes, lines, marks, error bars. Knows numbers and colours' names only.

Colours are classes, which the page's style gives a colour, in the light and in the dark. Coordinates of lines are whole
tenths of a pixel, relative to the point before: a line of a thousand points takes some 6 kB.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from estimator.results.numbers import number_text

FloatArray = NDArray[np.float64]

FINE = 10  # units a pixel
BAR, BAR_WIDTH = 20.0, 160.0  # pixels, of an error bar
NEAR = 8.0  # pixels from a tick's label to its axis


@dataclass(frozen=True)
class Box:
    """A plot's place in a drawing and its scales: pixels from the left and the top, and the values at its edges.

    Attributes
    ----------
    log : bool
        The vertical scale is logarithmic.
    """

    left: float
    top: float
    width: float
    height: float
    first: float
    last: float
    low: float
    high: float
    log: bool = False

    def x(self, value: float) -> float:
        """Return the pixel of a horizontal value."""
        return self.left + self.width * (value - self.first) / ((self.last - self.first) or 1.0)

    def y(self, value: float) -> float:
        """Return the pixel of a vertical value."""
        low, high = (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)
        value = math.log(value) if self.log else value
        return self.top + self.height * (high - value) / ((high - low) or 1.0)

    def _points(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return coordinates in whole tenths of a pixel from the box's corner; NaN stays."""
        low, high = (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)
        values = np.log(y) if self.log else y
        across = FINE * self.width * (x - self.first) / ((self.last - self.first) or 1.0)
        down = FINE * self.height * (high - values) / ((high - low) or 1.0)
        return np.round(across), np.asarray(np.round(np.clip(down, -FINE * self.height, 2 * FINE * self.height)))

    def line(self, x: FloatArray, y: FloatArray, style: str, *, held: bool = False, told: str = "") -> str:
        """Return a line through points, broken where one is missing.

        Parameters
        ----------
        held : bool
            Draw stairs: each value holds until the next.
        told : str
            What the read-out calls it; "" for a line that it does not read.
        """
        if held and len(x) > 1:
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        across, down = self._points(x, y)
        commands = []
        for run in runs_of(np.isfinite(down)):
            steps = np.diff(across[run], prepend=0), np.diff(down[run], prepend=0)
            numbers = [f"{int(dx)} {int(dy)}" for dx, dy in zip(*(s.tolist() for s in steps), strict=True)]
            commands.append(f"M{numbers[0]}" + (f"l{' '.join(numbers[1:])}" if len(numbers) > 1 else "h0"))
        reads = (
            f' data-name="{escape(told)}" data-low="{self.low:.9g}" data-high="{self.high:.9g}"'
            f' data-height="{FINE * self.height:g}"'
            if told
            else ""
        )
        path = "".join(commands).replace(" -", "-")
        return f'<path class="{style}" d="{path}"{reads} transform="{self._place()}"/>'

    def dots(self, x: FloatArray, y: FloatArray, style: str) -> str:
        """Return a dot for each point that is there."""
        across, down = self._points(x, y)
        known = np.isfinite(down)
        marks = [f"M{int(a)} {int(b)}h0" for a, b in zip(across[known].tolist(), down[known].tolist(), strict=True)]
        return f'<path class="{style} dots" d="{"".join(marks)}" transform="{self._place()}"/>'

    def crosses(self, x: FloatArray, y: FloatArray, style: str, *, size: int = 3) -> str:
        """Return a cross for each point that is there, of so many pixels to each side."""
        across, down = self._points(x, y)
        known = np.isfinite(down)
        s = FINE * size
        shape = f"l{2 * s} {2 * s}m0-{2 * s}l-{2 * s} {2 * s}"
        pairs = zip(across[known].tolist(), down[known].tolist(), strict=True)
        marks = [f"M{int(a) - s} {int(b) - s}{shape}" for a, b in pairs]
        return f'<path class="{style}" d="{"".join(marks)}" transform="{self._place()}"/>'

    def band(self, low: float, high: float, style: str) -> str:
        """Return a stripe between two vertical values."""
        top, bottom = self.y(min(high, self.high)), self.y(max(low, self.low))
        return _rectangle(self.left, top, self.width, bottom - top, style)

    def stripe(self, first: float, last: float, style: str, *, least: float = 2.0) -> str:
        """Return a stripe between two horizontal values, of so many pixels at least."""
        start, end = self.x(max(first, self.first)), self.x(min(last, self.last))
        wide = max(end - start, least)
        return _rectangle(start - (wide - (end - start)) / 2, self.top, wide, self.height, style)

    def grid(self, *, across: int, up: int, labels: bool = True, unit: str = "") -> str:
        """Return grid lines and tick labels; `unit` follows the name of the horizontal axis, below it.

        Parameters
        ----------
        across, up : about so many ticks on each axis
        labels : bool
            Write the horizontal axis's numbers.
        """
        parts = []
        bottom = self.top + self.height
        for value in ticks(self.first, self.last, across):
            x = self.x(value)
            parts.append(f'<path class="grid" d="M{x:.1f} {self.top:.1f}V{bottom:.1f}"/>')
            if labels:
                parts.append(text(x, bottom + 15, number_text(value, digits=10), anchor="middle"))
        for value in decades(self.low, self.high) if self.log else ticks(self.low, self.high, up):
            y = self.y(value)
            parts.append(f'<path class="grid" d="M{self.left:.1f} {y:.1f}H{self.left + self.width:.1f}"/>')
            parts.append(text(self.left - NEAR, y + 4, number_text(value, digits=10), anchor="end"))
        parts.append(f'<path class="axis" d="M{self.left:.1f} {self.top:.1f}V{bottom:.1f}h{self.width:.1f}"/>')
        if unit:
            parts.append(text(self.left + self.width / 2, bottom + 32, unit, anchor="middle"))
        return "".join(parts)

    def _place(self) -> str:
        return f"translate({self.left:g} {self.top:g})scale(.1)"


def drawing(parts: Iterable[str], *, width: float, height: float, name: str, style: str = "", data: str = "") -> str:
    """Return a drawing with what it shows in words, for who cannot see it."""
    return (
        f'<svg class="{style}" viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img"'
        f' aria-label="{escape(name)}"{data}>{"".join(parts)}</svg>'
    )


def text(x: float, y: float, said: str, *, anchor: str = "start", style: str = "") -> str:
    """Return a line of text."""
    cls = f' class="{style}"' if style else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{cls}>{escape(said)}</text>'


def ticks(low: float, high: float, about: int) -> list[float]:
    """Return round numbers between two, about so many.

    >>> ticks(0.0, 10.5, 5)
    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    """
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return [low] if math.isfinite(low) else []
    rough = (high - low) / max(about, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = min((m * power for m in (1.0, 2.0, 5.0, 10.0)), key=lambda s: abs(math.log(s / rough)))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(f"{k * step:.12g}") for k in range(first, last + 1)]


def decades(low: float, high: float) -> list[float]:
    """Return the powers of ten between two numbers above zero, five at most."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    every = max(1, math.ceil((last - first + 1) / 5))
    return [10.0**k for k in range(first, last + 1, every)]


def runs_of(known: NDArray[np.bool_]) -> list[slice]:
    """Return where an array, (n,), is true without a break."""
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True)
class Bar:
    """One estimate on a relative axis, in percent of a reference: where it lies, its standard error, other marks."""

    at: float
    error: float | None
    mark: float | None = None  # what it is compared with, a nominal value
    edges: tuple[float, ...] = ()  # bounds


def bar_limit(bars: Sequence[Bar], *, most: float = 100.0) -> float:
    """Return half the width, in percent, of an axis that shows every bar to two standard errors, or `most`."""
    reach = [abs(b.at) + 2 * (b.error or 0.0) for b in bars] + [abs(b.mark) for b in bars if b.mark is not None]
    largest = max((r for r in reach if math.isfinite(r)), default=1.0) or 1.0
    if largest >= most:
        return most
    power = 10.0 ** math.floor(math.log10(largest))
    return min(most, next(m * power for m in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0) if m * power >= largest * 0.999))


def bar(entry: Bar, *, limit: float, width: float = BAR_WIDTH, name: str = "") -> str:
    """Return an error bar as a drawing of its own."""
    return drawing([bar_marks(entry, limit=limit, width=width)], width=width, height=BAR, name=name, style="bar")


def bar_marks(entry: Bar, *, limit: float, width: float) -> str:
    """Return an error bar around zero percent: one standard error thick, two thin, an arrow where it goes beyond."""
    middle, height = width / 2, BAR
    scale = (middle - 6) / limit

    def x(percent: float) -> float:
        return middle + scale * min(max(percent, -limit), limit)

    y = height / 2
    parts = [f'<path class="grid" d="M{middle:g} 0V{height:g}"/>']
    if entry.error is not None and math.isfinite(entry.error):
        for times, style in ((2, "bar2"), (1, "bar1")):
            low, high = entry.at - times * entry.error, entry.at + times * entry.error
            parts.append(f'<path class="{style}" d="M{x(low):.1f} {y:g}H{x(high):.1f}"/>')
        if entry.at + 2 * entry.error > limit:
            parts.append(f'<path class="arrow" d="M{x(limit):.1f} {y - 4:g}l5 4-5 4z"/>')
        if entry.at - 2 * entry.error < -limit:
            parts.append(f'<path class="arrow" d="M{x(-limit):.1f} {y - 4:g}l-5 4 5 4z"/>')
    for edge in entry.edges:
        if abs(edge) <= limit:
            parts.append(f'<path class="bound" d="M{x(edge):.1f} 2V{height - 2:g}"/>')
    if abs(entry.at) <= limit:
        parts.append(f'<circle class="point" cx="{x(entry.at):.1f}" cy="{y:g}" r="3.2"/>')
    if entry.mark is not None:
        parts.append(f'<path class="nominal" d="M{x(entry.mark):.1f} {y - 5:g}l5 5-5 5-5-5z"/>')
    return "".join(parts)


def bar_axis(limit: float, *, width: float = BAR_WIDTH) -> str:
    """Return the axis below a column of bars, as a drawing of its own."""
    name = f"axis from {-limit:g} to {limit:g} percent"
    return drawing([axis_marks(limit, width=width)], width=width, height=18, name=name, style="bar")


def axis_marks(limit: float, *, width: float) -> str:
    """Return the axis below a column of bars."""
    middle = width / 2
    scale = (middle - 6) / limit
    parts = [f'<path class="axis" d="M6 1H{width - 6:g}"/>']
    for value in (-limit, 0.0, limit):
        x = middle + scale * value
        said = "0" if value == 0 else f"{value:+g} %"
        anchor = "middle" if value == 0 else "start" if value < 0 else "end"
        parts.append(text(x if value == 0 else x + math.copysign(4, value), 14, said, anchor=anchor))
        parts.append(f'<path class="axis" d="M{x:.1f} 1v4"/>')
    return "".join(parts)


def _rectangle(x: float, y: float, width: float, height: float, style: str) -> str:
    return f'<rect class="{style}" x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{max(height, 0):.1f}"/>'
