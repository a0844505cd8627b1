"""A case ⇄ what the page shows and sends of it. Knows no HTTP; keeps what the page does not show.

What the page leaves out of a case (sensors, filters, expectations, …) stays as it is: each function changes one part.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from estimator.app.place import Place
from estimator.cases.case import Case, OutputSpec, ParameterSpec, RunSpec
from estimator.cases.strict_toml import number_in
from estimator.choices import FMI_KINDS, LOSSES
from estimator.errors import InputError
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.variable import Variable
from estimator.method_names import METHODS
from estimator.motor.names import MOTOR, has_motor
from estimator.plans.binding import usual_parameters
from estimator.plans.parameters import Parameter
from estimator.plans.plan import Plan
from estimator.recordings.read_as import ReadAs
from estimator.recordings.units import parse_unit

ROLES = ("fit", "validate", "off")
READING: dict[str, type] = {"test": str, "motor": str, "supply": str, "counts": float, "per_turn": float, "rate": float}
READING_MAPS = ("columns", "units")


def recordings_shown(case: Case, off: Mapping[Path, RunSpec], place: Place) -> list[dict[str, Any]]:
    """Return the recordings with their roles: those of the case, then those that are left out of it."""
    taken = zip(case.recordings, case.runs_of(len(case.recordings)), strict=True)
    runs = [(path, run, "validate" if run.validate else "fit") for path, run in taken]
    runs += [(path, run, "off") for path, run in off.items()]
    return [
        {
            "file": place.name_of(path),
            "role": role,
            "window": run.window,
            "scale": dict(run.scale),
            "offset": dict(run.offset),
            "delay": run.delay,
            "temperature": run.temperature,
            "reading": {
                **{key: getattr(run.read_as, key) for key in READING},
                **{key: dict(getattr(run.read_as, key)) for key in READING_MAPS},
            },
        }
        for path, run, role in runs
    ]


def with_recordings(
    case: Case, rows: Any, place: Place, *, off: Mapping[Path, RunSpec]
) -> tuple[Case, dict[Path, RunSpec]]:
    """Return the case with the recordings that the page names, and those that it leaves out.

    Parameters
    ----------
    off : those that were left out before

    Raises
    ------
    InputError
        A row is none, or names a file twice or outside the folder.
    """
    before = {**off, **dict(zip(case.recordings, case.runs_of(len(case.recordings)), strict=True))}
    taken: list[tuple[Path, RunSpec]] = []
    left: dict[Path, RunSpec] = {}
    for row in _rows(rows, "recordings"):
        path = place.inside(str(row.get("file", "")))
        if not path.is_file():
            raise InputError(
                f"there is no recording {row.get('file')!r} in {place.path}; add it or take it off the list"
            )
        role = row.get("role")
        if role not in ROLES:
            raise InputError(f"the role of {row['file']!r} cannot be {role!r}; choose from {', '.join(ROLES)}")
        if path in left or any(path == other for other, _ in taken):
            raise InputError(f"{row['file']!r} is in the list twice; leave one out")
        run = _run(row, role, before.get(path, RunSpec()))
        if role == "off":
            left[path] = run
        else:
            taken.append((path, run))
    runs = tuple(run for _, run in taken)
    plain = all(run == RunSpec() for run in runs)
    return dataclasses.replace(case, recordings=tuple(p for p, _ in taken), runs=() if plain else runs), left


def with_mapping(case: Case, mapping: Any) -> Case:
    """Return the case with columns on the FMU's inputs and outputs; None: by their usual names.

    Raises
    ------
    InputError
        It is no mapping.
    """
    if mapping is None:
        return dataclasses.replace(case, inputs={}, input_variables={}, products={}, linear=(), jumping=(), outputs={})
    inputs, outputs = _texts(mapping, "inputs"), _texts(mapping, "outputs")
    kept = {name: variable for name, variable in case.input_variables.items() if name in inputs}
    return dataclasses.replace(
        case,
        inputs=inputs,
        input_variables=kept,
        products={name: column for name, column in case.products.items() if name in inputs},
        linear=tuple(name for name in case.linear if name in inputs),
        jumping=tuple(name for name in case.jumping if name in inputs),
        held=tuple(name for name in case.held if name in inputs),
        outputs={
            name: dataclasses.replace(case.outputs.get(name) or OutputSpec(column), column=column)
            for name, column in outputs.items()
        },
    )


def with_parameters(case: Case, rows: Any, description: FmuDescription) -> Case:
    """Return the case with what the page's table says of the parameters; None: as the data and the FMU say.

    Parameters
    ----------
    description : FmuDescription
        Of the case's FMU, in SI units.

    Raises
    ------
    InputError
        A row is none, or a fixed parameter has no value.
    """
    inputs = {v.name for v in description.of_causality("input")}
    held = {name: value for name, value in case.fixed.items() if name in inputs}
    if rows is None:
        return dataclasses.replace(case, parameters={}, fixed=held)
    starts = {v.name: v.start for v in description.of_causality("parameter")}
    free: dict[str, ParameterSpec] = {}
    for row in _rows(rows, "parameters"):
        name = str(row.get("name", ""))
        spec = case.parameters.get(name) or ParameterSpec(name)
        if row.get("free"):
            free[name] = dataclasses.replace(
                spec,
                minimum=_number(row, "min"),
                maximum=_number(row, "max"),
                start=_number(row, "start"),
                per_recording=bool(row.get("per_recording")),
            )
            continue
        value = _number(row, "value")
        for variable, gain in zip(spec.fmu, spec.gains or (1.0,) * len(spec.fmu), strict=True):
            own = starts.get(variable) if value is None else gain * value
            if own is None or isinstance(own, str):
                raise InputError(f"{name} is fixed, but at no value; give one")
            if value is not None or name in usual_parameters(starts):
                held[variable] = own
    return dataclasses.replace(case, parameters=free, fixed=held)


def with_search(case: Case, search: Any) -> Case:
    """Return the case with the page's method, seed and loss.

    Raises
    ------
    InputError
        One of them is none that there is.
    """
    if not isinstance(search, Mapping):
        raise InputError("search must be an object with method, seed and loss")
    for key, known in (("method", METHODS), ("loss", LOSSES)):
        if search.get(key) not in known:
            raise InputError(f"search.{key} cannot be {search.get(key)!r}; choose from {', '.join(known)}")
    seed = search.get("seed")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise InputError("the seed must be a whole number from 0 on")
    changed = dataclasses.replace(case.search, method=search["method"], loss=search["loss"], seed=seed)
    return dataclasses.replace(case, search=changed)


def parameters_shown(case: Case, description: FmuDescription, plan: Plan | None) -> list[dict[str, Any]]:
    """Return the rows of the page's table: all real parameters of the FMU, by the case's names, in SI units.

    "min", "max", "start" and "value" are what the case says; "lower", "upper" and "begin" what is taken.
    """
    variables = {v.name: v for v in description.of_causality("parameter") if v.is_real}
    named = list(case.parameters) or [name for name in usual_parameters(variables) if name not in case.fixed]
    if case.parameters and all(name in MOTOR for name in case.parameters) and has_motor(variables):
        named += [name for name in MOTOR if name not in named and name not in case.fixed]
    planned = {} if plan is None else {p.quantity or p.name: p for p in plan.parameters if p.place is None}
    driven = {target for spec in case.parameters.values() for target in spec.fmu}
    rows = []
    for name in dict.fromkeys([*named, *(n for n in variables if n not in driven)]):
        spec = case.parameters.get(name) or ParameterSpec(name)
        row = _row(spec, variables.get(spec.fmu[0]), planned.get(name))
        rows.append({**row, "free": name in named, "value": case.fixed.get(name)})
    order = {name: k for k, name in enumerate(MOTOR)}
    return sorted(rows, key=lambda row: (not row["free"] and row["value"] is None, order.get(row["name"], len(order))))


def _row(spec: ParameterSpec, variable: Variable | None, planned: Parameter | None) -> dict[str, Any]:
    """Return what the case, the FMU and the plan say of one parameter."""
    row: dict[str, Any] = {
        "name": spec.name,
        "unit": "",
        "description": "",
        "lower": None,
        "upper": None,
        "begin": None,
    }
    if variable is not None:
        start = variable.start if isinstance(variable.start, float) else None
        row |= {"unit": variable.unit, "description": variable.description, "begin": start}
    if planned is not None:
        row |= {"unit": planned.unit, "lower": planned.lower, "upper": planned.upper}
        row["begin"] = planned.start or row["begin"]
    said = {"min": spec.minimum, "max": spec.maximum, "start": spec.start, "nominal": spec.nominal}
    return {**row, **said, "per_recording": spec.per_recording}


def kind_of(value: Any) -> str | None:
    """Return the kind of FMI that the page chose; None: the default."""
    if value is not None and value not in FMI_KINDS:
        raise InputError(f"kind cannot be {value!r}; choose from {', '.join(FMI_KINDS)}")
    return None if value is None else str(value)


def _run(row: Mapping[str, Any], role: str, before: RunSpec) -> RunSpec:
    window = row.get("window")
    ends: tuple[float, float] | None = None
    if window is not None:
        if (
            not isinstance(window, Sequence)
            or len(window) != 2
            or not all(number_in(end) is not None for end in window)
        ):
            raise InputError(f"the window of {row['file']!r} must be two times in s")
        ends = (float(window[0]), float(window[1]))
    delay = row.get("delay")
    return dataclasses.replace(
        before,
        window=ends,
        scale={name: v for name, v in _numbers(row, "scale").items() if v != 1},
        offset={name: v for name, v in _numbers(row, "offset").items() if v != 0},
        delay="free" if delay == "free" else _number(row, "delay"),
        temperature=_number(row, "temperature"),
        validate=role == "validate",
        read_as=_read_as(row, before.read_as),
    )


def _read_as(row: Mapping[str, Any], before: ReadAs) -> ReadAs:
    """Return how a file is read; what the page does not show of it stays."""
    reading = row.get("reading")
    if reading is None:
        return before
    if not isinstance(reading, Mapping):
        raise InputError(f"the reading of {row['file']!r} must be an object")
    said: dict[str, Any] = {}
    for key, kind in READING.items():
        if kind is float:
            said[key] = _number(reading, key)
            if said[key] is not None and said[key] <= 0:
                raise InputError(f"{key} must be above 0, not {said[key]:g}")
        else:
            text = reading.get(key)
            if text is not None and not isinstance(text, str):
                raise InputError(f"{key} must be a text, not {text!r}")
            said[key] = (text or "").strip() or None
    for key in READING_MAPS:
        if key in reading:
            named = _texts(reading, key)
            said[key] = {name: text.strip() for name, text in named.items() if text.strip()}
    for name, unit in said.get("units", {}).items():
        if parse_unit(unit) is None:
            raise InputError(f"{unit!r}, given for {name!r}, is not a known unit; write one such as rpm, mA or ms")
    return dataclasses.replace(before, **said)


def _rows(rows: Any, what: str) -> list[Mapping[str, Any]]:
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{what} must be a list of objects")
    return rows


def _texts(mapping: Any, key: str) -> dict[str, str]:
    found = mapping.get(key) if isinstance(mapping, Mapping) else None
    if not isinstance(found, Mapping) or not all(isinstance(text, str) and text for text in found.values()):
        raise InputError(f"{key} must be an object of texts, such as names of columns")
    return {str(name): str(text) for name, text in found.items()}


def _numbers(row: Mapping[str, Any], key: str) -> dict[str, float]:
    found = row.get(key) or {}
    if not isinstance(found, Mapping) or not all(number_in(value) is not None for value in found.values()):
        raise InputError(f"{key} must be an object of numbers")
    return {str(name): float(value) for name, value in found.items()}


def _number(row: Mapping[str, Any], key: str) -> float | None:
    value = row.get(key)
    if value is None:
        return None
    number = number_in(value)
    if number is None:
        raise InputError(f"{key} must be a number, not {value!r}")
    return number
