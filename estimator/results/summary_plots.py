"""Figures of an estimate's numbers: error bars beside nominal values and bounds, cost profiles, convergence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from estimator.results.panels import MARKERS_UP_TO
from estimator.results.plots import INPUT, MEASURED, RESIDUAL, SIMULATED, WIDTH, finish
from estimator.results.result import CostProfile, Estimate, FloatArray, ParameterEstimate, SearchHistory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW, HEAD, FOOT = 0.62, 0.3, 0.15  # inch, of a figure with one row a parameter
MOST_PROFILES = 12
COLUMNS = 3
SHOWN_RISE = 10.0  # of a profile: a little over three standard errors
ROOM = 1.25  # around what is drawn of a parameter


def parameter_figure(estimate: Estimate) -> Figure | None:
    """Return each free parameter on a scale of its own: estimate, error bars, nominal value, bounds that are near.

    None where no parameter has a standard error or a nominal value.
    """
    from matplotlib.figure import Figure

    shown = [p for p in estimate.parameters.values() if _half_width(p) > 0]
    if not shown:
        return None
    height = HEAD + FOOT + ROW * len(shown)
    fig = Figure(figsize=(0.75 * WIDTH, height))
    for k, parameter in enumerate(shown):
        top = height - HEAD - k * ROW
        ax = fig.add_axes((0.16, (top - 0.38) / height, 0.8, 0.34 / height))
        _draw_parameter(ax, parameter)
    handles = [_handle(SIMULATED, marker="o", text="estimate, ± 1 and ± 2 standard errors")]
    if any(p.nominal is not None for p in shown):
        handles.append(_handle(INPUT, marker="D", text="nominal"))
    if any(_near_bounds(p) for p in shown):
        handles.append(_handle(RESIDUAL, marker="|", text="bound"))
    fig.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.15, 1.0),
        ncols=3,
        frameon=False,
        fontsize="small",
        borderaxespad=0.1,
    )
    return fig


def profile_figure(profiles: Mapping[str, CostProfile], *, units: Mapping[str, str]) -> Figure:
    """Return how the cost rises around every estimate, one axes a parameter."""
    from matplotlib.figure import Figure

    names = list(profiles)[:MOST_PROFILES]
    rows = math.ceil(len(names) / COLUMNS)
    height = 2.3 * rows + 0.35
    fig = Figure(figsize=(WIDTH * 0.9, height))
    axes: list[Axes] = []
    for k, name in enumerate(names):
        row, column = divmod(k, COLUMNS)
        left = (0.65 + column * 3.1) / (0.9 * WIDTH)
        bottom = (height - 0.35 - (row + 1) * 2.3 + 0.55) / height
        ax = fig.add_axes((left, bottom, 2.5 / (0.9 * WIDTH), 1.65 / height))
        _draw_profile(ax, profiles[name])
        ax.set_xlabel(f"{_short(name)} [{units.get(name) or '-'}]", fontsize="small")
        if column == 0:
            ax.set_ylabel("rise of the cost", fontsize="small")
        axes.append(ax)
    handles, texts = axes[0].get_legend_handles_labels()
    fig.legend(
        handles,
        texts,
        loc="upper left",
        bbox_to_anchor=(0.05, 1.0),
        ncols=3,
        frameon=False,
        fontsize="small",
        borderaxespad=0.1,
    )
    return fig


def convergence_figure(history: SearchHistory) -> Figure:
    """Return cost of the best and of the median nest over the simulations, and between which half of them lie."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(0.6 * WIDTH, 3.0))
    ax = fig.add_axes((0.12, 0.18, 0.85, 0.77))
    costs = np.array([history.best, history.median], dtype=float)
    costs[~np.isfinite(costs)] = np.nan
    marker = "." if len(history.simulations) <= MARKERS_UP_TO else ""
    finite = costs[np.isfinite(costs)]
    if finite.size and finite.min() > 0:
        ax.set_yscale("log")
    if history.lower is not None and history.upper is not None:
        known = np.isfinite(history.lower) & np.isfinite(history.upper)
        low, high = np.where(known, history.lower, np.nan), np.where(known, history.upper, np.nan)
        ax.fill_between(history.simulations, low, high, color="#d9d9d9", lw=0, label="half of all nests")
    ax.plot(history.simulations, costs[1], color=MEASURED, lw=2.2, marker=marker, label="median nest")
    ax.plot(history.simulations, costs[0], color=SIMULATED, lw=1.4, marker=marker, label="best nest")
    ax.set_xlabel("FMU simulations")
    ax.set_ylabel("cost")
    finish(ax)
    ax.legend(frameon=False, loc="upper right")
    return fig


def _draw_parameter(ax: Axes, p: ParameterEstimate) -> None:
    width = ROOM * _half_width(p)
    error = p.standard_error
    if error is not None and math.isfinite(error):
        ax.plot([p.value - 2 * error, p.value + 2 * error], [0, 0], color=SIMULATED, lw=1.2)
        ax.plot([p.value - error, p.value + error], [0, 0], color=SIMULATED, lw=4.0, solid_capstyle="butt")
    if p.nominal is not None:
        ax.plot([p.nominal], [0], marker="D", color=INPUT, ms=5, ls="", mfc="white")
    ax.plot([p.value], [0], marker="o", color=SIMULATED, ms=5, ls="")
    for bound in _near_bounds(p):
        ax.plot([bound, bound], [-0.8, 0.8], color=RESIDUAL, lw=2.0)
    ax.set_xlim(p.value - width, p.value + width)
    ax.set_ylim(-1, 1)
    ax.locator_params(axis="x", nbins=5)
    finish(ax)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_ylabel(f"{_short(p.name)}\n[{p.unit or '-'}]", fontsize="small", rotation=0, ha="right", va="center")


def _draw_profile(ax: Axes, profile: CostProfile) -> None:
    x = profile.values
    ax.plot(*_smooth(x, profile.held), color=MEASURED, lw=1.8, ls="--", label="the others held")
    ax.plot(*_smooth(x, profile.followed), color=SIMULATED, lw=1.6, label="the others following")
    ax.plot(x, profile.followed, color=SIMULATED, marker=".", ls="")
    ax.axhline(1.0, color=RESIDUAL, lw=0.8, ls=":", label="one standard error")
    best = int(np.argmin(np.where(np.isfinite(profile.followed), np.abs(profile.followed), np.inf)))
    ax.axvline(x[best], color=INPUT, lw=0.5)
    top = float(np.max(_finite(profile.followed), initial=1.0))
    lowest = float(np.min(_finite(profile.followed), initial=0.0))
    ax.set_ylim(lowest - 0.05 * top, max(SHOWN_RISE, 1.1 * top))
    ax.locator_params(axis="x", nbins=4)
    ax.locator_params(axis="y", nbins=5)
    finish(ax)


def _smooth(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve through the points: a cubic spline, which a parabola goes through as it is."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(y)
    if known.sum() < 4:
        return x, y
    fine = np.linspace(x[known][0], x[known][-1], 60)
    return fine, np.asarray(CubicSpline(x[known], y[known])(fine))


def _finite(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def _half_width(p: ParameterEstimate) -> float:
    """Return how far from the estimate there is something to draw; 0 for nothing."""
    error = p.standard_error if p.standard_error is not None and math.isfinite(p.standard_error) else 0.0
    away = abs(p.nominal - p.value) if p.nominal is not None else 0.0
    return max(2 * error, away) if p.free and math.isfinite(p.value) else 0.0


def _near_bounds(p: ParameterEstimate) -> list[float]:
    """Return the bounds that are no farther away than what is drawn."""
    return [bound for bound in (p.lower, p.upper) if abs(bound - p.value) <= ROOM * _half_width(p)]


def _handle(colour: str, *, marker: str, text: str) -> object:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, marker=marker, ls="", mfc="white" if marker == "D" else colour, label=text)


def _short(name: str) -> str:
    return name if len(name) <= 16 else name[:15] + "…"
