"""A case written as a case file, which reads back as the same case. Reads none, opens no FMU and no recording."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from estimator.cases.case import PARAMETER, SEARCH, Case, SearchSpec, is_file_name
from estimator.cases.case_signals import HELD, JUMPING, LINEAR, InputSpec, input_value, output_value, run_value
from estimator.cases.expectation import ENTRY, LIMITS
from estimator.cases.nameplate import nameplate_value
from estimator.cases.strict_toml import to_key, to_toml
from estimator.cases.tolerance import tolerance_value
from estimator.output import write_files


def write_case(case: Case, path: Path) -> None:
    """Write a case file that reads back as the same case; it appears whole or not at all.

    Paths are written relative to the file.
    """
    path = Path(path)
    folder = Path(os.path.abspath(path)).parent
    sections: list[tuple[str, dict[str, Any]]] = [
        ("[fmu]", {"path": _fmu_value(case.fmu, folder), "step": case.step, "kind": case.kind}),
        ("[inputs]", {name: input_value(_input(case, name)) for name in case.inputs}),
        ("[outputs]", {name: output_value(output) for name, output in case.outputs.items()}),
        ("[parameters]", {name: PARAMETER.write(spec) for name, spec in case.parameters.items()}),
        ("[fixed]", {**case.fixed, **case.fixed_texts}),
        *(
            ("[[recording]]", {"file": _relative(str(file), folder), **run_value(case.run(k))})
            for k, file in enumerate(case.recordings)
        ),
        ("[search]", SEARCH.write(_near(case.search, folder), always=("method", "seed"))),
        (
            "[expect]",
            {**{name: ENTRY.write(e) for name, e in case.expect.items()}, **LIMITS.write(case.limits)},
        ),
        ("[nameplate]", {} if case.nameplate is None else nameplate_value(case.nameplate)),
        ("[about]", dict(case.about)),
    ]
    tolerance = tolerance_value(case.tolerance)
    blocks = [f"tolerance = {to_toml(tolerance)}\n"] if isinstance(tolerance, str) else []
    if isinstance(tolerance, dict):
        sections.append(("[tolerance]", tolerance))
    for title, values in sections:
        rows = [f"{to_key(name)} = {to_toml(value)}" for name, value in values.items() if value is not None]
        if rows:
            blocks.append("\n".join([title, *rows]) + "\n")
    write_files({path: "\n".join(blocks).encode()})


def _near(search: SearchSpec, folder: Path) -> SearchSpec:
    """Return how to search with files of starts named from a folder."""
    starts = tuple(_relative(s, folder) if isinstance(s, str) else s for s in search.starts)
    return replace(search, starts=starts)


def _input(case: Case, name: str) -> InputSpec:
    ways = ((JUMPING, case.jumping), (LINEAR, case.linear), (HELD, case.held))
    return InputSpec(
        column=case.inputs[name],
        fmu=case.input_variables.get(name, ""),
        times=case.products.get(name, ""),
        between=next((way for way, names in ways if name in names), "found"),
    )


def _fmu_value(fmu: str, folder: Path) -> str:
    if not os.path.isabs(fmu):
        return fmu
    relative = _relative(fmu, folder)
    return relative if is_file_name(relative) else f"./{relative}"


def _relative(path: str, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return path
