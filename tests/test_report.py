"""Text, JSON and HTML of an estimate."""

import dataclasses
import html.parser
import json
import pickle
import re
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_estimates import MOTOR, comparison, estimate, profiles, with_parameter

from estimator.explaining.explained import REPORTED
from estimator.judging.outcome import parameter_estimates
from estimator.judging.verdict import Judgement, _identified
from estimator.plans.parameters import Parameter
from estimator.results import numbers, report_sentences, report_tables, report_text, result_json
from estimator.results.reason import Place, Reason
from estimator.results.report_html import html_report
from estimator.results.report_tables import estimate_texts
from estimator.results.residuals import recording_fits, whiteness
from estimator.results.result import Rival, RivalParameter, Validation
from estimator.results.text_table import TextTable

CONTRACT = {
    "verdict": str,
    "reasons": list,
    "parameters": dict,
    "correlation": dict,
    "rmse": dict,
    "fit_percent": dict,
    "simulations": int,
    "simulations_by_phase": dict,
    "failed_simulations": int,
    "steps": int,
    "seconds": float,
    "seed": int,
    "method": str,
    "fmu": dict,
    "versions": dict,
}


def check_contract(text: str) -> dict:
    """Parse the JSON of an estimate and check it against the contract; NaN and infinity are no JSON."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    result = json.loads(text, parse_constant=refuse)
    assert isinstance(result, dict)
    for key, kind in CONTRACT.items():
        assert isinstance(result[key], kind), key
    assert result["verdict"] in ("ok", "doubtful", "refused")
    assert all(isinstance(reason, str) for reason in result["reasons"])
    for parameter in result["parameters"].values():
        assert isinstance(parameter["value"], (float, type(None)))
        assert isinstance(parameter["standard_error"], (float, type(None)))
        assert isinstance(parameter["unit"], str)
        assert parameter["at_bound"] in (None, "lower", "upper")
        assert parameter["status"] in ("ok", "doubtful", "not identified")
    for name, row in result["correlation"].items():
        assert set(row) == set(result["correlation"])
        assert row[name] in (1.0, None)
    return result


def test_json_has_the_keys_of_the_contract_and_every_bit_of_the_values():
    result = check_contract(result_json.to_json(estimate()))
    assert {name: p["value"] for name, p in result["parameters"].items()} == MOTOR
    assert result["correlation"]["R"]["K"] == -0.97
    assert result["simulations_by_phase"] == {"probe": 1, "search": 180, "polish": 98, "step check": 4}


def test_json_has_null_for_what_is_not_a_number_wherever_it_comes_from():
    made = estimate(
        rmse={"i": np.float64("nan")},
        fit_percent={"i": float("-inf")},
        correlation=np.full((5, 5), np.nan),
        fmu={"path": Path("m.fmu"), "steps": (1, np.inf), "n": np.int64(3), "ok": np.bool_(True), "none": None},
    )
    made = with_parameter(made, "L", value=float("nan"), standard_error=float("inf"), upper=float("inf"))
    result = check_contract(result_json.to_json(made))
    assert result["rmse"]["i"] is None and result["fit_percent"]["i"] is None
    assert result["correlation"]["R"]["R"] is None
    assert result["parameters"]["L"]["value"] is None and result["parameters"]["L"]["standard_error"] is None
    assert result["fmu"] == {"path": "m.fmu", "steps": [1, None], "n": 3, "ok": True, "none": None}


def test_json_is_ascii_so_that_any_terminal_can_print_it():
    assert result_json.to_json(estimate(reasons=("the residual is ± 3 Ω",))).isascii()


def test_json_of_a_failure_has_the_keys_of_the_contract():
    result = check_contract(result_json.refusal_json("the FMU crashed", method="paper", seed=7))
    assert (result["verdict"], result["reasons"]) == ("refused", ["the FMU crashed"])
    assert (result["method"], result["seed"], result["parameters"]) == ("paper", 7, {})
    assert check_contract(result_json.refusal_json("x", method=None, seed=None))["seed"] == 1


@pytest.mark.parametrize(
    ("value", "error", "texts"),
    [
        (3.13712, 0.00234, ("3.1371", "0.0023")),
        (3.13712, 0.0996, ("3.14", "0.10")),
        (3.13712, 2.0, ("3.1", "2.0")),
        (0.0435, 442.0, ("0.043", "442")),  # no 0
        (-0.4149, 33.0, ("-0.41", "33")),
        (123456.0, 234.0, ("123456", "230")),
        (9.0012e-6, 2.5e-9, ("9.0012e-06", "2.5e-09")),
        (3.1363, 3e-14, ("3.13630000", "3.0e-14")),
        (9e-6, 1e-20, ("9.00000000e-06", "1.0e-20")),
        (0.048783, 3.51e-5, ("0.048783", "0.000035")),
        (0.0, 0.1, ("0.00", "0.10")),
        (3.13712, None, ("3.13712", "")),
        (0.000169, None, ("1.69e-04", "")),
        (float("nan"), 1.0, ("-", "")),
        (1.0, float("inf"), ("1", "")),
    ],
)
def test_a_value_shows_the_digits_that_its_standard_error_leaves(value, error, texts):
    if value == 123456.0:
        texts = ("123456", "234")  # digits before the point are not cut
    assert numbers.value_texts(value, error) == texts


@settings(derandomize=True)
@given(
    value=st.floats(1e-12, 1e9),
    relative=st.floats(1e-7, 10),
)
def test_a_shown_value_is_the_value_to_a_tenth_of_its_standard_error(value, relative):
    error = value * relative
    shown_value, shown_error = numbers.value_texts(value, error)
    assert abs(float(shown_value) - value) <= 0.1 * error + 1e-8 * value
    assert abs(float(shown_error) - error) <= 0.06 * error
    ulp = Decimal(1).scaleb(Decimal(shown_value).as_tuple().exponent)
    assert float(ulp) >= 1e-3 * error or ulp == 1  # no digits that mean nothing, after the point


@pytest.mark.smoke
def test_the_text_begins_with_the_verdict_and_its_reasons():
    text = report_text.text_report(estimate(verdict="doubtful", reasons=("first reason", "second reason")))
    lines = text.splitlines()
    assert lines[0].startswith("DOUBTFUL")
    assert lines[1:3] == ["  - first reason", "  - second reason"]


def test_the_text_is_a_table_whose_columns_are_aligned():
    lines = report_text.text_report(estimate()).splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("parameter"))
    rows = lines[start : start + 6]
    assert [row.split()[0] for row in rows[1:]] == list(MOTOR)
    assert len({row.index("±") for row in rows}) == 1
    assert all("0.1 %" in row for row in rows[1:])
    assert "V.s/rad" in rows[2]
    assert "nominal" not in rows[0], "nobody gave nominal values"


def test_the_text_shows_nominal_values_deviation_bounds_and_status():
    made = with_parameter(estimate(), "R", nominal=3.0, at_bound="upper", upper=3.1363)
    made = with_parameter(made, "L", standard_error=None, status="not identified", reason="too fast")
    made = with_parameter(made, "B", free=False, standard_error=None)
    text = report_text.text_report(made)
    row = {line.split()[0]: line for line in text.splitlines() if line.strip()}
    assert "+4.54 %" in row["R"] and "at its upper bound 3.1363" in row["R"]
    assert row["L"].endswith("not identified; too fast") and "±" not in row["L"]
    assert row["B"].endswith("fixed")


@pytest.mark.parametrize(
    ("value", "nominal", "text"),
    [
        (1.1, 1.0, "+10.00 %"),
        (1.00004, 1.0, "+0.004 %"),
        (-1.0, -1.000000001, "+1e-07 %"),
        (1.0, 1.0, "0 %"),
        (1e9, 1.0, "+1e+11 %"),
        (1.0, 0.0, ""),
        (float("nan"), 1.0, ""),
    ],
)
def test_a_deviation_from_the_nominal_value_is_short(value, nominal, text):
    assert numbers.deviation_text(value, nominal) == text


def test_a_reason_that_the_verdict_gave_is_not_said_again_in_the_table():
    made = estimate(verdict="doubtful", reasons=("L: the error is 14 %",))
    made = with_parameter(made, "L", status="doubtful", reason="the error is 14 %")
    assert report_text.text_report(made).count("the error is 14 %") == 1


def test_the_text_tells_fit_noise_cost_and_how_it_was_made():
    text = report_text.text_report(estimate(failures=("fmi2DoStep failed (first with 1, 2)",)))
    for part in (
        "95.2 %",
        "99.12 %",
        "0.02001      0.02  A",
        "283 simulations (1 probe, 180 search, 98 polish, 4 step check), 0 failed, 792 400 steps",
        "0.41 s, 2 workers",
        "method cuckoo, seed 1, FMU dc_motor (FMI 2.0)",
        "step from 0 to 10.5",
        "fmi2DoStep failed",
    ):
        assert part in text, part


def test_a_refused_estimate_without_anything_is_still_a_text():
    made = estimate(verdict="refused", reasons=("nothing moves",), parameters={}, rmse={}, comparisons=(), notes=())
    text = report_text.text_report(made)
    assert text.startswith("REFUSED") and "  - nothing moves" in text and "parameter  " not in text


def test_fits_near_100_percent_show_the_digits_that_differ():
    made = estimate(rmse={"a": 1.0, "b": 1.0, "c": 1.0}, fit_percent={"a": 100.0, "b": 99.99987, "c": -20.0})
    assert [row[5] for row in report_tables.signal_table(made).rows] == ["100 %", "99.99987 %", "-20.0 %"]


class Tags(html.parser.HTMLParser):
    """Checks that tags are closed in order, and collects attributes and text."""

    VOID = {"meta", "link", "img", "br", "input"}

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):  # noqa: D102
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):  # noqa: D102
        assert self.open.pop() == tag

    def handle_data(self, data):  # noqa: D102
        if self.open and self.open[-1] != "style":
            self.text.append(data)


def parsed(page: str) -> Tags:
    tags = Tags()
    tags.feed(page)
    tags.close()
    assert tags.open == []
    return tags


@pytest.mark.smoke
def test_the_html_report_stands_alone_with_the_verdict_first():
    page = html_report(
        estimate(verdict="doubtful", reasons=("L <is> weak",)),
        command="fmu-estimator estimate 'a b.csv' && rm",
        checksums={"a b.csv": "0" * 64},
    )
    tags = parsed(page)
    assert not re.search(r"https?:", page)
    links = [value for name, value in tags.attributes if name in ("src", "href")]
    assert links == ["data:,"]
    text = " ".join(" ".join(tags.text).split())
    order = ["Doubtful", "L <is> weak", "Parameters R 3.1363", "Transient", "step_10V5: measured and simulated"]
    order += ["Residuals", "Found in the data", "Correlation", "How to repeat it"]
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    for part in ("fmu-estimator estimate 'a b.csv' && rm", "0" * 64, "version of numpy", "-0.970", "3.1363"):
        assert part in text, part


def test_all_but_the_result_is_folded_away():
    page = html_report(dataclasses.replace(estimate(), profiles=profiles()))
    opened = re.findall(r'<details class="(\w+)" open>', page)
    folded = re.findall(r'<details class="(\w+)">', page)
    assert opened == ["fit", "residuals", "notes"]
    assert folded == ["correlation", "profiles", "full", "search", "repeat"]


def test_the_head_names_motor_operator_and_date_and_what_was_read():
    made = estimate(
        about={"motor": "No. <3>", "date": "2026-11-22"},
        read=({"recording": "a.csv", "text": "v ← voltage [V]"}, {"recording": "b.csv", "text": "v ← voltage [V]"}),
    )
    page, text = " ".join(parsed(html_report(made)).text), report_text.text_report(made)
    assert "motor: No. <3>" in page and "date: 2026-11-22" in page
    for shown in (page, text):
        assert "read a.csv, b.csv: v ← voltage [V]" in shown
        assert shown.index("read a.csv") < min(shown.find(w) % len(shown) for w in ("OK", "OK:"))
    assert "motor No. <3>, date 2026-11-22" in text
    assert json.loads(result_json.to_json(made))["about"] == {"motor": "No. <3>", "date": "2026-11-22"}


def test_error_bars_lie_on_one_relative_axis():
    made = with_parameter(estimate(), "R", standard_error=0.04 * MOTOR["R"])
    page = html_report(made)
    assert page.count("+10 %") == 1, "the axis, once: 2 standard errors of R are 8 %"
    ends = dict(re.findall(r'aria-label="(\w+): ± [^"]*".*?class="bar2" d="M[\d.]+ [\d.]+H([\d.]+)"', page))
    middle, half = 80, 74  # pixels of a bar: 160 wide, 6 left free at each end
    assert float(ends["R"]) == pytest.approx(middle + half * 0.8, abs=0.1)
    assert float(ends["K"]) == pytest.approx(middle + half * 0.02, abs=0.1)


def test_a_refused_recording_is_shown_with_the_place_where_the_reason_lies():
    shown = dataclasses.replace(comparison(), simulated={})
    reason = Reason("step_10V5: w is saturated", Place("step_10V5", "w", 0.52, 0.6))
    made = estimate(verdict="refused", reasons=(reason,), parameters={}, rmse={}, comparisons=(shown,), history=None)
    page = html_report(made)
    text = " ".join(parsed(page).text)
    assert "Where the reason lies" in text and "Transient" not in text and "simulated" not in text
    assert page.count('class="place" x=') == 4, (
        "in the enlarged part and in the whole recording, wide and slim, of the speed only"
    )
    (told,) = json.loads(result_json.to_json(made))["places"]
    assert told == {"reason": 0, "recording": "step_10V5", "signal": "w", "start": 0.52, "end": 0.6}
    doubted = html_report(dataclasses.replace(estimate(verdict="doubtful", reasons=(reason,))))
    assert "Transient" in doubted and 'class="place" x=' in doubted, "a transient that was fitted stays, and is marked"
    again = pickle.loads(pickle.dumps(reason))
    assert again == reason and again.places == reason.places and json.dumps(reason) == '"step_10V5: w is saturated"'


def rival(**changes):
    """Return another explanation, in which R is 6 % higher and L is at a bound."""
    found = {"R": RivalParameter(1.06 * MOTOR["R"], 0.01, "Ohm"), "L": RivalParameter(MOTOR["L"], None, "H")}
    made = Rival("sag instead of a <dip>", found, "R", MOTOR["R"], 4.2, 3.5, 0.15, "record two voltage levels")
    return dataclasses.replace(made, **changes)


def test_rivals_stand_in_the_report_on_one_axis_over_the_estimate_and_in_json():
    made = estimate(verdict="doubtful", rivals=(rival(),))
    page = html_report(made)
    text = " ".join(" ".join(parsed(page).text).split())
    assert "Rivals, and what they differ in the estimate R 3.1363 ± 0.0031 Ohm" in text
    assert "sag instead of a <dip> (weight 15 %): record two voltage levels R 3.324 ± 0.010 Ohm +6 %" in text
    assert 'aria-label="R: +6 % from the estimate"' in page and "+7 %" in text, "the axis holds its bar"
    (told,) = json.loads(result_json.to_json(made))["rivals"]
    assert told["what"] == "sag instead of a <dip>" and told["decided_by"] == "record two voltage levels"
    assert told["parameters"]["L"] == {"value": MOTOR["L"], "standard_error": None, "unit": "H"}
    assert (told["differs_in"], told["delta_criterion"], told["weight"]) == ("R", 3.5, 0.15)
    assert "nearly as well, with R = 3.324 instead of 3.136; record two voltage levels" in rival().sentence()
    assert "better, by the noise that was found, with R = 3.324" in rival(behind=-63.0).sentence()
    assert "Rivals" not in html_report(estimate()) and json.loads(result_json.to_json(estimate()))["rivals"] == []


def test_parameters_of_each_recording_are_compared():
    two = tuple(comparison(np.full(300, 10.5), name=f"run{k}") for k in (1, 2))
    made = estimate(comparisons=two)
    own = {f"R run{k}": dataclasses.replace(made.parameters["R"], name=f"R run{k}", value=3.0 + k) for k in (1, 2)}
    made = dataclasses.replace(made, parameters={**own, "K": made.parameters["K"]})
    text = " ".join(parsed(html_report(made)).text)
    assert "Parameters across recordings" in text and "weighted mean" in text
    assert "across recordings" not in html_report(estimate())


def test_each_recording_has_its_own_root_mean_square_error():
    two = tuple(comparison(np.full(300, 10.5), name=f"run{k}", noise=(0.01 * k, 1.0)) for k in (1, 2))
    (one, _, other, _) = recording_fits(two)
    assert (one.recording, one.output, one.unit, one.samples) == ("run1", "i", "A", 300)
    assert one.rmse == pytest.approx(0.01, rel=0.15) and other.rmse == pytest.approx(0.02, rel=0.15)
    text = " ".join(parsed(html_report(estimate(comparisons=two))).text)
    assert f"{other.rmse:.4g}" in text


def test_the_autocorrelation_is_that_of_the_noise():
    rng = np.random.default_rng(5)
    made = comparison()
    e = rng.standard_normal(2801)
    coloured = np.convolve(e, [1.0, 0.5, 0.25], mode="same")  # correlations 0.476, 0.190
    gap = np.where(np.arange(2801) % 50 == 0, np.nan, 1.0)
    signals = {"i": made.simulated["i"] + coloured * gap, "w": made.simulated["w"] + e}
    current, speed = whiteness((dataclasses.replace(made, measured=signals),))
    # of 2 801 samples a correlation is known to 0.019: four of those
    assert current.correlation[:4] == pytest.approx([1, 0.476, 0.19, 0], abs=0.08)
    assert np.mean(np.abs(speed.correlation[1:]) < speed.chance) > 0.8
    assert np.sum(speed.density * np.diff(speed.edges)) == pytest.approx(1, abs=0.001)


def test_what_was_taken_out_of_the_residuals_is_not_in_their_autocorrelation():
    made = comparison()
    wave = np.cos(made.time * 200)
    measured = {**made.measured, "i": made.measured["i"] + wave}
    spiked = np.zeros(2801, dtype=bool)
    spiked[1000] = True
    measured["i"][1000] += 50
    shown = dataclasses.replace(made, measured=measured, taken_out={"i": wave}, left_out={"i": spiked})
    current = whiteness((shown,))[0]
    assert np.abs(current.correlation[1:]).max() < 0.1


def test_the_html_report_of_a_refusal_has_no_empty_parts():
    made = estimate(
        verdict="refused",
        reasons=("nothing moves",),
        parameters={},
        rmse={},
        comparisons=(),
        notes=(),
        correlation=None,
        correlated=(),
        history=None,
    )
    page = html_report(made)
    parsed(page)
    assert "<h2>" not in page and "Correlation" not in page and "<svg" not in page


def test_the_html_report_escapes_what_a_recording_is_called():
    page = html_report(estimate(comparisons=(comparison(name="<b>&.csv"),)))
    assert "<b>&" not in page and "&lt;b&gt;&amp;.csv" in page


def test_json_ready_makes_text_of_what_it_does_not_know():
    assert result_json.json_ready({1: {3.5}, "x": Path("a/b")}) == {"1": [3.5], "x": "a/b"}


def test_how_the_fmu_was_driven_is_told_where_it_is_not_the_usual_way():
    usual = {"name": "motor", "fmi_version": "2.0", "kind": "co-simulation", "restart": "reset"}
    other = usual | {"kind": "model-exchange", "restart": "re-instantiate"}
    for fmu, told in ((usual, "(FMI 2.0)"), (other, "(FMI 2.0, model exchange, restarted by re-instantiate)")):
        assert report_sentences.cost_lines(dataclasses.replace(estimate(), fmu=fmu))[-1].endswith(f"FMU motor {told}")


NOTES = tuple(f"note {k}: " + "a long sentence of many words that goes beyond a line, " * 2 for k in range(12))
REASONS = tuple(f"reason {k}: " + "something of which much can be said, " * 4 for k in range(6))


@pytest.mark.parametrize(("reasons", "notes"), [((), NOTES), (REASONS[:2], NOTES), (REASONS, NOTES), (REASONS, ())])
def test_a_screen_has_forty_lines_of_its_width_and_says_where_the_rest_is(reasons, notes):
    made = estimate(verdict="doubtful", reasons=reasons, notes=notes)
    whole = report_text.text_report(made)
    text = report_text.text_report(made, width=80, lines=40, rest="in out/report.html")
    assert len(text.splitlines()) <= 40 and all(len(line) <= 80 for line in text.splitlines())
    assert all(f"- {sentence[:8]}" in text for sentence in reasons[:3])
    assert all(name in text for name in ("N.m.s/rad", "method cuckoo, seed 1", "99.12 %"))
    if len(whole.splitlines()) > 40 or notes:
        assert "in out/report.html" in text
    assert all(sentence in whole for sentence in (*reasons, *notes)), "a file is no screen"


def test_a_short_answer_leaves_nothing_out_on_a_screen():
    made = estimate()
    text = report_text.text_report(made, width=120, lines=40)
    assert text == report_text.text_report(made) and report_text.REST not in text


def test_what_was_fitted_to_a_held_out_recording_is_said():
    alone = Validation((comparison(),), {"i": 0.02}, {"i": 95.0})
    own = dataclasses.replace(alone, chain={"R": 3.0031, "delay": 5.2e-3}, units={"R": "Ohm", "delay": "s"})
    assert report_sentences.fitted_here(alone) == "Nothing was fitted to these recordings."
    told = "Fitted to these recordings: R = 3.003 Ohm, delay = 0.0052 s; nothing else was."
    assert report_sentences.fitted_here(own) == told
    made = dataclasses.replace(estimate(), validation=own)
    page = " ".join(parsed(html_report(made)).text)
    assert told in report_text.text_report(made) and told in page and "Nothing was fitted" not in page


def test_an_ok_without_standard_errors_does_not_say_that_parameters_are_identified():
    made = estimate()
    for name in MOTOR:
        made = with_parameter(made, name, standard_error=None)
    assert report_text.text_report(made).startswith("OK: The residuals are as small as the noise; this method gives no")
    assert "identified" not in report_sentences.meaning(made) and "identified" in report_sentences.meaning(estimate())


def test_the_two_noises_stand_in_one_table():
    made = estimate(sample_noise={"i": 0.0057, "w": 2.3})
    made_table = report_tables.signal_table(made)
    assert made_table.header[:4] == ["output", "RMSE", "residual", "noise"]
    assert made_table.rows[0][:4] == ["i", "0.02001", "0.02", "0.0057"]
    assert "RMSE  residual   noise" in report_text.text_report(made)
    assert json.loads(result_json.to_json(made))["sample_noise"] == {"i": 0.0057, "w": 2.3}


def test_an_error_is_shown_wherever_it_is_known_and_no_digits_of_what_is_not_identified():
    vague = with_parameter(estimate(), "R", value=0.137593, standard_error=70.0)
    assert report_tables.estimate_texts(vague.parameters["R"]) == ("0.14", "70", "> 100 %")
    unknown = with_parameter(vague, "R", value=0.137593, standard_error=70.0, status="not identified")
    assert report_tables.estimate_texts(unknown.parameters["R"]) == ("0.138", "", "> 100 %")
    for text in (report_text.text_report(unknown), html_report(unknown)):
        assert "0.138" in text and "> 100 %" in text.replace("&gt;", ">") and "0.137593" not in text.split("Bounds")[0]


@pytest.mark.parametrize(("error", "told"), [(2.7e11, False), (0.8, True)])
def test_what_has_an_error_far_beyond_it_is_no_measurement(error, told):
    """A friction of the measurement chain; an offset near 0 that is known to be near it stays one."""
    friction = Parameter("friction", "N.m", 0.0, 1.0, log=False, targets=(), place=REPORTED)
    polish = SimpleNamespace(standard_errors=np.array([error]), at_bound=np.array([0]))
    plan = SimpleNamespace(parameters=(friction,), fixed={})
    assert not _identified(
        plan, {"friction": 1e-9}, SimpleNamespace(standard_errors=np.array([0.1]), at_bound=np.array([0]))
    )
    statuses = _identified(plan, {"friction": 0.43}, polish)
    found = parameter_estimates(plan, np.array([0.43]), polish, Judgement("doubtful", (), statuses))["friction"]
    assert (found.status, found.standard_error) == (("ok", error) if told else ("not identified", None))
    assert estimate_texts(found) == (("0.43", "0.80", "> 100 %") if told else ("-", "", ""))
    assert told or "more than 100 times the value" in found.reason


def test_one_note_that_is_left_out_is_one_note():
    made = estimate(notes=("a first thing " * 20,), failures=("once " * 60,))
    text = report_text.text_report(made, width=60, lines=20)
    assert "Failed simulations: 1 note, " in text and "1 notes" not in text


def test_marks_beside_the_bars_are_explained_where_they_are_drawn():
    plain = estimate()
    assert "upright line" not in html_report(plain) and "A diamond" not in html_report(plain)
    near = with_parameter(plain, "R", lower=3.132, nominal=3.138)
    assert "An upright line is a bound. A diamond is the nominal value." in html_report(near)


def test_an_ok_says_what_hangs_on_a_unit_that_nobody_said():
    told = {"column": "n", "unit": "rpm", "unit_from": "name"}
    guessed = dataclasses.replace(estimate(), read=({"recording": "a", "text": "", "signals": {"w": told}},))
    assert report_sentences.meaning(guessed).endswith(" K, J, B hold if 'n' is in rpm, which nobody said.")
    said = dataclasses.replace(
        guessed, read=({"recording": "a", "text": "", "signals": {"w": {**told, "unit_from": "user"}}},)
    )
    assert report_sentences.meaning(said) == f"{report_sentences.MEANINGS['ok']}, and {report_sentences.SMALL}."


def test_the_sentence_of_an_ok_says_of_the_residuals_what_the_table_shows():
    """Residuals of 0.02 A and 1 rad/s, by the recording's own noise and by one that is smaller."""
    same = estimate(sample_noise={"i": 0.0185, "w": 1.4})
    assert report_sentences.meaning(same) == f"{report_sentences.MEANINGS['ok']}, and {report_sentences.SMALL}."
    grown = estimate(sample_noise={"i": 0.0045, "w": 1.4})
    told = report_sentences.meaning(grown)
    assert "small" not in told and "wanders (those of i 4.4 times the noise that the recording alone shows" in told
    assert " ".join(report_text.text_report(grown, width=60).split()).startswith(f"OK: {told}")
    assert told in " ".join(" ".join(parsed(html_report(grown)).text).split())
    assert json.loads(result_json.to_json(grown))["meaning"] == told
    searched = dataclasses.replace(grown, noise={}, sample_noise={"i": 0.01, "w": 0.5})
    for name in MOTOR:
        searched = with_parameter(searched, name, standard_error=None)
    assert report_sentences.meaning(searched).startswith(
        "The residuals pass as noise (those of i 2 times, those of w 2 times"
    )


def test_residuals_of_rounding_are_as_small_as_no_noise():
    exact = estimate(noise={"i": 1e-9, "w": 1e-9}, sample_noise={"i": 0.0, "w": 0.0}, fit_percent={"i": 100, "w": 100})
    assert report_sentences.SMALL in report_sentences.meaning(exact)
    none = dataclasses.replace(exact, noise={"i": 1e-2, "w": 1e-9}, fit_percent={"i": 99.0, "w": 100})
    assert "(those of i far above the noise" in report_sentences.meaning(none)


def test_a_table_that_is_too_wide_goes_on_below_itself():
    table = TextTable(
        ["name", "value", "error", "", "unit"],
        [["R", "3.14", "± 0.01", "", "Ohm"], ["K", "0.05", "± 0.1", "", "V"]],
        (1,),
    )
    whole = table.lines()
    assert table.lines(len(whole[0])) == whole
    parts = "\n".join(table.lines(14)).split("\n\n")
    assert [part.split("\n")[0].split() for part in parts] == [["name", "value"], ["name", "error"], ["name", "unit"]]
    assert all(len(line) <= 14 for part in parts for line in part.split("\n"))
    noted = TextTable(["name", "value", "note"], [["R", "3.14", ""], ["K", "0.05", "doubtful"]], (1,))
    assert noted.lines(13)[-2:] == ["name  note", "K     doubtful"]  # R has none
    made = report_text.text_report(estimate(), width=40, lines=30)
    assert all(len(line) <= 40 for line in made.split("\n")), made
