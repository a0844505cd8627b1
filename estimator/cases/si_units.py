"""An FMU's variables in SI units: unit, factor, offset. Knows a description; simulates nothing."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

from estimator.cases.unit_products import parse_product
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.variable import Base, Variable
from estimator.recordings.units import parse_unit

# Base units that have a name of their own.
NAMED = {
    (("kg", 1), ("m", 2), ("s", -3), ("A", -2)): "Ohm",
    (("kg", 1), ("m", 2), ("s", -2), ("A", -2)): "H",
    (("kg", 1), ("m", 2), ("s", -3), ("A", -1)): "V",
    (("kg", 1), ("m", 2), ("s", -2), ("A", -1)): "V.s/rad",
    (("kg", 1), ("m", 2), ("s", -2), ("A", -1), ("rad", -1)): "V.s/rad",
    (("kg", 1), ("m", 2), ("s", -2)): "N.m",
    (("kg", 1), ("m", 2), ("s", -1)): "N.m.s/rad",
    (("kg", 1), ("m", 2), ("s", -1), ("rad", -1)): "N.m.s/rad",
    (("kg", 1), ("m", 2)): "kg.m2",
    (("s", -1), ("rad", 1)): "rad/s",
    (("A", 1),): "A",
    (("s", 1),): "s",
    (("rad", 1),): "rad",
}


def in_si_units(description: FmuDescription) -> FmuDescription:
    """Return the description with its variables in SI units."""
    return dataclasses.replace(description, variables=tuple(in_si(v) for v in description.variables))


@lru_cache(maxsize=4096)
def in_si(variable: Variable) -> Variable:
    """Return a variable with its unit, start and limits in SI; `factor` and `offset` lead there."""
    unit, factor, offset = si_unit(variable)
    if (factor, offset) == (1.0, 0.0):
        return dataclasses.replace(variable, unit=unit)

    def convert(value: float | None) -> float | None:
        return None if value is None else value * factor + offset

    limits = sorted(x for x in (convert(variable.minimum), convert(variable.maximum)) if x is not None)
    both = variable.minimum is not None and variable.maximum is not None
    return dataclasses.replace(
        variable,
        unit=unit,
        own_unit=variable.unit,
        factor=factor,
        offset=offset,
        start=convert(variable.start) if isinstance(variable.start, float) else variable.start,
        minimum=limits[0] if both else convert(variable.minimum),
        maximum=limits[1] if both else convert(variable.maximum),
        nominal=convert(variable.nominal),
    )


def si_unit(variable: Variable) -> tuple[str, float, float]:
    """Return a variable's SI unit, and factor and offset from its own; an unknown unit is taken as it is.

    A unit that the FMU does not define in base units is read as it is written.
    """
    if not variable.unit:
        return "", 1.0, 0.0
    known = parse_unit(variable.unit)
    if known is not None and known.quantity != "ratio":
        factor = known.numerator / known.denominator
        return (variable.unit if (factor, known.offset) == (1.0, 0.0) else known.si), factor, known.offset
    base = variable.base or _as_written(variable.unit)
    if base is None or (base.factor, base.offset) == (1.0, 0.0):
        return variable.unit, 1.0, 0.0
    text = ".".join(f"{name}{'' if e == 1 else e}" for name, e in base.exponents)
    return NAMED.get(base.exponents, text or "1"), base.factor, base.offset


def is_known(variable: Variable) -> bool:
    """Return whether it is known what a variable's unit, as the FMU says it, is in SI units."""
    unit = variable.own_unit or variable.unit
    return parse_unit(unit) is not None or variable.base is not None or _as_written(unit) is not None


def named(unit: str) -> str:
    """Return the name of an SI unit here, of any way to write it: N*m/(rad/s) is N.m.s/rad; others as they are."""
    found = _as_written(unit)
    return unit if found is None or found.factor != 1 else NAMED.get(found.exponents, unit)


def _as_written(unit: str) -> Base | None:
    found = parse_product(unit)
    return None if found is None else Base(found[0], 0.0, found[1])
