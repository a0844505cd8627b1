"""What no recording tells, propagated: against closed forms, and against least squares on the exact response."""

import dataclasses
import json
from pathlib import Path

import forked
import numpy as np
import pytest
from motors import CML050, held_response, recording_of, step_recording
from scipy.linalg import expm

from estimator.cases.expectation import Expectation, Limits, checks
from estimator.cases.tolerance import tolerances
from estimator.errors import CaseError
from estimator.estimating.estimate import estimate_recordings
from estimator.results.budget_table import budget_line, budget_table
from estimator.results.handover import estimate_from_json
from estimator.results.result_json import to_json, to_mapping

EXAMPLE = Path(__file__).parent.parent / "examples" / "cml050_step.csv"

pytestmark = pytest.mark.usefixtures("shared_workers")

U = 0.01
GIVEN = {
    "i gain": "1 % (k=1)",
    "v gain": "1 % (k=1)",
    "w gain": "1 % (k=1)",
    "supply resistance": "0.05 Ohm",
    "brush drop": "0.105 V (k=1)",
    "dry friction": "10 % (k=1)",
    "temperature": "5 K (k=1)",
    "clock": "1 % (k=1)",
}
R, K, L, J, B = CML050.parameters.values()
NOISE = (0.02, 1.0)


@pytest.fixture(scope="module")
def made(case_of):
    """Return the estimates of a noisy step with all tolerances, and of a noise-free one with two."""
    cases = [
        dataclasses.replace(case_of("cuckoo"), tolerance=tolerances(GIVEN)),
        dataclasses.replace(case_of("cuckoo"), tolerance=tolerances({"i gain": "1 %", "v gain": "1 %"})),
    ]
    noisy, clean = step_recording(CML050, noise=NOISE, seed=3), step_recording(CML050)
    return estimate_recordings(cases, [[noisy], [clean]])


def relative(estimate, source):
    return {n: p.budget[source] / p.value for n, p in estimate.parameters.items() if p.free}


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("i gain", [-U, 0, -U, U, U]),  # v = R i + L i' + K w and K i = J w' + B w with i (1 + g)
        ("v gain", [U] * 5),  # v (1 + g)
        ("w gain", [0, -U, 0, -2 * U, -2 * U]),
        ("supply resistance", [0.05 / 3**0.5 / R, 0, 0, 0, 0]),
        ("brush drop", [0.105 / 10.5] * 5),  # of one level: the voltage less a constant
        ("temperature", [0.00393 * 5, 0, 0, 0, 0]),
        ("clock", [0, 0, U, U, 0]),  # L i' and J w' by intervals (1 + c)
    ],
)
def test_the_part_of_each_source_is_its_closed_form(made, source, expected):
    found = relative(made[0], source)
    assert list(found.values()) == pytest.approx(expected, abs=3e-4)
    assert made[0].tolerances[source].left == pytest.approx(1.0)


def test_the_part_of_dry_friction_is_what_least_squares_makes_of_the_exact_response(made):
    """The motor's equations with a constant torque, by the matrix exponential, and a central Jacobian."""
    voltage = np.where(np.arange(2801) >= 500, 10.5, 0.0)

    def response(parameters, torque=0.0):
        r, k, ell, j, b = parameters
        whole = np.zeros((4, 4))
        whole[:2] = [[-r / ell, -k / ell, 1 / ell, 0], [k / j, -b / j, 0, -1 / j]]
        step = expm(whole * 1e-3)
        x, rows = np.zeros(2), []
        for v in voltage:
            rows.append(x)
            x = step[:2, :2] @ x + step[:2, 2] * v + step[:2, 3] * (torque if v else 0.0)
        return (np.array(rows) / NOISE).ravel()

    theta = np.array([R, K, L, J, B])
    steps = np.exp(1e-4 * np.eye(5))
    jacobian = np.column_stack([(response(theta * s) - response(theta / s)) / 2e-4 for s in steps])
    torque = 0.1 * B * held_response(CML050, voltage, step=1e-3)[-1, 1]
    column = (response(theta, torque) - response(theta, -torque)) / 2
    shift = np.linalg.lstsq(jacobian, column, rcond=None)[0]
    left = made[0].tolerances["dry friction"].left
    found = np.array(list(relative(made[0], "dry friction").values())) / left
    np.testing.assert_allclose(found, shift, atol=0.1 * np.abs(shift).max())
    assert 0 < left <= 1


def test_the_uncertainty_is_the_root_of_the_sum_of_squares_and_the_standard_error_stays_statistical(made):
    data = to_mapping(made[0])
    for name, p in data["parameters"].items():
        parts = data["budget"][name]
        assert set(parts) == set(GIVEN) and all(part >= 0 for part in parts.values())
        whole = np.sqrt(p["standard_error"] ** 2 + np.sum(np.square(list(parts.values()))))
        assert p["uncertainty"] == pytest.approx(whole) and p["uncertainty"] > p["standard_error"]
        assert p["repeatability"] is None
    assert data["tolerance"]["i gain"]["standard_uncertainty"] == U


def test_what_follows_from_the_parameters_moves_with_them(made):
    """The speed per volt goes by 1 / (1 + g) with a voltage that reads high by g, and knows no current."""
    derived = made[0].derived["speed_per_volt"]
    assert derived.budget["v gain"] / derived.value == pytest.approx(-U, abs=3e-4)
    assert derived.budget["w gain"] / derived.value == pytest.approx(U, abs=3e-4)
    assert abs(derived.budget["i gain"]) / derived.value < 3e-4
    assert derived.uncertainty == pytest.approx(
        np.hypot(derived.standard_error, np.linalg.norm(list(derived.budget.values())))
    )


def test_a_noise_free_fit_has_its_budget_too(made):
    expected = np.array([1, 0, 1, 1, 1]) * 0.01 / 3**0.5
    found = np.abs(list(relative(made[1], "i gain").values()))
    assert made[1].verdict == "ok" and found == pytest.approx(expected, abs=1e-4)


def test_limits_hold_for_the_whole_uncertainty(made):
    expect = {"R": Expectation("R", R, fraction=0.02)}
    alone = dataclasses.replace(
        made[0], parameters={n: dataclasses.replace(p, budget={}) for n, p in made[0].parameters.items()}
    )
    for estimate, outcome in ((made[0], "undecided"), (alone, "pass")):
        assert checks(expect, Limits(confidence=0.95), estimate)[1].outcome == outcome


def test_the_budget_is_a_table_a_line_and_comes_back_from_json(made):
    table = budget_table(made[0])
    rows = table.rows
    assert table.header == ["uncertainty from", "given", "R", "K", "L", "J", "B"]
    assert [row[0] for row in rows] == ["noise and runs", *GIVEN, "combined"]
    assert rows[1][1:3] == ["1 % (k=1), normal", "1 %"]
    assert budget_line(made[0]).startswith("With i gain, v gain, w gain, supply resistance, brush drop,")
    again = estimate_from_json(to_json(made[0]))
    assert again.tolerances == made[0].tolerances
    assert again.parameters["R"].uncertainty == pytest.approx(made[0].parameters["R"].uncertainty)


def test_two_levels_tell_a_brush_drop_that_one_leaves_open(case_of):
    """Of 0.5 V two levels leave a hundredth or so; a gain stays as it is. Ten times 0.02 by chance: never."""
    n = 2000
    voltage = np.where(np.arange(n) < 100, 0.0, np.where(np.arange(n) < 1000, 5.0, 12.0))
    shown = held_response(CML050, voltage, step=1e-3)
    clock = np.arange(n) * 1e-3
    recording = recording_of("levels", clock, voltage, shown, noise=NOISE, seed=2)
    case = dataclasses.replace(case_of("cuckoo"), tolerance=tolerances({"brush drop": "0.5 V", "i gain": "1 %"}))
    (estimate,) = estimate_recordings([case], [[recording]])
    assert estimate.tolerances["brush drop"].left < 0.2 and estimate.tolerances["i gain"].left == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("source", "text", "part"),
    [
        ("x gain", "1 %", "the tolerance 'x gain' is of no output or input of this case (i, w, v); leave it out"),
        ("angle gain", "1 %", "the tolerance 'angle gain' is of no output or input of this case"),
    ],
)
def test_a_tolerance_that_the_case_has_nothing_for_is_an_error_before_the_search(case_of, source, text, part):
    case = dataclasses.replace(case_of("cuckoo"), tolerance=tolerances({source: text}))
    with pytest.raises(CaseError) as raised:
        estimate_recordings([case], [[step_recording(CML050)]])
    assert part in str(raised.value)


def test_the_command_line_takes_tolerances_and_refuses_wrong_ones_in_a_sentence(tmp_path):
    def run(*words):
        return forked.run("estimate", str(EXAMPLE), "--json", *words, cwd=tmp_path)

    done = run("--tolerance", "default", "--tolerance", "i gain=2 %")
    data = json.loads(done.stdout)
    assert done.returncode == 0 and data["tolerance"]["i gain"]["given"] == "2 %"
    assert data["budget"]["R"]["i gain"] == pytest.approx(0.02 / 3**0.5 * data["parameters"]["R"]["value"], rel=0.05)
    wrong = run("--tolerance", "i gian=2 %")
    assert wrong.returncode == 2 and "there is no tolerance 'i gian'" in wrong.stderr and wrong.stderr.count("\n") == 1
