"""A voltage that reaches its level by a ramp: the mean that it is of a linear model, and the motor right beside it."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.effects.time_mean import mean_over_time

MOTOR = {"R": 1.6, "K": 0.04, "L": 2.4e-3, "J": 2.5e-5, "B": 4e-5}
STEP, FINE = 1e-3, 40


@pytest.mark.parametrize("length", [0.3, 1.0, 2.5, 7.0, 7.9])
def test_the_mean_of_a_line_and_of_a_step_are_exact(length):
    t = np.arange(60.0)
    line = np.maximum(t - 20, 0)
    since = np.clip(np.maximum(t - 20, 0), 0, length)  # of the last `length`, what lies behind the bend
    exact = np.where(t <= 20, 0.0, since * (np.maximum(t - 20, 0) - since / 2) / length)
    np.testing.assert_allclose(mean_over_time(line, length * 0.01, 0.01), exact, atol=1e-12)
    np.testing.assert_array_equal(mean_over_time(line, 0.0, 0.01), line)
    np.testing.assert_allclose(mean_over_time(np.full(9, 3.0), length, 1.0), 3.0, rtol=1e-14)  # at rest before


def recorded(command, length, seed):
    """Return a bench's recording of a command, whose changes each take some s, by fine exact steps."""
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after = expm(whole * STEP / FINE)[:2]
    fine = np.repeat(command, FINE)
    width = round(length * FINE / STEP)
    voltage = np.convolve(np.concatenate([np.full(width, fine[0]), fine]), np.ones(width) / width)[width:-width]
    x, shown = np.zeros(2), np.empty((len(command), 2))
    for row in range(len(command)):
        shown[row] = x
        for v in voltage[row * FINE : (row + 1) * FINE]:
            x = after @ np.array([*x, v])
    noise = np.random.default_rng(seed).standard_normal(shown.shape) * [0.01, 0.3]
    columns = {
        "voltage [V]": command,
        "current [A]": shown[:, 0] + noise[:, 0],
        "speed [rad/s]": shown[:, 1] + noise[:, 1],
    }
    return recording_from_arrays("b", np.arange(len(command)) * STEP, columns)


LEVELS = np.repeat([0.0, 12.0, 0.0], [80, 400, 400])


@pytest.mark.parametrize(("length", "seed"), [pytest.param(4.6e-3, 0, marks=pytest.mark.full), (23.4e-3, 1)])
def test_a_ramp_is_found_and_the_motor_is_right(length, seed):
    """Means of both channels over whole samples stood for it, and an inductance 40 % off for the difference: ok."""
    result = estimate_parameters(recorded(LEVELS, length, seed), workers=1)
    assert result.verdict == "ok" and set(result.effects) == {"voltage ramp"}, (result.effects, result.reasons)
    (told,) = (note for note in result.notes if "by a ramp of" in note)
    assert float(told.split(" ramp of ")[1].split()[0]) == pytest.approx(1e3 * length, rel=0.05)
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.standard_error, (name, found.value, found.standard_error)


def test_none_is_found_of_a_step():
    result = estimate_parameters(recorded(LEVELS, STEP / FINE, 2), workers=1)
    assert result.verdict == "ok" and not result.effects, result.effects
