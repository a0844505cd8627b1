"""A case file guessed from an FMU and a recording's header, commented, ready to edit. Simulates nothing."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from estimator.cases.case import PARAMETER, ParameterSpec
from estimator.cases.case_signals import LINEAR, InputSpec, RunSpec, input_value, run_value
from estimator.cases.roles import driving_speed, guess_roles
from estimator.cases.si_units import in_si
from estimator.cases.strict_toml import to_key, to_toml
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.variable import Variable
from estimator.motor.integral_least_squares import integral_estimate, sane
from estimator.motor.names import MOTOR
from estimator.motor.winding import possible_inductance
from estimator.recordings.headers import ROLE_TITLE
from estimator.recordings.motor_columns import counting, motor_columns
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.recording import Recording
from estimator.recordings.samples import filled

MARK = "# TODO"  # what could not be guessed
WIDTH = 100.0  # factor either way of the start
WIDE = {"J": 1e3, "B": 1e4}  # of the shaft's, which single recordings tell less well
SHOWN = 30  # other variables that are listed
FEW = 6  # parameters of an FMU that is no motor: no more, and all are estimated
RPM = f"; taken as rad/s, add gain = {np.pi / 30:.10g} if it is in rpm"
NOTHING: Mapping[str, str] = {}
Range = tuple[float, float, float]
_MOTOR_NAMES = "  # a name R, K, L, J or B says what it is in a motor; fmu says what the FMU calls it"


def case_text(
    description: FmuDescription, recording: Recording, *, fmu: str, folder: Path, read_as: ReadAs = AS_WRITTEN
) -> str:
    """Return the text of a case file.

    Parameters
    ----------
    fmu : str
        As the user gave it: a file or a bundled model's name.
    folder : Path
        In which the case file will lie: paths are relative to it.
    read_as : ReadAs
        How the recording was read beyond what its header says.
    """
    variables = {v.name: in_si(v) for v in description.variables}
    roles = guess_roles(description)
    alike = _alike(variables, recording)
    columns = _columns(roles, alike, recording)
    motion = "angle" if "angle" in columns and "w" not in columns else "w"
    taken = [n for r in ("v", "load", "i", motion) if r in columns for n in roles.get(r, ())[:1]]
    given = {name: column for name, column in alike.items() if name not in taken and column not in columns.values()}
    driven = [_alike_line(variables[n], c) for n, c in given.items() if variables[n].causality == "input"]
    shaft = driving_speed(description) if roles and "w" in columns and not {"w", "angle"} & roles.keys() else None
    if shaft is not None:  # the electrical part alone: its motion comes from the recording
        driven = [line for line in driven if not line.startswith(f"{to_key(shaft)} = ")]
        speed = input_value(InputSpec(columns["w"], between=LINEAR))
        driven.append(f"{to_key(shaft)} = {to_toml(speed)}  # {_told(variables[shaft])}")
    shown = [_alike_line(variables[n], c) for n, c in given.items() if variables[n].causality != "input"]
    needed = (("v",), ("i", motion) if shaft is None else ("i",)) if roles else ((), ())
    parts = MOTOR if shaft is None else [role for role in MOTOR if role in roles or role not in WIDE]
    encoder = counting(recording, columns.values()) if motion not in columns else None
    hints = {} if encoder is None else {motion: f" ({encoder!r} counts an encoder: init again with --counts 4000)"}
    lines = [
        f"# Guessed from {description.path.name} ({description.generation_tool}, FMI {description.fmi_version}) and"
        f" {recording.title}.",
        f"# What could not be guessed is marked {MARK}. Values are in SI units.",
        "",
        "[fmu]",
        f"path = {to_toml(_path(fmu, description, folder))}",
        f"# step = {recording.step:g}  # s, communication step; finer where the FMU's own step error matters",
        *(
            [f"kind = {to_toml(description.kind)}  # also offered: model-exchange"]
            if len(description.kinds) > 1
            else []
        ),
        "",
        "[inputs]  # quantity = column of the recording, and what the FMU calls it",
        *_signals(("v", "load"), roles, columns, variables, causality="input", required=needed[0], more=driven),
        "",
        "[outputs]",
        *_signals(
            ("i", motion), roles, columns, variables, causality="output", required=needed[1], more=shown, hints=hints
        ),
        "",
        f"[parameters]{_MOTOR_NAMES if roles else ''}",
        *_parameters(roles, variables, _ranges(columns, recording), parts=parts),
        *_fixed(roles, {*columns, *given}, variables),
        "",
        "[[recording]]",
        f"file = {to_toml(_relative(recording.path or Path(f'{recording.name}.csv'), folder))}",
        *(f"{key} = {to_toml(value)}" for key, value in run_value(RunSpec(read_as=read_as)).items()),
        "",
        "[search]",
        "seed = 1",
    ]
    unused = [c for c in recording.signals if c not in (*columns.values(), *alike.values())]
    if unused:
        lines += ["", f"# Columns of the recording that are not used: {', '.join(unused)}"]
    return "\n".join(lines) + "\n"


def _signals(
    wanted: tuple[str, ...],
    roles: dict[str, tuple[str, ...]],
    columns: dict[str, str],
    variables: dict[str, Variable],
    *,
    causality: str,
    required: tuple[str, ...],
    more: list[str],
    hints: Mapping[str, str] = NOTHING,
) -> list[str]:
    rows = list(more)
    others = [n for n, v in variables.items() if v.causality == causality and v.is_real][:SHOWN]
    for role in wanted if roles else ():
        name, column = roles.get(role, ("",))[0], columns.get(role)
        if column is not None and name:
            other = RPM if role == "w" and not variables[name].unit else ""
            rows.append(f"{role} = {_signal(role, column, name)}  # {_told(variables[name])}{other}")
        elif role in required and (column is not None or name) and not more:
            missing = f"no column looks like {ROLE_TITLE[role]}{hints.get(role, '')}"
            missing = missing if column is None else "no variable looks like it"
            text = _signal(role, column or "?", name or "?")
            rows.append(f"# {role} = {text}  {MARK}: {missing}; the FMU has {', '.join(others) or 'none'}")
    if not rows and not others and causality == "input":
        return ["# the FMU has none"]
    if not rows and not others:
        others = [n for n, v in variables.items() if v.causality == "local" and v.is_real][:SHOWN]
    return rows or [f"{MARK}: nothing could be guessed; the FMU has {', '.join(others) or 'none'}"]


def _alike_line(variable: Variable, column: str) -> str:
    return f"{to_key(variable.name)} = {to_toml(column)}  # {_told(variable)}"


def _signal(role: str, column: str, name: str) -> str:
    return to_toml(input_value(InputSpec(column, fmu="" if name == role else name)))


def _ranges(columns: Mapping[str, str], recording: Recording) -> dict[str, Range]:
    """Return least, start and largest of a motor's parameters as the recording says; empty where it says none."""
    signals = {role: recording.signals[column] for role, column in columns.items()}
    if "angle" in signals and not np.isnan(signals["angle"]).all():
        signals.setdefault("w", np.gradient(filled(signals["angle"]), recording.time))
    if not {"v", "i", "w"} <= signals.keys():
        return {}
    v, i, w = (signals[role] for role in ("v", "i", "w"))
    if np.isnan(v).any() or not all(np.nanmax(np.abs(y), initial=0.0) > 0 for y in (v, i, w)):
        return {}
    guess = sane(integral_estimate(v, i, w, step=recording.step), v, i, w, step=recording.step)
    found = {n: (x / WIDE.get(n, WIDTH), x, x * WIDE.get(n, WIDTH)) for n, x in guess.items()}
    possible = possible_inductance(guess["R"], v, i, step=recording.step)
    if possible is not None:
        low, high = possible
        found["L"] = (low, min(max(guess["L"], low), high), high)
    return found


def _parameters(
    roles: dict[str, tuple[str, ...]],
    variables: dict[str, Variable],
    ranges: Mapping[str, Range],
    *,
    parts: Sequence[str],
) -> list[str]:
    rows = []
    taken = {name for role in MOTOR for name in roles.get(role, ())}
    for role in parts if roles else ():
        if names := roles.get(role):
            variable = variables[names[0]]
            rows.append(f"{role} = {_parameter(role, names, variable, ranges.get(role))}  # {_told(variable)}")
        else:
            rows.append(f'# {role} = {{ min = ?, max = ?, fmu = "?" }}  {MARK}: nothing looks like it')
    rest = [v for n, v in variables.items() if v.causality == "parameter" and v.is_real and n not in taken]
    rest = [v for v in rest if not v.name.startswith("_")]  # a tool's own: tolerances, log levels
    if not roles and len(rest) <= FEW:
        return [f"{to_key(v.name)} = {_parameter(v.name, (v.name,), v)}  # {_told(v)}" for v in rest]
    if rest and not roles:
        rows.append(f"{MARK}: take away the # of those to estimate; the others keep their start values:")
    elif rest:
        rows.append("# Other parameters keep their start values; take away the # to estimate one:")
    if rest:
        others = [(v, _parameter(v.name, (v.name,), v, mark="#")) for v in rest[:SHOWN]]
        rows += [f"# {to_key(v.name)} = {text}  # {_told(v)}" for v, text in others]
    return rows


def _parameter(
    name: str, targets: tuple[str, ...], variable: Variable, told: Range | None = None, *, mark: str = f"{MARK}:"
) -> str:
    """Return a parameter within the FMU's limits and what the recording tells of it, or else around its own start.

    Bounds that are not known are marked.
    """
    start = variable.start if isinstance(variable.start, float) else variable.nominal
    low, high = variable.minimum, variable.maximum
    least, begin, largest = told if told is not None else (0.0, 0.0, 0.0)
    if not variable.unit and start is not None and not least <= start <= largest:
        least = largest = 0.0  # in whatever unit it is
    allowed = max(least, -np.inf if low is None else low), min(largest, np.inf if high is None else high)
    if allowed[0] < allowed[1]:
        low, high = allowed
        start = min(max(float(f"{begin:.4g}"), low), high)
    elif start is not None and start > 0:
        low = start / WIDTH if low is None else max(low, start / WIDTH)
        high = start * WIDTH if high is None else min(high, start * WIDTH)
    elif start is not None and start < 0:
        low = start * WIDTH if low is None else max(low, start * WIDTH)
        high = start / WIDTH if high is None else min(high, start / WIDTH)
    spec = ParameterSpec(
        name,
        minimum=None if low is None else float(f"{low:.4g}"),
        maximum=None if high is None else float(f"{high:.4g}"),
        start=start,
        fmu=targets,
    )
    text = to_toml(PARAMETER.write(spec))
    return text if low is not None and high is not None else f"{text}  {mark} give min and max"


def _fixed(roles: dict[str, tuple[str, ...]], driven: set[str], variables: dict[str, Variable]) -> list[str]:
    load = roles.get("load", ("",))[0]
    if not load or {"load", load} & driven:
        return []
    return [
        "",
        "[fixed]  # values that are held, by the FMU's names",
        f"{to_key(load)} = 0.0  # {_told(variables[load])}",
    ]


def _told(variable: Variable) -> str:
    return " ".join(f"{variable.name} [{variable.unit or 'no unit'}] {variable.description}".split())


def _alike(variables: dict[str, Variable], recording: Recording) -> dict[str, str]:
    """Return the FMU's inputs and what it shows → the column of the same name; case matters only where it must."""
    shown = [v for v in variables.values() if v.is_real and v.causality in ("input", "output", "local")]
    found: dict[str, str] = {}
    for variable in shown:
        same = [c for c in recording.signals if c == variable.name]
        same = same or [c for c in recording.signals if c.casefold() == variable.name.casefold()]
        if len(same) == 1 and same[0] not in found.values():
            found[variable.name] = same[0]
    return found


def _columns(roles: dict[str, tuple[str, ...]], alike: dict[str, str], recording: Recording) -> dict[str, str]:
    """Return role → column: of the variable's own name, or what usually names it."""
    found = dict(motor_columns(recording, required=[])) if roles else {}
    own = {role: alike[names[0]] for role, names in roles.items() if names[0] in alike}
    return {**{role: c for role, c in found.items() if c not in own.values()}, **own}


def _path(fmu: str, description: FmuDescription, folder: Path) -> str:
    return fmu if description.is_bundled else _relative(description.path, folder)


def _relative(path: Path, folder: Path) -> str:
    text = Path(os.path.relpath(os.path.abspath(path), folder)).as_posix()
    return text if "/" in text or text.endswith(".fmu") or not text.startswith(".") else f"./{text}"
