"""The JSON Schema of a case file, for editors that complete and check while one types. Knows keys, reads nothing.

Put ``#:schema case.schema.json`` in the first line of a case file, or tell the editor (Taplo, Even Better TOML) that it
holds for ``*.case.toml``. The reader (case.py) stays the judge: it also checks files and what keys say of each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from estimator.cases.case import BUNDLED_FMU, FMI_KINDS, LOSSES, METHODS
from estimator.cases.case_signals import BEGINS, BETWEEN, FREE, MAX_AVERAGE, SENSORS
from estimator.cases.expectation import VERDICTS
from estimator.cases.nameplate import QUANTITIES
from estimator.cases.tolerance import DEFAULT, OFFERED
from estimator.recordings.filters import FAMILIES, MAX_ORDER

CELL = {"type": "string", "pattern": r"^\{[^{}]*\}$", "description": "a column of the table of motors"}
TEXT = {"type": "string", "pattern": r"\S"}
PERCENT = r"^\s*\d+(\.\d*)?([eE][-+]?\d{1,4})?\s*%\s*$"


def schema() -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) as plain data."""
    parameter = _object(
        min=_number("smallest value of the search"),
        max=_number("greatest value of the search"),
        nominal=_number("what the data sheet says, for comparison"),
        start=_number("where the search begins"),
        fmu={
            "anyOf": [
                TEXT,
                {"type": "array", "items": TEXT, "minItems": 1},
                {**_map(_number("factor"), "variable = factor"), "minProperties": 1},
            ],
            "description": "variables of the FMU that take the value; default: the parameter's own name",
        },
        per_recording={"type": "boolean", "default": False, "description": "a value of its own for each recording"},
    )
    output = _object(
        required=("column",),
        column={**TEXT, "description": "column of the recording"},
        fmu={**TEXT, "description": "variable of the FMU; default: the output's own name"},
        integral={**TEXT, "description": "variable of the FMU that integrates it, for the sensor mean"},
        sensor={
            "enum": list(SENSORS),
            "default": SENSORS[0],
            "description": "mean: over the last sampling interval, as differenced encoder counts; auto: by the data",
        },
        counts=_whole("of an encoder a turn: the column holds counts", minimum=1),
        average={
            "anyOf": [{"type": "integer", "minimum": 1, "maximum": MAX_AVERAGE}, {"const": "auto"}],
            "description": "samples of a running mean that the logger took; default: by the data",
        },
        filter={**_filter(), "description": "that the measurement went through; the model goes through it too"},
        both={**_filter(), "description": "that is applied here, to measurement and model"},
        gain=_value("of the sensor", exclusiveMinimum=0),
        offset=_value("of the sensor, SI"),
        delay=_value("of this channel beyond the recording's, s"),
        quantum=_positive("step of the quantisation, SI; default: by the data"),
    )
    driven = _object(
        required=("column",),
        column={**TEXT, "description": "column of the recording"},
        fmu={**TEXT, "description": "variable of the FMU; default: the input's own name"},
        times={**TEXT, "description": "column that it is multiplied with: the supply of a duty cycle"},
        between={"enum": list(BETWEEN), "default": BETWEEN[0], "description": "from row to row"},
    )
    entry: dict[str, Any] = {
        "value": _number("expected value"),
        "within": _tolerance(),
        "min": _number("smallest that is accepted"),
        "max": _number("greatest that is accepted"),
    }
    verdict: dict[str, Any] = {"enum": list(VERDICTS)}
    expect: dict[str, Any] = {
        **_object(
            verdict={"anyOf": [verdict, {"type": "array", "items": verdict, "minItems": 1}]},
            confidence={
                "anyOf": [{"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, CELL],
                "description": "an estimate passes only if this interval lies within its limits (ISO 14253-1)",
            },
            rmse={"type": "object", "additionalProperties": _positive("greatest root mean square error, SI")},
            standard_error={"type": "object", "additionalProperties": _tolerance()},
        ),
        "additionalProperties": _object(**entry),
    }
    plate = _object(**entry, unit={**TEXT, "description": "such as rpm; default: SI"})
    quantities: dict[str, Any] = {
        name: {"anyOf": [_number(f"{unit}, shown only"), plate]} for name, (unit, _) in QUANTITIES.items()
    }
    nameplate = _object(
        voltage=_positive("rated voltage, V"),
        **quantities,
    )
    recording = _object(
        required=("file",),
        file={**TEXT, "description": "path, relative to this file; a pattern (motor_*.csv) is a case for each match"},
        window={
            "type": "array",
            "items": _number("s"),
            "minItems": 2,
            "maxItems": 2,
            "description": "only samples from one time to the other are used, s",
        },
        scale=_map(_number("factor"), "channel = factor on its samples; -1 turns its sign"),
        offset=_map(_number("SI"), "channel = what is added to its samples after the factor"),
        delay=_value("of the outputs behind the inputs, s"),
        temperature=_number("of the winding, degrees Celsius"),
        columns=_map(TEXT, "v, i, w, angle or load = the column that it is; wins over the file's header"),
        units=_map(TEXT, "column, or v, i, w, …, time = its unit; wins over the file's header"),
        rate=_positive("of the samples of a file that has no time, Hz"),
        test={**TEXT, "description": "which test, of a file that holds several; default: all, each a recording"},
        motor={**TEXT, "description": "which motor, of a file that holds several: left, right, 1, …"},
        per_turn=_positive("m that a turn goes, of a speed in m/s or a way in m"),
        counts=_positive("counts a turn, of a column of encoder counts"),
        supply={**TEXT, "description": "of a duty cycle: volts, volts a count (12/255), or the column that holds them"},
        validate={"type": "boolean", "default": False, "description": "held out of the fit, compared with it"},
        begin={
            "enum": list(BEGINS),
            "description": "how the simulation begins: at rest, settled at the first row's inputs, or as FMU and case"
            " give its states; default: a motor by the data, another FMU as given",
        },
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Case file of fmu-estimator",
        **_object(
            required=("recording",),
            fmu=_object(
                path={**TEXT, "default": BUNDLED_FMU, "description": "a bundled model's name, or a file"},
                step=_positive("communication step, s; default: the recording's sampling interval"),
                kind={"enum": list(FMI_KINDS), "default": FMI_KINDS[0]},
            ),
            inputs=_map({"anyOf": [{**TEXT, "description": "column of the recording"}, driven]}, "FMU input = column"),
            outputs=_map({"anyOf": [TEXT, output]}, "FMU output = column"),
            parameters=_map(parameter, "parameters to estimate"),
            fixed=_map(
                {"anyOf": [_number("value"), {"type": "boolean"}, TEXT]}, "FMU parameters and inputs that are held"
            ),
            recording={"type": "array", "items": recording, "minItems": 1},
            motors=_object(
                required=("file",),
                file={**TEXT, "description": "CSV; {column} in this file's texts then stands for each row's cell"},
                name={**TEXT, "description": "column with the motors' names; default: the first"},
            ),
            search=_object(
                method={"enum": list(METHODS), "default": METHODS[0]},
                seed=_whole("of the random numbers", minimum=0, default=1),
                nests=_whole("candidates a generation", minimum=2),
                iterations=_whole("generations", minimum=1),
                loss={"enum": list(LOSSES), "default": LOSSES[0], "description": "huber: outliers pull less"},
            ),
            expect=expect,
            nameplate=nameplate,
            tolerance=_tolerances(),
            about={**_map({"type": "string"}, "motor, operator, date, … → text, for the report")},
        ),
    }


def _object(*, required: Sequence[str] = (), **properties: Any) -> dict[str, Any]:
    made: dict[str, Any] = {"type": "object", "properties": properties, "additionalProperties": False}
    return {**made, "required": list(required)} if required else made


def _map(value: dict[str, Any], description: str) -> dict[str, Any]:
    return {"type": "object", "additionalProperties": value, "description": description}


def _number(description: str) -> dict[str, Any]:
    return {"anyOf": [{"type": "number"}, CELL], "description": description}


def _positive(description: str) -> dict[str, Any]:
    return {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, CELL], "description": description}


def _whole(description: str, **limits: int) -> dict[str, Any]:
    default = {"default": limits.pop("default")} if "default" in limits else {}
    return {"anyOf": [{"type": "integer", **limits}, CELL], "description": description, **default}


def _filter() -> dict[str, Any]:
    parts = {
        "ripple": _positive("in the pass band, dB"),
        "attenuation": _positive("in the stop band, dB"),
    }
    families: dict[str, Any] = {
        family: _object(
            required=("order", *needed, "cutoff"),
            order=_whole("order", minimum=1, maximum=MAX_ORDER),
            cutoff=_positive("Hz"),
            **{name: parts[name] for name in needed},
        )
        for family, needed in FAMILIES.items()
    }
    numbers = {"type": "array", "items": {"type": "number"}, "minItems": 1}
    families["coefficients"] = _object(required=("b", "a"), b=numbers, a=numbers)
    return {**_object(**families), "minProperties": 1, "maxProperties": 1}


def _value(description: str, **limits: float) -> dict[str, Any]:
    return {
        "anyOf": [{"type": "number", **limits}, {"const": FREE}, CELL],
        "description": f'{description}: a number (held), "free" (estimated); default: by the data',
    }


def _tolerances() -> dict[str, Any]:
    size = {
        "anyOf": [{"type": "number", "exclusiveMinimum": 0}, TEXT],
        "description": '"1 %": within, or "1 % (k=2)": an expanded uncertainty; a number is a share, or in SI',
    }
    with_default = {"const": True, "description": "the set that is offered, besides"}
    sizes: dict[str, Any] = {DEFAULT: with_default, **dict.fromkeys(OFFERED, size)}
    named = _object(**sizes)
    gains = {"patternProperties": {". gain$": size}}
    text = {"const": DEFAULT, "description": "the set that is offered"}
    return {"anyOf": [{**named, **gains}, text], "description": "what no recording tells, part of each uncertainty"}


def _tolerance() -> dict[str, Any]:
    number = {"type": "number", "exclusiveMinimum": 0}
    return {
        "anyOf": [number, {"type": "string", "pattern": PERCENT}, CELL],
        "description": 'a share, "1 %", or a number in the unit of the value',
    }
