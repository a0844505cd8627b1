"""A current's sensor that saturates slowly, and a supply that ripples: found, and the motor right beside them."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays

MOTOR = {"R": 1.6, "K": 0.04, "L": 2.4e-3, "J": 2.5e-5, "B": 4e-5}
STEP, FINE = 1e-3, 20


def moved(voltage, ripple=0.0):
    """Return current and speed, (n, 2), of a voltage that each row holds, (n,), with a part of it at 100 Hz."""
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after = expm(whole * STEP / FINE)[:2]
    x, shown = np.zeros(2), np.empty((len(voltage), 2))
    for row, v in enumerate(voltage.tolist()):
        shown[row] = x
        for part in range(FINE):
            t = (row + (part + 0.5) / FINE) * STEP
            x = after @ np.array([*x, v * (1 + ripple * np.sin(2 * np.pi * 100 * t + 0.7))])
    return shown


def estimated(voltage, shown, seed):
    noise = np.random.default_rng(seed).standard_normal(shown.shape) * [0.01, 0.3]
    columns = {
        "voltage [V]": voltage,
        "current [A]": shown[:, 0] + noise[:, 0],
        "speed [rad/s]": shown[:, 1] + noise[:, 1],
    }
    result = estimate_parameters(recording_from_arrays("b", np.arange(len(voltage)) * STEP, columns), workers=1, seed=1)
    assert result.verdict == "ok", result.reasons
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.standard_error, (name, found.value, found.standard_error)
    return result


LEVELS = np.repeat([0.0, 5.0, 12.0, 0.0], [80, 400, 400, 400])


@pytest.mark.parametrize("seed", [1, pytest.param(0, marks=pytest.mark.full)])
def test_a_sensor_that_saturates_slowly_shows_less_of_a_large_current(seed):
    shown = moved(LEVELS)
    peak = np.max(np.abs(shown[:, 0]))
    shown[:, 0] *= 1 - 0.05 * (shown[:, 0] / peak) ** 2
    result = estimated(LEVELS, shown, seed)
    assert set(result.effects) == {"curve of i"}
    assert any("% less at the largest current" in note for note in result.notes), result.notes


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.full)])
def test_a_supply_that_ripples_moves_the_current_also_in_transients(seed):
    result = estimated(LEVELS, moved(LEVELS, ripple=0.04), seed)
    (told,) = (note for note in result.notes if note.startswith("the supply has a ripple of "))
    assert float(told.split()[6]) == pytest.approx(100, abs=0.05) and "amplitude" in told
    assert "switching ripple" not in result.effects


def test_neither_is_found_of_a_good_sensor_and_a_steady_supply():
    assert not estimated(LEVELS, moved(LEVELS), 4).effects
