"""The measurement chain found in emulated recordings: freed where the data show it, left alone where they do not."""

import dataclasses

import numpy as np
import pytest
from motors import CML050, NAMES, held_response, recording_of, step_recording

from estimator.cases.case import Case, Chebyshev1, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.recording import Recording, recording_from_arrays


def run(case: Case, *recordings: Recording):
    return estimate_recordings([case], [list(recordings)], workers=1)[0]


def worst(result, motor=CML050):
    """Return the largest error in standard errors."""
    return max(
        abs(result.parameters[n].value - motor.parameters[n]) / result.parameters[n].standard_error for n in NAMES
    )


def with_signals(recording: Recording, *, current=None, speed=None, voltage=None) -> Recording:
    s = recording.signals
    return recording_from_arrays(
        "changed",
        recording.time,
        {
            "voltage [V]": s["voltage"] if voltage is None else voltage,
            "current [A]": s["current"] if current is None else current,
            "speed [rad/s]": s["speed"] if speed is None else speed,
        },
    )


@pytest.fixture(scope="module")
def noisy():
    return step_recording(CML050, noise=(0.02, 1.0), seed=3)


def test_a_clean_recording_frees_nothing(case_of, noisy):
    result = run(case_of(), noisy)
    assert set(result.parameters) == set(NAMES)
    assert result.verdict == "ok"
    assert worst(result) < 5


@pytest.mark.parametrize("late", [3, 77, 250])
def test_a_delay_is_found_and_estimated(case_of, noisy, late):
    voltage = np.concatenate([noisy.signals["voltage"][late:], np.full(late, 10.5)])
    result = run(case_of(), with_signals(noisy, voltage=voltage))
    assert result.chain["delay"].value == pytest.approx(late * 1e-3, abs=2e-4)
    assert abs(result.chain["delay"].value - late * 1e-3) < 5 * result.chain["delay"].standard_error
    assert worst(result) < 5


def test_offsets_are_found_and_estimated(case_of, noisy):
    result = run(case_of(), with_signals(noisy, current=noisy.signals["current"] + 0.01))
    offset = result.chain["offset i"]
    assert abs(offset.value - 0.01) < 5 * offset.standard_error
    assert worst(result) < 5


@pytest.mark.parametrize("samples", [2, 4])
def test_a_logger_that_averages_is_found_out(case_of, noisy, samples):
    padded = np.concatenate([np.zeros(samples - 1), noisy.signals["current"]])
    mean = np.convolve(padded, np.full(samples, 1 / samples), "valid")
    result = run(case_of(), with_signals(noisy, current=mean))
    assert f"i is a mean over the last {samples} samples" in " ".join(result.notes)
    assert worst(result) < 5


@pytest.mark.parametrize("late", [1, 3])
def test_a_current_that_comes_late_is_not_taken_for_lost_samples(case_of, noisy, late):
    current = np.concatenate([noisy.signals["current"][:late], noisy.signals["current"][:-late]])
    result = run(case_of(), with_signals(noisy, current=current))
    assert result.verdict == "ok"
    assert result.chain["delay"].value == pytest.approx(late * 1e-3, abs=2e-4)
    assert result.chain["delay w"].value == pytest.approx(-late * 1e-3, abs=2e-4)
    assert any(note.startswith("i comes later than w") for note in result.notes)
    assert worst(result) < 5


@pytest.mark.parametrize("samples", [2, 3])
def test_a_mean_whose_noise_is_white_is_not_taken_for_lost_samples(case_of, samples):
    clean, rng = step_recording(CML050), np.random.default_rng(5)
    padded = np.concatenate([np.zeros(samples - 1), clean.signals["current"]])
    current = np.convolve(padded, np.ones(samples) / samples, mode="valid") + rng.normal(0, 0.02, len(clean.time))
    speed = clean.signals["speed"] + rng.normal(0, 1, len(clean.time))
    result = run(case_of(), with_signals(clean, current=current, speed=speed))
    assert result.verdict == "ok"
    assert any(f"i is a mean over the last {samples} samples" in note for note in result.notes)
    assert worst(result) < 5


def test_a_step_down_to_rest_is_estimated(case_of):
    recording = step_recording(CML050, noise=(0.02, 1.0), seed=2, levels=(10.5, 0.0))
    result = run(case_of(), recording)
    assert result.verdict == "ok"
    assert worst(result) < 5


def test_outliers_are_held_down_and_missing_samples_do_no_harm(case_of, noisy):
    """Two of the 31 outliers stand side by side. Were one of them taken for noise, this would be 1.1 times as large."""
    rng = np.random.default_rng(4)
    current, speed = noisy.signals["current"].copy(), noisy.signals["speed"].copy()
    hit = rng.random(len(current)) < 0.01
    assert np.any(hit[1:] & hit[:-1])
    current[hit] += 1.0
    speed[rng.random(len(speed)) < 0.05] = np.nan
    result = run(case_of(), with_signals(noisy, current=current, speed=speed))
    assert result.verdict == "ok", result.reasons
    assert f"i has {hit.sum()} outliers, weighted by Student's t" in result.notes
    assert result.noise["i"] == pytest.approx(0.02, rel=0.08)
    assert worst(result) < 3


def test_ripple_locked_to_the_angle_is_taken_out(case_of, noisy):
    clean = step_recording(CML050).signals["speed"]
    angle = np.cumsum(clean) * 1e-3
    ripple = 0.09 * np.cos(14 * angle + 1) * (np.arange(len(angle)) > 500)
    result = run(case_of(), with_signals(noisy, current=noisy.signals["current"] + ripple))
    (note,) = [note for note in result.notes if "ripple" in note]
    assert note.startswith("i has a ripple at an order of the shaft's angle") and ": 14 (0.0" in note
    (shown,) = result.comparisons
    assert set(shown.taken_out) == {"i"}, "the figure shows what the note says"
    assert np.corrcoef(shown.taken_out["i"][600:], ripple[600:])[0, 1] > 0.99
    assert result.noise["i"] == pytest.approx(0.02, rel=0.1)
    assert worst(result) < 5


def test_a_drift_is_named_and_makes_the_estimate_doubtful(case_of, noisy):
    k = np.arange(len(noisy.time))
    line = np.where(k > 520, (k - 1650) / 2300, 0.0)
    result = run(case_of(), with_signals(noisy, current=noisy.signals["current"] + 0.04 * line))
    assert result.verdict == "doubtful"
    told = [float(reason.split()[3]) for reason in result.reasons if reason.startswith("i drifts by")]
    assert told == pytest.approx([0.04], rel=0.2)  # its deviation is 0.003


def test_a_supply_that_sags_is_named(case_of, noisy):
    sagging = dataclasses.replace(CML050, voltage=10.5)
    k = np.arange(2801)
    voltage = np.where(k >= 500, 10.5 * (1 - 0.05 * np.exp(-(k - 500) / 30)), 0.0)
    shown = held_response(sagging, voltage, step=1e-3)
    recording = recording_of("sag", noisy.time, np.where(k >= 500, 10.5, 0.0), shown, noise=(0.02, 1.0), seed=5)
    result = run(case_of(), recording)
    assert result.verdict == "doubtful"
    assert any("supply's voltage seems to sag" in reason for reason in result.reasons)


def test_a_voltage_that_is_too_high_at_the_step_is_not_said_to_sag(case_of, noisy):
    k = np.arange(len(noisy.time))
    voltage = np.where(k >= 500, 10.5 * (1 + 0.1 * np.exp(-np.maximum(k - 500, 0) / 30)), 0.0)
    shown = held_response(CML050, voltage, step=1e-3)
    recording = recording_of("high", noisy.time, np.where(k >= 500, 10.5, 0.0), shown, noise=(0.02, 1.0), seed=5)
    reasons = " ".join(run(case_of(), recording).reasons)
    assert "the supply's voltage seems to be too high at the step (+" in reasons
    assert "sag" not in reasons


def test_a_motor_that_turns_already_without_voltage_is_said_to(case_of, noisy):
    voltage = noisy.signals["voltage"][480:]
    shown = held_response(CML050, np.concatenate([np.full(500, 5.0), voltage]), step=1e-3)[500:]
    recording = recording_of("coasts", np.arange(len(shown)) * 1e-3, voltage, shown, noise=(0.02, 1.0), seed=4)
    result = run(case_of(), recording)
    assert result.verdict == "doubtful"
    assert any("coasts: the motor turns already at" in reason for reason in result.reasons)


def test_lost_samples_in_the_transient_are_named(case_of, noisy):
    keep = np.r_[0:515, 520:2801]
    s = noisy.signals
    recording = recording_of(
        "lost", np.arange(len(keep)) * 1e-3, s["voltage"][keep], np.column_stack([s["current"], s["speed"]])[keep]
    )
    result = run(case_of(), recording)
    assert result.verdict == "doubtful"
    assert any(r.startswith("5 samples seem to be missing before t = 0.515 s") for r in result.reasons), result.reasons
    assert any("check the logger's clock" in reason for reason in result.reasons)
    assert worst(result) < 5  # what follows is compared at its time
    (shown,) = result.comparisons
    assert np.flatnonzero(np.isnan(shown.measured["w"])).tolist() == list(range(515, 520))
    assert shown.time == pytest.approx(noisy.time) and result.recordings[0]["missing_rows"] == 5


def test_the_speed_of_an_encoder_is_taken_as_a_mean_over_the_interval(case_of, noisy):
    clean = step_recording(CML050, interval=1e-4).signals["speed"]
    angle = np.concatenate([[0.0], np.cumsum((clean[1:] + clean[:-1]) / 2) * 1e-4])[::10]
    count = np.floor(angle / (2 * np.pi) * 4000 + 0.3)
    speed = np.concatenate([[0.0], np.diff(count)]) * 2 * np.pi / 4000 / 1e-3
    result = run(case_of(), with_signals(noisy, speed=speed))
    assert worst(result) < 5
    assert result.noise["w"] < 1.0


def test_a_declared_filter_is_applied_to_the_model_too(case_of, noisy):
    signal = pytest.importorskip("scipy.signal")
    filtered = signal.sosfilt(signal.cheby1(4, 0.5, 100, fs=1000, output="sos"), noisy.signals["speed"])
    case = dataclasses.replace(
        case_of(),
        inputs={"v": "voltage"},
        outputs={
            "i": OutputSpec("current"),
            "w": OutputSpec("speed", filter=Chebyshev1(order=4, ripple=0.5, cutoff=100)),
        },
    )
    result = run(case, with_signals(noisy, speed=filtered))
    assert result.verdict == "ok", result.reasons
    assert worst(result) < 5
