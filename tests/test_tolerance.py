"""Tolerances as a case, the command line and Python give them; what GUM makes of them."""

import json
import tomllib

import jsonschema
import pytest

from estimator.cases.case import read_case
from estimator.cases.schema import schema
from estimator.cases.tolerance import OFFERED, tolerances
from estimator.cases.written_case import write_case
from estimator.errors import CaseError

pytestmark = pytest.mark.usefixtures("shared_workers")


def one(source, text):
    (found,) = tolerances({source: text})
    return found


@pytest.fixture
def case_from(tmp_path):
    (tmp_path / "run.csv").write_text("")

    def read(text):
        path = tmp_path / "a.case.toml"
        path.write_text(f"{text}\n" if "[[recording]]" in text else f'[[recording]]\nfile = "run.csv"\n{text}\n')
        return read_case(path)

    return read


def test_what_only_bounds_an_error_is_rectangular_and_a_certificates_is_divided_by_its_k():
    """GUM 4.3.7: 100 +- 4 Celsius, u = 2.3; GUM 4.3.3: 240 ug at three standard deviations."""
    assert one("temperature", "4 K").standard_uncertainty == pytest.approx(2.309, abs=5e-4)
    certificate = one("i gain", "0.024 % (k=3)")
    assert certificate.standard_uncertainty == pytest.approx(8e-5) and certificate.distribution == "normal"


@pytest.mark.parametrize(
    ("source", "text", "size", "unit"),
    [
        ("i gain", "1 %", 0.01, ""),
        ("supply gain", "±0.5%", 0.005, ""),
        ("v gain", 0.02, 0.02, ""),
        ("supply resistance", "50 mOhm", 0.05, "Ohm"),
        ("supply resistance", "0.05", 0.05, "Ohm"),
        ("brush drop", "500 mV", 0.5, "V"),
        ("dry friction", "10 %", 0.1, ""),
        ("dry friction", "2 mN.m (k = 2)", 2e-3, "N.m"),
        ("temperature", "5 °C", 5.0, "K"),
    ],
)
def test_a_tolerance_is_read_in_the_units_of_its_kind(source, text, size, unit):
    found = one(source, text)
    assert (found.size, found.unit) == (pytest.approx(size), unit)


@pytest.mark.parametrize(
    ("source", "text", "part"),
    [
        ("i gian", "1 %", "there is no tolerance 'i gian'; did you mean 'i gain'?"),
        ("i gain", "1 V", "the tolerance 'i gain' cannot be in 'V'; write '1 %', or '1 % (k=2)'"),
        ("brush drop", "1 %", "the tolerance 'brush drop' cannot be in '%'; write '0.5 V'"),
        ("temperature", "warm", "the tolerance 'temperature' cannot be 'warm'; write '5 K'"),
        ("i gain", "1", "the tolerance 'i gain' is 1, a share: 100 %; write '1 %', or '100 %' if so much is meant"),
        ("i gain", "0 %", "the tolerance 'i gain' is '0 %', which must be above 0"),
        ("i gain", "1 % (k=0)", "which must be above 0"),
        ("i gain", "-1 %", "cannot be '-1 %'"),
        ("i gain", -0.01, "cannot be '-0.01'"),
    ],
)
def test_a_tolerance_that_cannot_be_read_is_refused_with_what_would_be_right(source, text, part):
    with pytest.raises(CaseError) as raised:
        tolerances({source: text})
    assert part in str(raised.value)


def test_a_tolerance_is_given_once():
    with pytest.raises(CaseError, match="'i gain' is given twice; leave one out"):
        tolerances([("i gain", "1 %"), ("i gain", "2 %")])


def test_a_tolerance_wins_over_that_of_the_default_set():
    found = {t.source: t for t in tolerances([("default", ""), ("i gain", "3 %")])}
    assert tuple(found) == tuple(OFFERED) and found["i gain"].size == 0.03
    assert not found["i gain"].offered and found["v gain"].offered


CASES = [
    '[tolerance]\n"i gain" = "1 %"\ntemperature = 5\n"duty gain" = "0.2 % (k=2)"',
    'tolerance = "default"\n[[recording]]\nfile = "run.csv"',
    '[tolerance]\ndefault = true\n"i gain" = "2 %"',
]


@pytest.mark.parametrize("text", CASES)
def test_a_case_file_with_tolerances_is_valid_and_reads_back_the_same(case_from, tmp_path, text):
    case = case_from(text)
    write_case(case, tmp_path / "b.case.toml")
    assert read_case(tmp_path / "b.case.toml") == case and case.tolerance
    jsonschema.validate(tomllib.loads((tmp_path / "b.case.toml").read_text()), json.loads(json.dumps(schema())))


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (
            'tolerance = "usual"\n[[recording]]\nfile = "run.csv"',
            "line 1: tolerance cannot be 'usual'; write \"default\"",
        ),
        ('[tolerance]\n"i gian" = "1 %"', "line 4: there is no tolerance 'i gian'"),
        ('[tolerance]\n"i gain" = true', "line 4: tolerance.i gain must be a number, not true"),
        ("[tolerance]\ndefault = false", "line 4: tolerance.default must be true, or left out"),
        ("tolerance = 3\n[[recording]]\nfile = 'run.csv'", "line 1: tolerance must be a table, not 3"),
    ],
)
def test_a_case_file_with_a_wrong_tolerance_is_refused_with_its_line(case_from, text, part):
    with pytest.raises(CaseError) as raised:
        case_from(text)
    assert part in str(raised.value)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(text), schema())
