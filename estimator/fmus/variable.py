"""One variable of an FMU's model description: its unit, limits and start, as fmpy has read them. Reads no file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

REAL_TYPES = ("Real", "Float64", "Float32")


@dataclass(frozen=True)
class Base:
    """A unit in base units, as the FMU defines it: SI = factor × value + offset."""

    factor: float
    offset: float
    exponents: tuple[tuple[str, int], ...]  # "kg", "m", "s", "A", "K", "mol", "cd", "rad"


@dataclass(frozen=True)
class Variable:
    """One variable of the model description; numbers in the FMU's own unit, None where not given."""

    name: str
    value_reference: int
    type: str  # "Real", "Integer", "Boolean", "String", "Enumeration", …
    causality: str  # "parameter", "input", "output", "local", …
    variability: str
    unit: str
    description: str
    start: float | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    initial: str = ""
    items: tuple[tuple[str, int], ...] = ()  # of an enumeration
    base: Base | None = None
    factor: float = 1.0  # SI = factor × the FMU's own number + offset, where cases/si_units.py has made it SI
    offset: float = 0.0
    own_unit: str = ""  # the FMU's own, where cases/si_units.py has made `unit` SI by a factor

    @property
    def is_real(self) -> bool:
        """Whether its value is a real number."""
        return self.type in REAL_TYPES

    @property
    def is_as_it_is(self) -> bool:
        """Whether the FMU's own number is the value, with no unit between."""
        return self.factor == 1 and self.offset == 0

    def reach_without(self, value: float) -> str:
        """Return the range of the variable, "0.001 to any", if a value is outside it; else ""."""
        low, high = self.minimum, self.maximum
        if (low is None or value >= low) and (high is None or value <= high):
            return ""
        return reach(low, high)

    @property
    def is_settable(self) -> bool:
        """Whether it takes a value before initialisation: a parameter, an input, or what has a start value."""
        if self.causality in ("parameter", "structuralParameter", "input"):
            return True
        variable = self.causality in ("local", "output") and self.variability != "constant"
        return variable and self.initial in ("", "exact", "approx") and self.start is not None


def reach(low: float | None, high: float | None) -> str:
    """Return a range in words, "0.001 to any"."""
    return f"{'any' if low is None else f'{low:g}'} to {'any' if high is None else f'{high:g}'}"


def base_of(unit: Any) -> Base | None:
    """Return a unit of fmpy's in base units; None where the FMU does not say."""
    base = unit.baseUnit
    if base is None:
        return None
    exponents = {name: int(getattr(base, name, 0) or 0) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    factor, offset = (number_of(getattr(base, name, None)) for name in ("factor", "offset"))
    if not factor or not math.isfinite(factor):
        factor = 1.0
    return Base(factor, offset or 0.0, tuple((name, e) for name, e in exponents.items() if e))


def variable_of(variable: Any, *, bases: Mapping[str, Base | None]) -> Variable:
    """Return a variable of fmpy's.

    Parameters
    ----------
    bases : unit → what it is in base units
    """
    declared = variable.declaredType
    unit = variable.unit or (declared.unit if declared is not None else None) or ""

    low, high = limit_of(variable, "min"), limit_of(variable, "max")
    if low is not None and high is not None and low > high:
        low = high = None
    return Variable(
        name=variable.name,
        value_reference=int(variable.valueReference),
        type=(variable.type or "Real") + ("[]" if getattr(variable, "dimensions", None) else ""),
        causality=variable.causality or "local",
        variability=variable.variability or "continuous",
        unit=unit,
        description=variable.description or "",
        start=start_of(variable),
        minimum=low,
        maximum=high,
        nominal=limit_of(variable, "nominal"),
        initial=variable.initial or "",
        items=tuple((i.name, int(i.value)) for i in getattr(declared, "items", None) or () if i.value is not None),
        base=bases.get(unit),
    )


def limit_of(variable: Any, name: str) -> float | None:
    """Return "min", "max" or "nominal" of a variable of fmpy's, or of its declared type."""
    value, declared = getattr(variable, name), variable.declaredType
    return number_of(value if value is not None or declared is None else getattr(declared, name, None))


def start_of(variable: Any) -> float | str | None:
    """Return the start value of a variable of fmpy's: a number, where it is one."""
    if variable.start is None or variable.type == "String":
        return None if variable.start is None else str(variable.start)
    if variable.start in ("true", "false"):
        return float(variable.start == "true")
    number = number_of(variable.start)
    return str(variable.start) if number is None else number


def number_of(text: Any) -> float | None:
    """Return a finite number that a text says; None where it says none."""
    try:
        number = None if text is None else float(text)
    except (TypeError, ValueError):
        return None
    return number if number is not None and math.isfinite(number) else None
