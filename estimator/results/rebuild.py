"""A model in C built into an FMU again, with the estimates as start values. Knows what `fmu_build` puts into an FMU."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.errors import FmuError
from estimator.results.result import Estimate

if TYPE_CHECKING:
    from estimator.fmus.fmu import FmuDescription

TOOL = "fmu_build"  # generationTool of what can be built again
TABLE_ROW = r"(X\(\s*parameter\s*,\s*{name}\s*,\s*)([^,]+?)(\s*,)"  # one line of a model's table, see model.h


def can_rebuild(description: FmuDescription) -> bool:
    """Return whether the FMU was made by `fmu_build`, with its model inside."""
    return description.generation_tool == TOOL and _source_name(description) in _names(description.path)


def rebuilt_fmu(estimate: Estimate, description: FmuDescription) -> bytes:
    """Return an FMU, for this machine, that starts with the estimated parameters.

    Raises
    ------
    FmuError
        The FMU holds no model in C, or its table does not let a start value be replaced.
    BuildError
        There is no compiler.
    """
    if not can_rebuild(description):
        raise FmuError(
            f"{description.path.name} was not made by fmu_build from a model in C, so its start values cannot be"
            " changed; take the .ssp, which sets the parameters before it runs"
        )
    import fmu_build

    values = {s.variable: s.value for p in estimate.parameters.values() for s in p.set_in_fmu}
    with zipfile.ZipFile(description.path) as archive:
        text = archive.read(_source_name(description)).decode()
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / f"{description.identifier}.c"
        model.write_text(with_starts(text, values, title=description.path.name), encoding="utf-8")
        built = fmu_build.build(
            model, output=Path(folder) / "rebuilt.fmu", fmi=3 if description.fmi_version.startswith("3") else 2
        )
        content = built.read_bytes()
        _check(built, values)
    return content


def with_starts(text: str, values: Mapping[str, float], *, title: str) -> str:
    """Return a model's C text with other start values of its parameters.

    Raises
    ------
    FmuError
        A parameter has no line of its own in the table.
    """
    for name, value in values.items():
        row = re.compile(TABLE_ROW.format(name=re.escape(name)))
        text, count = row.subn(rf"\g<1>{value!r}\g<3>", text)
        if count != 1:
            raise FmuError(
                f"{title}: {name} is on {count} lines of the model's table, not on one; set its start value by hand"
            )
    return text


def _check(fmu: Path, values: Mapping[str, float]) -> None:
    """See that the FMU says what it was built to say."""
    from estimator.fmus.fmu import describe

    starts = {v.name: v.start for v in describe(fmu).variables}
    wrong = [name for name, value in values.items() if starts.get(name) != value]
    if wrong:
        raise FmuError(f"the rebuilt FMU starts with {wrong[0]} = {starts.get(wrong[0])}; set it in the model by hand")


def _source_name(description: FmuDescription) -> str:
    return f"sources/{description.identifier}.c"


def _names(path: Path) -> list[str]:
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()
