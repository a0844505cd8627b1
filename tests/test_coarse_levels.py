"""Levels that a coarse converter shows: what their mean is off by, and bars that hold it."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.coarse_levels import _levels, _most_noise, level_error

STEP, ROWS, EDGE, VOLTS = 1e-3, 1500, 100, 12.0
CONVERTER = 0.04  # A


def test_the_mean_of_a_level_is_off_by_what_is_told():
    """Levels and noises at random: chi-square of 200 numbers of variance 1, beyond 5.5 deviations in 4e-8 of runs."""
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(200):
        level, noise, n = rng.uniform(3, 5), rng.uniform(0, 0.6), rng.integers(50, 1500)
        shown = np.rint(level + noise * rng.standard_normal(n))
        deviation = np.hypot(level_error(0.3 * shown, 0.3) / 0.3, shown.std() / np.sqrt(n))
        squares.append(((shown.mean() - level) / deviation) ** 2)
    assert max(squares) < 5**2
    assert np.mean(squares) == pytest.approx(1, abs=5.5 * np.sqrt(2 / 200))


@pytest.mark.parametrize("values", [(7.0,), (7.0, 8.0), (6.0, 7.0, 8.0, 9.0, 10.0, 11.0)])
def test_one_value_tells_least_and_many_all(values):
    error = level_error(np.repeat(values, 200), 1.0)
    if len(values) == 1:
        assert 0.17 < error < 12**-0.5, "a step's width, less what its noise takes off its ends"
    else:
        assert error < 0.01, "half of each value lies where they meet, whatever the noise"


def test_a_converter_without_noise_leaves_a_level_of_one_value_open_by_all_of_its_step():
    """Uniform over a step, as far as its slow passages from value to value tell."""
    ramp = np.arange(3000) / 60
    assert _most_noise(np.rint(ramp), ramp) < 0.05
    dithered = np.rint(ramp + 0.2 * np.random.default_rng(1).standard_normal(3000))
    assert _most_noise(dithered, ramp) > 0.2
    assert level_error(np.full(500, 3.0), 1.0, 0.01) == pytest.approx(12**-0.5, rel=0.05)


def test_a_level_ends_where_a_sensor_passes_to_another_value_and_not_where_noise_makes_it_hesitate():
    signal = np.repeat([3.4, 3.6], [200, 300])
    assert _levels(signal, np.rint(signal)) == [(200, 500), (0, 200)]
    at_the_edge = np.full(500, 3.5)
    shown = np.rint(at_the_edge + 0.1 * np.random.default_rng(2).standard_normal(500))
    assert len(_levels(at_the_edge, shown)) <= 2


def test_one_sample_tells_no_more_than_many_of_one_value():
    assert level_error(np.array([3.0]), 1.0) >= level_error(np.full(1000, 3.0), 1.0)


def response(p):
    """Return current and speed of a step, (ROWS, 2), stepped exactly."""
    a = np.array([[-p["R"] / p["L"], -p["K"] / p["L"]], [p["K"] / p["J"], -p["B"] / p["J"]]])
    after = expm(a * STEP)
    drive = np.linalg.solve(a, (after - np.eye(2)) @ [VOLTS / p["L"], 0.0])
    x = np.zeros((ROWS, 2))
    for n in range(EDGE, ROWS - 1):
        x[n + 1] = after @ x[n] + drive
    return x


@pytest.mark.parametrize("seed", [7, *(pytest.param(k, marks=pytest.mark.full) for k in (0, 1))])
def test_a_current_at_no_load_of_a_few_steps_has_a_bar_that_holds(seed):
    """Noise of a tenth of a step; 1 to 7 steps of steady current. Without the shared error B was 6 to 23 bars off."""
    rng = np.random.default_rng(seed)
    p = {"R": rng.uniform(1, 4), "K": rng.uniform(0.02, 0.06), "L": 2e-3, "J": 2e-5 * rng.uniform(0.5, 2)}
    p["B"] = p["K"] ** 2 * rng.uniform(0.04, 0.3) / (0.95 * VOLTS)
    x = response(p)
    columns = {
        "voltage [V]": np.repeat([0.0, VOLTS], [EDGE, ROWS - EDGE]),
        "current [A]": CONVERTER * np.rint((x[:, 0] + 0.1 * CONVERTER * rng.standard_normal(ROWS)) / CONVERTER),
        "speed [rad/s]": x[:, 1] + 0.5 * rng.standard_normal(ROWS),
    }
    result = estimate_parameters(recording_from_arrays("bench", np.arange(ROWS) * STEP, columns), workers=1, seed=1)
    assert result.verdict == "ok" and not result.effects
    for name, value in p.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4 * found.standard_error, name
    off = result.parameters["B"].standard_error / p["B"] * x[-1, 0] / CONVERTER
    assert 0.005 < off < 0.35, "B is known to less than a step of the current, and to no small part of it"


@pytest.mark.parametrize(
    ("seed", "every", "coarse"), [(0, 4, 6.0), pytest.param(2, 4, 6.0, marks=pytest.mark.full), (3, 14, 12.0)]
)
def test_a_coarse_speed_that_a_logger_shows_for_many_rows_is_coarse(seed, every, coarse):
    """One sample of 4 or 14 is new, in steps of 2 or 4 % of the speed: K was 4 bars off, or a lag was told."""
    rng = np.random.default_rng(seed)
    p = {"R": 2.0, "K": rng.uniform(0.038, 0.042), "L": 2e-3, "J": 8e-5, "B": 2e-5}
    x, rows = response(p), np.arange(ROWS)
    columns = {
        "voltage [V]": np.repeat([0.0, VOLTS], [EDGE, ROWS - EDGE]),
        "current [A]": x[:, 0] + 0.003 * rng.standard_normal(ROWS),
        "speed [rad/s]": coarse * np.rint(x[rows // every * every, 1] / coarse),
    }
    result = estimate_parameters(recording_from_arrays("bench", rows * STEP, columns), workers=1, seed=1)
    assert result.verdict == "ok" and not result.effects, (result.reasons, result.effects)
    for name, value in p.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4 * found.standard_error, (name, found)
