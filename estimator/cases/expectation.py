"""What a case file expects of its estimate, and whether the estimate meets it. Knows no FMU and runs nothing.

With a confidence an estimate passes only if its whole interval lies within the limits, fails if the whole interval
lies outside, and is undecided between: the guard band of ISO 14253-1, so that a measurement that cannot tell does
not pass a part. Without a confidence the value alone decides.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Literal

from estimator.cases import keys
from estimator.cases.keys import Key, Keys
from estimator.cases.strict_toml import Cell, Table
from estimator.conventions import CONFIDENCE
from estimator.errors import suggestion
from estimator.locked import Locked

if TYPE_CHECKING:
    from estimator.results.result import Estimate

Outcome = Literal["pass", "fail", "undecided"]
VERDICTS = ("ok", "doubtful", "refused")


@dataclass(frozen=True)
class Expectation:
    """What is expected of one quantity: a value with a tolerance, or limits."""

    name: str
    value: float | None = None  # None: the parameter's nominal value, or limits alone
    fraction: float | None = None  # within = "1 %" → 0.01
    absolute: float | None = None  # within = 0.05, in the quantity's unit
    minimum: float | None = None
    maximum: float | None = None

    @property
    def within(self) -> str | float | None:
        """The tolerance as it is written: a number, or a percentage that reads back as exactly this fraction."""
        return self.absolute if self.fraction is None else f"{Decimal(repr(self.fraction)).scaleb(2):f} %"

    def tolerance(self, value: float) -> float | None:
        """Return how far an estimate may be from an expected value, in its unit; None: not said."""
        return self.absolute if self.fraction is None else self.fraction * abs(value)

    def limits(self, nominal: float | None = None) -> tuple[float, float] | None:
        """Return the limits that an estimate must keep, infinite where there is none; None: a value alone."""
        value = nominal if self.value is None else self.value
        tolerance = None if value is None else self.tolerance(value)
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        if value is not None and tolerance is not None:
            return max(low, value - tolerance), min(high, value + tolerance)
        return None if self.minimum is None and self.maximum is None else (low, high)


@dataclass(frozen=True)
class Limits(Locked):
    """What is expected of the estimate as a whole.

    Attributes
    ----------
    verdicts : any of these; empty: anything but refused
    confidence : two-sided, of the interval around each estimate; None: the values alone decide
    rmse : output → greatest root mean square error, SI
    standard_error : parameter → greatest standard error, as a tolerance of its value
    """

    verdicts: tuple[str, ...] = ()
    confidence: float | None = None
    rmse: Mapping[str, float] = field(default_factory=dict)
    standard_error: Mapping[str, Expectation] = field(default_factory=dict)


@dataclass(frozen=True)
class Check:
    """One expectation, held against an estimate."""

    name: str  # "R", "rmse of i", "verdict"
    outcome: Outcome
    sentence: str  # what was measured, what is expected


def read_limits(expect: Table) -> Limits:
    """Read what [expect] says of the estimate as a whole."""
    limits = Limits(**LIMITS.read(expect))
    others = [key for key in expect.keys if key not in ("verdict", "confidence")]
    if limits.verdicts == ("refused",) and others:
        expect.fail((others[0],), f"an estimate that must be refused has no {others[0]}; leave one out")
    return limits


def read_expectation(entry: Table, *, nominal: float | None, remedy: str = "") -> Expectation:
    """Read one expected quantity: { value = …, within = … } or { min = …, max = … }."""
    said = ENTRY.read(entry)
    value, low, high = (said.get(name) for name in ("value", "minimum", "maximum"))
    if value is None and nominal is None and low is None and high is None:
        entry.fail((), f"{entry.title} has no value; add value = …{remedy}")
    if value is None and nominal is None and "within" in entry.value:
        entry.fail(("within",), f"{entry.title} has within but no value; add value = …{remedy}")
    if low is not None and high is not None and low >= high:
        entry.fail(("min",), f"{entry.title} has min {low:g} and max {high:g}; min must be the smaller one")
    fraction, absolute = said.get("within", (None, None))
    return Expectation(str(entry.way[-1]), value, fraction, absolute, low, high)


def _read_tolerance(table: Table, key: str) -> tuple[float | None, float | None]:
    """Return a tolerance as (fraction, None) or (None, absolute)."""
    given = table.value[key]
    if isinstance(given, str) and not (isinstance(given, Cell) and "%" not in given):
        number = given.number if isinstance(given, Cell) else given
        percent = re.fullmatch(r"\s*(\d+(?:\.\d*)?)(?:[eE]([-+]?\d{1,4}))?\s*%\s*", number, re.ASCII)
        fraction = float(f"{percent[1]}e{int(percent[2] or 0) - 2}") if percent else 0.0
        if not 0 < fraction < math.inf:
            table.fail((key,), f'{table.title}: {key} is {str(given)!r}; write {key} = "1 %" or a number')
        return fraction, None
    return None, table.number(key, above=0)


def check_names(expect: Iterable[str], limits: Limits) -> tuple[str, ...]:
    """Return the names of the checks that `checks` will make, in its order."""
    return (
        "verdict",
        *expect,
        *(f"standard error of {name}" for name in limits.standard_error),
        *(f"rmse of {name}" for name in limits.rmse),
    )


def checks(expect: Mapping[str, Expectation], limits: Limits, estimate: Estimate) -> tuple[Check, ...]:
    """Hold an estimate against what is expected of it."""
    return (
        _verdict(limits, estimate),
        *(_parameter(expectation, limits, estimate) for expectation in expect.values()),
        *(_standard_error(expectation, estimate) for expectation in limits.standard_error.values()),
        *(_rmse(name, limit, estimate) for name, limit in limits.rmse.items()),
    )


def compare(
    name: str,
    expectation: Expectation,
    *,
    value: float,
    standard_error: float | None,
    confidence: float | None,
    unit: str = "",
    nominal: float | None = None,
) -> Check:
    """Hold one quantity against its limits."""
    limits = expectation.limits(nominal)
    level = confidence if limits is not None else confidence or CONFIDENCE
    measured = f"measured {_with_error(value, standard_error, unit)}"
    if limits is None:
        expected = expectation.value if expectation.value is not None else nominal or 0.0
        said = f"expected {_number(expected, unit)}, within the {level:.6g} interval of the estimate"
        if standard_error is None:
            return Check(name, "undecided", f"{measured}, {said}; no standard error is known")
        half = _quantile(level or CONFIDENCE) * standard_error
        return Check(name, "pass" if abs(value - expected) <= half else "fail", f"{measured}, {said}")
    low, high = limits
    said = f"expected {_span(expectation, nominal, low, high, unit)}"
    inside = low <= value <= high
    if level is None:
        return Check(name, "pass" if inside else "fail", f"{measured}, {said}")
    if standard_error is None:
        return Check(name, "undecided" if inside else "fail", f"{measured}, {said}; no standard error is known")
    half = _quantile(level) * standard_error
    interval = f"its {level:.6g} interval is {_number(value - half)} to {_number(value + half, unit)}"
    if low <= value - half and value + half <= high:
        return Check(name, "pass", f"{measured}, {said}; {interval}")
    if value + half < low or value - half > high:
        return Check(name, "fail", f"{measured}, {said}; {interval}")
    return Check(name, "undecided", f"{measured}, {said}; {interval}, which crosses a limit")


def _verdict(limits: Limits, estimate: Estimate) -> Check:
    wanted = limits.verdicts or VERDICTS[:2]
    why = f" ({'; '.join(estimate.reasons)})" if estimate.reasons else ""
    sentence = f"the verdict is {estimate.verdict}{why}, expected {' or '.join(wanted)}"
    return Check("verdict", "pass" if estimate.verdict in wanted else "fail", sentence)


def _parameter(expectation: Expectation, limits: Limits, estimate: Estimate) -> Check:
    found = estimate.parameters.get(expectation.name)
    if found is None:
        return Check(expectation.name, "fail", _absent("parameter", expectation.name, estimate.parameters, estimate))
    if not found.is_told:
        return Check(expectation.name, "undecided", f"{expectation.name} is not identified: {found.reason}")
    return compare(
        expectation.name,
        expectation,
        value=found.value,
        standard_error=found.uncertainty if found.free else 0.0,
        confidence=limits.confidence,
        unit=found.unit,
        nominal=found.nominal,
    )


def _standard_error(expectation: Expectation, estimate: Estimate) -> Check:
    name = f"standard error of {expectation.name}"
    found = estimate.parameters.get(expectation.name)
    if found is None:
        return Check(name, "fail", _absent("parameter", expectation.name, estimate.parameters, estimate))
    limit = expectation.tolerance(found.value) or 0.0
    said = f"expected at most {_number(limit, found.unit)}"
    if expectation.fraction is not None:
        said += f" ({expectation.within} of {_number(found.value, found.unit)})"
    error = found.standard_error
    if error is None:
        return Check(name, "fail", f"{expectation.name} has no standard error, {said}")
    return Check(name, "pass" if error <= limit else "fail", f"measured {_number(error, found.unit)}, {said}")


def _rmse(output: str, limit: float, estimate: Estimate) -> Check:
    name = f"rmse of {output}"
    found = estimate.rmse.get(output)
    if found is None:
        return Check(name, "fail", _absent("output", output, estimate.rmse, estimate))
    return Check(name, "pass" if found <= limit else "fail", f"measured {found:.6g}, expected at most {limit:.6g}")


def _absent(what: str, name: str, known: Mapping[str, Any], estimate: Estimate) -> str:
    if not known:
        return f"there is no estimate: {'; '.join(estimate.reasons) or estimate.verdict}"
    return f"the estimate has no {what} {name!r}{suggestion(name, known)}"


def _span(expectation: Expectation, nominal: float | None, low: float, high: float, unit: str) -> str:
    value = expectation.value if expectation.value is not None else nominal
    if value is not None and expectation.minimum is None and expectation.maximum is None:
        tolerance = expectation.within
        shown = tolerance if isinstance(tolerance, str) else _number(tolerance or 0.0, unit)
        return f"{_number(value, unit)} within {shown}"
    if math.isinf(low):
        return f"at most {_number(high, unit)}"
    if math.isinf(high):
        return f"at least {_number(low, unit)}"
    return f"{_number(low)} to {_number(high, unit)}"


def _with_error(value: float, standard_error: float | None, unit: str) -> str:
    error = "" if standard_error is None else f" ± {standard_error:.2g}"
    return f"{value:.6g}{error}{f' {unit}' if unit else ''}"


def _number(value: float, unit: str = "") -> str:
    return f"{value:.6g}{f' {unit}' if unit else ''}"


def _quantile(confidence: float) -> float:
    """Return half the width of a two-sided interval, in standard errors."""
    return NormalDist().inv_cdf((1 + confidence) / 2)


def _read_verdicts(expect: Table, key: str) -> tuple[str, ...]:
    verdicts = expect.texts(key)
    for verdict in verdicts:
        if verdict not in VERDICTS:
            expect.fail((key,), f"{expect.full(key)} cannot be {verdict!r}{suggestion(verdict, VERDICTS)}")
    return verdicts


_VERDICT = {"enum": list(VERDICTS)}
_TOLERANCE = {
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string", "pattern": r"^\s*\d+(\.\d*)?([eE][-+]?\d{1,4})?\s*%\s*$"},
        keys.CELL,
    ],
    "description": 'a share, "1 %", or a number in the unit of the value',
}
ENTRY = Keys(
    Expectation,
    value=keys.number("expected value"),
    within=Key(_read_tolerance, _TOLERANCE),
    min=keys.number("smallest that is accepted").in_field("minimum"),
    max=keys.number("greatest that is accepted").in_field("maximum"),
)
LIMITS = Keys(  # of [expect]; every other key is a parameter
    Limits,
    verdict=Key(
        _read_verdicts,
        {"anyOf": [_VERDICT, {"type": "array", "items": _VERDICT, "minItems": 1}]},
        list,
        field="verdicts",
    ),
    confidence=keys.number(
        "an estimate passes only if this interval lies within its limits (ISO 14253-1)", above=0, below=1
    ),
    rmse=keys.named(keys.number("greatest root mean square error, SI", above=0), "output = limit"),
    standard_error=keys.named(
        Key(
            lambda table, name: Expectation(name, None, *_read_tolerance(table, name)),
            _TOLERANCE,
            lambda expectation: expectation.within,
        ),
        "parameter = greatest standard error",
    ),
)
EXPECT = {**LIMITS.schema(), "additionalProperties": ENTRY.schema()}
