"""Figures of an estimate's numbers: what is drawn, and where."""

import dataclasses

import numpy as np
import pytest
from made_estimates import MOTOR, UNITS, estimate, with_parameter
from matplotlib.backends.backend_agg import FigureCanvasAgg

from estimator.results import plots, summary_plots
from estimator.results.result import CostProfile


def profiles(names=tuple(MOTOR)) -> dict[str, CostProfile]:
    offsets = np.linspace(-3, 3, 13)
    return {
        name: CostProfile(MOTOR.get(name, 1.0) * (1 + 1e-3 * offsets), 25 * offsets**2, offsets**2) for name in names
    }


def drawn_texts(figure):
    """Return the boxes of all axis labels, visible tick labels and legend texts, drawn."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    found = [text for legend in figure.legends for text in legend.get_texts()]
    for ax in figure.axes:
        found += [ax.xaxis.label, ax.yaxis.label]
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            found += [t.label1 for t in axis.get_major_ticks() if low - 1e-12 <= t.get_loc() <= high + 1e-12]
    return [(t.get_text(), t.get_window_extent(renderer).padded(-1)) for t in found if t.get_text()]


FIGURES = {
    "parameters": lambda: summary_plots.parameter_figure(with_parameter(estimate(), "R", nominal=3.0)),
    "profiles": lambda: summary_plots.profile_figure(profiles(), units=UNITS),
    "one profile": lambda: summary_plots.profile_figure(profiles(("R",)), units=UNITS),
    "convergence": lambda: summary_plots.convergence_figure(estimate().history),
}


@pytest.mark.parametrize("name", FIGURES)
def test_no_label_covers_another_and_none_leaves_the_page(name):
    figure = FIGURES[name]()
    texts = drawn_texts(figure)
    for k, (one, box) in enumerate(texts):
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, one
        for other, other_box in texts[k + 1 :]:
            assert not box.overlaps(other_box), (one, other)


def test_error_bars_reach_two_standard_errors_and_nominal_and_near_bounds_are_shown():
    made = with_parameter(estimate(), "R", nominal=3.0, lower=2.98, upper=100.0)
    ax = summary_plots.parameter_figure(made).axes[0]
    R = made.parameters["R"]
    ends = [line.get_xdata() for line in ax.lines]
    assert [R.value - 2 * R.standard_error, R.value + 2 * R.standard_error] in [list(x) for x in ends]
    assert [3.0] in [list(x) for x in ends] and [2.98, 2.98] in [list(x) for x in ends]
    assert [100.0, 100.0] not in [list(x) for x in ends], "a far bound would hide the rest"


def test_without_any_error_or_nominal_value_there_are_no_bars():
    made = estimate()
    for name in MOTOR:
        made = with_parameter(made, name, standard_error=None)
    assert summary_plots.parameter_figure(made) is None


def test_a_profile_with_failed_simulations_is_drawn():
    made = profiles(("R",))
    made["R"].followed[:3] = np.nan
    assert plots.png(summary_plots.profile_figure(made, units={})).startswith(b"\x89PNG")


def test_convergence_shows_best_median_and_spread_on_a_logarithmic_scale():
    history = estimate().history
    history = dataclasses.replace(history, lower=history.best * 2, upper=history.median * 3)
    (ax,) = summary_plots.convergence_figure(history).axes
    assert ax.get_yscale() == "log" and ax.get_xlabel() == "FMU simulations"
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["half of all nests", "median nest", "best nest"]


def test_convergence_survives_costs_that_are_infinite_or_zero():
    history = estimate().history
    history.median[:] = np.inf
    history.best[-1] = 0.0
    history = dataclasses.replace(history, lower=history.best, upper=history.median)
    assert plots.png(summary_plots.convergence_figure(history)).startswith(b"\x89PNG")


def test_the_legend_names_only_what_is_drawn():
    def named(made):
        (legend,) = summary_plots.parameter_figure(made).legends
        return [text.get_text().split(",")[0] for text in legend.get_texts()]

    assert named(estimate()) == ["estimate"]
    assert named(with_parameter(estimate(), "R", nominal=3.0)) == ["estimate", "nominal"]
    assert named(with_parameter(estimate(), "R", lower=3.13)) == ["estimate", "bound"]
