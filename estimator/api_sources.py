"""What a Python program estimates from: files, tables, arrays, recordings, a case. Estimates nothing."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator.cases.case import Case, read_case
from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.commands.sources import expanded
from estimator.errors import InputError
from estimator.recordings.files import recordings_in
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Table = Any  # a mapping of header → (n,) samples, or a DataFrame of pandas or polars
Source = str | os.PathLike[str] | Case | Recording | Table
SIGNALS = ("v", "i", "w", "angle", "load")
ARRAYS = ("voltage [V]", "current [A]", "speed [rad/s]", "angle [rad]", "load torque [N.m]")  # headers of SIGNALS


def case_of(source: Source | Sequence[Source], said: ReadAs) -> tuple[Case, list[Recording] | None]:
    """Return the case that is meant, and its recordings where they are in memory."""
    if isinstance(source, Case):
        return source, None
    sources = list(source) if isinstance(source, (list, tuple)) else [source]
    if not sources:
        raise InputError("the list of recordings is empty; give one at least")
    things: list[Path | Recording] = []
    for thing in sources:
        things += _recordings(thing, said, name="table" if len(sources) == 1 else f"table {len(things) + 1}")
    if said != AS_WRITTEN and all(isinstance(thing, Recording) for thing in sources):
        raise InputError(
            "columns, units and the like say how files and tables are read, and a Recording is read already; say them"
            " where it is made (arrays are in SI units)"
        )
    paths = [thing for thing in things if isinstance(thing, Path)]
    cases = [path for path in paths if path.name.endswith(CASE_SUFFIX)]
    if cases and len(things) > 1:
        raise InputError(f"{cases[0]} is a case file; give it alone: it names its own recordings")
    if cases:
        return read_case(cases[0]), None
    if len(paths) == len(things):
        expanded([os.fspath(path) for path in paths])  # each once
        return Case(recordings=tuple(Path(os.path.abspath(path)) for path in paths)), None
    found = [r for thing in things for r in (recordings_in(thing, said) if isinstance(thing, Path) else [thing])]
    named = tuple(recording.path for recording in found if recording.path is not None)
    return Case(recordings=named if len(named) == len(found) else ()), found


def _recordings(thing: Any, said: ReadAs, *, name: str) -> list[Path | Recording]:
    """Return the recordings that one source means: files, or one in memory."""
    from estimator.recordings.in_memory import is_table, recording_from_table

    if isinstance(thing, Recording):
        return [thing]
    if is_table(thing):
        return [recording_from_table(name, thing, said)]
    if isinstance(thing, Case):
        raise InputError("a Case stands for its own recordings; give it alone, or give recordings")
    if not isinstance(thing, (str, os.PathLike)):
        raise InputError(
            f"{type(thing).__name__} is no recording; give a file, a DataFrame, a mapping such as"
            ' {"time [s]": t, "voltage [V]": u, "current [A]": i}, or the arrays by name: time=, v=, i=, w='
        )
    path = Path(thing)
    if path.suffix in (".toml", ".fmu") and not path.name.endswith(CASE_SUFFIX):
        raise InputError(f"{path} is no recording; a case file's name ends in {CASE_SUFFIX}, an FMU is given as fmu=")
    return [Path(file) for file in expanded([os.fspath(thing)])]


def recording_of_arrays(
    time: ArrayLike | None, arrays: Mapping[str, ArrayLike], *, fixed: Collection[str] = ()
) -> Recording:
    """Return arrays in SI units as a recording; `arrays` are by the names of SIGNALS, `fixed` is what has one value.

    Raises
    ------
    InputError
        The time is missing, the voltage, or all that is measured; or one of them is no (n,) array.
    """
    asked = "time=, v= and i= or w=, each (n,) in SI units"
    if time is None or not arrays:
        raise InputError(f"{'the signals are' if not arrays else 'time is'} missing; give {asked}")
    if not {"i", "w", "angle"} & arrays.keys():
        raise InputError(f"nothing is measured: i, w and angle are missing; give {asked}")
    if not {"v"} & {*arrays, *fixed}:
        raise InputError(f"v is missing; give {asked}, or fix={{'v': 10.5}} where the voltage was constant")
    headers = dict(zip(SIGNALS, ARRAYS, strict=True))
    return recording_from_arrays("arrays", time, {headers[name]: array for name, array in arrays.items()})
