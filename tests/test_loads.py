"""Loads on the shaft: one that sets in at an instant, one that acts one way, a fan beside an angle."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 1.2, "K": 0.03, "L": 1.5e-3, "J": 4e-5, "B": 3e-5}
STALL = 12.0 * MOTOR["K"] / MOTOR["R"]
H, FINE, ROWS = 1e-3, 20, 1500
TIMES = np.arange(ROWS) * H
STEP = np.where(TIMES < 0.1, 0.0, 12.0)
LEVELS = np.select([TIMES < 0.1, TIMES < 0.6, TIMES < 1.1], [0.0, 6.0, 12.0], 3.0)
BOTH_WAYS = np.select([TIMES < 0.1, TIMES < 0.6, TIMES < 1.1], [0.0, 9.0, -9.0], -5.0)
RANDOM = np.where(TIMES < 0.1, 0.0, np.repeat(np.random.default_rng(3).choice([3.0, 12.0], ROWS // 50), 50))


def loaded(voltage, torque, seed, *, noise=0.004):
    """Return a recording of a motor with a torque against positive speed, (rows FINE,), stepped exactly."""
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((4, 4))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance, 0.0], [k / j, -b / j, 0.0, -1 / j]]
    step = expm(whole * H / FINE)
    x, shown = np.zeros(2), []
    for row, v in enumerate(voltage.tolist()):
        shown.append(x)
        for held in torque[row * FINE : (row + 1) * FINE].tolist():
            x = step[:2, :2] @ x + step[:2, 2:] @ (v, held)
    rng, top = np.random.default_rng(seed), 12.0 / MOTOR["K"]
    i, w = (np.array(shown) + noise * rng.standard_normal((ROWS, 2)) * [STALL / MOTOR["K"], top]).T
    return recording_from_arrays("bench", TIMES, {"voltage [V]": voltage, "current [A]": i, "speed [rad/s]": w})


def from_instant(instant, size):
    return np.where(np.arange(ROWS * FINE) * H / FINE < instant, 0.0, size)


def with_arm(voltage, torque, seed, *, noise=0.004):
    """Return a recording of a motor with an arm, (N.m), that hangs when it begins: a torque as the angle's sine."""
    r, k, inductance, j, b = MOTOR.values()
    x, shown, h = np.zeros(3), [], H / FINE

    def slope(x, v):
        return np.array(
            [(v - r * x[0] - k * x[1]) / inductance, (k * x[0] - b * x[1] - torque * np.sin(x[2])) / j, x[1]]
        )

    for v in voltage.tolist():
        shown.append(x[:2])
        for _ in range(FINE):
            middle = x + 0.5 * h * slope(x, v)
            x = x + h * slope(middle, v)
    rng, top = np.random.default_rng(seed), 12.0 / MOTOR["K"]
    i, w = (np.array(shown) + noise * rng.standard_normal((ROWS, 2)) * [STALL / MOTOR["K"], top]).T
    return recording_from_arrays("bench", TIMES, {"voltage [V]": voltage, "current [A]": i, "speed [rad/s]": w})


@pytest.mark.parametrize("voltage", [0.06 * LEVELS, pytest.param(0.06 * BOTH_WAYS, marks=pytest.mark.full)])
def test_an_arm_is_told_and_leaves_the_parameters_right(voltage):
    """It was told as load steps, a lag of the speed and a torque that wanders, J 24 standard errors off."""
    result = estimate_parameters(with_arm(voltage, 0.01 * STALL, 1, noise=2e-4), workers=1)
    assert "unbalance" in result.effects, (result.effects, result.reasons)
    assert all(abs(off(result, name)) < 4.5 for name in MOTOR)
    assert result.parameters["J"].standard_error < 0.02 * MOTOR["J"]


@pytest.mark.full
def test_without_the_effect_an_arm_is_doubted(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "unbalance")
    result = estimate_parameters(with_arm(0.06 * LEVELS, 0.01 * STALL, 1, noise=2e-4), workers=1)
    assert result.verdict != "ok" or all(abs(off(result, name)) < 4.5 for name in MOTOR)


def off(result, name):
    found = result.parameters[name]
    return (found.value - MOTOR[name]) / found.standard_error


@pytest.mark.parametrize(
    ("voltage", "instant", "part"),
    [
        (STEP, 0.8034, 0.1),
        pytest.param(LEVELS, 0.9002, 0.03, marks=pytest.mark.full),
        (RANDOM, 0.7777, -0.1),
    ],
    ids=["step", "levels", "random"],
)
def test_a_load_that_sets_in_is_told_with_its_instant_and_leaves_the_parameters_right(voltage, instant, part):
    result = estimate_parameters(loaded(voltage, from_instant(instant, part * STALL), 1), workers=1)
    (size,) = [x for name, x in result.chain.items() if name.startswith("load step") and "#" not in name]
    assert size.name == f"load step near {instant:.2f} s"
    assert abs(size.value - part * STALL) < 4.5 * size.standard_error < 0.1 * STALL
    assert all(abs(off(result, name)) < 4.5 for name in MOTOR)
    assert result.parameters["B"].standard_error < 0.1 * MOTOR["B"]
    (reason,) = result.reasons
    assert reason.startswith(size.name) and ("more" if part > 0 else "less") in reason


@pytest.mark.full  # of one instant above
def test_of_a_load_that_comes_and_goes_both_instants_are_told():
    torque = from_instant(0.7, 0.1 * STALL) - from_instant(1.1, 0.1 * STALL)
    result = estimate_parameters(loaded(STEP, torque, 2), workers=1)
    told = sorted(n for n in result.chain if n.startswith("load step") and "#" not in n)
    assert told == ["load step near 0.70 s", "load step near 1.10 s"]
    assert all(abs(off(result, name)) < 4.5 for name in MOTOR)


@pytest.mark.full  # as above
def test_without_the_effect_a_load_that_sets_in_is_doubted(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "load step")
    result = estimate_parameters(loaded(STEP, from_instant(0.8034, 0.1 * STALL), 1), workers=1)
    assert result.verdict == "doubtful"
    assert all(abs(off(result, name)) < 4.5 for name in MOTOR)


@pytest.mark.full  # nor any other effect: test_effects.py
@pytest.mark.parametrize("voltage", [STEP, LEVELS, RANDOM], ids=["step", "levels", "random"])
def test_no_load_is_told_where_there_is_none(voltage):
    result = estimate_parameters(loaded(voltage, np.zeros(ROWS * FINE), 4), workers=1)
    assert result.verdict == "ok" and not any("load" in name for name in result.chain)


def test_a_weight_that_acts_one_way_is_a_torque():
    torque = np.where(np.arange(ROWS * FINE) < 100 * FINE, 0.0, 0.02 * STALL)  # a brake holds it before
    result = estimate_parameters(loaded(BOTH_WAYS, torque, 5), workers=1)
    assert result.verdict == "ok", result.reasons
    told = result.chain["load torque"]
    assert abs(told.value - 0.02 * STALL) < 4.5 * told.standard_error < 0.002 * STALL
    assert all(abs(off(result, name)) < 4.5 for name in MOTOR)


@pytest.mark.full  # five seconds; leave-one-out of all effects is a bench
def test_without_the_effect_a_weight_is_doubted_or_within_the_errors(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "load torque")
    torque = np.where(np.arange(ROWS * FINE) < 100 * FINE, 0.0, 0.02 * STALL)
    result = estimate_parameters(loaded(BOTH_WAYS, torque, 5), workers=1)
    assert result.verdict == "doubtful" or all(abs(off(result, name)) < 4.5 for name in MOTOR)


@pytest.mark.full  # a fan by a speed is asked in test_odd_motors.py
@pytest.mark.parametrize("shown", ["angle [rad]", "speed [rad/s]"])
def test_a_strong_fan_is_told_by_an_angle_as_by_a_speed(shown):
    r, k, inductance, j, b = MOTOR.values()
    fan, rng = 3 * b / 300, np.random.default_rng(6)
    x, states = np.zeros(3), []
    for v in LEVELS.tolist():
        states.append(x)
        found = solve_ivp(
            lambda _, x, v=v: [
                (v - r * x[0] - k * x[1]) / inductance,
                (k * x[0] - b * x[1] - fan * x[1] * abs(x[1])) / j,
                x[1],
            ],
            (0.0, H), x, rtol=1e-9, atol=1e-10,
        )  # fmt: skip
        x = found.y[:, -1]
    i, w, angle = np.array(states).T
    sensor = {"angle [rad]": angle + 1e-3 * rng.standard_normal(ROWS), "speed [rad/s]": w + rng.standard_normal(ROWS)}
    columns = {"voltage [V]": LEVELS, "current [A]": i + 0.03 * rng.standard_normal(ROWS), shown: sensor[shown]}
    result = estimate_parameters(recording_from_arrays("fan", TIMES, columns), workers=1)
    assert result.verdict == "ok", result.reasons
    told = result.chain["fan load"]
    assert told.value == pytest.approx(fan, rel=0.02) and told.standard_error < 0.05 * fan
    assert all(abs(off(result, name)) < 4.5 for name in MOTOR)
