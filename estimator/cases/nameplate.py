"""What a motor's nameplate says, computed from an estimate and checked. Knows units and limits, no FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from estimator.cases import keys
from estimator.cases.expectation import ENTRY, Check, Expectation, compare, read_expectation
from estimator.cases.keys import Key, Keys
from estimator.cases.strict_toml import Table
from estimator.errors import suggestion
from estimator.locked import Locked
from estimator.motor.plate_quantities import plate_quantities

if TYPE_CHECKING:
    from estimator.results.result import Estimate

# quantity → (SI unit, quantity of units.py)
QUANTITIES = {
    "Kt": ("N.m/A", ""),
    "R": ("Ohm", "resistance"),
    "no_load_speed": ("rad/s", "angular speed"),
    "no_load_current": ("A", "current"),
    "stall_current": ("A", "current"),
    "stall_torque": ("N.m", "torque"),
}
NEED_VOLTAGE = tuple(name for name in QUANTITIES if name not in ("Kt", "R"))


@dataclass(frozen=True)
class Nameplate(Locked):
    """The rated voltage [V], and what the plate says, SI units."""

    voltage: float | None = None
    values: Mapping[str, Expectation] = field(default_factory=dict)


@dataclass(frozen=True)
class PlateValue:
    """One nameplate quantity of an estimate, SI, with its standard error to first order; None if that is unknown."""

    value: float
    standard_error: float | None


def read_nameplate(table: Table) -> Nameplate:
    """Read [nameplate]."""
    table.only(*NAMEPLATE)
    voltage = table.number("voltage", above=0)
    values = {}
    for name in table.keys:
        if name == "voltage":
            continue
        if voltage is None and name in NEED_VOLTAGE:
            table.fail((name,), f"{table.full(name)} depends on the voltage; add voltage = …, in V")
        values[name] = NAMEPLATE[name].read(table, name)
    return Nameplate(voltage, values)


def nameplate_value(nameplate: Nameplate) -> dict[str, Any]:
    """Return a nameplate as the table that reads back the same."""
    return {"voltage": nameplate.voltage, **{n: ENTRY.write(e) for n, e in nameplate.values.items()}}


def plate_values(estimate: Estimate, *, voltage: float | None) -> dict[str, PlateValue]:
    """Return the nameplate quantities of an estimate; those that its parameters do not give are left out.

    Standard errors are propagated to first order with the estimate's correlations.
    """
    have = estimate.parameters
    if "K" not in have or "R" not in have:
        return {}
    B = have["B"].value if "B" in have else None
    found = plate_quantities(have["R"].value, have["K"].value, B, voltage)
    order = [name for name in QUANTITIES if name in found]
    return {name: PlateValue(found[name][0], _error(estimate, found[name][1])) for name in order}


def plate_checks(nameplate: Nameplate, estimate: Estimate, *, confidence: float | None = None) -> tuple[Check, ...]:
    """Hold an estimate against the limits of a nameplate; a value without a tolerance is shown, not checked."""
    found = plate_values(estimate, voltage=nameplate.voltage)
    result = []
    for name, expectation in nameplate.values.items():
        if expectation.limits() is None:
            continue
        title = f"nameplate {name}"
        if name not in found:
            why = "; ".join(estimate.reasons) if not estimate.parameters else "it needs R, K and B"
            result.append(Check(title, "fail", f"the estimate gives no {name}: {why}"))
            continue
        value, unit = found[name], QUANTITIES[name][0]
        result.append(
            compare(
                title,
                expectation,
                value=value.value,
                standard_error=value.standard_error,
                confidence=confidence,
                unit=unit,
            )
        )
    return tuple(result)


def plate_check_names(nameplate: Nameplate | None) -> tuple[str, ...]:
    """Return the names of the checks that `plate_checks` will make, in its order."""
    if nameplate is None:
        return ()
    return tuple(f"nameplate {name}" for name, e in nameplate.values.items() if e.limits() is not None)


def _error(estimate: Estimate, gradient: Mapping[str, float]) -> float | None:
    variance = 0.0
    errors = {}
    for name in gradient:
        parameter = estimate.parameters[name]
        error = parameter.standard_error if parameter.free else 0.0
        if error is None:
            return None
        errors[name] = error
    for a, slope_a in gradient.items():
        for b, slope_b in gradient.items():
            variance += slope_a * slope_b * errors[a] * errors[b] * _correlation(estimate, a, b)
    for source in estimate.tolerances:  # moves all of them at once
        variance += sum(slope * estimate.parameters[a].budget.get(source, 0.0) for a, slope in gradient.items()) ** 2
    return float(max(variance, 0.0) ** 0.5)


def _correlation(estimate: Estimate, a: str, b: str) -> float:
    if a == b:
        return 1.0
    names = estimate.correlated
    if estimate.correlation is None or a not in names or b not in names:
        return 0.0
    return float(estimate.correlation[names.index(a), names.index(b)])


def _factor(entry: Table, name: str) -> float:
    si, quantity = QUANTITIES[name]
    if "unit" not in entry.value:
        return 1.0
    text = entry.text("unit")
    if text == si:
        return 1.0
    from estimator.recordings.units import parse_unit  # imports numpy

    unit = parse_unit(text)
    if unit is None or unit.quantity != quantity or unit.offset:
        entry.fail(("unit",), f"{entry.title} cannot be in {text!r}{suggestion(text, (si, *_usual(quantity)))}")
    return unit.numerator / unit.denominator


def _usual(quantity: str) -> tuple[str, ...]:
    return {"angular speed": ("rpm",), "current": ("mA",), "torque": ("mN.m",), "resistance": ("mOhm",)}.get(
        quantity, ()
    )


def _in_si(e: Expectation, factor: float) -> Expectation:
    def scaled(value: float | None) -> float | None:
        return None if value is None else value * factor

    return Expectation(e.name, scaled(e.value), e.fraction, scaled(e.absolute), scaled(e.minimum), scaled(e.maximum))


def _read_quantity(table: Table, name: str) -> Expectation:
    if not isinstance(table.value[name], dict):
        return Expectation(name, table.required_number(name))
    entry = table.table(name)
    entry.only(*PLATE)
    return _in_si(read_expectation(entry, nominal=None), _factor(entry, name))


PLATE = Keys(None, **ENTRY, unit=keys.text("such as rpm; default: SI"))
NAMEPLATE = Keys(
    None,
    voltage=keys.number("rated voltage, V", above=0),
    **{
        name: Key(_read_quantity, {"anyOf": [keys.number(f"{unit}, shown only").schema, PLATE.schema()]})
        for name, (unit, _) in QUANTITIES.items()
    },
)
