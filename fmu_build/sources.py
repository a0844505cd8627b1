"""Which C files make an FMU, where they lie, and their digest. Knows no compiler and no FMU."""

from __future__ import annotations

import hashlib
import re
import uuid
from pathlib import Path

from .errors import BuildError

HERE = Path(__file__).resolve().parent
# The Python that describes a model, as it was when it was loaded: what runs, even if an upgrade changes the files.
_RECIPE = {path.name: path.read_bytes() for path in HERE.glob("*.py")}
_COMMON = ("model.h", "integrator.c", "regime.c", "modes.c", "instance.c", "sensitivity.c", "fmi.c")
GLUE = {fmi: (*_COMMON, f"fmi{fmi}.c") for fmi in (2, 3)}  # the code around the model, by version of FMI

_UNIT = """\
/* {model}: the whole FMU as one translation unit. Made by fmu_build; compile this file only. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif
#define MODEL_GUID "{guid}"
#include "{model}"
#include "fmi{fmi}.c"
"""


def beside(name: str) -> Path:
    """Return a file or folder of the project: within the package when installed, beside it in a checkout."""
    inside = HERE / name
    return inside if inside.exists() else HERE.parent / name


def bundled_sources() -> dict[str, Path]:
    """Return the bundled models' files by name."""
    return {path.stem: path for path in sorted(beside("models").glob("*.c"))}


def find_source(model: str | Path) -> Path:
    """Return the file of a model: a bundled one by its name, any other by its path.

    Raises
    ------
    BuildError
        There is none, or it cannot be a model's file.
    """
    known = bundled_sources()
    if str(model) in known:
        return known[str(model)]
    path = Path(model)
    if not path.is_file():
        raise BuildError(f"no model {str(model)!r}: neither a C file nor a bundled model ({', '.join(known)})")
    check_name(path)
    return path


def check_name(path: Path) -> None:
    """Refuse a file name that cannot be a model's.

    Raises
    ------
    BuildError
        It is no C file, no C identifier, or taken by the code around the model.
    """
    if path.suffix != ".c":
        raise BuildError(f"{path}: a model is one C file, its name ending in .c")
    if not re.fullmatch(r"[A-Za-z_]\w*", path.stem, re.A):
        raise BuildError(f"{path}: the name becomes a C identifier; use letters, digits and _, such as my_motor.c")
    if any(path.name in names for names in GLUE.values()) or path.stem.endswith("_fmu"):
        raise BuildError(f"{path}: this name is taken by the code around the model; give the file another")


def fmu_sources(source: Path, *, fmi: int = 2) -> tuple[dict[str, bytes], str]:
    """Return all files of an FMU's sources/ by name, and the GUID that follows from their content.

    The GUID also follows from the Python that describes the model: equal GUIDs, equal FMUs.

    Raises
    ------
    BuildError
        The model file cannot be read, or includes files of its own.
    """
    try:
        text = source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
        raise BuildError(f"{source}: the model file cannot be read: {reason}") from error
    for included in re.findall(r'^\s*#\s*include\s*"(.*?)"', text, re.M):
        if included != "model.h":
            raise BuildError(f'{source}: a model is one file; it includes "{included}"; put its text in instead')
    files = {source.name: text.encode()} | {name: (HERE / name).read_bytes() for name in GLUE[fmi]}
    digest = hashlib.sha256()
    for name, content in sorted((files | _RECIPE).items()):
        digest.update(f"{name} {len(content)}\n".encode() + content)
    guid = f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"
    return files | {unit_name(source): _UNIT.format(model=source.name, guid=guid, fmi=fmi).encode()}, guid


def unit_name(source: Path) -> str:
    """Return the name of the translation unit that is made for a model."""
    return f"{source.stem}_fmu.c"
