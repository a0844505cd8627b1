"""Statistics over a batch against hand-made and drawn numbers (gauge.py)."""

import csv

import numpy as np
import pytest

from estimator.batches.gauge import components, natural, outliers, spreads, statistics_files, statistics_text, trend


def row(case, value, *, motor="", error=0.1, verdict="ok", status="ok", plate=None):
    parameter = {"value": value, "standard_error": error, "unit": "Ohm", "at_bound": None, "status": status}
    return {
        "case": case,
        "motor": motor,
        "verdict": verdict,
        "parameters": {"R": parameter},
        "nameplate": {} if plate is None else {"Kt": {"value": plate, "standard_error": None, "unit": "N.m/A"}},
    }


def test_variance_splits_as_by_hand():
    # means 2 and 6; within (2 + 2) / 2 = 2; between 2 (4 + 4) / 1 = 16; (16 − 2) / 2 = 7
    assert components([np.array([1.0, 3.0]), np.array([5.0, 7.0])]) == (7.0, 2.0)
    assert components([np.array([1.0]), np.array([5.0])]) is None
    assert components([np.array([1.0, 3.0])]) == (0.0, 2.0)
    assert components([np.array([1.0, 3.0]), np.array([1.0, 3.0])])[0] == 0.0  # negative: none


def test_variance_of_unequal_groups_is_right_on_average():
    rng = np.random.default_rng(0)
    sizes = (1, 2, 3, 6)
    found = np.array(
        [components([rng.normal(rng.normal(0, 3), 1, size=n) for n in sizes * 5]) for _ in range(400)]
    ).mean(axis=0)
    assert found[1] == pytest.approx(1, abs=0.05)
    assert found[0] == pytest.approx(9, abs=0.8)  # 5 standard errors of the mean of 400


def test_gauge_r_and_r_of_two_motors():
    rows = [
        row(f"l[{m}, {k}]", v, motor=m)
        for m, vs in {"a": (1.0, 3.0), "b": (5.0, 7.0)}.items()
        for k, v in enumerate(vs)
    ]
    (s,) = spreads(rows)
    assert (s.motors, s.runs, s.mean, s.minimum, s.maximum) == (2, 4, 4.0, 1.0, 7.0)
    assert (s.between, s.repeats, s.total) == pytest.approx((7**0.5, 2**0.5, 3.0))
    assert s.gauge_percent == pytest.approx(100 * 2**0.5 / 3)
    assert s.categories == 2  # 1.41 √7 / √2 = 2.6
    assert s.standard_error == pytest.approx(0.1)


def test_one_case_that_leaves_much_open_is_not_what_the_cases_say_of_themselves():
    """One of 20 simulated recordings had a bar of 9 % of B among bars of 0.2 %: the root mean square was 2 %."""
    errors = [0.002] * 19 + [0.09]
    (s,) = spreads([row(f"m{k}", 1.0 + 0.001 * (k % 3), error=e) for k, e in enumerate(errors)])
    assert s.standard_error == pytest.approx(0.002)


def test_one_run_a_motor_has_a_spread_but_no_gauge():
    (s,) = spreads([row("a", 1.0), row("b", 3.0)])
    assert (s.between, s.repeats, s.gauge_percent, s.categories) == (None,) * 4
    assert s.total == pytest.approx(2**0.5)


def test_what_was_not_estimated_does_not_count():
    rows = [row("a", 1.0), row("b", 9.0, verdict="refused"), row("c", 9.0, status="not identified")]
    assert spreads([*rows, row("f", 9.0, error=None)]) == []
    assert spreads([]) == []


def test_an_outlier_stands_out_and_is_named():
    values = [3.0, 3.1, 2.9, 3.05, 2.95, 3.02, 4.5]
    assert outliers(np.array(values))[-1] == pytest.approx(0.6745 * (4.5 - 3.02) / 0.07)
    (s,) = spreads([row(f"m{k}", v) for k, v in enumerate(values)])
    assert [name for name, _, _ in s.outliers] == ["m6"]
    assert np.all(outliers(np.ones(5)) == 0)
    (few,) = spreads([row(f"m{k}", v) for k, v in enumerate([1.0, 1.0, 9.0])])
    assert few.outliers == ()


def test_a_run_of_the_only_motor_can_be_an_outlier():
    values = [3.0, 3.1, 2.9, 3.05, 2.95, 3.02, 4.5]
    (s,) = spreads([row(f"run {k}", v, motor="a") for k, v in enumerate(values)])
    assert [name for name, _, _ in s.outliers] == ["run 6"]


def test_a_trend_is_found_and_its_probability_is_right():
    rng = np.random.default_rng(1)
    p = np.array([trend(rng.standard_normal(12))[1] for _ in range(2000)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.025)  # 5 standard errors
    slope, probability = trend(3 + 0.1 * np.arange(20) + 0.01 * rng.standard_normal(20))
    assert slope == pytest.approx(0.1, rel=0.01) and probability < 1e-10
    assert trend(np.arange(4.0)) is None
    assert trend(np.ones(9)) == (0.0, 1.0)
    assert trend(np.arange(9.0))[1] < 1e-12


@pytest.mark.parametrize("runs_first", [False, True], ids=["motor by motor", "run by run"])
def test_motors_that_differ_are_no_trend(runs_first):
    """Five motors, ten runs each: 54 % of such batches had a drift with a stated chance of 1 %.

    More than 27 of 1 000, or fewer than one, by chance: 1 in 100 000 (binomial).
    """
    rng = np.random.default_rng(3)
    motors = np.repeat(np.arange(5), 10)
    motors = motors.reshape(5, 10).T.ravel() if runs_first else motors
    p = [
        trend(rng.standard_normal(5)[motors] + 0.1 * rng.standard_normal(50), [f"m{k}" for k in motors])[1]
        for _ in range(1000)
    ]
    assert 1 <= np.count_nonzero(np.array(p) < 0.01) <= 27
    slope, probability = trend(0.1 * np.arange(50) + 0.01 * rng.standard_normal(50), [f"m{k}" for k in motors])
    assert slope == pytest.approx(0.1, rel=0.02) and probability < 1e-4


def test_of_few_motors_that_were_measured_one_after_the_other_no_trend_is_told():
    assert trend(np.arange(9.0), ["a"] * 3 + ["b"] * 3 + ["c"] * 3) is None


def test_runs_are_taken_in_their_natural_order():
    assert sorted(["run 10", "run 9", "a", "run"], key=natural) == ["a", "run", "run 9", "run 10"]
    assert sorted(["5²7", "5²6"], key=natural) == ["5²6", "5²7"]  # a power is no number
    (s,) = spreads([row(f"run {k}", float(k)) for k in (10, 9, 8, 11, 12, 7)])
    assert s.drift == pytest.approx(1.0)


def test_the_statistics_are_tables_and_text():
    rows = [row(f"m{k}", 3 + 0.1 * k + 0.01 * (k % 3), plate=0.05 + k * 1e-4) for k in range(8)] + [row("m9", 30.0)]
    files = statistics_files(rows)
    lines = list(csv.DictReader(files["statistics.csv"].decode().splitlines()))
    assert [line["quantity"] for line in lines] == ["R", "nameplate Kt"]
    assert [line["motor"] for line in csv.DictReader(files["outliers.csv"].decode().splitlines())] == ["m9"]
    text = "\n".join(statistics_text(rows))
    assert "outlier: m9, R = 30 Ohm (modified z-score " in text
    assert "+0.0001 a case (p = " in text
    assert statistics_text(rows[:1]) == []
