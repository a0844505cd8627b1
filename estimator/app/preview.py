"""One candidate of a case, simulated and shown beside the data: a start, or the best so far. Judges nothing.

The FMU runs in a worker process of its own, so that one that crashes costs a picture.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass

import numpy as np

from estimator.app.series import Series
from estimator.errors import SimulationError
from estimator.fitting.problem import Problem
from estimator.fmus.workers import Workers
from estimator.plans.plan import Plan
from estimator.results.panels import transient
from estimator.results.result import Comparison

LIMIT = 20.0  # s that one simulation may take
KEPT = 24  # pictures


@dataclass(frozen=True)
class Picture:
    """What one candidate looks like.

    Attributes
    ----------
    recordings : one Series a recording
        Signals are called "input v", "measured i", "simulated i".
    names : of the recordings
    transients : begin and end of the part of each recording that is worth enlarging, s
    units : signal's plain name → SI unit
    fit_percent : output → 100 (1 − ‖e‖ / ‖y − mean‖), over all recordings
    """

    recordings: tuple[Series, ...]
    names: tuple[str, ...]
    transients: tuple[tuple[float, float], ...]
    units: Mapping[str, str]
    fit_percent: Mapping[str, float | None]


class Previews:
    """Simulates candidates one after the other in one worker process, which stays for the next."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._crew: Workers | None = None
        self._problem: tuple[Hashable, Problem] | None = None
        self._made: dict[Hashable, Picture] = {}

    def picture(self, key: Hashable, plan: Callable[[], Plan], values: Mapping[str, float]) -> Picture:
        """Return what a candidate looks like.

        Parameters
        ----------
        key : hashable
            Of the plan: the same key, the same plan.
        plan : () → Plan
            Called if it is not the one of before.
        values : parameter → value, SI
            Those that are not given begin where the plan begins.

        Raises
        ------
        SimulationError
            The FMU fails there.
        InputError
            The plan cannot be made.
        """
        whole = (key, tuple(sorted(values.items())))
        with self._lock:
            if whole not in self._made:
                self._made[whole] = self._simulated(key, plan, values)
                while len(self._made) > KEPT:
                    del self._made[next(iter(self._made))]
            return self._made[whole]

    def close(self) -> None:
        """End the worker process."""
        with self._lock:
            if self._crew is not None:
                self._crew.__exit__(None, None, None)
            self._crew, self._problem = None, None

    def _simulated(self, key: Hashable, plan: Callable[[], Plan], values: Mapping[str, float]) -> Picture:
        if self._crew is None:
            self._crew = Workers(1, time_limit=LIMIT)
        if self._problem is None or self._problem[0] != key:
            made = plan()
            self._problem = (key, Problem(made, self._crew, sigma=dict.fromkeys(made.outputs, 1.0)))
        problem = self._problem[1]
        middle = problem.box.from_cube(np.full(problem.box.dimension, 0.5))
        starts = [m if p.start is None else p.start for p, m in zip(problem.parameters, middle, strict=True)]
        candidate = np.array([values.get(p.name, s) for p, s in zip(problem.parameters, starts, strict=True)])
        failures = len(self._crew.failures)
        batch = problem.trajectories(candidate[None, :])
        if batch.failed[0] or batch.shown is None:
            reasons = [failure.reason for failure in self._crew.failures[failures:]]
            why = reasons[0] if reasons else "no reason is known"
            raise SimulationError(f"the FMU fails with these values: {why}; try others")
        return _picture(problem, problem.shown(batch))


def _picture(problem: Problem, shown: list[np.ndarray]) -> Picture:
    plan, recordings, transients = problem.plan, [], []
    squares, total = dict.fromkeys(plan.outputs, 0.0), dict.fromkeys(plan.outputs, 0.0)
    for observed, rows in zip(plan.observed, shown, strict=True):
        time = observed.recording.time
        signals = {f"input {name}": u for name, u in observed.inputs.items()}
        for j, name in enumerate(plan.outputs):
            measured = observed.outputs[name]
            signals |= {f"measured {name}": measured, f"simulated {name}": rows[:, j].copy()}
            squares[name] += float(np.nansum((measured - rows[:, j]) ** 2))
            total[name] += float(np.nansum((measured - np.nanmean(measured)) ** 2))
        simulated = {name: rows[:, j] for j, name in enumerate(plan.outputs)}
        recordings.append(Series(time, signals))
        transients.append(transient(Comparison("", time, {}, observed.outputs, simulated, {})))
    units = {name: plan.unit(name) for name in (*plan.observed[0].inputs, *plan.outputs)}
    fit = {name: 100 * (1 - (squares[name] / total[name]) ** 0.5) if total[name] > 0 else None for name in plan.outputs}
    names = tuple(o.recording.title for o in plan.observed)
    return Picture(tuple(recordings), names, tuple(transients), units, fit)
