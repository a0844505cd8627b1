"""Residuals that are no plain noise make a method doubtful that models no measurement chain."""

import dataclasses

import numpy as np
import pytest
from made_estimates import comparison
from motors import CML050, step_recording

from estimator.cases.case import SearchSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.judging.plain_noise import structured

pytestmark = pytest.mark.usefixtures("shared_workers")


def with_residuals(*, i=0.0, w=0.0, seed=1):
    """Return a recording whose current or speed holds something besides white noise."""
    made = comparison(seed=seed)
    measured = {"i": made.measured["i"] + i, "w": made.measured["w"] + w}
    return dataclasses.replace(made, measured=measured)


TIME = comparison().time


@pytest.mark.parametrize(("seeds", "most"), [(100, 3), pytest.param(300, 4, marks=pytest.mark.full)])
def test_white_noise_raises_no_alarm(seeds, most):
    """Each recording may raise one in 1e-3 of cases: more than 3 of 100 are a chance of 4e-6, 4 of 300 of 2e-5."""
    alarms = sum(bool(structured([with_residuals(seed=seed)])) for seed in range(seeds))
    assert alarms <= most


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"i": 0.02 * np.sin(2 * np.pi * 120 * TIME)}, "the residuals of i hold a ripple of 0.02 A at 120 Hz"),
        ({"w": np.where((TIME >= 0.51) & (TIME < 0.518), 4.0, 0.0)}, "the residuals of w lie to one side, +3."),
        ({"i": 0.006 * np.sin(TIME)}, "the residuals of i lie to one side"),
        ({"i": 0.03 * np.convolve(np.random.default_rng(3).standard_normal(TIME.size + 5), [0.4] * 6, "valid")},
         "the residuals of i "),
    ],
    ids=["ripple", "transient", "drift", "coloured"],
)  # fmt: skip
def test_what_is_no_noise_is_named_with_its_place(more, said):
    (reason,) = structured([with_residuals(**more)])
    assert said in reason and "--method cuckoo" in reason
    (place,) = reason.places
    (name,) = more
    assert (place.recording, place.signal) == ("step_10V5", name)
    if "to one side, +3." in said:
        assert place.start == pytest.approx(0.51, abs=0.004) and place.end == pytest.approx(0.517, abs=0.004)


def test_residuals_that_the_sensor_does_not_resolve_and_rounding_are_no_structure():
    shown = comparison(noise=(0.0, 0.0))
    rounded = {"i": np.round(shown.simulated["i"], 2), "w": shown.simulated["w"] * (1 + 1e-9)}
    assert structured([dataclasses.replace(shown, measured=rounded)]) == []


def test_a_few_samples_and_missing_ones_tell_nothing_and_do_no_harm():
    made = with_residuals(i=0.02 * np.sin(2 * np.pi * 120 * TIME))
    few = {n: np.where(np.arange(TIME.size) < 30, y, np.nan) for n, y in made.measured.items()}
    none = {n: np.full(TIME.size, np.nan) for n in made.measured}
    for measured in (few, none):
        assert structured([dataclasses.replace(made, measured=measured)]) == []
    holes = {n: np.where(np.arange(TIME.size) % 7 == 3, np.nan, y) for n, y in made.measured.items()}
    assert "ripple of 0.0" in structured([dataclasses.replace(made, measured=holes)])[0]


def test_the_integral_method_is_not_ok_where_a_ripple_is_left(case_of):
    recording = step_recording(CML050, noise=(0.02, 1.0), seed=1)
    angle = np.cumsum(recording.signals["speed"]) * recording.step
    ripple = np.where(recording.signals["voltage"] > 0, 0.25 * np.cos(14 * angle), 0.0)
    current = {**recording.signals, "current": recording.signals["current"] + ripple}
    case = dataclasses.replace(case_of(), search=SearchSpec(method="integral"))
    (result,) = estimate_recordings([case], [[dataclasses.replace(recording, signals=current)]])
    assert result.verdict == "doubtful" and any("the residuals of i hold a ripple" in r for r in result.reasons)
    assert all(p.standard_error is None for p in result.parameters.values())
