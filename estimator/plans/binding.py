"""The names of a case, resolved once against its FMU and its recordings. Knows no sample; simulates nothing.

Inside, every value is in SI and every quantity has the case's name. A name R, K, L, J or B of a parameter, v of an
input, i or w of an output is a role: it says what the quantity is in a motor, whatever the FMU calls it, and lets the
steady-state relations work. Parameters and fixed values go to variables by the FMU's names.
"""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from estimator.cases.case import Case, OutputSpec, ParameterSpec
from estimator.cases.si_units import in_si_units
from estimator.errors import CaseError, FmuError, InputError, RecordingError, suggestion
from estimator.fmus.fmu import FmuDescription, with_kind
from estimator.fmus.variable import Variable
from estimator.motor.names import MOTOR, has_motor
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.recording import Recording
from estimator.stepping import layout

FREE_TOO = ("friction",)  # beside the motor's five, where the FMU has it: the Coulomb friction of dc_motor_friction
INTEGRALS = {"w": "angle"}  # outputs whose integral has a usual name


@dataclass(frozen=True)
class Channels:
    """The columns of one recording, by the FMU input that they drive and the output that they are compared with."""

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]


@dataclass(frozen=True)
class Binding:
    """What the names of a case mean in its FMU and its recordings.

    Attributes
    ----------
    description : FmuDescription
        In SI units, of the kind that the case asks for.
    channels : of each recording
    free : what is estimated
    fixed, texts : FMU variable → number in SI, or text, that it is set to
    """

    case: Case
    description: FmuDescription
    channels: tuple[Channels, ...] = ()
    free: tuple[ParameterSpec, ...] = ()
    fixed: Mapping[str, float] = dataclasses.field(default_factory=dict)
    texts: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def on(self, description: FmuDescription) -> Binding:
        """Return the same names in another FMU that has them all."""
        return dataclasses.replace(self, description=in_si_units(description))

    @cached_property
    def own(self) -> dict[str, Variable]:
        """The FMU's variables by its own names."""
        return {v.name: v for v in self.description.variables}

    @cached_property
    def parameters(self) -> dict[str, Variable]:
        """The FMU's parameters by its own names."""
        return {v.name: v for v in self.description.of_causality("parameter")}

    @cached_property
    def inputs(self) -> dict[str, Variable]:
        """The FMU's inputs by the case's names, driven or not."""
        renamed = {variable: name for name, variable in self.case.input_variables.items()}
        return {renamed.get(v.name, v.name): v for v in self.description.of_causality("input")}

    @property
    def outputs(self) -> dict[str, OutputSpec]:
        """What is compared, with the sensor that shows it."""
        return {n: self.case.outputs.get(n) or OutputSpec(column) for n, column in self.channels[0].outputs.items()}

    @cached_property
    def unshown(self) -> tuple[str, ...]:
        """The FMU's outputs that no column is compared with, nor with what integrates or is integrated by one."""
        shown = {v.name for name in self.outputs for v in (self.signal(name), self.integral(name)) if v is not None}
        outputs = [v.name for v in self.description.of_causality("output")]
        return tuple(name for name in outputs if not {name, INTEGRALS.get(name)} & shown)

    @cached_property
    def is_motor(self) -> bool:
        """Whether the FMU is a motor, which moves in the same way at any angle, and begins at zero."""
        return has_motor({*self.case.parameters, *self.parameters}) and not self.begins_elsewhere

    @cached_property
    def begins_elsewhere(self) -> bool:
        """Whether the case says where the simulation begins: a state has a start value of its own."""
        names = [name for spec in self.case.parameters.values() for name in spec.fmu] + list(self.case.fixed)
        return any(name in self.own and self.own[name].causality in ("output", "local") for name in names)

    @property
    def held_inputs(self) -> dict[str, float]:
        """Inputs that have one value all the time."""
        held = {name: self.own[name] for name in self.case.fixed}
        return {name: self.fixed[name] for name, v in held.items() if v.causality == "input" and v.is_real}

    @property
    def settings(self) -> tuple[tuple[Variable, float | str], ...]:
        """What is set and is no real number."""
        values: dict[str, float | str] = {**self.fixed, **self.texts}
        return tuple((self.own[name], value) for name, value in values.items() if not self.own[name].is_real)

    def signal(self, name: str, *, role: str = "variable") -> Variable:
        """Return the variable of an input or an output; `role` ("input", "output") bounds the suggestion.

        Raises
        ------
        FmuError
            The FMU has none.
        """
        spec = self.case.outputs.get(name)
        own = self.case.input_variables.get(name) or (spec.fmu if spec else "") or name
        return self._known(own, role)

    def integral(self, output: str) -> Variable | None:
        """Return the output that integrates another, as the angle does the speed; None where the FMU has none."""
        spec = self.case.outputs.get(output)
        if spec is not None and spec.integral:
            return self._known(spec.integral, "output")
        name = INTEGRALS.get(output, "")
        given = self.case.outputs.get(name)
        return self.own.get(given.fmu or name if given else name)

    def read(self, output: str, sensor: int) -> Variable:
        """Return the variable to read for an output: for a mean the output's integral.

        Raises
        ------
        FmuError
            The FMU has none.
        """
        found = self.integral(output) if sensor == layout.MEAN else self.signal(output)
        if found is None:
            raise FmuError(
                f"{self.description.path.name} has no output that integrates {output!r} (such as 'angle' for 'w');"
                ' sensor = "mean" needs it; use sensor = "identity"'
            )
        return found

    def target(self, name: str) -> Variable:
        """Return a variable, by the FMU's name, that takes a value before the simulation.

        Raises
        ------
        FmuError
            There is none of that name, or it cannot be set.
        """
        variable = self.own.get(name)
        path = self.description.path.name
        known = [v.name for v in self.own.values() if v.causality in ("parameter", "input")]
        if variable is None:
            raise FmuError(f"{path} has no parameter {name!r}{suggestion(name, known)}")
        if not variable.is_settable:
            what = f"{variable.causality} {name!r} of {path}"
            raise FmuError(f"the {what} is calculated, so it takes no value{suggestion(name, known)}")
        return variable

    def _known(self, own: str, role: str) -> Variable:
        return self.own[own] if own in self.own else self.description.variable(own, role=role)


def usual_parameters(available: Collection[str]) -> tuple[str, ...]:
    """Return which of an FMU's parameters are estimated where a case names none."""
    return tuple(name for name in (*MOTOR, *FREE_TOO) if name in available)


def bind(case: Case, description: FmuDescription, recordings: Sequence[Recording]) -> Binding:
    """Resolve the names of a case.

    Raises
    ------
    InputError
        A name is of no variable and no column, or of one that cannot be meant: one sentence.
    """
    names = Binding(case, in_si_units(with_kind(description, case.kind)))
    for name in case.input_variables:
        names.signal(name, role="input")
    for name, spec in case.outputs.items():
        names.signal(name, role="output")
        if spec.integral:
            names.integral(name)
    fixed, texts = _fixed_values(names)
    channels = tuple(_channels(names, recording) for recording in recordings)
    _check_channels(names, channels, recordings)
    return dataclasses.replace(names, channels=channels, free=_free(names), fixed=fixed, texts=texts)


def _channels(names: Binding, recording: Recording) -> Channels:
    """Return the columns of a recording, from the case or by the usual names."""
    case = names.case
    inputs = {name: recording.column(column) for name, column in case.inputs.items()}
    outputs = {name: recording.column(spec.column) for name, spec in case.outputs.items()}
    if outputs and (inputs or all(name in case.fixed for name in names.inputs)):
        return Channels(inputs, outputs)
    needs_voltage = not inputs and "v" not in case.fixed
    roles = motor_columns(recording, required=["v"] if needs_voltage else [], either=[] if outputs else ["i", "w"])
    usual: dict[str, str] = {r: roles[r] for r in ("v", "load") if r in roles and r in names.inputs}
    if needs_voltage and "v" not in usual and not names.inputs:
        raise FmuError(
            f"{names.description.path.name} has no inputs, so no voltage can drive it; export it with the voltage as an"
            " input, or say in a case file, under [outputs], what of it is compared with which column"
        )
    if needs_voltage and "v" not in usual:
        raise FmuError(
            f"{names.description.path.name} has no input 'v' (its inputs: {', '.join(names.inputs)});"
            f" {how_to_map(names, 'inputs', 'which input takes which column')}"
        )
    return Channels(inputs or usual, outputs or _usual_outputs(names, roles))


def _usual_outputs(names: Binding, roles: Mapping[str, str]) -> dict[str, str]:
    """Return which output is compared with which column, by the usual names of both."""
    measured = [r for r in ("i", "w", "angle") if r in roles and not (r == "angle" and "w" in roles)]
    shown = [v.name for v in names.description.of_causality("output")]
    if missing := [role for role in measured if role not in shown]:
        raise FmuError(
            f"{names.description.path.name} has no output {missing[0]!r}{suggestion(missing[0], shown)};"
            f" {how_to_map(names, 'outputs', 'which output shows which column')}"
        )
    return {role: roles[role] for role in measured}


def _check_channels(names: Binding, channels: Sequence[Channels], recordings: Sequence[Recording]) -> None:
    """Refuse an input that is driven and fixed, names of no variable, a column that is compared twice.

    And recordings of other channels than the first.
    """
    first, title = channels[0], recordings[0].title
    for own, recording in zip(channels, recordings, strict=True):
        for name, column in own.inputs.items():
            if names.signal(name, role="input").name in names.case.fixed:
                raise InputError(
                    f"the input {name!r} is fixed, but {recording.title} has it in the column {column!r};"
                    " leave the fixed value out, or name the columns to use in a case file"
                )
        compared: dict[str, str] = {}
        for name, column in own.outputs.items():
            if (other := compared.setdefault(column, name)) != name:
                raise CaseError(
                    f"the column {column!r} of {recording.title} is compared with {other} and {name}, so its noise"
                    " would count as two; leave one of them out"
                )
        if tuple(own.outputs) != tuple(first.outputs):
            raise RecordingError(
                f"{recording.title} measures {', '.join(own.outputs)}, but {title} measures {', '.join(first.outputs)};"
                " all recordings need the same columns"
            )
        if tuple(own.inputs) != tuple(first.inputs):
            raise RecordingError(
                f"{recording.title} drives {', '.join(own.inputs)}, but {title} drives {', '.join(first.inputs)};"
                " all recordings need the same columns, or name under [inputs] those to use"
            )


def _free(names: Binding) -> tuple[ParameterSpec, ...]:
    """Return what is estimated: what the case names, or what a motor has."""
    case, available, path = names.case, names.parameters, names.description.path.name
    free = [n for n in case.parameters if n not in case.fixed]
    if not case.parameters:
        free = [n for n in usual_parameters(available) if n not in case.fixed]
        if not free and not any(n in available for n in MOTOR):
            listed = ", ".join(list(available)[:20]) or "none"
            raise FmuError(
                f"{path} has none of the parameters R, K, L, J, B (its parameters: {listed});"
                f" {how_to_map(names, 'parameters', 'which parameters to estimate')}"
            )
    elif all(n in MOTOR for n in case.parameters) and has_motor(available):
        free = [n for n in MOTOR if n not in case.fixed]  # bounds for some do not fix the others
    if not free:
        raise CaseError("every parameter is fixed; leave at least one free")
    found = tuple(case.parameters.get(name) or ParameterSpec(name) for name in free)
    for variable in (names.target(name) for spec in found for name in spec.fmu):
        if not variable.is_real:
            raise FmuError(
                f"{variable.name!r} of {path} is {variable.type}; only real parameters are estimated;"
                " give it a value under [fixed]"
            )
    return found


def _fixed_values(names: Binding) -> tuple[dict[str, float], dict[str, str]]:
    """Return the case's fixed values by the FMU's names: numbers in SI, and texts.

    An item of an enumeration may be named; true and false are 1 and 0.
    """
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    path = names.description.path.name
    for name, value in names.case.fixed.items():
        variable = names.target(name)
        if variable.type == "String":
            raise CaseError(f"[fixed] {name} is a text in {path}; write it in quotes")
        if variable.is_real and isinstance(value, bool):
            raise CaseError(f"[fixed] {name} is a number in {path}; give one, not {str(value).lower()}")
        if not variable.is_real and value != round(value):
            raise CaseError(f"[fixed] {name} is {variable.type} in {path}; {value:g} is no whole number")
        if reach := variable.reach_without(value):
            raise CaseError(f"[fixed] {name} = {value:g} is outside the range {reach} that {path} allows")
        if variable.items and value not in dict(variable.items).values():
            known = ", ".join(f"{item} = {number}" for item, number in variable.items)
            raise CaseError(f"[fixed] {name} of {path} has no item of the value {value:g} ({known})")
        numbers[name] = float(value)
    for name, text in names.case.fixed_texts.items():
        variable = names.target(name)
        items = dict(variable.items)
        if variable.type == "String":
            texts[name] = text
        elif text in items:
            numbers[name] = float(items[text])
        elif items:
            raise CaseError(f"[fixed] {name} of {path} has no item {text!r}{suggestion(text, items)}")
        else:
            raise CaseError(f"[fixed] {name} is {variable.type} in {path}; give a number, not {text!r}")
    return numbers, texts


def how_to_map(names: Binding, key: str, what: str) -> str:
    """Return the remedy where the FMU has other names: the key of the case file, or the command that guesses one."""
    case, description = names.case, names.description
    if case.path is not None or not case.recordings:
        return f"say in a case file, under [{key}], {what}"
    fmu = description.name if description.is_bundled else str(description.path)
    command = shlex.join(["fmu-estimator", "init", fmu, str(case.recordings[0]), "-o", "motor.case.toml"])
    return f"a case file says {what}: let one be guessed with {command}"
