"""Units to base-unit exponents and display units, as FMI wants them. Knows coherent SI units only."""

from __future__ import annotations

import math
import re

from .errors import BuildError

# FMI's base units, in its order.
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

_SYMBOLS: dict[str, dict[str, int]] = {
    **{unit: {unit: 1} for unit in BASE_UNITS},
    "1": {},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "S": {"kg": -1, "m": -2, "s": 3, "A": 2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "C": {"A": 1, "s": 1},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "T": {"kg": 1, "s": -2, "A": -1},
    "Hz": {"s": -1},
}

# What people read instead: name, factor (display value = factor * value).
DISPLAY_UNITS: dict[str, tuple[str, float]] = {
    "rad": ("deg", 180 / math.pi),
    "rad/s": ("rpm", 30 / math.pi),
}


def derivative_unit(unit: str) -> str:
    """Return the unit of a derivative by time: ``"A"`` is ``"A/s"``, ``"rad/s"`` is ``"rad/s2"``."""
    numerator, slash, denominator = unit.partition("/")
    if not slash:
        return f"{unit}/s"
    factors = denominator.strip("()").split(".")
    for k, factor in enumerate(factors):
        if re.fullmatch(r"s\d*", factor):
            factors[k] = f"s{int(factor[1:] or 1) + 1}"
            break
    else:
        factors.append("s")
    return f"{numerator}/{factors[0]}" if len(factors) == 1 else f"{numerator}/({'.'.join(factors)})"


def base_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the base units: ``"V.s/rad"`` is kg m2 s-2 A-1 rad-1.

    A unit is a product of symbols with integer exponents, with at most one ``/``: all after it divides.

    Raises
    ------
    BuildError
        The unit is not made of SI symbols.
    """
    numerator, *denominators = unit.split("/")
    exponents: dict[str, int] = {}
    try:
        if len(denominators) > 1:
            raise ValueError(unit)
        for sign, product in [(1, numerator), *((-1, text.strip("()")) for text in denominators)]:
            for factor in product.split("."):
                match = re.fullmatch(r"([A-Za-z]+|1)(-?\d+)?", factor)
                if match is None or match[1] not in _SYMBOLS:
                    raise ValueError(factor)
                for base, exponent in _SYMBOLS[match[1]].items():
                    exponents[base] = exponents.get(base, 0) + sign * exponent * int(match[2] or 1)
    except ValueError as error:
        known = ", ".join(_SYMBOLS)
        raise BuildError(f"{unit!r} is not a coherent SI unit such as 'N.m.s/rad' (known: {known})") from error
    return {base: exponents[base] for base in BASE_UNITS if exponents.get(base)}
