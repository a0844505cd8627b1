"""What a case calls things → the FMU's variables: names, factors, units. Knows a description; simulates nothing.

Inside, every value is in SI and every quantity has the case's name. A name R, K, L, J or B of a parameter, v of an
input, i or w of an output is a role: it says what the quantity is in a motor, whatever the FMU calls it, and lets the
steady-state relations work.
"""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Mapping

from estimator.cases.case import Case
from estimator.errors import CaseError, FmuError, suggestion
from estimator.fmus.fmu import FmuDescription, Variable, with_kind
from estimator.recordings.units import parse_unit

# Base units that have a name of their own.
NAMED = {
    (("kg", 1), ("m", 2), ("s", -3), ("A", -2)): "Ohm",
    (("kg", 1), ("m", 2), ("s", -2), ("A", -2)): "H",
    (("kg", 1), ("m", 2), ("s", -3), ("A", -1)): "V",
    (("kg", 1), ("m", 2), ("s", -2), ("A", -1)): "V.s/rad",
    (("kg", 1), ("m", 2), ("s", -2), ("A", -1), ("rad", -1)): "V.s/rad",
    (("kg", 1), ("m", 2), ("s", -2)): "N.m",
    (("kg", 1), ("m", 2), ("s", -1)): "N.m.s/rad",
    (("kg", 1), ("m", 2), ("s", -1), ("rad", -1)): "N.m.s/rad",
    (("kg", 1), ("m", 2)): "kg.m2",
    (("s", -1), ("rad", 1)): "rad/s",
    (("A", 1),): "A",
    (("s", 1),): "s",
    (("rad", 1),): "rad",
}


def mapped(case: Case, description: FmuDescription) -> FmuDescription:
    """Return the description with the case's names, in SI units; the FMU's own variables stay beside them.

    Raises
    ------
    FmuError
        The case names a variable that the FMU does not have, or a kind that it does not offer.
    """
    description = in_si_units(with_kind(description, case.kind))
    own = description.variables
    by_name = {v.name: v for v in own}
    aliases: dict[str, Variable] = {}

    def alias(name: str, target: str, role: str) -> None:
        if target not in by_name:
            known = [v.name for v in own if v.causality == role]
            raise FmuError(f"{description.path.name} has no {role} {target!r}{suggestion(target, known)}")
        if target != name:
            aliases[name] = dataclasses.replace(by_name[target], name=name)

    for name, target in case.input_variables.items():
        alias(name, target, "input")
    for name, spec in case.outputs.items():
        alias(name, spec.fmu or name, "output")
        if spec.integral:
            alias(integral_of(name), spec.integral, "output")
    names = tuple(aliases.values()) + tuple(v for v in own if v.name not in aliases)
    return dataclasses.replace(description, variables=names)


def integral_of(output: str) -> str:
    """Return the name of the variable that integrates an output: the angle of a speed."""
    return {"w": "angle"}.get(output, f"integral of {output}")


def target(description: FmuDescription, name: str) -> Variable:
    """Return a variable of the FMU that takes a value before the simulation: a parameter, an input, a start value.

    Raises
    ------
    FmuError
        There is none of that name, or it cannot be set.
    """
    own = description.originals or description.variables
    variable = next((v for v in own if v.name == name), None)
    known = [v.name for v in own if v.causality in ("parameter", "input")]
    if variable is None:
        raise FmuError(f"{description.path.name} has no parameter {name!r}{suggestion(name, known)}")
    if not variable.is_settable:
        what = f"{variable.causality} {name!r} of {description.path.name}"
        raise FmuError(f"the {what} is calculated, so it takes no value{suggestion(name, known)}")
    return variable


def fixed_values(case: Case, description: FmuDescription) -> tuple[dict[str, float], dict[str, str]]:
    """Return the case's fixed values by the FMU's names: numbers in SI, and texts.

    An item of an enumeration may be named; true and false are 1 and 0.
    """
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    for name, value in case.fixed.items():
        variable = target(description, name)
        if variable.type == "String":
            raise CaseError(f"[fixed] {name} is a text in {description.path.name}; write it in quotes")
        if not variable.is_real and value != round(value):
            raise CaseError(
                f"[fixed] {name} is {variable.type} in {description.path.name}; {value:g} is no whole number"
            )
        _in_range(variable, value, description)
        if variable.items and value not in dict(variable.items).values():
            known = ", ".join(f"{item} = {number}" for item, number in variable.items)
            raise CaseError(f"[fixed] {name} of {description.path.name} has no item of the value {value:g} ({known})")
        numbers[name] = value
    for name, text in case.fixed_texts.items():
        variable = target(description, name)
        items = dict(variable.items)
        if variable.type == "String":
            texts[name] = text
        elif text in items:
            numbers[name] = float(items[text])
        elif items:
            raise CaseError(f"[fixed] {name} of {description.path.name} has no item {text!r}{suggestion(text, items)}")
        else:
            raise CaseError(
                f"[fixed] {name} is {variable.type} in {description.path.name}; give a number, not {text!r}"
            )
    return numbers, texts


def driven_twice(case: Case, inputs: Mapping[str, str]) -> str | None:
    """Return the input that a column drives and that is fixed as well; None: there is none."""
    return next((name for name in inputs if case.input_variables.get(name, name) in case.fixed), None)


def how_to_map(case: Case, description: FmuDescription, key: str, what: str) -> str:
    """Return the remedy where the FMU has other names: the key of the case file, or the command that guesses one."""
    if case.path is not None or not case.recordings:
        return f"say in a case file, under [{key}], {what}"
    fmu = description.name if description.is_bundled else str(description.path)
    command = shlex.join(["fmu-estimator", "init", fmu, str(case.recordings[0]), "-o", "motor.case.toml"])
    return f"a case file says {what}: let one be guessed with {command}"


def begins_elsewhere(case: Case, description: FmuDescription) -> bool:
    """Whether the case says where the simulation begins: a state has a start value of its own."""
    names = [name for spec in case.parameters.values() for name in spec.fmu] + list(case.fixed)
    own = {v.name: v for v in description.originals}
    return any(name in own and own[name].causality in ("output", "local") for name in names)


def settings(
    description: FmuDescription, numbers: Mapping[str, float], texts: Mapping[str, str]
) -> tuple[tuple[str, int, float | str], ...]:
    """Return what is set and is no real number: type, value reference, value."""
    found = []
    values: dict[str, float | str] = {**numbers, **texts}
    for name in settings_names(description, numbers, texts):
        variable = target(description, name)
        found.append((variable.type, variable.value_reference, values[name]))
    return tuple(found)


def settings_names(
    description: FmuDescription, numbers: Mapping[str, float], texts: Mapping[str, str]
) -> tuple[str, ...]:
    """Return the names of what `settings` sets, in its order."""
    return tuple(name for name in (*numbers, *texts) if not target(description, name).is_real)


def in_si_units(description: FmuDescription) -> FmuDescription:
    """Return the description with its variables in SI units; the FMU's own stay beside them."""
    own = tuple(in_si(v) for v in description.variables)
    return dataclasses.replace(description, variables=own, originals=own)


def in_si(variable: Variable) -> Variable:
    """Return a variable with its unit, start and limits in SI; `factor` and `offset` lead there."""
    unit, factor, offset = si_unit(variable)
    if (factor, offset) == (1.0, 0.0):
        return dataclasses.replace(variable, unit=unit)

    def convert(value: float | None) -> float | None:
        return None if value is None else value * factor + offset

    limits = sorted(x for x in (convert(variable.minimum), convert(variable.maximum)) if x is not None)
    both = variable.minimum is not None and variable.maximum is not None
    return dataclasses.replace(
        variable,
        unit=unit,
        own_unit=variable.unit,
        factor=factor,
        offset=offset,
        start=convert(variable.start) if isinstance(variable.start, float) else variable.start,
        minimum=limits[0] if both else convert(variable.minimum),
        maximum=limits[1] if both else convert(variable.maximum),
        nominal=convert(variable.nominal),
    )


def si_unit(variable: Variable) -> tuple[str, float, float]:
    """Return a variable's SI unit, and factor and offset from its own; an unknown unit is taken as it is."""
    if not variable.unit:
        return "", 1.0, 0.0
    known = parse_unit(variable.unit)
    if known is not None and known.quantity != "ratio":
        factor = known.numerator / known.denominator
        return (variable.unit if (factor, known.offset) == (1.0, 0.0) else known.si), factor, known.offset
    base = variable.base
    if base is None or (base.factor, base.offset) == (1.0, 0.0):
        return variable.unit, 1.0, 0.0
    text = ".".join(f"{name}{'' if e == 1 else e}" for name, e in base.exponents)
    return NAMED.get(base.exponents, text or "1"), base.factor, base.offset


def _in_range(variable: Variable, value: float, description: FmuDescription) -> None:
    low, high = variable.minimum, variable.maximum
    if (low is not None and value < low) or (high is not None and value > high):
        reach = f"{'any' if low is None else f'{low:g}'} to {'any' if high is None else f'{high:g}'}"
        raise CaseError(
            f"[fixed] {variable.name} = {value:g} is outside the range {reach} that {description.path.name} allows"
        )
