"""A batch as one page: outcomes, control charts, filters, links."""

import json
import re

import numpy as np
import pytest
from test_report import parsed

from estimator.batches.control import control_charts
from estimator.batches.line_page import line_page, outcome_of


def row(case, *, motor="", verdict="ok", R=3.0, status="ok", checks=None, reasons=()):
    """Return a case's row as a batch keeps it."""
    told = {"R": {"value": R, "standard_error": 0.01, "unit": "Ohm", "at_bound": None, "status": status}}
    return {
        "case": case,
        "motor": motor,
        "verdict": verdict,
        "reasons": list(reasons),
        "parameters": told if verdict in ("ok", "doubtful") else {},
        "nameplate": {},
        "checks": checks or {},
    }


@pytest.mark.parametrize(
    ("verdict", "checks", "outcome"),
    [
        ("ok", {}, "pass"),
        ("ok", {"R": "pass"}, "pass"),
        ("ok", {"R": "pass", "K": "undecided"}, "undecided"),
        ("ok", {"R": "fail", "K": "undecided"}, "fail"),
        ("doubtful", {"R": "pass"}, "doubtful"),
        ("doubtful", {"R": "fail"}, "fail"),
        ("refused", {}, "refused"),
        ("failed", {}, "failed"),
    ],
)
def test_a_case_has_the_worst_of_its_verdict_and_its_expectations(verdict, checks, outcome):
    assert outcome_of(row("a", verdict=verdict, checks=checks)) == outcome


def test_the_limits_are_those_of_the_moving_range():
    values = [3.0, 3.1, 3.0, 3.2, 3.1, 3.0]  # moving ranges 0.1 0.1 0.2 0.1 0.1: mean 0.12
    (chart,) = control_charts([row(f"c{k}", R=v) for k, v in enumerate(values)])
    mean = np.mean(values)
    assert (chart.mean, chart.lower, chart.upper) == pytest.approx((mean, mean - 0.3192, mean + 0.3192))
    assert chart.points == ("c0", "c1", "c2", "c3", "c4", "c5") and chart.beyond == ()


def test_a_motor_that_stands_out_is_beyond_the_limits_and_a_drift_does_not_hide_it():
    rng = np.random.default_rng(3)
    values = 3.0 + 0.02 * np.arange(30) + 0.01 * rng.standard_normal(30)
    values[20] += 1.0
    (chart,) = control_charts([row(f"c{k}", R=v) for k, v in enumerate(values.tolist())])
    assert "c20" in chart.beyond


def test_stable_motors_are_beyond_the_limits_about_three_times_in_a_thousand():
    rng = np.random.default_rng(8)
    count = 0
    for _ in range(20):
        (chart,) = control_charts(
            [row(f"c{k}", R=v) for k, v in enumerate((3 + 0.1 * rng.standard_normal(100)).tolist())]
        )
        count += len(chart.beyond)
    assert count <= 20  # of 2 000: 5.4 by the normal distribution, some more as the limits are estimated


def test_runs_of_a_motor_are_one_point_with_its_mean():
    rows = [row(f"m{m}_{r}", motor=f"m{m}", R=3.0 + m + 0.1 * r) for m in range(5) for r in range(3)]
    (chart,) = control_charts(rows)
    assert chart.points == ("m0", "m1", "m2", "m3", "m4") and len(chart.runs) == 15
    assert chart.values == pytest.approx([3.1, 4.1, 5.1, 6.1, 7.1])
    assert chart.errors == pytest.approx(np.full(5, 0.01 / np.sqrt(3)))


def test_what_is_refused_or_not_identified_is_in_no_chart():
    rows = [row("a"), row("b", verdict="refused"), row("c", status="not identified"), row("d")]
    (chart,) = control_charts(rows)
    assert chart.points == ("a", "d") and chart.lower is None
    assert control_charts(rows[:2]) == []


def test_the_page_has_a_cell_a_case_with_a_link_to_what_shows_it():
    rows = [
        row("a10", motor="M<2>"),
        row("a9", motor="M1", checks={"R": "fail"}),
        row("b", verdict="refused", reasons=["no step"]),
    ]
    html = line_page(rows, title="Batch of 3 cases", links={"a9": "cases/a9/report.html"})
    tags = parsed(html)
    text = " ".join(tags.text)
    assert "✓ pass: 1" in text and "✗ fail: 1" in text and "– refused: 1" in text and "M<2>" in text
    assert "no step" in text and "not met or undecided: R" in text and "http" not in html
    cells = re.findall(r'data-case="([^"]*)" data-outcome="(\w+)"', html)
    assert cells == [("a9", "fail"), ("a10", "pass"), ("b", "refused")], "in natural order"
    assert [value for name, value in tags.attributes if name == "href"][1:] == ["cases/a9/report.html"] * 2


def test_names_cannot_leave_the_data_of_the_page():
    rows = [row(f"</script><b>{k}") for k in range(3)]
    html = line_page(rows, title="t", links={})
    data = re.search(r'id="points">(.*?)</script>', html, re.S)[1]
    assert json.loads(data)[0]["points"][0] == "</script><b>0" and "</script><b>" not in data


def test_the_same_rows_give_the_same_page_and_thousands_stay_small():
    rows = [row(f"c{k}", R=3.0 + 0.001 * k) for k in range(2000)] + [row("bad", verdict="failed", reasons=["gone"])]
    html = line_page(rows, title="t", links={})
    assert html == line_page(rows[::-1], title="t", links={})
    assert "2000 cases that pass are in results.csv only" in html and "gone" in html and len(html) < 750_000
