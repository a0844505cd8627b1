"""A model as its compiled library tells it: the variable table and the equations, read back. Knows no FMI."""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from .errors import BuildError

Kind = Literal["input", "parameter", "state", "output", "mode"]
# Values by name, to the states' derivatives, the calculated outputs' values and the modes' margins by name; NaN where
# they are not set. With .linear after it, a margin's name is that of what it is told to be made of, with .told that of
# the margin that this makes.
Equations = Callable[[Mapping[str, float]], dict[str, float]]


@dataclass(frozen=True)
class Variable:
    """One line of a model's table; its place in the table is its value reference."""

    kind: Kind
    name: str
    start: float
    nominal: float
    min: float
    max: float
    unit: str
    description: str


@dataclass(frozen=True)
class LogCategory:
    """What an FMU may log."""

    name: str
    description: str


@dataclass(frozen=True)
class Model:
    """A model's table.

    Attributes
    ----------
    name : str
        The model file's name without suffix; the FMU's model identifier.
    linear : bool
        The derivatives are declared to be linear in the states.
    variables : tuple of Variable
        In the order of the table.
    log_categories : tuple of LogCategory
        What the code around the model may log.
    """

    name: str
    linear: bool
    variables: tuple[Variable, ...]
    log_categories: tuple[LogCategory, ...]

    def of_kind(self, *kinds: Kind) -> list[Variable]:
        """Return the variables of these kinds, in the order of the table."""
        return [variable for variable in self.variables if variable.kind in kinds]


class _TableRow(ctypes.Structure):  # model.h
    _fields_ = [
        ("kind", ctypes.c_int),
        ("name", ctypes.c_char_p),
        ("start", ctypes.c_double),
        ("nominal", ctypes.c_double),
        ("min", ctypes.c_double),
        ("max", ctypes.c_double),
        ("unit", ctypes.c_char_p),
        ("description", ctypes.c_char_p),
    ]


class _LogCategory(ctypes.Structure):  # instance.c
    _fields_ = [("name", ctypes.c_char_p), ("description", ctypes.c_char_p)]


class _Switch(ctypes.Structure):  # model.h
    _fields_ = [(name, ctypes.c_double) for name in ("margin", "next", "lasts", "linear", "most")]


_Values = ctypes.POINTER(ctypes.c_double)
_Derivatives = ctypes.CFUNCTYPE(None, _Values, ctypes.POINTER(ctypes.c_double))
_Switches = ctypes.CFUNCTYPE(None, _Values, ctypes.POINTER(_Switch))


class _ModelInfo(ctypes.Structure):  # instance.c
    _fields_ = [
        ("variables", ctypes.c_int),
        ("linear", ctypes.c_int),
        ("log_categories", ctypes.c_int),
        ("table", ctypes.POINTER(_TableRow)),
        ("log_category", ctypes.POINTER(_LogCategory)),
        ("derivatives", _Derivatives),
        ("switches", _Switches),
    ]


@contextmanager
def loaded_model(library: Path, *, source: Path) -> Iterator[tuple[Model, Equations]]:
    """Load a model's compiled library, made for this machine, for as long as the context lasts.

    Parameters
    ----------
    library : Path
        The shared library.
    source : Path
        The model file: its name, and what errors name.

    Raises
    ------
    BuildError
        The library cannot be loaded, or its texts are not UTF-8.
    """
    with _loaded(library) as handle:
        handle.fmu_build_model.restype = ctypes.POINTER(_ModelInfo)
        info = handle.fmu_build_model().contents
        categories = [info.log_category[k] for k in range(info.log_categories)]
        model = Model(
            name=source.stem,
            linear=bool(info.linear),
            variables=tuple(_variable(info.table[k], source) for k in range(info.variables)),
            log_categories=tuple(LogCategory(c.name.decode(), c.description.decode()) for c in categories),
        )
        rates = [v.name for v in model.of_kind("state")] + [v.name for v in model.of_kind("output")]
        modes = [v.name for v in model.of_kind("mode")]

        def equations(point: Mapping[str, float]) -> dict[str, float]:
            values = (ctypes.c_double * (len(model.variables) + 1))(*(point[v.name] for v in model.variables))
            results = (ctypes.c_double * len(rates))(*[math.nan] * len(rates))
            info.derivatives(values, results)
            switches = (_Switch * (len(modes) + 1))(*[_Switch(margin=math.nan)] * (len(modes) + 1))
            info.switches(values, switches)
            found = dict(zip(rates, results, strict=True))
            for name, switch in zip(modes, switches, strict=False):
                found[name] = switch.margin
                if switch.lasts == 0 and switch.most != 0:
                    folded = switch.most < math.inf
                    found[f"{name}.linear"] = switch.linear
                    found[f"{name}.told"] = switch.most - abs(switch.linear) if folded else switch.linear
            return found

        yield model, equations


@contextmanager
def _loaded(library: Path) -> Iterator[ctypes.CDLL]:
    """Load a library, and close it again: where files in use cannot be deleted, it is to be deleted."""
    import _ctypes

    try:
        loaded = ctypes.CDLL(str(library))
    except OSError as error:
        raise BuildError(f"the compiled library cannot be loaded: {error}") from error
    try:
        yield loaded
    finally:
        close: Any = getattr(_ctypes, "FreeLibrary" if sys.platform == "win32" else "dlclose")
        close(loaded._handle)


def _variable(row: _TableRow, source: Path) -> Variable:
    try:
        unit, description = row.unit.decode(), row.description.decode()
    except UnicodeDecodeError as error:
        raise BuildError(f"{source}: the line of {row.name.decode()} is not UTF-8; save the file so") from error
    return Variable(
        get_args(Kind)[row.kind], row.name.decode(), row.start, row.nominal, row.min, row.max, unit, description
    )
