"""The picture of an estimate: that it is matplotlib's figure, and that no label covers another."""

import dataclasses
import io
import itertools

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from test_plots import CASES, NOISE, SIX, modules_of

from estimator.results import canvas, figure_layout, picture, plots
from estimator.results.canvas import Canvas, Field, mixed
from estimator.results.png import png_of
from estimator.results.reason import Place

MARKED = dataclasses.replace(CASES["outliers and ripple"][0], name="marked")
ALL_NAMED = [MARKED], [Place("marked", "w", 2.0, 2.4)]  # as many names in the legend as there can be


def pixels(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))


def coarse(content: bytes) -> np.ndarray:
    """Return a picture's darkness, each number of 10 × 10 pixels, from 0 to 1."""
    dark = 1 - pixels(content).mean(axis=2) / 255
    rows, columns = (n // 10 for n in dark.shape)
    return dark[: 10 * rows, : 10 * columns].reshape(rows, 10, columns, 10).mean(axis=(1, 3))


@pytest.mark.parametrize("name", [*CASES, "all named", "six"])
def test_no_text_covers_another_or_leaves_the_picture(name):
    shown, places = ALL_NAMED if name == "all named" else ({**CASES, "six": SIX}[name], [])
    drawn = picture.drawn(figure_layout.laid_out(shown, noise=NOISE, places=places))
    height, width, _ = drawn.pixels().shape
    assert len(drawn.texts) > 10
    for text, (left, top, right, bottom) in drawn.texts:
        assert 0 <= left < right <= width and 0 <= top < bottom <= height, text
    for (one, box), (other, beside) in itertools.combinations(drawn.texts, 2):
        apart = box[2] <= beside[0] or beside[2] <= box[0] or box[3] <= beside[1] or beside[3] <= box[1]
        assert apart, (one, other)


ALIKE = {"noisy", "short", "gap", "outliers and ripple", "not simulated"}  # by default: what is drawn, each once


@pytest.mark.parametrize("name", [pytest.param(c, marks=() if c in ALIKE else pytest.mark.full) for c in CASES])
def test_it_looks_as_the_figure_of_matplotlib(name):
    """Ticks and their labels may differ; lines do not."""
    own = picture.comparison_png(CASES[name], noise=NOISE)
    theirs = plots.png(plots.comparison_figure(CASES[name], noise=NOISE))
    assert pixels(own).shape == pixels(theirs).shape
    one, other = coarse(own), coarse(theirs)
    assert np.mean(np.abs(one - other)) < 0.015
    assert np.corrcoef(one.ravel(), other.ravel())[0, 1] > 0.9


@pytest.mark.parametrize("name", ["noisy", "long", "not simulated"])
def test_it_is_a_png_of_moderate_size_and_shows_its_colours(name):
    content = picture.comparison_png(CASES[name], noise=NOISE)
    image = pixels(content)
    assert len(content) < 300_000 and image.shape[1] == int(figure_layout.WIDTH * figure_layout.DPI)
    colours = [figure_layout.MEASURED, figure_layout.RESIDUAL, figure_layout.SIMULATED]
    for colour in colours[: 1 if name == "not simulated" else 3]:
        assert np.any(np.all(image == [int(colour[k : k + 2], 16) for k in (1, 3, 5)], axis=2)), colour
    assert content == picture.comparison_png(CASES[name], noise=NOISE)


def test_a_picture_loads_no_matplotlib():
    code = (
        "import sys; from made_estimates import estimate; from estimator.results.figure_process import draw;"
        "draw(estimate(), ('png',)); print(*sys.modules)"
    )
    loaded = modules_of(code)
    assert "estimator.results.picture" in loaded and "matplotlib" not in loaded


def test_where_the_font_is_not_found_matplotlib_draws(monkeypatch):
    canvas.font_of.cache_clear()
    monkeypatch.setattr(canvas, "FONT", "mpl-data/fonts/no such font.ttf")
    made = picture.comparison_png(CASES["short"])
    canvas.font_of.cache_clear()
    assert made == plots.png(plots.comparison_figure(CASES["short"]))


def test_a_png_holds_the_pixels_and_their_size():
    image = np.random.default_rng(1).integers(0, 256, (7, 5, 3)).astype(np.uint8)
    content = png_of(image, dpi=130)
    assert np.array_equal(pixels(content), image)
    assert np.array_equal(np.round(255 * imread(io.BytesIO(content))), image)
    assert Image.open(io.BytesIO(content)).info["dpi"] == pytest.approx((130, 130), abs=0.02)


def test_a_line_is_as_wide_as_asked_where_it_was_asked():
    field = Field(40, 30)
    field.line(np.array([-5.0, 50.0]), np.array([10.0, 10.0]), width=4.0, colour="#000000")
    field.stripe(20.0, 0.0, 22.0, 5.0, "#0000ff")
    image = Canvas(60, 50)
    image.place(field, 10, 10)
    dark = 1 - image.pixels() / 255
    assert dark[:, 45].sum() / 3 == pytest.approx(4.0, abs=0.4)
    rows = np.flatnonzero(dark[:, 45, 0] > 0.5)
    assert list(rows) == [18, 19, 20, 21]
    assert np.argwhere(dark[:, :, 0] - dark[:, :, 2] > 0.5).min(axis=0).tolist() == [10, 30]
    assert not dark[:, :10].any() and not dark[:, 50:].any(), "what lies beyond a field is not seen"


def test_a_colour_over_white_is_lighter():
    assert [mixed("#d55e00", share) for share in (0, 0.5, 1)] == ["#ffffff", "#eaae80", "#d55e00"]
