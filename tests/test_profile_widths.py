"""Bars where the cost is no parabola: an inductance that is settled within a sampling interval."""

import numpy as np
import pytest
from driven_motor import DrivenMotor
from scipy.linalg import expm
from scipy.optimize import least_squares

from estimator import estimate_parameters, recording_from_arrays

TRUE = {"R": 2.63, "K": 0.0403, "L": 5e-4, "J": 1.08e-4, "B": 1.5e-5}  # L / R is a fifth of an interval
H, ROWS, NOISE = 1e-3, 900, np.array([0.013, 1.5])
V = np.repeat([0.0, 8.6, 12.6], [100, 400, 400])


def response(parameters):
    """Return current and speed, (ROWS, 2), stepped exactly."""
    r, k, ind, j, b = parameters
    a = np.array([[-r / ind, -k / ind], [k / j, -b / j]])
    step = expm(a * H)
    drive = np.linalg.solve(a, (step - np.eye(2)) @ [1 / ind, 0.0])
    x = np.zeros((ROWS, 2))
    for n in range(ROWS - 1):
        x[n + 1] = step @ x[n] + drive * V[n]
    return x


def cost_held_at(inductance, measured, start):
    """Return the least z'z with the inductance held, by another least squares."""

    def residual(x):
        r, k, j, b = np.exp(x) * start
        return ((response((r, k, inductance, j, b)) - measured) / NOISE).ravel()

    return 2 * least_squares(residual, np.zeros(4), x_scale=1e-3).cost


@pytest.mark.parametrize("seed", [1, pytest.param(13, marks=pytest.mark.full)])
def test_a_bar_reaches_as_far_as_the_cost_lets_it(seed):
    measured = response(TRUE.values()) + NOISE * np.random.default_rng(seed).standard_normal((ROWS, 2))
    columns = {"voltage [V]": V, "current [A]": measured[:, 0], "speed [rad/s]": measured[:, 1]}
    result = estimate_parameters(recording_from_arrays("bench", np.arange(ROWS) * H, columns), workers=1, seed=1)
    found = {n: result.parameters[n] for n in TRUE}
    others = np.array([found[n].value for n in "RKJB"])
    here = cost_held_at(found["L"].value, measured, others)
    half = cost_held_at(0.5 * found["L"].value, measured, others)
    assert 4 < half - here < 16, "the recording tells it from half of it, not by far"
    assert found["L"].standard_error > 0.9 * 0.5 * found["L"].value / np.sqrt(half - here)
    assert found["L"].standard_error < found["L"].value, "nor from zero"


@pytest.mark.parametrize("seed", [0, pytest.param(4, marks=pytest.mark.full)])
def test_a_bar_is_no_kink_beyond_which_the_cost_stays_as_it_is(seed):
    """A limit hides the current's rise: it is reached within a sample, whatever L is below a sampling interval."""
    true = {"R": 0.854, "K": 0.01604, "L": 1.86e-4, "J": 1.32e-5, "B": 1.9e-5}
    step, rows = 5e-4, 800
    v = np.repeat([0.0, 8.36], [100, rows - 100])
    after = DrivenMotor(true | {"current_limit": 5.53}).response(v, np.zeros(rows), step=step)[:, :2]
    measured = np.vstack([np.zeros((1, 2)), after[:-1]])  # each row with the voltage that begins then
    measured += np.array([0.054, 5.0]) * np.random.default_rng(seed).standard_normal((rows, 2))
    columns = {"voltage [V]": v, "current [A]": measured[:, 0], "speed [rad/s]": measured[:, 1]}
    result = estimate_parameters(recording_from_arrays("bench", np.arange(rows) * step, columns), workers=1, seed=1)
    assert "current limit" in result.effects
    for name in "RKJB":
        found = result.parameters[name]
        assert abs(found.value - true[name]) < 4 * found.standard_error, name
    found = result.parameters["L"]
    assert found.status == "not identified", "it may be anything below"
    assert found.standard_error is None or found.standard_error > 0.5 * true["L"]
