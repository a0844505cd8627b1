"""Figures of matplotlib: what is drawn, and that no label covers another."""

import dataclasses
import io
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from made_estimates import comparison
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread

from estimator.results import figure_layout, panels, plots
from estimator.results.numbers import number_text
from estimator.results.reason import Place
from estimator.results.result import Comparison

ROOT = Path(__file__).resolve().parent.parent
NOISE = {"i": 0.02, "w": 1.0}


def unequal(n: int) -> np.ndarray:
    """Return a voltage that switches all the time."""
    levels = np.random.default_rng(3).choice([-10.5, 10.5], n // 100 + 1)
    return np.repeat(levels, 100)[:n]


def named(made: Comparison, name: str, unit: str) -> Comparison:
    """Return a comparison with one output of another name and unit."""
    return Comparison(
        name="a recording with a very long name that goes on and on until nobody reads it any more.csv",
        time=made.time + 1e4,
        inputs=made.inputs,
        measured={name: 1e6 * made.measured["w"]},
        simulated={name: 1e6 * made.simulated["w"]},
        units={name: unit, "v": "V"},
    )


def without_simulation(made: Comparison) -> Comparison:
    return Comparison(made.name, made.time, made.inputs, made.measured, {}, made.units)


def with_gap(made: Comparison) -> Comparison:
    current = made.measured["i"].copy()
    current[1000:1400] = np.nan
    measured = {"i": current, "w": made.measured["w"]}
    return Comparison(made.name, made.time, made.inputs, measured, made.simulated, made.units)


def with_marks(made: Comparison) -> Comparison:
    out = np.zeros(len(made.time), dtype=bool)
    out[[520, 700, 701]] = True
    ripple = 0.01 * np.cos(made.time * 300) * (made.time > 0.5)
    return dataclasses.replace(made, left_out={"i": out}, taken_out={"i": ripple})


CASES = {
    "noisy": [comparison()],
    "noise-free": [comparison(noise=(1e-15, 1e-13))],
    "exact": [comparison(noise=(0.0, 0.0))],
    "negative from the first row": [comparison(np.full(2801, -10.5))],
    "long": [comparison(unequal(100_000), step=1e-4)],
    "short": [comparison(np.full(12, 10.5))],
    "gap": [with_gap(comparison())],
    "strange": [named(comparison(), "model.drive.shaft.flange.phi_relative", "kg.m2/(A.s3)")],
    "not simulated": [without_simulation(comparison())],
    "outliers and ripple": [with_marks(comparison())],
    "two": [comparison(), comparison(np.full(2801, 5.0), name="second")],
}
SIX = [comparison(np.full(30, 10.5), name=f"r{k}") for k in range(6)]


OTHERS = ("exact", "negative from the first row", "long", "gap", "noisy")  # whose labels are those of some other


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.full if n in OTHERS else ()) for n in CASES])
def test_no_text_covers_another_or_leaves_the_figure(name):
    figure = plots.comparison_figure(CASES[name], noise=NOISE)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in figure.texts]
    for ax in figure.axes:
        texts = [ax.title, ax._left_title, ax.xaxis.label, ax.yaxis.label]
        texts += [label for axis in (ax.xaxis, ax.yaxis) for label in shown_labels(axis, ax)]
        if ax.get_legend() is not None:
            texts += ax.get_legend().get_texts()
        boxes += [
            (text.get_text(), text.get_window_extent(renderer))
            for text in texts
            if text.get_visible() and text.get_text()
        ]
    page = figure.bbox
    for text, box in boxes:
        assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1, text
    for (one, box), (other, other_box) in itertools.combinations(boxes, 2):
        assert not box.overlaps(other_box), (one, other)


def shown_labels(axis, ax):
    """Return the tick labels that lie inside the axes and are switched on."""
    side = "labelbottom" if axis is ax.xaxis else "labelleft"
    if not (axis.get_visible() and axis.get_tick_params()[side]):
        return []
    low, high = sorted(axis.get_view_interval())
    return [
        tick.label1 for tick in axis.get_major_ticks() if low - 1e-9 <= tick.get_loc() <= high + 1e-9
    ]  # others are not drawn


@pytest.mark.parametrize("name", ["long", "not simulated", pytest.param("noisy", marks=pytest.mark.full)])
def test_a_figure_is_a_png_of_moderate_size_and_shows_its_colours(name):
    content = plots.png(plots.comparison_figure(CASES[name], noise=NOISE))
    image = imread(io.BytesIO(content))
    assert len(content) < 500_000
    assert image.shape[1] == int(figure_layout.WIDTH * plots.DPI)
    colours = [figure_layout.MEASURED, figure_layout.RESIDUAL, figure_layout.SIMULATED]
    for colour in colours[: 1 if name == "not simulated" else 3]:
        rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
        assert np.any(np.all(np.abs(image[:, :, :3] - rgb) < 0.01, axis=2)), colour


def test_the_same_estimate_gives_the_same_png_and_the_figure_stays_as_it_was():
    figures = [plots.comparison_figure(CASES["short"], noise=NOISE) for _ in range(2)]
    before = figures[0].get_dpi()
    one, two, again = (plots.png(figure) for figure in (*figures, figures[0]))
    assert one == two == again
    assert figures[0].get_dpi() == before != plots.DPI


def test_all_rows_of_a_column_have_the_lines_of_its_time_axis():
    axes = plots.comparison_figure([comparison()], noise=NOISE).axes
    for left in sorted({ax.get_position().x0 for ax in axes}):
        *others, lowest = (ax for ax in axes if ax.get_position().x0 == left)
        first, last = lowest.get_xlim()
        ticks = [t for t in lowest.get_xticks() if first <= t <= last]
        assert len(ticks) > 2
        for ax in others:
            (ruled,) = (c for c in ax.collections if len(c.get_segments()) == len(ticks))
            assert [segment[0][0] for segment in ruled.get_segments()] == ticks


def test_signals_have_their_quantity_name_and_unit_and_residuals_lie_below():
    figure = plots.comparison_figure([comparison()], noise=NOISE)
    left = [ax for ax in figure.axes if ax.get_ylabel()]
    assert [ax.get_ylabel() for ax in left] == [
        "voltage v\n[V]",
        "current i\n[A]",
        "residual\n[A]",
        "speed w\n[rad/s]",
        "residual\n[rad/s]",
    ]
    heights = [ax.get_position().y0 for ax in left]
    assert heights == sorted(heights, reverse=True)
    assert len(figure.axes) == 10, "the enlarged part has its own column; an input of zeros has no row"


def test_recordings_beyond_the_first_four_are_counted():
    figure = plots.comparison_figure(SIX)
    assert [text.get_text() for text in figure.texts] == ["2 more recordings are not shown"]
    figure = plots.comparison_figure(SIX[:5])
    assert [text.get_text() for text in figure.texts] == ["one more recording is not shown"]


def modules_of(code):
    """Return the modules that a program started anew prints."""
    path = os.pathsep.join(["tests", ".", *sys.path])
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, capture_output=True, check=True
    )
    return run.stdout.decode().split()


def test_nothing_global_is_touched():
    code = (
        "import sys; from made_estimates import comparison; from estimator.results import plots;"
        "plots.png(plots.comparison_figure([comparison()])); print(*sys.modules)"
    )
    loaded = modules_of(code)
    assert "matplotlib.figure" in loaded and "matplotlib.pyplot" not in loaded


def legend(figure):
    """Return what the legend names."""
    (found,) = [ax.get_legend() for ax in figure.axes if ax.get_legend() is not None]
    return [text.get_text() for text in found.get_texts()]


def test_outliers_and_ripple_are_drawn_and_named_where_there_are_some():
    assert legend(plots.comparison_figure([comparison()])) == ["measured", "simulated with the estimate"]
    figure = plots.comparison_figure(CASES["outliers and ripple"])
    assert legend(figure)[2:] == ["outlier, weighted down", "ripple or drift, taken out"]
    current = next(ax for ax in figure.axes if ax.get_ylabel() == "current i\n[A]")
    crosses = [line for line in current.lines if line.get_marker() == "x"]
    assert [len(line.get_xdata()) for line in crosses] == [3]


def test_outliers_do_not_rule_the_scale_of_the_residuals_and_are_marked_at_its_edge():
    made = comparison()
    measured = made.measured["i"].copy()
    measured[[30, 60]] += [5.0, -7.0]
    out = np.zeros(len(measured), dtype=bool)
    out[[30, 60]] = True
    made = dataclasses.replace(made, measured={**made.measured, "i": measured}, left_out={"i": out})
    figure = plots.comparison_figure([made])
    residual = next(ax for ax in figure.axes if ax.get_ylabel() == "residual\n[A]")
    top = residual.get_ylim()[1]
    assert top < 1.0
    (crosses,) = [line for line in residual.lines if line.get_marker() == "x"]
    assert list(np.sign(crosses.get_ydata())) == [1, -1] and np.all(np.abs(crosses.get_ydata()) < top)
    rows = [r for r in panels.panels(made) if r.kind == "residual" and r.unit == "A"]
    assert rows[0].largest(rows[0].lines) < 1.0


def test_ticks_are_written_as_the_tables_write_numbers():
    made = comparison(noise=(1e-5, 1e-3))
    figure = plots.comparison_figure([made])
    FigureCanvasAgg(figure).draw()
    residual = next(ax for ax in figure.axes if ax.get_ylabel() == "residual\n[A]")
    texts = [label.get_text() for label in residual.get_yticklabels()]
    assert "0" in texts and all(text == number_text(float(text)) for text in texts)
    assert any("e-05" in text for text in texts)


def test_where_a_reason_lies_is_shaded_in_the_signal_that_shows_it():
    shown = comparison()
    figure = plots.comparison_figure([shown], places=[Place(shown.name, "w", 2.0, 2.4), Place("another", "", 0.0, 9.0)])
    shaded = [(ax, patch) for ax in figure.axes for patch in ax.patches if patch.get_label() == "where the reason lies"]
    ((ax, patch),) = shaded
    assert "speed" in ax.get_ylabel() and patch.get_x() == 2.0 and patch.get_width() == pytest.approx(0.4)
    assert "where the reason lies" in legend(figure)
