"""An estimate against recordings that it has not seen. Knows neither search nor polish."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.case import Case
from estimator.errors import SimulationError
from estimator.fmu import describe, with_kind
from estimator.noise_level import output_deviations
from estimator.outcome import comparisons, figures
from estimator.plan import Plan
from estimator.planning import plan_case
from estimator.probe import driven
from estimator.problem import Problem
from estimator.recording import Recording
from estimator.result import Estimate, Validation
from estimator.workers import Workers


def validated(
    estimate: Estimate, case: Case, files: Sequence[Path] = (), *, recordings: Sequence[Recording] | None = None
) -> Estimate:
    """Return the estimate with how well its model explains other recordings; nothing is fitted to them.

    Parameters
    ----------
    case : Case
        The one that was estimated; its own recordings are not read.
    files : paths of recordings
    recordings : sequence of Recording, optional
        Instead of the files.

    Raises
    ------
    InputError
        A recording cannot be used.
    SimulationError
        The FMU fails with these inputs.
    """
    if estimate.verdict == "refused" or not estimate.parameters:
        return estimate
    case = dataclasses.replace(case, recordings=tuple(files))
    plan = plan_case(case, driven(with_kind(describe(case.fmu), case.kind)), recordings=recordings)
    values = np.array([estimate.parameters[name].value for name in plan.names])
    with Workers(1) as crew:
        problem = Problem(plan, crew, sigma=_sigma(plan))
        batch = problem.trajectories(values[None, :])
        if batch.failed[0] or batch.shown is None:
            reason = crew.failures[0].reason if crew.failures else "no reason given"
            raise SimulationError(
                f"the FMU fails with the inputs of {plan.observed[0].recording.title}: {reason}; leave it out"
            )
        compared = comparisons(plan, problem.shown(batch))
        simulations, steps = crew.simulations, crew.steps
    rmse, fit = figures(plan, compared)
    return dataclasses.replace(
        estimate,
        validation=Validation(comparisons=compared, rmse=rmse, fit_percent=fit),
        simulations=estimate.simulations + simulations,
        simulations_by_phase={**estimate.simulations_by_phase, "validation": simulations},
        steps=estimate.steps + steps,
    )


def _sigma(plan: Plan) -> dict[str, float]:
    return {name: spread or 1.0 for name, (_, spread) in output_deviations(plan).items()}
