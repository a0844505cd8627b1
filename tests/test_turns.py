"""Angles that start again with every turn: known by their jumps, added up, told; too fast ones are refused."""

import numpy as np
import pytest
from motors import CML050, NAMES, step_recording

from estimator.errors import RecordingError
from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.turns import is_countable, starts_again, with_turns

pytestmark = pytest.mark.usefixtures("shared_workers")

TURN = 2 * np.pi


def test_an_angle_that_goes_on_does_not_start_again():
    assert not starts_again(np.linspace(0, 100, 500))
    assert not starts_again(np.linspace(0, 6.2, 500))
    assert not starts_again(np.array([np.nan, 1.0]))


@pytest.mark.parametrize("low", [0.0, -np.pi])
def test_turns_are_added_up_over_missing_samples_and_either_way(low):
    there = np.concatenate([np.linspace(0, 40, 400), np.linspace(40, -30, 700)])
    shown = (there - low) % TURN + low
    shown[[3, 300, 301]] = np.nan
    assert starts_again(shown)
    whole = with_turns(shown)
    known = ~np.isnan(shown)
    np.testing.assert_allclose(np.diff(whole[known]), np.diff(there[known]), atol=1e-9)
    assert np.isnan(whole[~known]).all()


def test_half_a_turn_a_sample_cannot_be_counted():
    assert not is_countable(with_turns(np.arange(100) * 0.9 * np.pi % TURN))


def angle_alone(case_of, angle):
    r = step_recording(CML050, noise=(0.02, 1.0), seed=6)
    signals = {
        "voltage [V]": r.signals["voltage"],
        "current [A]": r.signals["current"],
        "angle [deg]": np.degrees(angle),
    }
    recording = recording_from_arrays("wrapped", r.time, signals)
    return estimate_recordings([case_of()], [[recording]], workers=1)[0]


def test_a_motor_is_estimated_from_an_angle_that_starts_again(case_of):
    r = step_recording(CML050)
    w, rng = r.signals["speed"], np.random.default_rng(3)
    angle = np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2) * r.step]) + rng.normal(0, 1e-3, len(w))
    result = angle_alone(case_of, (angle + 3.0) % TURN)
    assert "wrapped: angle starts again with every turn; its turns are added up" in result.notes
    for name in NAMES:  # the trapezoid is off by h²/12 of the acceleration's change only
        assert result.parameters[name].value == pytest.approx(CML050.parameters[name], rel=0.02)


def test_turns_that_cannot_be_counted_are_said(case_of):
    with pytest.raises(RecordingError, match="moves by nearly half a turn from row to row"):
        angle_alone(case_of, np.arange(2801) * 0.9 * np.pi % TURN)
