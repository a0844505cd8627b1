"""From a case, an FMU and recordings to a plan: which column is what, what each sensor shows. Simulates nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator import layout
from estimator.case import Case
from estimator.errors import CaseError, FmuError, RecordingError, suggestion
from estimator.excitation import Excitation, find_delay, find_excitation, quantum
from estimator.fmu import FmuDescription, Variable
from estimator.free_parameters import first_guess, free_parameters
from estimator.mapping import begins_elsewhere, fixed_values, integral_of, mapped, target
from estimator.plan import ChainSpec, Observed, Plan
from estimator.recording import Recording, motor_columns, read_recording

FloatArray = NDArray[np.float64]

LATE = 2  # samples: a response that starts this much later than it could is delayed
COUNTS, WHOLE = (16, 1e6), 0.02  # counts a turn of an encoder whose differences are the speed


def plan_case(case: Case, description: FmuDescription, *, recordings: Sequence[Recording] | None = None) -> Plan:
    """Make a case concrete.

    Raises
    ------
    InputError
        A recording, a column, an FMU variable or a bound is wrong: one sentence.
    """
    description = mapped(case, description)
    fixed, texts = fixed_values(case, description)
    recordings = [read_recording(path) for path in case.recordings] if recordings is None else list(recordings)
    if not recordings:
        raise CaseError('the case names no recording; add [[recording]] with file = "run.csv"')
    observed = tuple(_observe(case, description, recording) for recording in recordings)
    for other in observed[1:]:
        if tuple(other.outputs) != tuple(observed[0].outputs):
            raise RecordingError(
                f"{other.recording.title} measures {', '.join(other.outputs)}, but {observed[0].recording.title}"
                f" measures {', '.join(observed[0].outputs)}; all recordings need the same columns"
            )
    guess, notes = first_guess(case, observed)
    parameters = free_parameters(case, description, guess)
    if not parameters:
        raise CaseError("every parameter is fixed; leave at least one free")
    return Plan(
        case=case,
        description=description,
        observed=observed,
        parameters=parameters,
        fixed=fixed,
        sensors=_sensors(case, description, observed),
        guess=guess,
        notes=notes,
        chains=_chains(case, observed),
        texts=texts,
    )


def _observe(case: Case, description: FmuDescription, recording: Recording) -> Observed:
    inputs, outputs = _columns(case, description, recording)
    driven: dict[str, FloatArray] = {}
    for name, column in inputs.items():
        signal = recording.signal(column, unit=description.variable(name, role="input").unit or None)
        if np.isnan(signal).any():
            k = int(np.flatnonzero(np.isnan(signal))[0])
            raise RecordingError(
                f"{recording.title}: {column} has no sample at t = {recording.time[k]:g} s; an input must be complete"
            )
        driven[name] = signal
    for name, value in case.fixed.items():
        variable = target(description, name)
        if variable.causality == "input" and variable.is_real:
            driven[name] = np.full(len(recording.time), value)
    measured = {}
    for name, column in outputs.items():
        signal = recording.signal(column, unit=description.variable(name, role="output").unit or None)
        measured[name] = _without_rest(signal) if name == "angle" else signal
    if not driven:  # the FMU moves by itself, as the motor did
        return Observed(recording, driven, measured, Excitation("several", 0, 0.0, 0.0, False), 0)
    first = next(iter(driven.values()))
    excitation = find_excitation(first, measured)
    if begins_elsewhere(case, description):  # nothing to run in, and the way from there is a response
        kind = "several" if excitation.kind == "none" else excitation.kind
        still = dataclasses.replace(excitation, kind=kind, running=False)
        return Observed(recording, driven, measured, still, 0)
    lead = 0
    if excitation.running and first[0] != 0 and excitation.kind != "none":
        lead = len(first) - (excitation.index if excitation.kind == "step" else 0)
    late = find_delay(excitation, measured) if lead == 0 else 0
    return Observed(recording, driven, measured, excitation, lead, late * recording.step if late >= LATE else 0.0)


def _without_rest(angle: FloatArray) -> FloatArray:
    """Leave out what an encoder shows before it counts first: its error is constant there."""
    known = angle[~np.isnan(angle)]
    resting = int(np.argmax(angle != known[0])) if quantum(angle) > 0 else 0
    resting = int(np.argmax(~np.isnan(angle) & (angle != known[0]))) if resting else 0
    return np.where(np.arange(len(angle)) < resting, np.nan, angle)


def _columns(case: Case, description: FmuDescription, recording: Recording) -> tuple[dict[str, str], dict[str, str]]:
    """Return FMU input → column and FMU output → column, from the case or from the usual names."""
    undriven = all(v.name in case.fixed for v in description.of_causality("input"))
    if case.outputs and (case.inputs or undriven):
        return (
            {name: recording.column(column) for name, column in case.inputs.items()},
            {name: recording.column(spec.column) for name, spec in case.outputs.items()},
        )
    inputs = {name: recording.column(column) for name, column in case.inputs.items()}
    outputs = {name: recording.column(spec.column) for name, spec in case.outputs.items()}
    roles = motor_columns(recording, required=[*([] if inputs else ["v"]), *([] if outputs else ["i", "w"])])
    if not inputs:
        for role in ("v", "load"):
            if role in roles and any(v.name == role for v in description.of_causality("input")):
                inputs[role] = roles[role]
        if "v" not in inputs:
            known = ", ".join(v.name for v in description.of_causality("input")) or "none"
            raise FmuError(
                f"{description.path.name} has no input 'v' (its inputs: {known});"
                " say in a case file, under [inputs], which input takes which column"
            )
    if not outputs:
        measured = [r for r in ("i", "w", "angle") if r in roles and not (r == "angle" and "w" in roles)]
        names = [v.name for v in description.variables if v.causality == "output"]
        outputs = {role: roles[role] for role in measured if role in names}
        missing = [role for role in measured if role not in names]
        if missing:
            raise FmuError(
                f"{description.path.name} has no output {missing[0]!r}{suggestion(missing[0], names)};"
                " say in a case file, under [outputs], which output shows which column"
            )
    return inputs, outputs


def _is_differenced(description: FmuDescription, observed: tuple[Observed, ...]) -> bool:
    """Whether the speed is that of encoder counts, differenced: its steps are 2π / (whole counts a turn) / interval."""
    if not any(v.name == "angle" for v in description.variables):
        return False
    for o in observed:
        step = quantum(o.outputs["w"]) * o.recording.step
        counts = 2 * np.pi / step if step > 0 else 0.0
        if not (COUNTS[0] <= counts <= COUNTS[1] and abs(counts - round(counts)) < WHOLE):
            return False
    return True


def _sensors(case: Case, description: FmuDescription, observed: tuple[Observed, ...]) -> dict[str, int]:
    sensors = {}
    for name in observed[0].outputs:
        spec = case.outputs.get(name)
        mean = spec is not None and spec.sensor == "mean"
        mean = mean or (spec is None and name == "w" and _is_differenced(description, observed))
        sensors[name] = layout.MEAN if mean else layout.IDENTITY
        if mean:
            read_variable(description, layout.MEAN, name)
    return sensors


def _chains(case: Case, observed: tuple[Observed, ...]) -> dict[str, ChainSpec]:
    chains = {}
    for name, spec in case.outputs.items():
        if spec.filter is None or name not in observed[0].outputs:
            continue
        for o in observed:
            if not spec.filter.cutoff * o.recording.step < 0.5:
                raise CaseError(
                    f"output {name!r}: the filter's cutoff {spec.filter.cutoff:g} Hz is not below half the sampling"
                    f" rate of {o.recording.title}, {0.5 / o.recording.step:g} Hz"
                )
        chains[name] = ChainSpec(filter=spec.filter)
    return chains


def read_variable(description: FmuDescription, sensor: int, name: str) -> Variable:
    """Return the variable to read for an output: a mean is read from the output's integral."""
    if sensor != layout.MEAN:
        return description.variable(name, role="output")
    integral = integral_of(name)
    for variable in description.variables:
        if variable.name == integral:
            return variable
    raise FmuError(
        f"{description.path.name} has no output that integrates {name!r} (such as 'angle' for 'w');"
        ' sensor = "mean" needs it; use sensor = "identity"'
    )
