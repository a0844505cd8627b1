"""Validation of an estimate by recordings that were not fitted. Knows no search.

The parameters, the sensors and the drive's switches are the estimate's. What belongs to a recording and not to the
motor is fitted to the new one: its delay and offsets, if the estimate has such, a parameter that has a value for each
recording, and what is a part at the largest signals of a recording, such as a K that falls. Then it is tested whether
the new recordings contradict the other parameters (other_values.py).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import Case, RunSpec
from estimator.conventions import FALSE_ALARM
from estimator.errors import SimulationError
from estimator.explaining.addition import Addition
from estimator.explaining.effects import known_effects
from estimator.explaining.effects.offset import Offset
from estimator.explaining.explanation import Explanation, followed
from estimator.explaining.selection_of_plan import freed_by_the_case
from estimator.fitting.fit import Fit, new_fit
from estimator.fitting.gauss_newton import solved
from estimator.fitting.simulator import Nuisance, Simulator, per_recording
from estimator.fmus.fmu import FmuDescription, describe, with_kind
from estimator.fmus.probe import bundled_model, driven
from estimator.fmus.workers import Workers
from estimator.judging.other_values import other_values
from estimator.judging.outcome import comparisons, figures
from estimator.judging.reading import what_was_read
from estimator.judging.refusal import implausible_reason
from estimator.noise.noise_model import NoiseModel
from estimator.plans.noise_level import output_deviations
from estimator.plans.plan import Plan
from estimator.plans.planning import plan_case, resistance_stands_at
from estimator.recordings.recording import Recording
from estimator.results.result import Estimate, Validation
from estimator.stepping import layout

FloatArray = NDArray[np.float64]


def validated(
    estimate: Estimate,
    case: Case,
    files: Sequence[Path] = (),
    *,
    recordings: Sequence[Recording] | None = None,
    runs: Sequence[RunSpec] = (),
) -> Estimate:
    """Return the estimate with how well its model explains other recordings.

    If these contradict its parameters, or are implausible by themselves, the verdict is doubtful.

    Parameters
    ----------
    case : Case
        The one that was estimated; of its own recordings only those that it holds out are taken.
    files : paths of further recordings, corrected as the case's first one
    recordings : sequence of Recording, optional
        Instead of the files and of those that the case holds out.
    runs : what is said of each of these; without, they are corrected as files are

    Raises
    ------
    InputError
        A recording cannot be used.
    SimulationError
        The FMU fails with these inputs.
    """
    if estimate.verdict == "refused" or not estimate.parameters:
        return estimate
    fitted = [run for run in case.runs_of(max(len(case.recordings), len(case.runs))) if not run.validate]
    case = _held_out(case, files, count=None if recordings is None else len(recordings), said=runs)
    if not case.recordings and not recordings:
        return estimate
    plan = plan_case(case, driven(with_kind(describe(case.fmu), case.kind)), recordings=recordings, held_out=True)
    plan = dataclasses.replace(plan, stands_at=resistance_stands_at(fitted))
    deviations = output_deviations(plan)
    with Workers(1) as crew:
        start = _as_estimated(plan, estimate, crew, {name: spread or 1.0 for name, (_, spread) in deviations.items()})
        held = followed(_with_columns(solved(start), estimate)).fit
        if not np.isfinite(held.cost):
            reason = crew.failures[0].reason if crew.failures else "no reason given"
            raise SimulationError(
                f"the FMU fails with the inputs of {plan.observed[0].recording.title}: {reason}; leave it out"
            )
        others = other_values(held, estimate)
        simulations, steps = crew.simulations, crew.steps
    compared = comparisons(plan, [held.explained[clock.rows] for clock in held.simulator.clocks])
    rmse, fit = figures(plan, compared)
    implausible = [implausible_reason(o, f) for o in plan.observed for f in o.findings if f.is_fatal]
    reasons = (*estimate.reasons, *implausible)
    if others is not None and others.chance < FALSE_ALARM:
        titles = " and ".join(o.recording.title for o in plan.observed)
        reasons = (*reasons, others.sentence(titles))
    return dataclasses.replace(
        estimate,
        read=(*estimate.read, *what_was_read(plan)),
        notes=(*estimate.notes, *(f.sentence for o in plan.observed for f in o.findings if not f.is_fatal)),
        verdict="ok" if not reasons else "doubtful",
        reasons=reasons,
        validation=Validation(
            comparisons=compared,
            rmse=rmse,
            fit_percent=fit,
            chain=dict(zip(held.names, held.estimates.tolist(), strict=True)),
            units=_units(held),
            others=others,
        ),
        simulations=estimate.simulations + simulations,
        simulations_by_phase={**estimate.simulations_by_phase, "validation": simulations},
        steps=estimate.steps + steps,
    )


def _units(held: Fit) -> dict[str, str]:
    """Return the unit of each value that was fitted to the new recordings."""
    s = held.simulator
    units = {p.name: p.unit for p in s.plan.parameters} | {n.name: n.unit for n in s.nuisances}
    units |= {f"{g.name}{f'#{k}' if k else ''}": unit for g in held.linear for k, unit in enumerate(g.units)}
    return {name: units.get(name, "") for name in held.names}


def _held_out(case: Case, files: Sequence[Path], *, count: int | None, said: Sequence[RunSpec]) -> Case:
    """Return the case with the recordings to validate on, and no other."""
    usual = dataclasses.replace(case.run(0), validate=True, window=None, temperature=None, delay=None)
    if count is not None:
        return dataclasses.replace(case, recordings=(), runs=tuple(said) or (usual,) * count)
    own = [k for k in range(len(case.recordings)) if case.run(k).validate]
    runs: tuple[RunSpec, ...] = (*(case.run(k) for k in own), *[usual] * len(files))
    return dataclasses.replace(case, recordings=(*(case.recordings[k] for k in own), *files), runs=runs)


def _as_estimated(plan: Plan, estimate: Estimate, crew: Workers, sigma: Mapping[str, float]) -> Fit:
    """Return where a fit of the new recordings begins: all as estimated, and free what belongs to a recording."""
    chain = {**{name: parameter.value for name, parameter in estimate.chain.items()}, **estimate.chosen}
    plan = dataclasses.replace(plan, sensors={**plan.sensors, **_sensors(plan, estimate)})
    description, nuisances = _bench(plan, chain)
    simulator = Simulator(plan.on(description), nuisances, crew, sigma)
    known, free = _known(simulator, estimate, chain)
    offsets = {name: y for y in plan.outputs for name in per_recording(plan, f"offset {y}")}
    freed = {n.name for n in freed_by_the_case(plan)}
    free += [name for name in offsets if name in freed]
    known.update({name: 0.0 for name in offsets})
    values = simulator.values(known)
    simulator.lower = np.minimum(simulator.lower, values)
    simulator.upper = np.maximum(simulator.upper, values)
    deviations = np.array([noise or spread or 1.0 for noise, spread in output_deviations(plan).values()])
    fit = new_fit(simulator, values, free, NoiseModel.plain(deviations, tuple(-1 for _ in plan.outputs)))
    shown = {y for y in plan.outputs if any(n == f"offset {y}" or n.startswith(f"offset {y} ") for n in chain)}
    turned = {
        name
        for o, name in zip(plan.observed, per_recording(plan, "offset angle"), strict=True)
        if "angle" in plan.outputs and o.has_phase
    }
    linear = [g for g in Offset().of_each_output(fit) if offsets[g.name] in shown or g.name in turned]
    return dataclasses.replace(fit, linear=tuple(linear))


def _with_columns(fit: Fit, estimate: Estimate) -> Explanation:
    """Return a fit with the columns of the estimate, but for offsets, which it has."""
    effects = [e for e in known_effects() if e.name in estimate.effects and not isinstance(e, Offset)]
    columns = {g.name: (e, g) for e in effects for g in e.linear(fit) if g.name in estimate.chain}
    additions = [Addition(e, g.name, g.columns.shape[2], np.inf, linear=g) for e, g in columns.values()]
    if additions:
        fit = solved(dataclasses.replace(fit, linear=(*fit.linear, *(g for _, g in columns.values()))))
    return Explanation(fit, tuple(additions))


def _known(simulator: Simulator, estimate: Estimate, chain: Mapping[str, float]) -> tuple[dict[str, float], list[str]]:
    """Return what the estimate says of a simulator's parameters, and those of them that are each recording's own."""
    plan = simulator.plan
    known, free = dict(chain), []
    for parameter in plan.parameters:
        if parameter.name in estimate.parameters:
            known[parameter.name] = estimate.parameters[parameter.name].value
        else:  # it has a value for each recording: their mean is where this one's begins
            own = parameter.quantity or parameter.name
            same = [p.value for n, p in estimate.parameters.items() if n == own or n.startswith(f"{own} ")]
            known[parameter.name] = float(np.mean(same))
            free.append(parameter.name)
    channels = {f"delay {name}" for name in plan.outputs}
    late = any(n.split(" ")[0] == "delay" and not n.startswith("delay of ") and n not in channels for n in chain)
    for o, name in zip(plan.observed, per_recording(plan, "delay"), strict=True):
        if name in simulator.index and (o.delay != 0 or late):
            known[name] = o.delay
            free.append(name)
    if len(plan.observed) > 1:
        known.pop("delay", None)  # of all recordings: each of these has its own
    return known, free


def _sensors(plan: Plan, estimate: Estimate) -> dict[str, int]:
    """Return the outputs that are shown as they are, as the estimate has it; a mean is the plan's or a nuisance."""
    shown = {y: estimate.sensors[y]["sensor"] for y in plan.outputs if y in estimate.sensors}
    return {y: layout.IDENTITY for y, kind in shown.items() if kind != "mean"}


def _bench(plan: Plan, chain: Mapping[str, float]) -> tuple[FmuDescription, tuple[Nuisance, ...]]:
    """Return the FMU that has all that the estimate found, and the nuisance parameters that it may have."""
    nuisances = {n.name: n for n in freed_by_the_case(plan)}
    for y in plan.outputs:
        if f"gain {y}" in chain and f"gain {y}" not in nuisances:
            nuisances[f"gain {y}"] = Nuisance(f"gain {y}", "", 0.1, 10.0, 1.0, 0.1, output=y, act=_scaled)
    description = plan.description
    for effect in known_effects():
        own = effect.nuisances(plan)
        if effect.fmu and not {n.name for n in own} & set(chain):
            continue
        if effect.fmu:
            description = bundled_model(effect.fmu)
        nuisances = {**{n.name: n for n in own}, **nuisances}
    return description, tuple(nuisances.values())


def _scaled(y: FloatArray, gain: float, h: float) -> FloatArray:
    return gain * y
