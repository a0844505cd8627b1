"""A plan as a job of workers: variables by their references, recordings in the FMU's units. Simulates nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.errors import CaseError
from estimator.fitting.candidate_values import CandidateValues
from estimator.fmus.job import Experiment, Job
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.recordings.recording import Recording
from estimator.recordings.sensors import Section
from estimator.stepping.layout import types_of

MOST_STEPS = 100_000_000  # of one simulation of a recording: 1.5 s of the bundled motor, minutes of some others
ON_LINES = 8  # communication steps a row, where an input goes on lines and the FMU takes its mean over each

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def job_of(plan: Plan, values: CandidateValues, *, sigma: Mapping[str, float]) -> Job:
    """Return what is simulated of a plan.

    Parameters
    ----------
    values : CandidateValues
        Of the plan: how those of a candidate follow each other.
    sigma : output → float
        Deviations that weigh the outputs in costs, in their units.

    Raises
    ------
    CaseError
        The communication step does not divide a sampling interval, or is far too short.
    """
    description, binding = plan.description, plan.binding
    inputs = tuple(plan.observed[0].inputs)
    driven = [binding.signal(n) for n in inputs]
    read = [binding.read(y, plan.sensors[y]) for y in plan.outputs]
    return Job(
        description=description,
        parameter_references=tuple(v.value_reference for v in values.variables),
        input_references=tuple(v.value_reference for v in driven),
        output_references=tuple(v.value_reference for v in read),
        sensors=tuple(plan.sensors[y] for y in plan.outputs),
        experiments=tuple(_experiment(plan, o, sigma) for o in plan.observed),
        sensor_values=values.sensors,
        linear=tuple(name in plan.case.linear for name in inputs),
        even_steps=not description.capabilities.get("canHandleVariableCommunicationStepSize", True),
        reinstantiate=description.restart == "re-instantiate",
        fresh_process=description.restart == "fresh process",
        types=types_of([v.type for v in (*values.variables, *driven, *read)]),
        settings=tuple((v.type, v.value_reference, value) for v, value in binding.settings),
        names=(*values.names, *(v.name for v, _ in binding.settings), *inputs),
        scale=tuple((v.factor, v.offset) for v in read) if any(not v.is_as_it_is for v in read) else (),
    )


def _experiment(plan: Plan, observed: Observed, sigma: Mapping[str, float]) -> Experiment:
    recording = observed.recording
    own = [_own_unit(plan, name, signal) for name, signal in observed.inputs.items()]
    inputs = own[0][:, None] if len(own) == 1 else np.empty((len(recording.time), 0))
    inputs = np.column_stack(own) if len(own) > 1 else inputs
    still = [_own_unit(plan, name, np.zeros(observed.rest)) for name in observed.inputs]
    at_rest = np.column_stack(still) if still else np.empty((observed.rest, 0))
    if observed.before:
        inputs = np.concatenate([at_rest, np.repeat(inputs[:1], observed.lead, axis=0), inputs])
    jumped = [observed.jumps.get(name, np.zeros(len(own[0]), dtype=bool)) for name in observed.inputs]
    ends = _ends(inputs, np.column_stack(jumped)) if any(map(np.any, jumped)) else None
    start = plan.description.default_experiment["start_time"] or 0.0
    times = None
    if not recording.even or observed.taken is not None:
        first = observed.before * recording.step
        before = np.arange(observed.before) * recording.step
        times = np.concatenate([before, observed.times - observed.times[0] + first]) + start
    return Experiment(
        start=start,
        interval=recording.step,
        substeps=_substeps(plan, recording),
        inputs=inputs,
        measured=observed.compared,
        weights=np.array([1 / sigma[y] ** 2 for y in plan.outputs]),
        chains=_chains(plan, recording.step),
        times=times,
        ends=ends,
    )


def _ends(inputs: FloatArray, jumped: BoolArray) -> FloatArray:
    """Return where inputs, (before + n, inputs), end: where the next row is, unless they jump there, (n, inputs)."""
    jumps = np.zeros(inputs.shape, dtype=bool)
    jumps[len(inputs) - len(jumped) :] = jumped
    ends = inputs.copy()
    ends[:-1] = np.where(jumps[1:], inputs[:-1], inputs[1:])
    return ends


def _own_unit(plan: Plan, name: str, signal: FloatArray) -> FloatArray:
    """Return an input in the FMU's unit."""
    variable = plan.binding.signal(name)
    return signal if variable.is_as_it_is else (signal - variable.offset) / variable.factor


def _chains(plan: Plan, step: float) -> tuple[tuple[int, tuple[Section, ...]], ...]:
    specs = [plan.chains.get(y, ChainSpec()) for y in plan.outputs]
    if all(s.is_plain for s in specs):
        return ()
    return tuple((s.average, s.sections(step)) for s in specs)


def _substeps(plan: Plan, recording: Recording) -> int:
    case = plan.case
    if case.step is None:
        capable = plan.description.capabilities.get("canInterpolateInputs", False)
        return ON_LINES if case.linear and not capable else 1
    steps = recording.step / case.step * len(recording.time)
    if steps > MOST_STEPS:
        raise CaseError(
            f"the communication step {case.step:g} s makes {steps:.3g} steps of each simulation of {recording.title},"
            f" more than {MOST_STEPS:,}; take a longer one, up to the sampling interval {recording.step:g} s"
        )
    substeps = round(recording.step / case.step)
    if substeps < 1 or abs(recording.step / case.step - substeps) > 1e-6 * substeps:
        raise CaseError(
            f"the communication step {case.step:g} s does not divide the sampling interval {recording.step:g} s"
            f" of {recording.title}; take {recording.step:g} s or a whole fraction of it"
        )
    return substeps
