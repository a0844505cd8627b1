"""A new model file to start from. Knows no compiler and no FMU."""

from __future__ import annotations

from pathlib import Path

from .errors import BuildError
from .sources import HERE, bundled_sources, check_name


def new_model(name: str, *, folder: Path) -> Path:
    """Write a small model that builds, to be changed into one's own; return its file.

    Parameters
    ----------
    name : str
        Of the model, with or without ``.c``.
    folder : Path
        Where to write it.

    Raises
    ------
    BuildError
        The name is no C identifier or taken, the file is there already, or it cannot be written.
    """
    stem = name.removesuffix(".c")
    path = folder / f"{stem}.c"
    if stem in bundled_sources():
        raise BuildError(f"{stem} is a bundled model; give yours another name")
    check_name(path)
    text = (HERE / "template.c").read_text(encoding="utf-8").replace("NAME.c", path.name)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise BuildError(f"{path} is there already; give another name, or remove it") from error
    except OSError as error:
        raise BuildError(f"{path} cannot be written ({error.strerror}); give a folder of yours") from error
    return path
