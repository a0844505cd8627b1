"""What changed between results: the statistics, and the command."""

import dataclasses
import json
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from made_estimates import MOTOR, estimate, with_parameter
from test_report import parsed

from estimator.cli import main
from estimator.errors import InputError
from estimator.results.changes import changes
from estimator.results.changes_shown import change_text, changes_mapping, changes_page, changes_svg, changes_text
from estimator.results.handover import estimate_from_json
from estimator.results.result import DerivedQuantity, Estimate
from estimator.results.result_json import to_json

BASE = estimate()
ERRORS = {name: 1e-3 * value for name, value in MOTOR.items()}


def shifted(by: dict[str, float] | np.ndarray, made: Estimate | None = None) -> Estimate:
    """Return an estimate whose parameters are off by so many standard errors."""
    made = made or BASE
    steps = by if isinstance(by, dict) else dict(zip(MOTOR, by.tolist(), strict=True))
    moved = {
        name: dataclasses.replace(made.parameters[name], value=MOTOR[name] + count * ERRORS[name])
        for name, count in steps.items()
    }
    return dataclasses.replace(made, parameters={**made.parameters, **moved})


def test_results_of_one_motor_differ_no_more_often_than_is_said():
    rng = np.random.default_rng(4)
    root = np.linalg.cholesky(BASE.correlation)
    rate, count = 0.05, 1500
    alarms = 0
    for draws in rng.standard_normal((count, 3, 5)):
        several = {name: shifted(root @ draw) for name, draw in zip("abc", draws, strict=True)}
        alarms += bool(changes(several, false_alarm=rate).differing)
    # 75 are allowed; beyond 75 + 4 √71 = 109 once in 30 000; the tests share a reference, so that it is somewhat fewer
    assert 15 < alarms < 109


def test_a_change_of_one_parameter_is_found_with_its_error_bar():
    found = changes({"monday": estimate(), "friday": shifted({"J": 41.0})})
    assert found.differing == {"friday": ["J"]}
    (change,) = next(q for q in found.quantities if q.name == "J").changes
    assert change.percent == pytest.approx(4.1) and change.percent_error == pytest.approx(0.1 * math.sqrt(2))
    assert change.z == pytest.approx(41 / math.sqrt(2)) and found.tests == 6
    text = changes_text(found)
    assert text.startswith("DIFFERENT from monday. friday: J.\n") and "+4.10 % ± 0.14 %" in text
    assert "beyond 3.14 standard errors: a false alarm in 1 % of such comparisons (6 tests)" in text


@pytest.mark.parametrize(
    ("percent", "error", "text"), [(4.1, 0.6, "+4.10 % ± 0.60 %"), (-0.03, 0.44, "-0.03 % ± 0.44 %")]
)
def test_a_relative_change_is_written_with_its_sign_and_its_error(percent, error, text):
    assert change_text(percent, error) == text


def test_what_no_parameter_shows_alone_all_show_together():
    """R and K go up together by 2 standard errors each, where their errors have a correlation of -0.97."""
    found = changes({"a": estimate(), "b": shifted({"R": 2.0, "K": 2.0})})
    assert not any(c.differs for q in found.quantities for c in q.changes)
    (joint,) = found.joint
    # along (1, 1) the variance of each difference's sum is 2 (2 - 2 · 0.97)
    assert joint.chi_square == pytest.approx(16 / (2 * 0.06)) and joint.degrees == 5 and joint.differs
    assert found.differing == {"b": ["all parameters together"]}


def test_what_is_within_the_tolerance_is_alike():
    several = {"a": estimate(), "b": shifted({"J": 15.0})}  # 1.5 %
    assert changes(several).differing and not changes(several, within=1.5).differing
    assert changes(several, within=0.7).differing == {"b": ["J"]}


def test_three_results_and_more_have_a_repeatability():
    rng = np.random.default_rng(6)
    several = {f"r{k}": shifted(3.0 * rng.standard_normal(5)) for k in range(40)}
    for quantity in changes(several).quantities:
        r = quantity.repeatability
        assert r.ratio == pytest.approx(3.0, rel=0.4)  # of 40 values: 11 %, three and a half of those
        assert r.percent == pytest.approx(0.1 * r.ratio, rel=0.01) and r.probability < 1e-6
    alike = {f"r{k}": shifted(rng.standard_normal(5)) for k in range(40)}
    assert all(q.repeatability.probability > 1e-4 for q in changes(alike).quantities)
    assert changes({"a": estimate(), "b": estimate()}).quantities[0].repeatability is None


def test_what_is_not_determined_is_not_compared_and_told():
    weak = with_parameter(estimate(), "L", status="not identified", standard_error=None)
    fixed = with_parameter(estimate(), "B", free=False, standard_error=None)
    found = changes({"weak": weak, "fixed": fixed})
    assert [q.name for q in found.quantities] == ["R", "K", "J"]
    assert "weak does not determine L: not compared" in found.notes
    assert "fixed holds B = 0.000169 fixed: not compared" in found.notes


def test_what_holds_a_part_of_the_inductance_is_compared_only_where_all_or_none_determine_it():
    free = estimate(derived={"kA": DerivedQuantity(6.3e-4, 8e-6, "V.s2/rad")})
    other = estimate(derived={"kA": DerivedQuantity(5.8e-4, 2e-6, "V.s2/rad")})
    assert changes({"a": free, "b": other}).differing == {"b": ["kA"]}
    found = changes({"a": free, "b": with_parameter(other, "L", free=False, standard_error=None)})
    assert not found.differing and "kA" not in [q.name for q in found.quantities]
    assert "not all determine L, so kA holds its part in some only: not compared" in found.notes


def test_where_the_parameters_are_not_identified_derived_quantities_are_compared():
    def speed_only(gain):
        made = estimate(derived={"speed_per_volt": DerivedQuantity(gain, 0.01, "rad/(s.V)")}, correlation=None)
        return dataclasses.replace(
            made, parameters={"R": with_parameter(made, "R", standard_error=None).parameters["R"]}
        )

    found = changes({"a": speed_only(16.0), "b": speed_only(16.1)})
    assert found.differing == {"b": ["speed per volt"]} and not found.joint


def test_what_else_is_not_alike_is_told():
    other = estimate(
        verdict="doubtful", reasons=("a drift",), method="paper", fmu={"name": "other"}, recordings=({"name": "step"},)
    )
    notes = " | ".join(changes({"a": estimate(recordings=({"name": "step"},)), "b": other}).notes)
    for part in (
        "b is doubtful: a drift",
        "FMU: dc_motor in a, other in b",
        "method: cuckoo in a, paper in b",
        "a and b both come from a recording named step",
    ):
        assert part in notes


def test_a_result_reads_back_with_all_that_is_compared():
    made = estimate(derived={"gain": DerivedQuantity(2.0, 0.1, "rad/(s.V)")}, about={"motor": "3"})
    back = estimate_from_json(to_json(made))
    assert back.derived == made.derived and back.about == made.about and back.rmse == made.rmse
    assert np.array_equal(back.correlation, made.correlation) and tuple(back.correlated) == made.correlated
    older = json.loads(to_json(made))
    for key in ("derived", "correlation", "about", "measurement_chain", "sample_noise"):
        del older[key]
    assert estimate_from_json(json.dumps(older)).correlation is None


@pytest.fixture
def folders(tmp_path):
    """Return a function that writes results into folders, and gives their paths."""

    def write(**several):
        for name, made in several.items():
            (tmp_path / name).mkdir()
            (tmp_path / name / "result.json").write_text(to_json(made))
        return [str(tmp_path / name) for name in several]

    return write


def test_the_exit_status_says_whether_something_differs(folders, capsys):
    a, b, c = folders(a=estimate(), b=shifted({"R": 0.5}), c=shifted({"R": 30.0}))
    assert main(["compare", a, b]) == 0
    assert capsys.readouterr().out.startswith("NO DIFFERENCE from a ")
    assert main(["compare", a, f"{c}/result.json"]) == 1
    assert main(["compare", a, c, "--within", "5 %"]) == 0
    capsys.readouterr()
    assert main(["compare", a, b, c, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["differs"] is True and told["differing"] == {"c": ["R"]} and told["results"] == ["a", "b", "c"]
    assert (
        set(told["quantities"]["R"]["changes"]) == {"b", "c"} and told["quantities"]["R"]["repeatability"]["ratio"] > 5
    )


def test_a_page_a_figure_and_the_numbers_are_written(folders, tmp_path, capsys):
    a, b = folders(**{"a": estimate(), "b&<c>": shifted({"J": 30.0})})
    output = tmp_path / "out"
    assert main(["compare", a, b, "-o", str(output)]) == 1
    assert {p.name for p in output.iterdir()} == {"compare.html", "compare.svg", "compare.json"}
    page = (output / "compare.html").read_text()
    text = " ".join(parsed(page).text)
    assert "DIFFERENT from a. b&<c>: J." in text and "fmu-estimator compare" in text and "http" not in page
    root = ElementTree.parse(output / "compare.svg").getroot()
    drawn = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"R", "J", "+3.00 % ± 0.14 %"} <= set(drawn)
    red = [g for g in root.iter("{http://www.w3.org/2000/svg}g") if g.get("class") == "differs"]
    assert len(red) == 1 and len(page) < 40_000
    assert json.loads((output / "compare.json").read_text())["differs"] is True


def test_results_in_folders_of_one_name_are_told_apart(tmp_path, capsys):
    for day in ("monday", "friday"):
        (tmp_path / day / "out").mkdir(parents=True)
        (tmp_path / day / "out" / "result.json").write_text(to_json(estimate()))
    assert main(["compare", str(tmp_path / "monday" / "out"), str(tmp_path / "friday" / "out")]) == 0
    assert "NO DIFFERENCE from monday/out" in capsys.readouterr().out


def test_a_refused_result_cannot_be_compared():
    with pytest.raises(InputError, match="b was refused, so there is nothing to compare: no step"):
        changes({"a": estimate(), "b": estimate(verdict="refused", reasons=("no step",), parameters={})})


def test_results_without_error_bars_cannot_be_compared():
    bare = estimate()
    for name in MOTOR:
        bare = with_parameter(bare, name, standard_error=None)
    with pytest.raises(InputError, match="a and b have no quantity in common that both determine with a standard"):
        changes({"a": estimate(), "b": bare})


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["{a}"], "one result alone cannot be compared; give two or more, the reference first"),
        (["{a}", "{a}/result.json"], "is given twice; leave one out"),
        (["{a}", "{a}/nothing"], "No such file or directory; give the folder or the result.json of estimate -o"),
        (["{a}", "{b}", "--false-alarm", "5"], "'5' is no probability between 0 and 1, such as 0.01"),
        (["{a}", "{b}", "--within", "-2"], "'-2' is below zero; give a percentage such as 2"),
    ],
)
def test_what_cannot_be_compared_is_one_sentence_and_status_2(folders, capsys, arguments, sentence):
    a, b = folders(a=estimate(), b=estimate())
    try:
        status = main(["compare", *(word.format(a=a, b=b) for word in arguments)])
    except SystemExit as left:
        status = left.code
    captured = capsys.readouterr()
    assert status == 2 and sentence in captured.err and captured.out == "" and captured.err.count("\n") == 1


def test_numbers_that_cannot_be_said_leave_the_json_valid():
    made = changes({"a": with_parameter(estimate(), "R", value=0.0), "b": estimate()})
    json.dumps(changes_mapping(made), allow_nan=False)
    assert changes_svg(made) and parsed(changes_page(made))
