"""Angles that start again with every turn: known by their jumps, added up, told; too fast ones are refused."""

import numpy as np
import pytest
from motors import CML050, NAMES, step_recording

from estimator.cases.case import read_case
from estimator.errors import RecordingError
from estimator.estimating.estimate import estimate_recordings
from estimator.fmus.fmu import describe
from estimator.plans.planning import plan_case
from estimator.recordings.files import recordings_in
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.turns import counted_on, is_countable, starts_again, with_turns

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


@pytest.mark.parametrize(("bits", "low"), [(16, 0), (16, -(2**15)), (32, 0), (32, -(2**31))])
def test_a_counter_that_overflows_is_counted_on_over_missing_samples_and_either_way(bits, low):
    there = np.round(np.concatenate([np.linspace(-20, 900, 300), np.linspace(900, -700, 300)]))
    shown = (there - low) % 2.0**bits + low
    if low:
        shown = (there + 2.0 ** (bits - 1) - 1 - low) % 2.0**bits + low  # over the largest number to the least
    shown[[0, 5, 6, 7]] = np.nan
    whole, found = counted_on(shown)
    known = ~np.isnan(shown)
    assert found == bits and abs(whole[1]) <= 2.0 ** (bits - 1)
    assert (np.diff(whole[known]) == np.diff(there[known])).all() and np.isnan(whole[~known]).all()


@pytest.mark.parametrize("counts", [np.linspace(0, 1e9, 50).round(), np.array([0.0, 40000.5]), np.array([np.nan, 3.0])])
def test_counts_that_do_not_overflow_stay_as_they_are(counts):
    whole, bits = counted_on(counts)
    assert whole is counts and bits is None


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


@pytest.mark.parametrize("said", ["--counts", "case"])
def test_a_recording_whose_counter_overflows_is_read_and_that_is_told(tmp_path, said):
    time = 1e-3 * np.arange(200)
    counts = np.round(np.arange(200) - 20) % 2**32
    path = tmp_path / "wheel.csv"
    rows = np.column_stack([time, np.full(200, 6.0), counts])
    np.savetxt(path, rows, delimiter=",", header="time [s],voltage [V],encoder", comments="", fmt="%.10g")
    if said == "--counts":
        (recording,) = recordings_in(path, ReadAs(counts=464))
        angle = recording.signals["encoder"]
        told = [recording.made["encoder"]]
    else:
        case = tmp_path / "wheel.case.toml"
        case.write_text('[outputs]\nangle = { column = "encoder", counts = 464 }\n[[recording]]\nfile = "wheel.csv"\n')
        plan = plan_case(read_case(case), describe("dc_motor"))
        angle, told = plan.observed[0].outputs["angle"], plan.notes
    assert np.ptp(angle[~np.isnan(angle)]) == pytest.approx(199 * TURN / 464)
    assert any("its counter of 32 bits overflows, and is counted on" in sentence for sentence in told)
