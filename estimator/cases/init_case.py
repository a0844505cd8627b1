"""A case file guessed from an FMU and a recording's header, commented, ready to edit. Simulates nothing."""

from __future__ import annotations

import os
from pathlib import Path

from estimator.cases.mapping import in_si
from estimator.cases.roles import guess_roles
from estimator.cases.strict_toml import to_key, to_toml
from estimator.fmus.fmu import FmuDescription, Variable
from estimator.recordings.headers import ROLE_TITLE
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.recording import Recording
from estimator.results.linear import MOTOR

MARK = "# TODO"  # what could not be guessed
WIDTH = 100.0  # factor either way of the start
SHOWN = 30  # other variables that are listed


def case_text(description: FmuDescription, recording: Recording, *, fmu: str, folder: Path) -> str:
    """Return the text of a case file.

    Parameters
    ----------
    fmu : str
        As the user gave it: a file or a bundled model's name.
    folder : Path
        In which the case file will lie: paths are relative to it.
    """
    variables = {v.name: in_si(v) for v in description.variables}
    roles = guess_roles(description)
    columns = _columns(recording)
    motion = "angle" if "angle" in columns and "w" not in columns else "w"
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
        *_signals(("v", "load"), roles, columns, variables, causality="input", required=("v",)),
        "",
        "[outputs]",
        *_signals(("i", motion), roles, columns, variables, causality="output", required=("i", motion)),
        "",
        "[parameters]  # a name R, K, L, J or B says what it is in a motor; fmu says what the FMU calls it",
        *_parameters(roles, variables),
        *_fixed(roles, columns, variables),
        "",
        "[[recording]]",
        f"file = {to_toml(_relative(recording.path or Path(f'{recording.name}.csv'), folder))}",
        "",
        "[search]",
        "seed = 1",
    ]
    unused = [c for c in recording.signals if c not in columns.values()]
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
) -> list[str]:
    rows = []
    others = [n for n, v in variables.items() if v.causality == causality and v.is_real][:SHOWN]
    for role in wanted:
        name, column = roles.get(role, ("",))[0], columns.get(role)
        if column is not None and name:
            rows.append(f"{role} = {_signal(role, column, name)}  # {_told(variables[name])}")
        elif role in required and (column is not None or name):
            missing = f"no column looks like {ROLE_TITLE[role]}" if column is None else "no variable looks like it"
            text = _signal(role, column or "?", name or "?")
            rows.append(f"# {role} = {text}  {MARK}: {missing}; the FMU has {', '.join(others) or 'none'}")
    return rows or [f"{MARK}: nothing could be guessed; the FMU has {', '.join(others) or 'none'}"]


def _signal(role: str, column: str, name: str) -> str:
    return to_toml(column) if name == role else to_toml({"column": column, "fmu": name})


def _parameters(roles: dict[str, tuple[str, ...]], variables: dict[str, Variable]) -> list[str]:
    rows = []
    taken = {name for role in MOTOR for name in roles.get(role, ())}
    for role in MOTOR:
        if names := roles.get(role):
            rows.append(f"{role} = {_parameter(role, names, variables[names[0]])}  # {_told(variables[names[0]])}")
        else:
            rows.append(f'# {role} = {{ min = ?, max = ?, fmu = "?" }}  {MARK}: nothing looks like it')
    rest = [v for n, v in variables.items() if v.causality == "parameter" and v.is_real and n not in taken]
    if rest:
        rows.append("# Other parameters keep their start values; take away the # to estimate one:")
        rows += [f"# {to_key(v.name)} = {_parameter(v.name, (v.name,), v)}  # {_told(v)}" for v in rest[:SHOWN]]
    return rows


def _parameter(name: str, targets: tuple[str, ...], variable: Variable) -> str:
    start = variable.start if isinstance(variable.start, float) else variable.nominal
    low, high = variable.minimum, variable.maximum
    if start is not None and start > 0:
        low = start / WIDTH if low is None else max(low, start / WIDTH)
        high = start * WIDTH if high is None else min(high, start * WIDTH)
    value = {
        "min": None if low is None else float(f"{low:.4g}"),
        "max": None if high is None else float(f"{high:.4g}"),
        "start": start,
        "fmu": None if targets == (name,) else targets[0] if len(targets) == 1 else list(targets),
    }
    text = to_toml(value)
    return text if low is not None and high is not None else f"{text}  {MARK}: give min and max"


def _fixed(roles: dict[str, tuple[str, ...]], columns: dict[str, str], variables: dict[str, Variable]) -> list[str]:
    load = roles.get("load", ("",))[0]
    if not load or "load" in columns:
        return []
    return [
        "",
        "[fixed]  # values that are held, by the FMU's names",
        f"{to_key(load)} = 0.0  # {_told(variables[load])}",
    ]


def _told(variable: Variable) -> str:
    unit = f" [{variable.unit}]" if variable.unit else ""
    return " ".join(f"{variable.name}{unit} {variable.description}".split())


def _columns(recording: Recording) -> dict[str, str]:
    return dict(motor_columns(recording, required=[]))


def _path(fmu: str, description: FmuDescription, folder: Path) -> str:
    return fmu if description.is_bundled else _relative(description.path, folder)


def _relative(path: Path, folder: Path) -> str:
    text = Path(os.path.relpath(os.path.abspath(path), folder)).as_posix()
    return text if "/" in text or text.endswith(".fmu") or not text.startswith(".") else f"./{text}"
