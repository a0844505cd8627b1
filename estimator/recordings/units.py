"""Units as people write them → SI. Knows no columns, files or motors."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import overload

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Unit:
    """A unit and its way to SI: ``si = value * numerator / denominator + offset``.

    Two numbers instead of one factor, because 250 mA / 1000 is the double next to 0.25 A and 250 * 0.001
    need not be.
    """

    quantity: str  # "angular speed"
    si: str  # "rad/s"
    numerator: float = 1.0
    denominator: float = 1.0
    offset: float = 0.0

    @overload
    def to_si(self, value: float) -> float: ...
    @overload
    def to_si(self, value: FloatArray) -> FloatArray: ...
    def to_si(self, value: float | FloatArray) -> float | FloatArray:
        """Return the value, or the array of any shape, in SI."""
        return value * self.numerator / self.denominator + self.offset

    def from_si(self, value: FloatArray) -> FloatArray:
        """Return an array of any shape in this unit, from SI."""
        return (value - self.offset) * self.denominator / self.numerator


SI_UNIT = {
    "time": "s",
    "voltage": "V",
    "current": "A",
    "angular speed": "rad/s",
    "electrical speed": "erad/s",
    "angle": "rad",
    "torque": "N.m",
    "angular acceleration": "rad/s2",
    "temperature": "K",
    "ratio": "1",
    "count": "count",
    "count rate": "count/s",
    "resistance": "Ohm",
    "inductance": "H",
    "inertia": "kg.m2",
    "power": "W",
    "frequency": "Hz",
    "length": "m",
    "speed": "m/s",
    "mass": "kg",
    "force": "N",
    "magnetic flux": "Wb",
}

_PREFIXES = {"": (1.0, 1.0), "n": (1.0, 1e9), "u": (1.0, 1e6), "m": (1.0, 1e3), "c": (1.0, 1e2), "k": (1e3, 1.0)}

# Symbols keep their case: mA is no MA. Each takes the prefixes of its string ("-" is none).
_SYMBOLS = {
    "s": ("time", "-num"),
    "V": ("voltage", "-umk"),
    "A": ("current", "-umk"),
    "rad": ("angle", "-m"),
    "rad/s": ("angular speed", "-mk"),
    "rad/s2": ("angular acceleration", "-k"),
    "N.m": ("torque", "-umk"),
    "Nm": ("torque", "-umk"),
    "K": ("temperature", "-"),
    "Ohm": ("resistance", "-mk"),
    "H": ("inductance", "-um"),
    "kg.m2": ("inertia", "-"),
    "W": ("power", "-mk"),
    "Hz": ("frequency", "-k"),
    "m": ("length", "-umc"),
    "m/s": ("speed", "-m"),
    "kg": ("mass", "-"),
    "N": ("force", "-umk"),
    "Wb": ("magnetic flux", "-um"),
}

# Words in any case: (quantity, numerator, denominator, offset, spellings).
_COUNTS = "count counts cnt cnts tick ticks pulse pulses inc incs"
_PER_SECOND = f"{_COUNTS} step steps"  # a column called "steps" counts rows, one of "steps/s" does not
_WORDS: tuple[tuple[str, float, float, float, str], ...] = (
    ("time", 1, 1, 0, "s sec secs seg second seconds segundos sekunden с сек"),
    (
        "time",
        1,
        1e3,
        0,
        "msec msecs milisec millisec millisecs milisecond miliseconds millisecond milliseconds milisegundos мс",
    ),
    ("time", 1, 1e6, 0, "usec usecs microsec microsecs microsecond microseconds microsegundos"),
    ("time", 60, 1, 0, "min minute minutes"),
    ("voltage", 1, 1, 0, "v volt volts в"),
    ("voltage", 1, 1e3, 0, "millivolt millivolts"),
    ("current", 1, 1, 0, "a amp amps ampere amperes а"),
    ("current", 1, 1e3, 0, "milliamp milliamps milliampere milliamperes ма"),
    (
        "angular speed",
        1,
        1,
        0,
        "rad/s rad/sec rad/seg rads/s rad.s-1 rads-1 rads rads/sec radian/s radians/s radps рад/с",
    ),
    (
        "angular speed",
        math.pi,
        30,
        0,
        "rpm r/min rev/min revs/min 1/min min-1 /min u/min tr/min rot/min turns/min upm umdr/min"
        " umdrehungen/min giri/min obr/min ot/min omw/min o/min devir/dk об/мин 转/分 转/分钟",
    ),
    ("angular speed", 1e3 * math.pi, 30, 0, "krpm"),
    ("electrical speed", math.pi, 30, 0, "erpm"),
    ("electrical speed", 1, 1, 0, "erad/s"),
    ("angular speed", 2 * math.pi, 1, 0, "rps r/s rev/s revs/s rev/sec turns/s turn/s rot/s"),
    ("angular speed", math.pi, 180, 0, "deg/s deg/sec degs/s degree/s degrees/s dps deg.s-1 deg/seg"),
    ("speed", 1e3, 3600, 0, "km/h kmh kph"),
    ("angle", 1, 1, 0, "rad rads radian radians"),
    ("angle", math.pi, 180, 0, "deg degs degree degrees"),
    ("angle", 2 * math.pi, 1, 0, "rev revs revolution revolutions turn turns"),
    ("torque", 1, 1, 0, "n.m nm n-m"),
    ("torque", 1, 1e2, 0, "n.cm ncm n-cm"),
    ("temperature", 1, 1, 273.15, "degc celsius"),
    ("ratio", 1, 1, 0, "1 -"),
    ("ratio", 1, 100, 0, "% percent pct"),
    ("count", 1, 1, 0, _COUNTS),
    ("count rate", 1, 1, 0, " ".join(f"{c}/{s}" for c in _PER_SECOND.split() for s in ("s", "sec", "second"))),
    ("mass", 1, 1e3, 0, "g"),
    ("resistance", 1, 1, 0, "ohm ohms"),
)


def _tables() -> tuple[dict[str, Unit], dict[str, Unit]]:
    symbols = {}
    for symbol, (quantity, prefixes) in _SYMBOLS.items():
        for prefix in ("", *prefixes[1:]):
            numerator, denominator = _PREFIXES[prefix]
            symbols[prefix + symbol] = Unit(quantity, SI_UNIT[quantity], numerator, denominator)
    words: dict[str, Unit] = {}
    for quantity, numerator, denominator, offset, spellings in _WORDS:
        for spelling in spellings.split():
            words.setdefault(spelling, Unit(quantity, SI_UNIT[quantity], numerator, denominator, offset))
    return symbols, words


_BY_SYMBOL, _BY_WORD = _tables()
_REWRITTEN = (
    ("µ", "u"),  # U+00B5
    ("μ", "u"),  # U+03BC
    ("Ω", "Ohm"),
    ("°C", "degC"),
    ("°", "deg"),
    ("·", "."),
    ("⋅", "."),
    ("*", "."),
    ("²", "2"),
    ("⁻¹", "-1"),
    ("^", ""),
    (" per ", "/"),
    ("_per_", "/"),
    ("_", "/"),
)


def plain_text(text: str) -> str:
    """Return a unit as it is written here: without blanks, with ``.`` for a product, ``u`` for µ, ``Ohm`` for Ω."""
    key = text.strip()
    for old, new in _REWRITTEN:
        key = key.replace(old, new)
    return re.sub(r"\s+", "", key)


@cache
def parse_unit(text: str, *, symbols_only: bool = False) -> Unit | None:
    """Return the unit that a text means, or None if it means none.

    With ``symbols_only`` a single letter must have its right case, so that the ``a`` of ``U_a`` is no ampere.
    """
    key = plain_text(text)
    found = _BY_SYMBOL.get(key)
    if found is None and not (symbols_only and len(key) < 2):
        found = _BY_WORD.get(key.lower())
    return found


def unit_of(quantity: str) -> Unit:
    """Return the SI unit of a quantity of ``SI_UNIT``."""
    return Unit(quantity, SI_UNIT[quantity])


def examples(quantity: str) -> str:
    """Return a few units that would fit, for an error message: ``"A, mA"``."""
    return {
        "time": "s, ms, us",
        "voltage": "V, mV",
        "current": "A, mA",
        "angular speed": "rad/s, rpm, deg/s, rev/s",
        "angle": "rad, deg, rev",
        "torque": "N.m, mN.m",
    }.get(quantity, SI_UNIT[quantity])
