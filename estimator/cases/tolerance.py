"""What no recording can tell, as a case states it: sensor gains, supply, brushes, temperature. Knows no fit.

A tolerance becomes a standard uncertainty as in GUM (JCGM 100:2008): "1 %" bounds an error of which no more is known, a
rectangular distribution, u = a / sqrt 3 (4.3.7); "1 % (k=2)" is an expanded uncertainty of a certificate, u = U / k
(4.3.3); k=1 states the standard uncertainty itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from estimator.errors import CaseError, suggestion

if TYPE_CHECKING:
    from estimator.cases.strict_toml import Table

GAIN = " gain"  # "i gain", "v gain": of any output or input
CLOCK = "clock"  # a crystal's is too small to be offered
SOURCES: Mapping[str, tuple[str, ...]] = {  # what it is given in, the usual first
    "supply resistance": ("resistance",),
    "brush drop": ("voltage",),
    "dry friction": ("ratio", "torque"),  # of the viscous friction at the highest speed, or N.m
    "temperature": ("temperature",),
    CLOCK: ("ratio",),
}
LARGEST_SHARE = 0.2  # of a gain, as a bare number: percent are meant
EXAMPLES = {"resistance": "0.05 Ohm", "voltage": "0.5 V", "ratio": "1 %", "temperature": "5 K"}
OFFERED = {  # the default set: usual shunts, encoders and supplies, carbon brushes, a winding in a room
    "i gain": "1 %",
    "v gain": "0.5 %",
    "w gain": "0.1 %",
    "supply resistance": "0.05 Ohm",
    "brush drop": "0.5 V",
    "dry friction": "10 %",
    "temperature": "5 K",
}
DEFAULT = "default"
_SIZE = {
    "anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "string", "pattern": r"\S"}],
    "description": '"1 %": within, or "1 % (k=2)": an expanded uncertainty; a number is a share, or in SI',
}
TOLERANCE: Mapping[str, Any] = {  # what a JSON Schema says of the key
    "anyOf": [
        {
            "type": "object",
            "properties": {
                DEFAULT: {"const": True, "description": "the set that is offered, besides"},
                **dict.fromkeys((*OFFERED, CLOCK), _SIZE),
            },
            "patternProperties": {f".{GAIN}$": _SIZE},
            "additionalProperties": False,
        },
        {"const": DEFAULT, "description": "the set that is offered"},
    ],
    "description": "what no recording tells, part of each uncertainty",
}
_TEXT = re.compile(
    r"\s*(?:±|\+-|\+/-)?\s*(\d+\.?\d*(?:[eE][-+]?\d+)?)\s*([^\s(0-9][^(]*?)?\s*(?:\(\s*k\s*=\s*(\d+\.?\d*)\s*\))?\s*",
    re.ASCII,
)


@dataclass(frozen=True)
class Tolerance:
    """What is known of one quantity that no recording tells.

    Attributes
    ----------
    source : "i gain", "supply resistance", …
    text : as it was given
    size : half of the interval, or the expanded uncertainty; a share, or in `unit`
    unit : SI; "" for a share
    coverage : k of an expanded uncertainty; None: the interval is all that is known
    offered : of the default set: left out where the case has nothing for it
    """

    source: str
    text: str
    size: float
    unit: str = ""
    coverage: float | None = None
    offered: bool = False

    @property
    def standard_uncertainty(self) -> float:
        """The standard uncertainty, a share or in `unit`."""
        return self.size / (math.sqrt(3) if self.coverage is None else self.coverage)

    @property
    def distribution(self) -> str:
        """How the error is thought to be distributed."""
        return "rectangular" if self.coverage is None else "normal"

    @property
    def signal(self) -> str:
        """Whose gain it is; "" for another source."""
        return self.source.removesuffix(GAIN) if self.source.endswith(GAIN) else ""


def tolerances(given: Mapping[str, str | float] | Iterable[tuple[str, str | float]] | str) -> tuple[Tolerance, ...]:
    """Return tolerances in the order in which they are given; "default" is the set that is offered.

    Raises
    ------
    CaseError
        A source is not known, is given twice, or its size cannot be read.
    """
    if isinstance(given, str):
        given = [(given, "")]
    pairs = list(given.items() if isinstance(given, Mapping) else given)
    found: dict[str, Tolerance] = {}
    if (DEFAULT, "") in pairs:
        pairs.remove((DEFAULT, ""))
        found = {source: _tolerance(source, text, offered=True) for source, text in OFFERED.items()}
    for source, text in pairs:
        if source in found and not found[source].offered:
            raise CaseError(f"the tolerance {source!r} is given twice; leave one out")
        found[source] = _tolerance(source, text)
    return tuple(found.values())


def read_tolerances(top: Table) -> tuple[Tolerance, ...]:
    """Read the key ``tolerance`` of a case file: a table of sources, or "default"; a table may hold default = true."""
    given = top.value.get("tolerance")
    if given is None:
        return ()
    if isinstance(given, str):
        if given != DEFAULT:
            top.fail(("tolerance",), f'tolerance cannot be {given!r}; write "default" or a table [tolerance]')
        return tolerances(DEFAULT)
    table = top.table("tolerance")
    found: dict[str, Tolerance] = {}
    if DEFAULT in table.value:
        if table.value[DEFAULT] is not True:
            table.fail((DEFAULT,), f"{table.full(DEFAULT)} must be true, or left out")
        found = {t.source: t for t in tolerances(DEFAULT)}
    for source in table.keys:
        if source == DEFAULT:
            continue
        value = table.value[source]
        number = value if isinstance(value, str) else table.required_number(source)
        try:
            found[source] = _tolerance(source, number)
        except CaseError as error:
            table.fail((source,), str(error))
    return tuple(found.values())


def tolerance_value(given: tuple[Tolerance, ...]) -> str | dict[str, Any] | None:
    """Return tolerances as the key of a case file that reads back the same; None for none."""
    if given and given == tolerances(DEFAULT):
        return DEFAULT
    default = {DEFAULT: True} if any(t.offered for t in given) else {}
    return {**default, **{t.source: t.text for t in given if not t.offered}} or None


def _tolerance(source: str, given: str | float, *, offered: bool = False) -> Tolerance:
    is_gain = source.endswith(GAIN) and len(source) > len(GAIN)
    quantities = ("ratio",) if is_gain else SOURCES.get(source)
    if quantities is None:
        known = (*SOURCES, "i gain", "v gain", "w gain")
        raise CaseError(f"there is no tolerance {source!r}{suggestion(source, known)}")
    text = given if isinstance(given, str) else repr(float(given))
    match = _TEXT.fullmatch(text)
    example = EXAMPLES[quantities[0]]
    remedy = f"{example!r}, or {example + ' (k=2)'!r} for an expanded uncertainty"
    if match is None:
        raise CaseError(f"the tolerance {source!r} cannot be {text!r}; write {remedy}")
    size, unit = float(match[1]), ""
    if match[2]:
        from estimator.recordings.units import parse_unit  # imports numpy

        parsed = parse_unit(match[2])
        if parsed is None or parsed.quantity not in quantities:
            raise CaseError(f"the tolerance {source!r} cannot be in {match[2]!r}; write {remedy}")
        size = size * parsed.numerator / parsed.denominator
        quantity = parsed.quantity
    else:
        quantity = quantities[0]
    coverage = float(match[3]) if match[3] else None
    if not 0 < size < math.inf or coverage == 0:
        raise CaseError(f"the tolerance {source!r} is {text!r}, which must be above 0; write {remedy}")
    if is_gain and not match[2] and size >= LARGEST_SHARE:
        said = f"the tolerance {source!r} is {text}, a share: {100 * size:g} %"
        raise CaseError(f"{said}; write '{text} %', or '{100 * size:g} %' if so much is meant")
    if quantity != "ratio":
        from estimator.recordings.units import SI_UNIT

        unit = SI_UNIT[quantity]
    return Tolerance(source, text, size, unit, coverage, offered)
