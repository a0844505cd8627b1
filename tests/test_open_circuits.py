"""Circuits that open under a measured voltage: which rows, which not, and a motor estimated from them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from driven_motor import DrivenMotor
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.open_circuits import OwnVoltage, _first_of, open_rows
from estimator.noise.clock import Clock
from estimator.noise.noise_model import COASTS, WAYS, NoiseModel, unwound
from estimator.noise.whitener import Whitener
from estimator.recordings.signal_noise import input_noise, is_measured

MOTOR = {"R": 2.0, "K": 0.05, "L": 3e-3, "J": 2e-5, "B": 4e-5}
STEP, OPENS = 1e-3, 400


def bench(seed, *, offset=0.0, opens=True, kick=0.0, inertia=MOTOR["J"]):
    """Return voltage, current and speed of a motor that is let go of, or braked, after 0.4 s: rows of a real logger.

    A kick is the voltage, V, that its winding shows in the row in which its current ends.
    """
    rng = np.random.default_rng(seed)
    v = np.r_[np.zeros(100), np.full(OPENS - 100, 6.0), np.zeros(500)]
    after = DrivenMotor(MOTOR | {"J": inertia, "coasts": float(opens)}).response(v, np.zeros(len(v)), step=STEP)[:, :2]
    i, w = np.vstack([np.zeros((1, 2)), after[:-1]]).T
    i, v = i.copy(), v.copy()
    if opens:
        i[OPENS:] = 0.0
        v[OPENS:] = MOTOR["K"] * w[OPENS:]
    if kick:
        i[OPENS], v[OPENS] = i[OPENS - 1], kick
    noise = rng.standard_normal((3, len(v)))
    return v + 0.01 * noise[0], i + offset + 0.008 * noise[1], w + 0.2 * noise[2]


def observed(v, i, w):
    return SimpleNamespace(inputs={"v": v}, outputs={"i": i, "w": w})


@pytest.mark.parametrize("offset", [0.05, pytest.param(0.0, marks=pytest.mark.full)])
def test_rows_without_a_current_whose_voltage_follows_the_speed_are_open(offset):
    found = open_rows(observed(*bench(0, offset=offset)))
    assert found[OPENS:].all() and not found[: OPENS - 1].any()


def test_the_row_in_which_the_winding_drives_its_current_on_until_it_ends_is_open():
    v, i, w = bench(0, kick=-20.0)
    assert v[OPENS] < -19 and i[OPENS] > 0.02
    found = open_rows(observed(v, i, w))
    assert found[OPENS:].all() and not found[:OPENS].any()


def test_a_voltage_is_measured_also_where_most_of_its_rows_are_exactly_none():
    """Each row of its noise was a change of the command then, with a ramp of its own: minutes for 4 000 rows."""
    v = bench(0)[0]
    v[OPENS:] = 0.0
    assert is_measured(v) and input_noise(v) == pytest.approx(0.01, rel=0.3)
    for command in (np.repeat([0.0, 6.0, 0.0], [500, 100, 400]), np.tile([0.0, 0.0, 0.0, 6.0], 200)):
        assert not is_measured(command)


@pytest.mark.full
def test_a_recording_that_ends_soon_after_the_circuit_opened_tells_it_too():
    """Its motor had lost a tenth of its speed only: more was asked for, and no effect explained the rest."""
    v, i, w = (column[: OPENS + 60] for column in bench(6))
    assert 0.85 < w[-1] / w[OPENS] < 0.95
    found = open_rows(observed(v, i, w))
    assert found[OPENS:].all() and not found[: OPENS - 1].any()


def test_a_current_that_is_lost_while_voltage_and_speed_are_constant_or_fall_unlike_opens_nothing():
    rng = np.random.default_rng(7)
    v, i, w = bench(7)
    i[350:] = 0.008 * rng.standard_normal(len(i) - 350)
    assert open_rows(observed(v[:OPENS], i[:OPENS], w[:OPENS])) is None
    v, i, w = bench(7)
    v[OPENS:] = v[OPENS] * np.linspace(1, 0.8, len(v) - OPENS)
    assert open_rows(observed(v, i, w)) is None


def test_a_motor_that_is_braked_or_runs_at_no_load_or_stands_is_not_open():
    v, i, w = bench(1, opens=False)
    assert open_rows(observed(v, i, w)) is None
    driven = slice(0, OPENS)
    assert open_rows(observed(v[driven], i[driven], w[driven])) is None, "a current that settles at little"
    assert open_rows(observed(np.zeros(300), i[:300] * 0, w[:300] * 0)) is None


@pytest.mark.full
def test_a_current_that_settled_below_its_noise_long_before_has_opened_nothing_then():
    """From the end of the inrush on 6 V were taken for the motor's own, and replaced by none."""
    v, i, w = bench(5, inertia=4e-6)
    i = i + 0.05 * np.random.default_rng(5).standard_normal(len(i))
    found = open_rows(observed(v, i, w))
    assert found[OPENS:].all() and not found[: OPENS - 1].any()


@pytest.mark.full  # of a motor that is braked or runs at no load above
def test_a_current_loop_that_wants_none_opens_no_circuit():
    """What it lets flow by the noise of its sensor was lost, and five effects made up for it."""
    rng = np.random.default_rng(8)
    wanted = np.repeat([0.0, 0.3, -0.2, 0.25, 0.0], [100, 200, 200, 200, 500])
    whole = np.zeros((3, 3))
    r, k, inductance, inertia, friction = MOTOR.values()
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / inertia, -friction / inertia, 0.0]]
    after = expm(whole * STEP)
    state, total, rows = np.zeros(2), 0.0, []
    for now in wanted:
        shown = state + rng.standard_normal(2) * [0.008, 0.2]
        total += 500.0 * (now - shown[0]) * STEP
        voltage = float(np.clip(4.0 * (now - shown[0]) + total, -12, 12))
        rows.append((voltage + 0.01 * rng.standard_normal(), *shown))
        state = after[:2, :2] @ state + after[:2, 2] * voltage
    columns = dict(zip(("voltage [V]", "current [A]", "speed [rad/s]"), np.array(rows).T, strict=True))
    result = estimate_parameters(recording_from_arrays("loop", np.arange(len(rows)) * STEP, columns), workers=1, seed=1)
    assert not any("circuit is open" in note for note in result.notes), result.notes
    assert result.verdict == "ok", result.reasons
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.standard_error, name


def test_one_current_that_is_off_neither_opens_a_circuit_nor_closes_it():
    v, i, w = bench(2)
    i[300], i[600] = 0.0, 2.0
    found = open_rows(observed(v, i, w))
    assert found[OPENS:].all() and not found[: OPENS - 1].any()


# Of the first a dip made up for the kick; of the third the voltage's noise seemed 1.4 times the sensor's.
@pytest.mark.parametrize(
    ("seed", "kick"), [(3, -20.0), *(pytest.param(k, 0.0, marks=pytest.mark.full) for k in (3, 4))]
)
def test_a_motor_that_is_let_go_of_is_estimated_and_said_to_be(seed, kick):
    v, i, w = bench(seed, kick=kick)
    columns = {"voltage [V]": v, "current [A]": i, "speed [rad/s]": w}
    result = estimate_parameters(recording_from_arrays("bench", np.arange(len(v)) * STEP, columns), workers=1, seed=1)
    assert result.verdict == "ok", result.reasons
    assert any("the circuit is open" in note and "t = 0.4 s" in note for note in result.notes), result.notes
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4 * found.standard_error, name


@pytest.mark.parametrize("late", [0.0, 0.0031])
def test_a_motor_whose_own_voltage_tells_another_constant_is_doubted(late):
    """A speed that is shown late is compared with the voltage as it was then: K seemed 4 % off."""
    time = STEP * np.arange(300)
    speed = 500 * np.exp(-(time - late) / 0.085)
    voltage = np.where(time > 0.1, 0.0559 * 500 * np.exp(-time / 0.085), np.nan)
    noise = 0.02 * np.random.default_rng(8).standard_normal(len(time))
    own = OwnVoltage("", 0, time, voltage + noise + 0.2, speed - 1.5)  # offsets are no other constant
    k, error = own.constant(late)
    assert abs(k - 0.0559) < 4.5 * error < 3e-4
    assert own.doubt(0.0559, 1e-5, late) == "" and own.doubt(0.0557, 1e-4, late) == ""
    assert f"K = {k:.4g}, all else 0.055:" in own.doubt(0.0550, 3e-5, late)
    assert not late or own.doubt(0.0559, 3e-5, 0.0)


def test_a_torque_that_wanders_is_whitened_with_the_circuit_closed_and_open():
    """By the closed machine alone the speed of one that coasts is no white noise."""
    rng, n, tau = np.random.default_rng(5), 6000, 0.1
    a = np.array([[-MOTOR["R"], -MOTOR["K"]], [0, 0]]) / MOTOR["L"]
    a[1] = MOTOR["K"] / MOTOR["J"], -MOTOR["B"] / MOTOR["J"]
    b = np.array([0.0, -1 / MOTOR["J"]])
    opens = np.arange(n) // 1500 % 2 == 1
    noise = dataclasses.replace(NoiseModel.plain(np.array([5e-3, 5e-2]), (0, 1)), machine=(a, b), torque=(2e-4, tau))
    closed = noise.states(np.array([STEP]), np.ones(2), np.array([2]), np.array([WAYS]))["transition"][0]
    free = noise.states(np.array([STEP]), np.ones(2), np.array([COASTS]), np.array([WAYS]))["transition"][0]
    np.testing.assert_allclose(free[:2], unwound(a.tobytes(), b.tobytes(), STEP)[:2])
    x, shown, f = np.zeros(3), np.empty((n, 2)), np.exp(-STEP / tau)
    x[2] = 2e-4 * rng.standard_normal()
    for k in range(n):
        shown[k] = x[:2]
        x = (free if opens[k] else closed) @ x
        x[2] += 2e-4 * np.sqrt(1 - f * f) * rng.standard_normal()
    shown += rng.standard_normal((n, 2)) * noise.white
    one = np.ones((n, 2))
    knows_not = Whitener(
        noise, (Clock(STEP * np.arange(n), slice(0, n)),), one > 0, 0 * one, one, one[:, 0] > 0, 0 * one
    )
    ratios = [
        float(np.mean(whitener(shown[:, :, None])[0][200:] ** 2))
        for whitener in (dataclasses.replace(knows_not, opens=opens), knows_not)
    ]
    assert abs(ratios[0] - 1) < 5 * np.sqrt(2 / (2 * n)) and ratios[1] > 1.05, ratios


@pytest.mark.full
@pytest.mark.parametrize("late", [0, 1])
def test_a_current_that_ends_before_or_after_the_sample_of_its_row_leads_to_no_other_story(late):
    """One sample, of full current or of none, was explained by a fan and friction that drifts: B was lost."""
    v, i, w = bench(5)
    v = np.r_[np.zeros(100), np.full(OPENS - 100, 6.0), np.zeros(len(v) - OPENS)]
    i[OPENS] = i[OPENS - 1] if late else 0.0
    columns = {"voltage [V]": v, "current [A]": i, "speed [rad/s]": w}
    result = estimate_parameters(recording_from_arrays("bench", np.arange(len(v)) * STEP, columns), workers=1, seed=1)
    assert result.verdict == "ok" and set(result.effects) == {"coasting"}, (result.effects, result.reasons)
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.standard_error, name


def test_each_opening_tells_the_constant_by_its_own_fall_and_one_without_a_fall_tells_none():
    """Over two like coasts together the first half fell to nothing in the second: K of any size was no doubt."""
    once = 500 * np.exp(-np.arange(200) * STEP / 0.1)
    speed = np.concatenate([np.full(100, 500.0), once, np.full(100, 500.0), once])
    opens = np.concatenate([np.zeros(100), np.ones(200), np.zeros(100), np.ones(200)]) > 0
    voltage = np.where(opens, 0.056 * speed, np.nan) + 0.02 * np.random.default_rng(9).standard_normal(600)
    own = OwnVoltage("", 0, np.arange(600) * STEP, voltage, speed)
    k, error = own.constant(0.0)
    assert abs(k - 0.056) < 4.5 * error < 2e-4
    assert own.doubt(0.050, 1e-5, 0.0) and not own.doubt(0.056, 1e-5, 0.0)
    still = OwnVoltage("", 0, np.arange(600) * STEP, voltage, np.full(600, 12.0))
    assert not np.isfinite(still.constant(0.0)[1]) and still.doubt(0.05, 1e-5, 0.0) == ""


@pytest.mark.full
def test_a_speed_of_coarse_counts_hides_no_open_circuit_whose_voltage_jumps_a_row_before_the_current_ends():
    """Its noise was not allowed for: brushes that drop 2.5 V and lost rows were told of a motor that has neither."""
    rng, rows = np.random.default_rng(3), OPENS + 80
    v, i, w = (column[:rows].copy() for column in bench(9))
    w += 1.6 * rng.standard_normal(rows)
    i[OPENS] = 0.6 * i[OPENS - 1]  # a sensor's lag shows it on
    found = open_rows(observed(v, i, w))
    assert found is not None and found[OPENS:].all() and not found[:OPENS].any()


def test_the_jumps_that_a_winding_makes_before_its_circuit_opens_are_found_among_many():
    """All were gone through for each: 11 s of a measured random voltage of 200 000 rows, 0.1 s now."""
    assert [_first_of([5, 20, 22, 23, 40], k) for k in (5, 20, 23, 24, 40, 41)] == [5, 20, 20, 20, 40, 40]
    assert _first_of([], 7) == 7
