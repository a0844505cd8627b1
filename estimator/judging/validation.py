"""An estimate against recordings that it has not seen. Knows no search.

The parameters and the sensors are the estimate's. What belongs to a recording and not to the motor is fitted to the new
one: its delay and offsets, where the estimate has such, and a parameter that has a value for each recording.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import Case, RunSpec
from estimator.errors import SimulationError
from estimator.fitting.freeing import free_delay, named, with_offset
from estimator.fitting.polish import LeastSquares
from estimator.fitting.problem import Problem
from estimator.fmus.fmu import describe, with_kind
from estimator.fmus.probe import driven
from estimator.fmus.workers import Workers
from estimator.judging.outcome import comparisons, figures
from estimator.judging.reading import what_was_read
from estimator.plans.noise_level import output_deviations
from estimator.plans.parameters import Box
from estimator.plans.plan import ChainSpec, Plan
from estimator.plans.planning import plan_case
from estimator.recordings.recording import Recording
from estimator.results.result import Estimate, Validation
from estimator.stepping import layout

FloatArray = NDArray[np.float64]


def validated(
    estimate: Estimate, case: Case, files: Sequence[Path] = (), *, recordings: Sequence[Recording] | None = None
) -> Estimate:
    """Return the estimate with how well its model explains other recordings.

    Parameters
    ----------
    case : Case
        The one that was estimated; of its own recordings only those that it holds out are taken.
    files : paths of further recordings, corrected as the case's first one
    recordings : sequence of Recording, optional
        Instead of the files and of those that the case holds out.

    Raises
    ------
    InputError
        A recording cannot be used.
    SimulationError
        The FMU fails with these inputs.
    """
    if estimate.verdict == "refused" or not estimate.parameters:
        return estimate
    case = _held_out(case, files, count=None if recordings is None else len(recordings))
    if not case.recordings and not recordings:
        return estimate
    plan = plan_case(case, driven(with_kind(describe(case.fmu), case.kind)), recordings=recordings, held_out=True)
    plan, values, free = _as_estimated(plan, estimate)
    with Workers(1) as crew:
        problem = Problem(plan, crew, sigma=_sigma(plan))
        values = _fitted(problem, values, free)
        batch = problem.trajectories(values[None, :])
        if batch.failed[0] or batch.shown is None:
            reason = crew.failures[0].reason if crew.failures else "no reason given"
            raise SimulationError(
                f"the FMU fails with the inputs of {plan.observed[0].recording.title}: {reason}; leave it out"
            )
        compared = comparisons(plan, problem.shown(batch))
        simulations, steps = crew.simulations, crew.steps
    rmse, fit = figures(plan, compared)
    own = {plan.names[j]: float(values[j]) for j in free}
    return dataclasses.replace(
        estimate,
        read=(*estimate.read, *what_was_read(plan)),
        notes=(*estimate.notes, *(f.sentence for o in plan.observed for f in o.findings)),
        validation=Validation(
            comparisons=compared,
            rmse=rmse,
            fit_percent=fit,
            chain=own,
            units={plan.names[j]: plan.parameters[j].unit for j in free},
        ),
        simulations=estimate.simulations + simulations,
        simulations_by_phase={**estimate.simulations_by_phase, "validation": simulations},
        steps=estimate.steps + steps,
    )


def _held_out(case: Case, files: Sequence[Path], *, count: int | None) -> Case:
    """Return the case with the recordings to validate on, and no other."""
    usual = dataclasses.replace(case.run(0), validate=True, window=None, temperature=None, delay=None)
    if count is not None:
        return dataclasses.replace(case, recordings=(), runs=(usual,) * count)
    own = [k for k in range(len(case.recordings)) if case.run(k).validate]
    runs: tuple[RunSpec, ...] = (*(case.run(k) for k in own), *[usual] * len(files))
    return dataclasses.replace(case, recordings=(*(case.recordings[k] for k in own), *files), runs=runs)


def _as_estimated(plan: Plan, estimate: Estimate) -> tuple[Plan, FloatArray, list[int]]:
    """Return the plan with the estimate's sensors, its values, and which of them belong to the recordings."""
    chain = {name: parameter.value for name, parameter in estimate.chain.items()}
    kinds, chains = dict(plan.sensors), dict(plan.chains)
    for name in plan.outputs:
        found = estimate.sensors.get(name)
        if found is None:
            continue
        kinds[name] = layout.MEAN if found["sensor"] == "mean" else layout.IDENTITY
        spec = chains.get(name, ChainSpec())
        gain, delay = chain.get(f"gain {name}", spec.gain), chain.get(f"delay {name}", spec.delay)
        chains[name] = dataclasses.replace(spec, average=int(found["average"]), gain=gain, delay=delay)
    plan = dataclasses.replace(plan, sensors=kinds, chains=chains)
    values: list[float] = []
    free: list[int] = []
    for j, parameter in enumerate(plan.parameters):
        if parameter.name in estimate.parameters:
            values.append(estimate.parameters[parameter.name].value)
        else:  # it has a value for each recording: their mean is where this one's begins
            own = parameter.quantity or parameter.name
            same = [p.value for n, p in estimate.parameters.items() if n == own or n.startswith(f"{own} ")]
            values.append(float(np.mean(same)))
            free.append(j)
    channels = {f"delay {name}" for name in plan.outputs}
    is_late = any(name.startswith("delay") and name not in channels for name in chain)
    for e, o in enumerate(plan.observed):
        if (o.delay != 0 or is_late) and f"delay of {e}" not in plan.declared:
            plan = free_delay(plan, e, o.delay)
        for name in plan.outputs:
            has_phase = name == "angle" and o.has_phase and "offset angle" not in plan.declared
            if has_phase or any(n == f"offset {name}" or n.startswith(f"offset {name} ") for n in chain):
                plan = with_offset(named(f"offset {name}", plan, e), name, e)(plan, 0.0)
    free += list(range(len(values), len(plan.parameters)))
    values += [p.start or 0.0 for p in plan.parameters[len(values) :]]
    return plan, np.array(values), free


def _fitted(problem: Problem, values: FloatArray, free: Sequence[int]) -> FloatArray:
    """Return the values with those that belong to the recordings fitted to them."""
    if not free:
        return values
    deviations = np.array([noise or spread or 1.0 for noise, spread in output_deviations(problem.plan).values()])

    def residuals(candidates: FloatArray) -> FloatArray:
        whole = np.repeat(values[None, :], len(candidates), axis=0)
        whole[:, free] = candidates
        return problem.residuals(whole)

    box = Box.of(tuple(problem.parameters[j] for j in free))
    squares = LeastSquares(residuals, box, output=problem.output_of_residual, spread=problem.spread)
    best, _ = squares.fit(values[free], deviations)
    fitted = values.copy()
    fitted[free] = best
    return fitted


def _sigma(plan: Plan) -> dict[str, float]:
    return {name: spread or 1.0 for name, (_, spread) in output_deviations(plan).items()}
