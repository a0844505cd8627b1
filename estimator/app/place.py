"""The folder that the app works in: what lies there, by relative names. Lets no name lead out of it."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.errors import InputError, is_text
from estimator.recordings.suffixes import JSON, SUFFIXES, is_recording

DRAFT = f"app{CASE_SUFFIX}"  # the case under way
RESULT = "result.json"
DEEPEST = 3  # folders below, in which files are listed
MOST_LISTED = 2000
LONGEST_NAME = 120


class Place:
    """The folder.

    Parameters
    ----------
    path : path
        It must be there.

    Raises
    ------
    InputError
        It is no folder.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path).resolve()
        if not self.path.is_dir():
            raise InputError(f"{path}: no such folder; give one that is there, or none for this one")

    def inside(self, name: str) -> Path:
        """Return the path of a file or folder by its relative name.

        Raises
        ------
        InputError
            The name leads out of the folder, by itself or by a link.
        """
        if not name or "\0" in name or "\\" in name or PurePosixPath(name).is_absolute():
            raise InputError(f"{name!r} is no name of a file in {self.path}")
        path = (self.path / name).resolve()
        if path == self.path or not path.is_relative_to(self.path):
            raise InputError(f"{name!r} leads out of {self.path}; put the file there, or start the app where it is")
        return self.path / os.path.normpath(name)

    def name_of(self, path: str | os.PathLike[str]) -> str:
        """Return the name of a path relative to the folder, with slashes; it may lead out."""
        return Path(os.path.relpath(path, self.path)).as_posix()

    def listed(self) -> dict[str, list[str]]:
        """Return the names of the recordings, FMUs, case files and result folders, each sorted."""
        found: dict[str, list[str]] = {"recordings": [], "fmus": [], "cases": [], "results": []}
        for folder, names, files in os.walk(self.path):
            here = PurePosixPath(self.name_of(folder))
            deep = len(here.parts)
            names[:] = (
                sorted(n for n in names if is_text(n) and not n.startswith((".", "__"))) if deep < DEEPEST else []
            )
            if RESULT in files:
                found["results"].append(here.as_posix())
            for file in sorted(f for f in files if not f.startswith(".") and is_text(f)):
                kind = _kind(file)
                if kind == "recordings" and file.lower().endswith(JSON) and not is_recording(Path(folder, file)):
                    continue
                if kind == "recordings" and RESULT in files and file == "parameters.csv":
                    continue  # an export's table
                if kind is not None:
                    found[kind].append((here / file).as_posix())
            if sum(map(len, found.values())) > MOST_LISTED:
                break
        found["cases"] = [name for name in found["cases"] if name != DRAFT]
        found["results"] = [name for name in found["results"] if name != "."]
        return {kind: sorted(names, key=_natural) for kind, names in found.items()}

    def receive(self, name: str, content: bytes) -> str:
        """Put a file that was dropped into the folder and return its name; one that is there already stays.

        Raises
        ------
        InputError
            The name is none for a file.
        """
        plain = os.path.basename(name.replace("\\", "/")).strip()
        if not plain or plain.startswith(".") or "\0" in plain or len(plain.encode()) > LONGEST_NAME:
            raise InputError(f"{name!r} is no name for a recording; rename the file")
        if _kind(plain) is None:
            known = ", ".join((*SUFFIXES, JSON, ".fmu", CASE_SUFFIX))
            raise InputError(f"{plain} is no recording, FMU or case file by its name; it should end in one of {known}")
        stem, suffix = plain, ""
        for known in (CASE_SUFFIX, Path(plain).suffix):
            if plain.endswith(known):
                stem, suffix = plain.removesuffix(known), known
                break
        for k in range(1, 1000):
            path = self.path / (plain if k == 1 else f"{stem}-{k}{suffix}")
            try:
                with open(path, "xb") as stream:
                    stream.write(content)
                return path.name
            except FileExistsError:
                if path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content:
                    return path.name
            except OSError as error:
                raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
        raise InputError(f"{plain}: there are too many files of that name in {self.path}")

    def free_name(self, stem: str) -> str:
        """Return ``run-3``: the first name with a number of which there is neither a folder nor a case file."""
        k = 1
        while (self.path / f"{stem}-{k}").exists() or (self.path / f"{stem}-{k}{CASE_SUFFIX}").exists():
            k += 1
        return f"{stem}-{k}"


def _kind(file: str) -> str | None:
    lower = file.lower()
    if lower.endswith(CASE_SUFFIX):
        return "cases"
    if lower.endswith(".fmu"):
        return "fmus"
    return "recordings" if lower.endswith((*SUFFIXES, JSON)) else None


def _natural(name: str) -> tuple[tuple[int, str], ...]:
    """Sort run-2 before run-10."""
    parts: list[str] = []
    for c in name.casefold():
        if parts and parts[-1][-1:].isdigit() == c.isdigit():
            parts[-1] += c
        else:
            parts.append(c)
    return tuple((int(p), "") if p.isdecimal() else (-1, p) for p in parts)
