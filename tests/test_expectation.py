"""What a case file expects, the guard band, and the nameplate (expectation.py, nameplate.py)."""

import dataclasses
import math
import pickle

import mpmath
import numpy as np
import pytest

from estimator.cases.case import Case, read_case
from estimator.cases.expectation import Expectation, Limits, check_names, checks, compare
from estimator.cases.nameplate import Nameplate, plate_check_names, plate_checks, plate_values
from estimator.cases.written_case import write_case
from estimator.errors import CaseError
from estimator.results.result import Estimate, ParameterEstimate

pytestmark = pytest.mark.usefixtures("shared_workers")

RECORDING = '[[recording]]\nfile = "run.csv"\n'
UNITS = {"R": "Ohm", "K": "V.s/rad", "L": "H", "J": "kg.m2", "B": "N.m.s/rad"}


def estimate_of(errors=0.01, verdict="ok", reasons=(), correlation=None, **values):
    parameters = {n: ParameterEstimate(n, v, UNITS[n], 0, 100, standard_error=errors) for n, v in values.items()}
    return Estimate(
        verdict=verdict,
        reasons=reasons,
        parameters=parameters,
        method="cuckoo",
        seed=1,
        simulations=1,
        simulations_by_phase={},
        failed_simulations=0,
        steps=1,
        seconds=0.0,
        fmu={},
        versions={},
        rmse={"i": 0.02},
        correlation=correlation,
        correlated=tuple(values) if correlation is not None else (),
    )


@pytest.fixture
def case_of(tmp_path):
    (tmp_path / "run.csv").write_text("")

    def read(text):
        (tmp_path / "a.case.toml").write_text(RECORDING + text)
        return read_case(tmp_path / "a.case.toml")

    return read


# Limits 2.97 to 3.03, standard error 0.01: two-sided 95 % is 1.96 standard errors.
@pytest.mark.parametrize(
    ("value", "confidence", "outcome"),
    [
        (3.0, 0.95, "pass"),
        (3.0103, 0.95, "pass"),
        (3.0105, 0.95, "undecided"),
        (3.0495, 0.95, "undecided"),
        (3.0497, 0.95, "fail"),
        (2.9895, 0.95, "undecided"),
        (2.9503, 0.95, "fail"),
        (3.0299, None, "pass"),
        (3.0301, None, "fail"),
        (3.0105, 0.9, "pass"),  # 1.645 standard errors
    ],
)
def test_a_part_passes_only_if_its_whole_interval_lies_within_the_limits(value, confidence, outcome):
    expectation = Expectation("R", 3.0, fraction=0.01)
    assert compare("R", expectation, value=value, standard_error=0.01, confidence=confidence).outcome == outcome


def test_the_sentence_tells_measured_expected_error_and_interval():
    check = compare(
        "R", Expectation("R", 3.0, fraction=0.01), value=3.0105, standard_error=0.01, confidence=0.95, unit="Ohm"
    )
    assert check.sentence == (
        "measured 3.0105 ± 0.01 Ohm, expected 3 Ohm within 1 %;"
        " its 0.95 interval is 2.9909 to 3.0301 Ohm, which crosses a limit"
    )


@pytest.mark.parametrize(
    ("expectation", "said"),
    [
        (Expectation("R", 3.0, absolute=0.5), "expected 3 Ohm within 0.5 Ohm"),
        (Expectation("R", minimum=2), "expected at least 2 Ohm"),
        (Expectation("R", maximum=4), "expected at most 4 Ohm"),
        (Expectation("R", minimum=2, maximum=4), "expected 2 to 4 Ohm"),
    ],
)
def test_limits_may_be_given_in_several_ways(expectation, said):
    check = compare("R", expectation, value=3.2, standard_error=None, confidence=None, unit="Ohm")
    assert (check.outcome, check.sentence) == ("pass", f"measured 3.2 Ohm, {said}")


def test_without_a_standard_error_a_confidence_cannot_be_met():
    check = compare("R", Expectation("R", minimum=2), value=3, standard_error=None, confidence=0.95)
    assert check.outcome == "undecided" and check.sentence.endswith("; no standard error is known")
    assert compare("R", Expectation("R", minimum=2), value=1, standard_error=None, confidence=0.95).outcome == "fail"


def test_a_value_without_a_tolerance_must_lie_in_the_interval_of_the_estimate():
    expectation = Expectation("R", 3.0)
    assert compare("R", expectation, value=3.019, standard_error=0.01, confidence=None).outcome == "pass"
    assert compare("R", expectation, value=3.021, standard_error=0.01, confidence=None).outcome == "fail"
    assert compare("R", expectation, value=3.0, standard_error=None, confidence=None).outcome == "undecided"


def test_a_case_expects_verdict_errors_and_rmse_too(case_of):
    case = case_of(
        '[expect]\nR = { value = 3, within = "1 %" }\nverdict = "ok"\nconfidence = 0.95\n'
        'rmse = { i = 0.01 }\nstandard_error = { R = "1 %", K = 0.5 }\n'
    )
    names = check_names(case.expect, case.limits)
    results = checks(case.expect, case.limits, estimate_of(R=3.0))
    assert tuple(check.name for check in results) == names
    assert names == ("verdict", "R", "standard error of R", "standard error of K", "rmse of i")
    assert [check.outcome for check in results] == ["pass", "pass", "pass", "fail", "fail"]
    assert results[2].sentence == "measured 0.01 Ohm, expected at most 0.03 Ohm (1 % of 3 Ohm)"
    assert results[3].sentence == "the estimate has no parameter 'K' (R)"
    assert results[4].sentence == "measured 0.02, expected at most 0.01"


@pytest.mark.parametrize(
    ("wanted", "verdict", "outcome"),
    [
        ("", "ok", "pass"),
        ("", "doubtful", "pass"),
        ("", "refused", "fail"),
        ('verdict = "ok"', "doubtful", "fail"),
        ('verdict = "refused"', "refused", "pass"),
        ('verdict = ["ok", "refused"]', "refused", "pass"),
    ],
)
def test_a_verdict_may_be_demanded(wanted, verdict, outcome, case_of):
    case = case_of(f"[expect]\n{wanted}\n")
    (check,) = checks(case.expect, case.limits, estimate_of(verdict=verdict, reasons=("v is zero",)))
    assert check.outcome == outcome
    assert check.sentence.startswith(f"the verdict is {verdict} (v is zero), expected ")


def test_a_refused_estimate_fails_what_is_expected_of_its_parameters():
    results = checks(
        {"R": Expectation("R", 3.0)}, Limits(rmse={"x": 1}), estimate_of(verdict="refused", reasons=("why",))
    )
    assert [check.outcome for check in results] == ["fail"] * 3
    assert results[1].sentence == "there is no estimate: why"
    assert results[2].sentence == "the estimate has no output 'x' (i)"


def test_of_what_the_recording_does_not_tell_no_value_passes():
    made = estimate_of(errors=None, R=3.0)
    untold = dataclasses.replace(made.parameters["R"], status="not identified", reason="any value fits as well")
    made = dataclasses.replace(made, parameters={"R": untold})
    (_, check) = checks({"R": Expectation("R", 3.0, fraction=0.05)}, Limits(), made)
    assert (check.outcome, check.sentence) == ("undecided", "R is not identified: any value fits as well")


def test_a_parameter_at_a_bound_has_no_standard_error_to_limit():
    results = checks({}, Limits(standard_error={"R": Expectation("R", absolute=1.0)}), estimate_of(errors=None, R=1.0))
    assert results[1].sentence == "R has no standard error, expected at most 1 Ohm"


WRONG = {
    "unknown verdict": ('verdict = "okay"', r"line 4: expect\.verdict cannot be 'okay'; did you mean 'ok'\? \(ok, dou"),
    "confidence 95": ("confidence = 95", r"line 4: expect\.confidence must be below 1, not 95$"),
    "no confidence": ("confidence = 0", r"line 4: expect\.confidence must be above 0, not 0$"),
    "refused and R": (
        'verdict = "refused"\nR = { value = 1 }',
        r"line 5: an estimate that must be refused has no R; le",
    ),
    "rmse": ("rmse = { i = -1 }", r"line 4: expect\.rmse\.i must be above 0, not -1$"),
    "error": (
        'standard_error = { R = "much" }',
        r"expect\.standard_error: R is 'much'; write R = \"1 %\" or a number$",
    ),
    "upside down": ("R = { min = 2, max = 1 }", r"expect\.R has min 2 and max 1; min must be the smaller one$"),
    "within nothing": (
        "R = { min = 2, within = 1 }",
        r"expect\.R has within but no value; add value = …, or a nominal",
    ),
    "plate key": ("[nameplate]\nK = 1", r"line 5: there is no key 'K' in nameplate; did you mean 'Kt'\? \(voltage, Kt"),
    "plate voltage": ("[nameplate]\nstall_torque = 1", r"stall_torque depends on the voltage; add voltage = …, in V$"),
    "plate unit": (
        '[nameplate]\nvoltage = 12\nno_load_speed = { value = 1, unit = "A" }',
        r"nameplate\.no_load_speed cannot be in 'A' \(rad/s, rpm\)$",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_in_one_sentence_with_file_and_line(name, case_of):
    text, message = WRONG[name]
    with pytest.raises(CaseError, match=message):
        case_of(f"[expect]\n{text}\n")


# Nameplate

MOTOR = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}


def test_nameplate_values_solve_the_motor_s_equations():
    found = plate_values(estimate_of(**MOTOR), voltage=10.5)
    R, K, B = MOTOR["R"], MOTOR["K"], MOTOR["B"]
    A = mpmath.matrix([[R, K], [K, -B]])  # R i + K w = V;  K i − B w = 0
    i, w = mpmath.lu_solve(A, mpmath.matrix([10.5, 0]))
    assert found["no_load_speed"].value == pytest.approx(float(w), rel=1e-14)
    assert found["no_load_current"].value == pytest.approx(float(i), rel=1e-14)
    assert found["stall_torque"].value == pytest.approx(K * 10.5 / R, rel=1e-14)
    assert list(found) == ["Kt", "R", "no_load_speed", "no_load_current", "stall_current", "stall_torque"]


def test_their_standard_errors_are_those_of_many_draws():
    rng = np.random.default_rng(0)
    correlation = np.eye(5)
    correlation[0, 1] = correlation[1, 0] = -0.9
    correlation[0, 4] = correlation[4, 0] = 0.3
    relative = 1e-3
    base = estimate_of(correlation=correlation, **MOTOR)
    parameters = {n: dataclasses.replace(p, standard_error=relative * p.value) for n, p in base.parameters.items()}
    found = plate_values(dataclasses.replace(base, parameters=parameters), voltage=10.5)
    values = np.array(list(MOTOR.values()))
    draws = values * (1 + relative * rng.multivariate_normal(np.zeros(5), correlation, size=2000))
    drawn = [plate_values(estimate_of(**dict(zip(MOTOR, row, strict=True))), voltage=10.5) for row in draws.tolist()]
    for name, plate in found.items():
        spread = np.std([each[name].value for each in drawn])
        assert plate.standard_error == pytest.approx(spread, rel=0.08)  # 5 standard errors of a spread of 2 000 draws


def test_a_nameplate_is_checked_where_it_has_a_tolerance(case_of):
    case = case_of(
        '[nameplate]\nvoltage = 10.5\nR = 3.1\nKt = { value = 0.0488, within = "1 %" }\n'
        'no_load_speed = { value = 2000, unit = "rpm", within = "5 %" }\nstall_torque = { min = 0.2 }\n'
    )
    assert plate_check_names(case.nameplate) == ("nameplate Kt", "nameplate no_load_speed", "nameplate stall_torque")
    results = plate_checks(case.nameplate, estimate_of(errors=1e-5, **MOTOR))
    assert tuple(c.name for c in results) == plate_check_names(case.nameplate)
    assert [c.outcome for c in results] == ["pass", "fail", "fail"]
    assert "expected 209.44 rad/s within 5 %" in results[1].sentence
    assert case.nameplate.values["no_load_speed"].value == pytest.approx(2000 * 2 * math.pi / 60)
    (kt, *_) = plate_checks(case.nameplate, estimate_of(R=1.0))
    assert kt.sentence == "the estimate gives no Kt: it needs R, K and B"
    (kt, *_) = plate_checks(case.nameplate, estimate_of(verdict="refused", reasons=("why",)))
    assert kt.sentence == "the estimate gives no Kt: why"
    assert plate_check_names(None) == ()


def test_expectations_are_written_so_that_they_read_back_the_same(case_of, tmp_path):
    case = Case(
        recordings=(tmp_path / "run.csv",),
        expect={"R": Expectation("R", minimum=1.0, maximum=2.5)},
        limits=Limits(("ok", "doubtful"), 0.95, {"i": 0.1}, {"R": Expectation("R", fraction=0.01)}),
        nameplate=Nameplate(12.0, {"Kt": Expectation("Kt", 0.05, absolute=0.01), "R": Expectation("R", 3.0)}),
    )
    write_case(case, tmp_path / "written.case.toml")
    assert read_case(tmp_path / "written.case.toml") == case
    assert pickle.loads(pickle.dumps(case)) == case
