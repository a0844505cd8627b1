"""An estimate's values as text for other tools: CSV, MATLAB, Modelica, state space. Knows no FMU and writes no file.

Every number keeps all its bits, and every text says with how much doubt it was found.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import re
from collections.abc import Iterable, Mapping
from typing import Any, get_args

import numpy as np

from estimator.errors import InputError
from estimator.motor.names import INPUTS, MOTOR, STATES, is_motor
from estimator.motor.state_space import matrices, transfer_functions
from estimator.results.result import DerivedQuantity, Estimate, ParameterEstimate, Setting, StandardUncertainty, Verdict
from estimator.results.result_json import json_ready, to_mapping
from estimator.results.spreadsheet_cells import harmless

MODELICA_PART = re.compile(r"[A-Za-z_]\w*|'(?:[^'\\]|\\.)+'", re.ASCII)  # a component's name, plain or quoted
MODELICA_NAME = re.compile(rf"(?:{MODELICA_PART.pattern})(?:\.(?:{MODELICA_PART.pattern}))*", re.ASCII)
MSL = {  # what takes each value in a motor made of the Modelica Standard Library
    "R": "Modelica.Electrical.Analog.Basic.Resistor resistor(R={})",
    "L": "Modelica.Electrical.Analog.Basic.Inductor inductor(L={})",
    "K": "Modelica.Electrical.Analog.Basic.RotationalEMF emf(k={})",
    "J": "Modelica.Mechanics.Rotational.Components.Inertia inertia(J={})",
    "B": "Modelica.Mechanics.Rotational.Components.Damper damper(d={})",
}


def estimate_from_json(text: str, *, source: str = "result.json") -> Estimate:
    """Return the estimate of a result.json, without its signals.

    Raises
    ------
    InputError
        It is no result of `estimate`.
    """
    try:
        data = json.loads(text)
        if data["verdict"] not in get_args(Verdict):
            raise ValueError(f"no such verdict: {data['verdict']!r}")
        given = data.get("tolerance", {})
        budget = {n: {s: t["shift"][n] for s, t in given.items() if n in t["shift"]} for n in data["parameters"]}
        parameters = {name: _parameter(name, entry, budget[name]) for name, entry in data["parameters"].items()}
        return Estimate(
            verdict=data["verdict"],
            reasons=tuple(data["reasons"]),
            parameters=parameters,
            method=data["method"],
            seed=data["seed"],
            simulations=data["simulations"],
            simulations_by_phase=data["simulations_by_phase"],
            failed_simulations=data["failed_simulations"],
            steps=data["steps"],
            seconds=data["seconds"],
            fmu=data["fmu"],
            versions=data["versions"],
            tolerances={
                source: StandardUncertainty(
                    t["given"], t["distribution"], t["standard_uncertainty"], t["unit"], t["left"]
                )
                for source, t in given.items()
            },
            **_numbers(data),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        if isinstance(error, json.JSONDecodeError | RecursionError):
            why = "it is no JSON"
        elif isinstance(error, KeyError):
            why = f"it lacks {error}"
        else:
            why = str(error) if isinstance(error, ValueError) else "its content is another"
        raise InputError(
            f"{source} is no result of an estimate: {why}; give the result.json that estimate -o wrote"
        ) from error


def csv_table(estimate: Estimate) -> bytes:
    """Return one row a parameter: name, value, standard error, unit, bounds, nominal, status."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    columns = ("value", "standard_error", "unit", "lower", "upper", "at_bound", "nominal", "free", "status")
    writer.writerow(("parameter", *columns))
    for name, entry in to_mapping(estimate)["parameters"].items():
        cells = (entry[column] for column in columns)
        writer.writerow((harmless(name), *("" if c is None else repr(c) if isinstance(c, float) else c for c in cells)))
    return stream.getvalue().encode()


def matlab_script(estimate: Estimate) -> bytes:
    """Return a script that defines ``parameters`` and ``standard_errors``, and a motor's ``ss`` where it is one.

    Its function handle ``set_fmu`` gives the values to an FMU block in Simulink.
    """
    name = _identifier(str(estimate.fmu.get("name") or "motor"))
    fields = _identifiers(estimate.parameters)
    lines = [f"% {line}" for line in _heading(estimate)]
    lines += ["", "% values, in the unit that is named"]
    for parameter in estimate.parameters.values():
        lines.append(f"parameters.{fields[parameter.name]} = {_number(parameter.value)};  % {_doubt(parameter)}")
    lines += ["", "% standard errors; NaN where none is known"]
    for parameter in estimate.parameters.values():
        error = parameter.standard_error if parameter.free else 0.0
        shown = "NaN" if error is None else _number(error)
        lines.append(f"standard_errors.{fields[parameter.name]} = {shown};")
    values = {n: p.value for n, p in estimate.parameters.items()}
    if is_motor(values):
        A, B, C, D = (_matrix(m.tolist()) for m in matrices(values))
        lines += ["", "% the motor as a linear system: inputs v [V], load [N.m]; outputs i [A], w [rad/s]"]
        lines += [f"A = {A};", f"B = {B};", f"C = {C};", f"D = {D};"]
        lines += [
            "if exist('ss', 'file')  % Control System Toolbox, or Octave's control package",
            f"    {name} = ss(A, B, C, D, 'InputName', {{'v', 'load'}}, 'OutputName', {{'i', 'w'}});",
            "end",
        ]
    pairs = [
        f"'{_quoted(s.variable)}', '{_number(s.value)}'" for p in estimate.parameters.values() for s in p.set_in_fmu
    ]
    lines += ["", "% In Simulink: set_fmu(gcb) with the FMU block selected"]
    lines += [f"set_fmu = @(block) set_param(block, {', '.join(pairs)});"]
    return ("\n".join(lines) + "\n").encode()


def modelica_modifier(estimate: Estimate) -> bytes:
    """Return a modifier of the model behind the FMU, and the same values for the Modelica Standard Library's parts."""
    lines = [f"// {line}" for line in _heading(estimate)]
    settings = [s for p in estimate.parameters.values() for s in p.set_in_fmu if s.type in ("Real", "Integer")]
    named = [s for s in settings if MODELICA_NAME.fullmatch(s.variable)]
    lines += ["// Put behind the model's name, as in: MyMotor motor" + _modifier(named) + ";"]
    lines += [_modifier(named)]
    lines += [
        f"// Not set, as no modifier can: {' '.join(s.variable.split())} = {_number(s.value)}"
        for s in settings
        if s not in named
    ]
    values = {n: p.value for n, p in estimate.parameters.items()}
    if is_motor(values):
        lines += ["", "// The same motor from parts of the Modelica Standard Library:"]
        lines += [f"{MSL[name].format(_number(values[name]))};" for name in MOTOR]
    return ("\n".join(lines) + "\n").encode()


def state_space_json(estimate: Estimate) -> bytes:
    """Return the motor's matrices and transfer functions as JSON.

    Raises
    ------
    InputError
        It is no motor: R, K, L, J and B are needed.
    """
    values = {name: p.value for name, p in estimate.parameters.items()}
    A, B, C, D = matrices(values)
    content: dict[str, Any] = {
        "description": "; ".join(filter(None, ("dx/dt = A x + B u, y = C x + D u, SI units", without_units(estimate)))),
        "inputs": INPUTS,
        "states": STATES,
        "outputs": STATES,
        "A": A,
        "B": B,
        "C": C,
        "D": D,
        "transfer_functions": {
            name: {"numerator": numerator, "denominator": denominator}
            for name, (numerator, denominator) in transfer_functions(values).items()
        },
    }
    return (json.dumps(json_ready(content), indent=2, allow_nan=False) + "\n").encode()


def without_units(estimate: Estimate) -> str:
    """Return a sentence on a motor's parameters whose unit the FMU does not say; "" where there is none."""
    bare = [name for name in MOTOR if name in estimate.parameters and not estimate.parameters[name].unit]
    if not bare or not is_motor({name: p.value for name, p in estimate.parameters.items()}):
        return ""
    return f"the FMU says no unit of {', '.join(bare)}: matrices and parts of a motor are right if these are in SI"


def _numbers(data: dict[str, Any]) -> dict[str, Any]:
    """Return what an estimate says in numbers besides its parameters, as far as its result.json has it."""
    correlation = data.get("correlation") or {}
    rows = [[entry.get(name) for name in correlation] for entry in correlation.values()]
    return {
        "derived": {
            name: DerivedQuantity(float(q["value"]), float(q["standard_error"]), q["unit"])
            for name, q in data.get("derived", {}).items()
            if q["value"] is not None and q["standard_error"] is not None
        },
        "chain": {name: _parameter(name, entry) for name, entry in data.get("measurement_chain", {}).items()},
        "correlation": np.array(rows, dtype=float) if rows else None,  # None, no number, becomes NaN
        "correlated": tuple(correlation),
        "notes": tuple(data.get("notes", ())),
        "recordings": tuple(dict(recording) for recording in data.get("recordings", ())),
        "about": dict(data.get("about", {})),
        **{name: dict(data.get(name, {})) for name in ("rmse", "fit_percent", "noise", "sample_noise")},
    }


def _parameter(name: str, entry: dict[str, Any], budget: Mapping[str, float] | None = None) -> ParameterEstimate:
    known = entry.get("variables")
    settings = None
    if known is not None:
        settings = tuple(
            Setting(variable, s["value"], s["unit"], s.get("type", "Real")) for variable, s in known.items()
        )
    if not isinstance(entry["value"], (int, float)):
        raise ValueError(f"{name} has no value")
    infinity = float("inf")
    return ParameterEstimate(
        name=name,
        value=float(entry["value"]),
        unit=entry["unit"],
        lower=entry["lower"] if entry["lower"] is not None else -infinity,
        upper=entry["upper"] if entry["upper"] is not None else infinity,
        standard_error=entry["standard_error"],
        at_bound=entry["at_bound"],
        status=entry["status"],
        reason=entry["reason"],
        free=entry["free"],
        nominal=entry["nominal"],
        settings=settings,
        repeatability=entry.get("repeatability"),
        budget=budget or {},
    )


def _heading(estimate: Estimate) -> list[str]:
    fmu = estimate.fmu.get("name") or "an FMU"
    lines = [f"Parameters of {fmu}, estimated by fmu-estimator; verdict: {estimate.verdict}"]
    units = [sentence] if (sentence := without_units(estimate)) else []
    return [" ".join(line.split()) for line in (*lines, *estimate.reasons, *units)]


def _doubt(parameter: ParameterEstimate) -> str:
    parts = [parameter.unit or "-"]
    if not parameter.free:
        parts.append("fixed")
    elif parameter.standard_error is not None:
        parts.append(f"+- {parameter.standard_error:.2g}")
    if parameter.status != "ok":
        parts.append(parameter.status)
    return ", ".join(parts)


def _modifier(settings: list[Setting]) -> str:
    """Return ``(R=3.1, drive(K=0.05))``: a dot in a name is a component of the model."""
    tree: dict[str, Any] = {}
    for setting in settings:
        *path, last = MODELICA_PART.findall(setting.variable)
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[last] = str(round(setting.value)) if setting.type == "Integer" else _number(setting.value)

    def text(branch: dict[str, Any]) -> str:
        items = [f"{k}{text(v)}" if isinstance(v, dict) else f"{k}={v}" for k, v in branch.items()]
        return f"({', '.join(items)})"

    return text(tree)


def _matrix(rows: list[list[float]]) -> str:
    return "[" + "; ".join(" ".join(_number(x) for x in row) for row in rows) + "]"


def _quoted(name: str) -> str:
    """Return a name for MATLAB's quotes: Modelica's own names may hold one."""
    return name.replace("'", "''")


def _number(value: float) -> str:
    return repr(float(value))


def _identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return a field's name for each name, no two alike: those of `a.R` and `a_R` would be one."""
    found: dict[str, str] = {}
    for name in sorted(names, key=lambda n: _identifier(n) != n):  # what is an identifier keeps its name
        plain = _identifier(name)
        others = (f"{plain}_{k}" for k in itertools.count(1))
        found[name] = plain if plain not in found.values() else next(o for o in others if o not in found.values())
    return found


def _identifier(name: str) -> str:
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return plain if re.match(r"[A-Za-z]", plain) else f"p_{plain}"
