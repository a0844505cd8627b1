"""Units that are written as products and quotients of others, N*m/A or V/krpm → SI. Knows no FMU and no variable."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache

from estimator.recordings.units import parse_unit, plain_text

Exponents = tuple[tuple[str, int], ...]
BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")  # in the order of FMI's base units

# SI units of one name in base units.
_SI: dict[str, Exponents] = {
    "s": (("s", 1),),
    "V": (("kg", 1), ("m", 2), ("s", -3), ("A", -1)),
    "A": (("A", 1),),
    "rad": (("rad", 1),),
    "rad/s": (("s", -1), ("rad", 1)),
    "N.m": (("kg", 1), ("m", 2), ("s", -2)),
    "Ohm": (("kg", 1), ("m", 2), ("s", -3), ("A", -2)),
    "H": (("kg", 1), ("m", 2), ("s", -2), ("A", -2)),
    "Wb": (("kg", 1), ("m", 2), ("s", -2), ("A", -1)),
    "W": (("kg", 1), ("m", 2), ("s", -3)),
    "m": (("m", 1),),
    "kg": (("kg", 1),),
    "N": (("kg", 1), ("m", 1), ("s", -2)),
}
HIGHEST = 9  # exponent of a unit
_BETWEEN = re.compile(r"(?<=[^\W_])\s+(?=[^\W_])")  # a blank that stands for a product
_TOKEN = re.compile(r"[()./]|[^\W\d]+|[+-]?\d+")


@cache
def parse_product(text: str) -> tuple[float, Exponents] | None:
    """Return factor to SI and exponents of base units of a text such as ``g.cm2``; None where it is none.

    It is read from left to right, so that N*m/rad*s is N.m.s/rad.
    """
    key = plain_text(_BETWEEN.sub(".", text.strip().replace(" per ", "/")))
    tokens = _TOKEN.findall(key)
    if not tokens or "".join(tokens) != key:
        return None
    try:
        factor, exponents = _Reader(tokens).product()
    except (ValueError, IndexError, OverflowError):
        return None
    return factor, tuple((name, exponents[name]) for name in BASE if exponents[name])


class _Reader:
    """Tokens, read one after the other; ValueError or IndexError where they make no product."""

    def __init__(self, tokens: list[str]) -> None:
        self.tokens = tokens

    def product(self, *, inside: bool = False) -> tuple[float, Counter[str]]:
        factor, exponents, sign = 1.0, Counter[str](), 1
        while True:
            own, of_it = self._power()
            factor *= own**sign
            for name, exponent in of_it.items():
                exponents[name] += sign * exponent
            if not self.tokens or self.tokens[0] == ")":
                if bool(self.tokens) != inside:
                    raise ValueError("brackets")
                return factor, exponents
            sign = {".": 1, "/": -1}[self.tokens.pop(0)] if self.tokens[0] in "./" else self._nothing()

    def _power(self) -> tuple[float, Counter[str]]:
        token = self.tokens.pop(0)
        if token == "(":
            factor, exponents = self.product(inside=True)
            self.tokens.pop(0)
        elif token == "1":
            return 1.0, Counter()
        else:
            factor, exponents = _named(token)
        if self.tokens and re.fullmatch(r"[+-]?\d+", self.tokens[0]):
            power = int(self.tokens.pop(0))
            if abs(power) > HIGHEST:
                raise ValueError(power)
            return factor**power, Counter({name: power * e for name, e in exponents.items()})
        return factor, exponents

    def _nothing(self) -> int:
        raise ValueError("two units without a sign between them")


def _named(name: str) -> tuple[float, Counter[str]]:
    unit = parse_unit(name)
    if unit is None or unit.si not in _SI or unit.offset:
        raise ValueError(name)
    return unit.numerator / unit.denominator, Counter(dict(_SI[unit.si]))
