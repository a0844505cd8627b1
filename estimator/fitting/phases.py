"""Where the angle of a recording begins, which nobody knows of encoder counts. Knows fits and plans, no FMU."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from estimator.fitting.fit import Fit, colours, squares
from estimator.fitting.freeing import named, with_offset
from estimator.fitting.problem import Problem
from estimator.plans.plan import Plan
from estimator.recordings.excitation import quantum
from estimator.recordings.samples import mean_of_known

COUNTS = "angle is an encoder's, in counts: its phase is estimated"
ELSEWHERE = "angle does not begin where the model's does: its phase is estimated"


def with_phases(fit: Fit, rebuild: Callable[[Plan], Problem]) -> Fit:
    """Return the fit with the phase of each recording free, if that of one is not known and the case says nothing.

    Parameters
    ----------
    rebuild : callable
        A plan with other nuisances → a problem.
    """
    plan = fit.problem.plan
    if not any(o.has_phase for o in plan.observed) or "offset angle" in plan.declared:
        return fit
    sentence = COUNTS if all(quantum(o.outputs["angle"]) > 0 for o in plan.observed) else ELSEWHERE
    for e in range(len(plan.observed)):
        name = named("offset angle", plan, e)
        if name in fit.problem.plan.names:
            continue
        start = _at_first_sight(fit, e)
        problem = rebuild(with_offset(name, "angle", e)(fit.problem.plan, start))
        polish = squares(problem, fit.treatment).polish(np.append(fit.polish.values, start), fit.polish.deviations)
        fit = dataclasses.replace(fit, problem=problem, polish=polish)
        fit = dataclasses.replace(fit, colours=colours(fit))
        if sentence not in fit.freed:
            fit = dataclasses.replace(fit, freed=(*fit.freed, sentence), names=(*fit.names, name))
    return fit


def _at_first_sight(fit: Fit, recording: int) -> float:
    """Return the mean, rad, of what is measured less what is simulated."""
    problem = fit.problem
    shown = problem.shown(problem.trajectories(fit.polish.values[None, :]))[recording]
    return mean_of_known(problem.plan.observed[recording].outputs["angle"] - shown[:, problem.outputs.index("angle")])
