"""Units: spellings against numbers worked out by hand."""

import math

import numpy as np
import pytest

from estimator.cases.si_units import NAMED
from estimator.cases.unit_products import parse_product
from estimator.recordings.units import SI_UNIT, examples, parse_unit, unit_of


@pytest.mark.parametrize(
    ("text", "value", "si", "quantity"),
    [
        ("s", 2.0, 2.0, "time"),
        ("ms", 250.0, 0.25, "time"),
        ("µs", 7.0, 7e-6, "time"),  # U+00B5, micro sign
        ("μs", 7.0, 7e-6, "time"),  # U+03BC, Greek mu
        ("min", 2.0, 120.0, "time"),
        ("mV", 10500.0, 10.5, "voltage"),
        ("kV", 0.012, 12.0, "voltage"),
        ("Volts", 3.0, 3.0, "voltage"),
        ("mA", 250.0, 0.25, "current"),
        ("amps", 0.5, 0.5, "current"),
        ("rpm", 60.0, 2 * math.pi, "angular speed"),
        ("RPM", 60.0, 2 * math.pi, "angular speed"),
        ("1/min", 30.0, math.pi, "angular speed"),
        ("min⁻¹", 30.0, math.pi, "angular speed"),
        ("min^-1", 30.0, math.pi, "angular speed"),
        ("U/min", 30.0, math.pi, "angular speed"),
        ("krpm", 0.06, 2 * math.pi, "angular speed"),
        ("rev/s", 1.0, 2 * math.pi, "angular speed"),
        ("deg/s", 180.0, math.pi, "angular speed"),
        ("°/s", 180.0, math.pi, "angular speed"),
        ("rad/seg", 5.0, 5.0, "angular speed"),
        ("rad per s", 5.0, 5.0, "angular speed"),
        ("rad_s", 5.0, 5.0, "angular speed"),
        ("rad·s⁻¹", 5.0, 5.0, "angular speed"),
        ("deg", 90.0, math.pi / 2, "angle"),
        ("°", 90.0, math.pi / 2, "angle"),
        ("rev", 0.5, math.pi, "angle"),
        ("mNm", 20.0, 0.02, "torque"),
        ("N·m", 20.0, 20.0, "torque"),
        ("N cm", 20.0, 0.2, "torque"),
        ("°C", 25.0, 298.15, "temperature"),
        ("%", 50.0, 0.5, "ratio"),
        ("g", 500.0, 0.5, "mass"),
    ],
)
def test_a_unit_as_people_write_it_becomes_si(text: str, value: float, si: float, quantity: str) -> None:
    unit = parse_unit(text)
    assert unit is not None
    assert unit.quantity == quantity
    assert unit.si == SI_UNIT[quantity]
    assert unit.to_si(value) == pytest.approx(si, rel=1e-15)
    assert unit.to_si(np.array([value, value])) == pytest.approx([si, si], rel=1e-15)


def test_milliamperes_become_the_nearest_double() -> None:
    unit = parse_unit("mA")
    assert unit is not None
    assert [unit.to_si(float(k)) for k in range(1000)] == [k / 1000 for k in range(1000)]


@pytest.mark.parametrize("text", ["", "furlong", "MA", "km/min", "m A x", "rad/ss", "V/A"])
def test_other_texts_are_no_unit(text: str) -> None:
    assert parse_unit(text) is None


def test_a_single_small_letter_is_a_unit_in_brackets_but_no_symbol() -> None:
    assert parse_unit("a") == unit_of("current")
    assert parse_unit("a", symbols_only=True) is None
    assert parse_unit("A", symbols_only=True) == unit_of("current")


def test_the_examples_of_a_quantity_are_units_of_it() -> None:
    for quantity in SI_UNIT:
        for text in examples(quantity).split(", "):
            unit = parse_unit(text)
            assert unit is not None, text
            assert unit.quantity == quantity


@pytest.mark.parametrize(
    ("text", "factor", "name"),
    [
        ("g*cm^2", 1e-7, "kg.m2"),
        ("N*m/A", 1.0, "V.s/rad"),
        ("mN.m.s/rad", 1e-3, "N.m.s/rad"),
        ("N*m/(rad/s)", 1.0, "N.m.s/rad"),
        ("V/krpm", 0.03 / math.pi, "V.s/rad"),
        ("mWb", 1e-3, "V.s/rad"),
        ("g cm²", 1e-7, "kg.m2"),
        ("mV per rpm", 0.03 / math.pi, "V.s/rad"),
        ("kg·m²·s⁻¹", 1.0, "N.m.s/rad"),
    ],
)
def test_a_product_of_units_becomes_si(text: str, factor: float, name: str) -> None:
    found = parse_product(text)
    assert found is not None and found[0] == pytest.approx(factor, rel=1e-12)
    assert NAMED[found[1]] == name


@pytest.mark.parametrize("text", ["", "slug.ft2", "V/", "V..s", "(V", "V)", "V(s)", "V 12", "m^999999", "degC/s"])
def test_other_texts_are_no_product_of_units(text: str) -> None:
    assert parse_product(text) is None
