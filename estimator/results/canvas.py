"""An image that is drawn on: smooth lines, marks, stripes, texts. Knows pixels and colours only.

Lines and marks are drawn on a field of `FINE` times the pixels each way, whose means are what is seen; straight edges
lie on whole pixels.
"""

from __future__ import annotations

import functools
import importlib.util
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

FloatArray = NDArray[np.float64]
Box = tuple[int, int, int, int]  # pixels from the left and the top: left, top, right, bottom

FINE = 3
WIDE, SHARP = 2.0, 0.8  # pixels; cosine of a turn: at a sharper one a wide line is rounded
FONT = "mpl-data/fonts/ttf/DejaVuSans.ttf"  # in matplotlib's folder


class Field:
    """A part of a canvas that is drawn on finely. Coordinates are pixels from its left upper corner."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._image = Image.new("RGB", (FINE * width, FINE * height), "white")
        self._pen = ImageDraw.Draw(self._image)

    def stripe(self, left: float, top: float, right: float, bottom: float, colour: str) -> None:
        """Fill a rectangle, no thinner than a pixel, to whole pixels."""
        first, upper = round(left), round(top)
        last, lower = max(round(right), first + 1), max(round(bottom), upper + 1)
        self._pen.rectangle((FINE * first, FINE * upper, FINE * last - 1, FINE * lower - 1), fill=colour)

    def line(self, x: FloatArray, y: FloatArray, *, width: float, colour: str) -> None:
        """Draw a line through points, (n,), of so many pixels' width; it is round at its ends and where it turns."""
        points = np.round(FINE * np.column_stack([x, y]) - 0.5)
        self._pen.line(points.ravel().tolist(), fill=colour, width=_thickness(width))
        if width < WIDE:
            return
        steps = np.diff(points, axis=0)
        steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
        turns = np.ones(len(points), dtype=bool)
        turns[1:-1] = (steps[1:] * steps[:-1]).sum(axis=1) < SHARP
        self.dots(x[turns], y[turns], size=width, colour=colour)

    def dots(self, x: FloatArray, y: FloatArray, *, size: float, colour: str) -> None:
        """Draw a disc around each point, (n,), of so many pixels across."""
        half = (FINE * size - 1) / 2
        across, down = np.round(FINE * x - 0.5), np.round(FINE * y - 0.5)
        for edges in np.column_stack([across - half, down - half, across + half, down + half]).tolist():
            self._pen.ellipse(edges, fill=colour)

    def crosses(self, x: FloatArray, y: FloatArray, *, size: float, width: float, colour: str) -> None:
        """Draw a cross around each point, (n,), of so many pixels across."""
        half = FINE * size / 2
        for a, b in zip((FINE * x - 0.5).tolist(), (FINE * y - 0.5).tolist(), strict=True):
            for way in (half, -half):
                self._pen.line((a - half, b - way, a + half, b + way), fill=colour, width=_thickness(width))

    def seen(self) -> Image.Image:
        """Return what is seen of it, in the canvas's pixels."""
        return self._image.reduce(FINE)


class Canvas:
    """An image, white at first.

    Attributes
    ----------
    texts : what was written, and where
    """

    def __init__(self, width: int, height: int) -> None:
        self._image = Image.new("RGB", (width, height), "white")
        self._pen = ImageDraw.Draw(self._image)
        self.texts: list[tuple[str, Box]] = []

    def place(self, field: Field, left: int, top: int) -> None:
        """Show a field."""
        self._image.paste(field.seen(), (left, top))

    def rule(self, left: int, top: int, width: int, height: int, colour: str = "black") -> None:
        """Fill a rectangle of whole pixels."""
        self._pen.rectangle((left, top, left + width - 1, top + height - 1), fill=colour)

    def text(self, x: float, y: float, said: str, *, size: float, anchor: str = "l") -> None:
        """Write a line at its baseline, which begins ("l"), ends ("r") or has its middle ("m") at a point."""
        font, at = font_of(size), (round(x), round(y))
        self._pen.text(at, said, font=font, fill="black", anchor=f"{anchor}s")
        self.texts.append((said, _moved(font.getbbox(said, anchor=f"{anchor}s"), *at)))

    def upright(self, x: float, y: float, lines: str, *, size: float) -> None:
        """Write lines from below to above, the middle of each at height y, the last one's lower edge at x."""
        font = font_of(size)
        said = lines.split("\n")
        wide, high = round(max(font.getlength(line) for line in said)) + 2, round(1.2 * size)
        turned = Image.new("L", (wide, high * len(said)), 0)
        pen = ImageDraw.Draw(turned)
        for k, line in enumerate(said):
            pen.text((wide // 2, round((k + 0.8) * high)), line, font=font, fill=255, anchor="ms")
        turned = turned.transpose(Image.Transpose.ROTATE_90)
        left, top = round(x) - turned.width, round(y) - turned.height // 2
        self._image.paste("black", (left, top), turned)
        self.texts.append((lines, (left, top, left + turned.width, top + turned.height)))

    def pixels(self) -> NDArray[np.uint8]:
        """Return red, green and blue, (height, width, 3)."""
        return np.asarray(self._image)


def width_of(said: str, *, size: float) -> float:
    """Return how many pixels a line takes."""
    return float(font_of(size).getlength(said))


@functools.cache
def font_of(size: float) -> ImageFont.FreeTypeFont:
    """Return the font that matplotlib brings, of so many pixels.

    Raises
    ------
    OSError, ImportError
        It is not where it was looked for, or no library draws it.
    """
    found = importlib.util.find_spec("matplotlib")
    folders = [Path(folder) for folder in (found.submodule_search_locations or ()) if folder] if found else []
    path = next((folder / FONT for folder in folders if (folder / FONT).is_file()), Path(FONT).name)
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)


def mixed(colour: str, share: float) -> str:
    """Return a colour, "#rrggbb", of which a share lies over white.

    >>> mixed("#000000", 0.2)
    '#cccccc'
    """
    parts = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round(255 - share * (255 - part)):02x}" for part in parts)


def _thickness(width: float) -> int:
    """Return the width of a line on a field, rather wider: Pillow draws slanted ones thinner."""
    return math.ceil(FINE * width - 0.1)


def _moved(box: tuple[float, float, float, float], x: int, y: int) -> Box:
    left, top, right, bottom = (round(edge) for edge in box)
    return x + left, y + top, x + right, y + bottom
