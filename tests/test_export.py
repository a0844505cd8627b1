"""The files of an estimate."""

import hashlib
import json
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy.ssp.ssd import read_ssv
from made_estimates import MOTOR, UNITS, comparison, estimate, with_parameter

from estimator.results import export
from estimator.results.result import Setting


def read(content: bytes, tmp_path):
    """Read a parameter set as fmpy does, which checks it against the schema of SSP."""
    path = tmp_path / "p.ssv"
    path.write_bytes(content)
    return read_ssv(str(path), validate=True)


def test_the_parameter_set_is_valid_ssp_and_keeps_every_bit_and_every_unit(tmp_path):
    made = with_parameter(estimate(), "R", value=1 / 3)
    read_back = read(export.parameter_set(made), tmp_path)
    assert {p.name: float(p.value) for p in read_back.parameters} == {**MOTOR, "R": 1 / 3}
    assert {p.name: p.unit for p in read_back.parameters} == UNITS


def test_a_parameter_that_sets_several_variables_is_written_for_each(tmp_path):
    both = (Setting("Ke", 0.05, "V.s/rad"), Setting("Km", 50.0, "mN.m/A"), Setting("poles", 2.0, "", "Integer"))
    content = export.parameter_set(with_parameter(estimate(), "K", settings=both))
    found = [(p.name, p.value) for p in read(content, tmp_path).parameters]
    assert [name for name, _ in found] == ["R", "Ke", "Km", "poles", "L", "J", "B"]
    assert {"Ke": "0.05", "Km": "50.0", "poles": "2"}.items() <= dict(found).items()


def test_a_value_of_the_measurement_chain_is_no_variable_of_the_fmu(tmp_path):
    made = with_parameter(estimate(), "L", settings=())
    assert "L" not in [p.name for p in read(export.parameter_set(made), tmp_path).parameters]


def test_a_strange_unit_is_left_out_of_a_still_valid_parameter_set(tmp_path):
    made = with_parameter(with_parameter(estimate(), "R", unit="furlong"), "K", unit="")
    units = {p.name: p.unit for p in read(export.parameter_set(made), tmp_path).parameters}
    assert units["R"] is None and units["K"] is None and units["L"] == "H"


def test_a_parameter_set_without_any_known_unit_is_valid(tmp_path):
    made = estimate()
    for name in MOTOR:
        made = with_parameter(made, name, unit="?")
    assert len(read(export.parameter_set(made), tmp_path).parameters) == 5


def test_the_parameter_set_says_what_is_not_identified():
    content = export.parameter_set(with_parameter(estimate(), "L", status="not identified")).decode()
    assert 'name="L" description="not identified"' in content


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("Ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("H", {"kg": 1, "m": 2, "s": -2, "A": -2}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("V.s/rad", {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}),
        ("N.m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("V/(rad.s-1)", {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}),
        ("m/m", {}),
        ("1", {}),
        ("1/s", {"s": -1}),
        ("J/C", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("Wb/s", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("T.m2", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("F.Ohm", {"s": 1}),
        ("Pa.m3/W", {"s": 1}),
        ("Hz", {"s": -1}),
        ("", None),
        ("rpm", None),
        ("m^2", None),
    ],
)
def test_units_are_made_of_si_base_units(unit, exponents):
    assert export.unit_exponents(unit) == exponents


def test_an_estimate_has_all_four_files_and_the_figure_is_in_the_report(tmp_path):
    data = tmp_path / "data.csv"
    data.write_bytes(b"time\n")
    files = export.result_files(estimate(), command="fmu-estimator estimate data.csv", sources=[data, tmp_path / "no"])
    assert set(files) == {"result.json", "report.html", "parameters.ssv", "figure.png"}
    assert json.loads(files["result.json"])["verdict"] == "ok"
    assert files["figure.png"].startswith(b"\x89PNG")
    page = files["report.html"].decode()
    assert page.count('<svg class="chart"') == 4 and "<img" not in page  # transient, whole; wide and slim
    assert len(page) < 150_000
    assert hashlib.sha256(b"time\n").hexdigest() in page
    assert "fmu-estimator estimate data.csv" in page
    assert "http:" not in page and "https:" not in page


def test_the_figure_may_be_had_for_print_too():
    files = export.result_files(estimate(), figures=["svg", "pdf", "svg"])
    assert set(files) == set(export.RESULT_FILES)
    assert ElementTree.fromstring(files["figure.svg"]).tag == "{http://www.w3.org/2000/svg}svg"
    assert files["figure.pdf"].startswith(b"%PDF-") and files["figure.pdf"].rstrip().endswith(b"%%EOF")
    assert files == export.result_files(estimate(), figures=["svg", "pdf"])  # the same estimate, the same bytes


def test_each_recording_has_its_own_figure_in_the_report():
    made = estimate(comparisons=tuple(comparison(np.full(30, 10.5), name=f"r{k}") for k in range(2)), history=None)
    page = export.result_files(made)["report.html"].decode()
    assert page.count('<svg class="chart"') == 6
    assert all(f"r{k}: measured and simulated" in page for k in range(2))


def test_a_refused_estimate_has_no_parameter_set_and_without_a_recording_no_figure():
    files = export.result_files(estimate(verdict="refused", reasons=("no",), comparisons=(), history=None))
    assert set(files) == {"result.json", "report.html"}
