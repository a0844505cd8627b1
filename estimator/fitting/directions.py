"""In which directions a fit's residuals would lie if its measurement chain were another. Knows plans, no FMU."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.fitting.freeing import (
    named,
    with_average,
    with_channel_delay,
    with_delay,
    with_gain,
    with_mean,
    with_offset,
)
from estimator.fitting.noise import averaged
from estimator.fitting.problem import Problem
from estimator.plans.plan import ChainSpec, Plan
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

EARLY = "{first} comes later than {later}; the delay of {later} behind it, below zero, is estimated"
LATE_CURRENT = EARLY.format(first="i", later="w")
AVERAGES = (2, 3, 4, 5, 6, 8, 10, 16)  # samples that a logger's running mean may span


@dataclass(frozen=True)
class Direction:
    """A nuisance that might be freed: the plan with it, where to start, and its gain at first sight."""

    name: str
    column: FloatArray  # (m,) change of the weighted residuals for a unit of it
    unit: float | None  # for a nuisance with two states only: the size of the step; None: any size
    extend: Callable[[Plan, float], Plan]
    starts: tuple[float, ...] = (0.0,)
    sentence: str = ""
    sentence_if_early: str = ""  # of a channel whose delay turns out to be negative
    is_channel: bool = False  # a delay of one channel, that a running mean explains as well

    @property
    def default(self) -> float:
        """What it is where nothing is wrong."""
        return default_of(self.name)

    @property
    def is_gain(self) -> bool:
        """Whether it is a channel's gain."""
        return self.name.startswith("gain ")


def default_of(name: str) -> float:
    """Return what a nuisance is where nothing is wrong."""
    return 1.0 if name.startswith("gain") else 0.0


def directions(fit: Fit) -> Iterator[Direction]:
    """Yield the nuisances that a fit has not freed yet."""
    problem = fit.problem
    shown = problem.shown(problem.trajectories(fit.polish.values[None, :]))
    yield from _delays(fit, shown)
    for j, y in enumerate(problem.outputs):
        yield from _scales(fit, shown, j)
        if y == "w":
            yield from _means(fit, shown, j)


def _weighted(fit: Fit, rows: list[FloatArray]) -> FloatArray:
    weights = 1 / fit.polish.deviations
    return np.asarray(fit.problem.spread_out(rows) * weights[fit.problem.output_of_residual])


def _alone(shown: list[FloatArray], j: int, change: Callable[[FloatArray], FloatArray]) -> list[FloatArray]:
    """Return what changes, (n, outputs) a recording, if output j changes by `change` of its own."""
    rows = [np.zeros_like(s) for s in shown]
    for row, full in zip(rows, shown, strict=True):
        row[:, j] = change(full[:, j])
    return rows


def _delays(fit: Fit, shown: list[FloatArray]) -> Iterator[Direction]:
    plan = fit.problem.plan
    for e, o in enumerate(plan.observed):
        name = named("delay", plan, e)
        if name in plan.names or f"delay of {e}" in plan.declared or o.excitation.kind == "none":
            continue
        slope = [-np.gradient(y, axis=0) / o.recording.step if r == e else 0 * y for r, y in enumerate(shown)]
        sentence = f"{o.recording.title}: the outputs come later than the input; the delay is estimated"
        yield Direction(name, _weighted(fit, slope), None, with_delay(name, e), sentence=sentence)


def _scales(fit: Fit, shown: list[FloatArray], j: int) -> Iterator[Direction]:
    plan = fit.problem.plan
    y = plan.outputs[j]
    for e, o in enumerate(plan.observed) if f"offset {y}" not in plan.declared else ():
        name = named(f"offset {y}", plan, e)
        if name not in plan.names:
            rows = _alone(shown, j, np.ones_like)
            rows = [r if k == e else 0 * r for k, r in enumerate(rows)]
            of = f" in {o.recording.title}" if len(plan.observed) > 1 else ""
            sentence = f"{y} has an offset{of}; it is estimated"
            yield Direction(name, _weighted(fit, rows), None, with_offset(name, y, e), sentence=sentence)
    name = f"delay {y}"
    if j > 0 and name not in {*plan.names, *plan.declared} and plan.sensors[y] == layout.IDENTITY:
        late = [np.zeros_like(s) for s in shown]
        for rows_late, full, o in zip(late, shown, plan.observed, strict=True):
            rows_late[:, j] = -np.gradient(full[:, j]) / o.recording.step
        yield Direction(
            name,
            _weighted(fit, late),
            None,
            with_channel_delay(name, y),
            sentence=f"{y} comes later than {plan.outputs[0]}; its delay is estimated",
            sentence_if_early=EARLY.format(first=plan.outputs[0], later=y),
            is_channel=True,
        )
    name = f"gain {y}"
    if name not in {*plan.names, *plan.declared} and y != "angle":  # of the encoder the counts a turn are known
        column = _weighted(fit, _alone(shown, j, lambda full: full))
        sentence = (
            f"{y} is shown with a gain other than 1, as what is held fixed or shown beside it tells; it is estimated"
        )
        yield Direction(name, column, None, with_gain(name, y), sentence=sentence)


def _means(fit: Fit, shown: list[FloatArray], j: int) -> Iterator[Direction]:
    plan = fit.problem.plan
    y = plan.outputs[j]
    if plan.chains.get(y, ChainSpec()).average != 1 or plan.sensors[y] != layout.IDENTITY:
        return
    for n in AVERAGES[1:] if f"average {y}" not in plan.declared else ():
        column = _weighted(fit, _alone(shown, j, lambda full, n=n: averaged(full[:, None], n)[:, 0] - full))  # type: ignore[misc]
        sentence = f"{y} is a mean over the last {n} samples, as the data show; the model's is taken so too"
        yield Direction(f"average {y} {n}", column, 1.0, with_average(y, n), sentence=sentence)
    if "mean w" not in plan.declared and any(v.name == "angle" for v in plan.description.variables):
        column = _weighted(fit, _alone(shown, j, lambda full: np.append(0.0, 0.5 * (full[:-1] - full[1:]))))
        sentence = "w is a mean over the sampling interval, as differenced encoder counts are"
        yield Direction("mean w", column, 1.0, with_mean, sentence=sentence)


def starts(direction: Direction, start: float, problem: Problem) -> tuple[float, ...]:
    """Return the starts of a nuisance: a fractional delay may have two minima."""
    if direction.name.startswith("gain"):
        return (float(np.clip(direction.default + start, 0.2, 5.0)),)
    if not direction.name.startswith("delay"):
        return (start,)
    h = problem.plan.observed[0].recording.step
    start = float(np.clip(start, -5 * h, 5 * h))
    near = np.floor(start / h) * h
    return tuple(dict.fromkeys((start, near + 0.5 * h, near + 1.5 * h if start - near > 0.5 * h else near - 0.5 * h)))


def as_well(rival: Fit, direction: Direction | None) -> str:
    """Say that an accusation, or a channel's delay or gain, explains a recording as well as what was taken."""
    if direction is None:
        return f"it would be explained as well otherwise: {rival.treatment.accused[-1].sentence}"
    size = float(rival.polish.values[rival.problem.plan.names.index(direction.name)])
    channel = direction.name.partition(" ")[2]
    if direction.is_gain:
        return f"{channel} shown with a gain of {size:.4g} would explain the recording as well; check its scale"
    late = f"{1e3 * abs(size):.2g} ms {'late' if size > 0 else 'early'}"
    return f"{channel} shown {late} would explain the recording as well; measure it"


def late_as_well(late: Fit) -> str:
    """Say that a current that comes late explains a recording as well as a mean of it."""
    delay = -float(late.polish.values[late.problem.plan.names.index("delay w")])
    return f"i shown {1e3 * delay:.2g} ms late would explain the recording as well; measure it"
