"""Recordings that begin under way, stand still, coast or lift a load: estimated, or named for what they are."""

import dataclasses

import numpy as np
import pytest
from dry_friction import DryMotor
from motors import CML050, held_response, recording_of
from scipy.linalg import expm

from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.measured_signals import MeasuredSignals
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.plausibility import implausible
from estimator.recordings.preview import preview
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

STEP = 1e-3
DRY = {
    "R": 3.1363,
    "K": 0.048774,
    "L": 0.01307,
    "J": 9e-6,
    "B": 5e-5,
    "friction": 0.012,
    "stiction": 0.004,
    "brush": 0.0,
}


def made(voltage, shown, *, seed=1, load=None):
    recording = recording_of("bench", STEP * np.arange(len(voltage)), voltage, shown, noise=(0.02, 1.0), seed=seed)
    if load is None:
        return recording
    signals = {f"{c} [{recording.units[c]}]": y for c, y in recording.signals.items()}
    return recording_from_arrays("bench", recording.time, {**signals, "load torque [N.m]": load})


def dry(voltage):
    return np.vstack([[0.0, 0.0], DryMotor(dict(DRY)).response(voltage, np.zeros(len(voltage)), step=STEP)[:-1, :2]])


def kinds(recording):
    columns = motor_columns(recording)
    signals = {n: recording.signals[c] for n, c in columns.items()}
    return [f.kind for f in implausible(MeasuredSignals("bench", recording.time, signals))]


def estimated(case_of, recording):
    (found,) = estimate_recordings([case_of("cuckoo")], [[recording]])
    return found


def right(found, truth=CML050.parameters, *, within=5.0):
    for name, p in found.parameters.items():
        assert abs(p.value - truth[name]) < within * p.standard_error, name


def test_a_recording_that_begins_at_full_voltage_is_estimated(case_of):
    voltage = np.full(800, 10.5)
    recording = made(voltage, held_response(CML050, voltage, step=STEP))
    found = estimated(case_of, recording)
    assert kinds(recording) == [] and found.verdict == "ok"
    right(found)


def test_a_motor_that_runs_already_is_estimated(case_of):
    voltage = np.repeat([5.0, 5.0, 10.5], 500)
    recording = made(voltage[500:], held_response(CML050, voltage, step=STEP)[500:])
    found = estimated(case_of, recording)
    assert kinds(recording) == [] and found.verdict == "ok"
    right(found)


@pytest.mark.parametrize("seed", range(5))
def test_the_noise_of_a_measured_voltage_behind_its_step_is_no_dead_band(seed):
    """Its largest sample lies anywhere behind the step, and a line through the rows before it rises by chance."""
    rng, n, tau = np.random.default_rng(seed), 800, 0.06
    t = STEP * np.arange(n) - 0.1
    speed = 150 * np.maximum(0.0, 1 - np.exp(-t / tau)) + rng.standard_normal(n)
    voltage = np.where(t >= 0, 24.0, 0.0) + 0.024 * rng.standard_normal(n)
    current = np.where(t >= 0, (24.0 - 0.155 * speed) / 2.0, 0.0) + 0.02 * rng.standard_normal(n)
    signals = {"voltage [V]": voltage, "current [A]": current, "speed [rad/s]": speed}
    assert kinds(recording_from_arrays("bench", STEP * np.arange(n), signals)) == []


def test_a_dead_band_is_named_with_the_model_that_has_one(case_of):
    voltage = np.linspace(0, 10, 1500)
    recording = made(voltage, dry(voltage))
    assert kinds(recording) == ["dead band"]
    found = estimated(case_of, recording)
    assert {"dry friction", "break-away"} <= set(found.effects)  # which the data that were read looked like
    right(found, DRY)
    linear = made(voltage, held_response(CML050, voltage, step=STEP))
    assert kinds(linear) == []


def test_a_coasting_motor_is_named_and_one_that_brakes_is_not(case_of):
    driven = np.r_[np.zeros(50), np.full(150, 10.5)]
    shown, w = dry(np.r_[driven, 0.0]), []  # the last row is what stands when the driver opens
    rate, level = DRY["B"] / DRY["J"], DRY["friction"] / DRY["B"]
    for k in range(1, 100):
        w.append(max(0.0, (float(shown[-1, 1]) + level) * np.exp(-rate * STEP * k) - level))
    voltage = np.r_[driven, np.zeros(100)]
    coasting = made(voltage, np.vstack([shown, np.column_stack([np.zeros(99), w])]))
    assert kinds(coasting) == ["coasts"]
    assert kinds(made(voltage, dry(voltage))) == []
    found = estimated(case_of, coasting)
    assert "coasting" in found.effects and "from t = 0.2 s the motor turns at 18" in found.read[0]["implausible"][0]
    right(found, DRY)


def locked():
    voltage = np.r_[np.zeros(200), np.full(600, 3.0)]
    fading = np.exp(-STEP * np.arange(600) * CML050.R / CML050.L)
    return voltage, np.column_stack([np.r_[np.zeros(200), 3.0 / CML050.R * (1 - fading)], np.zeros(800)])


def test_a_locked_rotor_is_named_and_tells_the_winding(case_of):
    recording = made(*locked())
    assert kinds(recording) == ["held"]
    found = estimated(case_of, recording)
    assert found.verdict == "doubtful" and "the shaft is held; that tells R and L alone" in found.reasons[0]
    gain = found.derived["current_per_volt"]
    assert abs(gain.value - 1 / CML050.R) < 5 * gain.standard_error


def test_a_locked_rotor_whose_sensor_shows_nothing_is_refused(case_of):
    recording = made(*locked())
    still = dataclasses.replace(recording, signals={**recording.signals, "speed": np.zeros(800)})
    found = estimated(case_of, still)
    assert found.verdict == "refused" and "its sensor is dead, or the shaft is held" in found.reasons[0]
    assert any("from the first to the last sample" in sentence for sentence in preview(still).found)


def crane():
    """Return a load that is held, lifted, held and lowered: voltage, load torque, and current and speed."""
    load = np.full(2400, 0.02)
    hold = CML050.R * 0.02 / CML050.K
    voltage = np.r_[np.full(400, hold), np.full(700, 8.0), np.full(500, hold), np.full(800, -4.0)]
    block = np.zeros((4, 4))
    block[:2] = [
        [-CML050.R / CML050.L, -CML050.K / CML050.L, 1 / CML050.L, 0],
        [CML050.K / CML050.J, -CML050.B / CML050.J, 0, -1 / CML050.J],
    ]
    step = expm(block * STEP)
    x, rows = np.array([0.02 / CML050.K, 0.0]), np.zeros((2400, 2))
    for k in range(2400):
        rows[k] = x
        x = step[:2, :2] @ x + step[:2, 2] * voltage[k] + step[:2, 3] * load[k]
    return voltage, load, rows


@pytest.mark.parametrize("is_logged", [True, False])
def test_a_crane_that_lifts_and_lowers_is_no_sign_turned(case_of, is_logged):
    """Lowering, the current stays positive against the voltage: the load drives."""
    voltage, load, shown = crane()
    recording = made(voltage, shown, load=load if is_logged else None)
    assert kinds(recording) == []
    if is_logged:
        found = estimated(case_of, recording)
        assert found.verdict == "ok"
        right(found)
