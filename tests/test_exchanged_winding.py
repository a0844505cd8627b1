"""A lag of the current that is slower than the winding, beside a speed that is late: which of both is the winding's."""

import numpy as np
import pytest
from fine_motor import FINE, NOISE, STEP
from scipy.linalg import expm
from scipy.signal import lfilter

from estimator import estimate_parameters, recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 1.6, "K": 0.04, "L": 4.8e-4, "J": 2.5e-5, "B": 4e-5}  # L/R: 0.3 ms
COMMAND = np.repeat([0.0, 5.0, 9.0], [100, 350, 350])


def bench(seed, *, lag, late, noise):
    """Return a recording whose current is shown behind a lag, s, and whose speed is late by parts of a row."""
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after, fine = expm(whole * STEP / FINE)[:2], np.zeros((len(COMMAND) * FINE, 2))
    for n, v in enumerate(np.repeat(COMMAND, FINE)[:-1].tolist()):
        fine[n + 1] = after @ np.array([*fine[n], v])
    part = 1 - np.exp(-STEP / FINE / lag)
    current = lfilter([0.5 * part, 0.5 * part], [1, part - 1], fine[:, 0])  # on lines, to a part of a part
    at = np.arange(len(COMMAND)) * FINE
    shown = np.column_stack([current[at], fine[np.maximum(at - late, 0), 1]])
    shown += np.random.default_rng(seed).standard_normal(shown.shape) * NOISE * noise
    columns = {"voltage [V]": COMMAND, "current [A]": shown[:, 0], "speed [rad/s]": shown[:, 1]}
    return recording_from_arrays("b", np.arange(len(COMMAND)) * STEP, columns)


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("noise", [3.0, 1.0])
def test_a_lag_taken_for_the_winding_is_a_rival_where_the_speed_is_late_by_the_difference(noise, seed):
    """With the larger noise L was told five times too large, 36 standard errors off, ok: it needs no delay."""
    lag = 1.6e-3
    late = round((lag - MOTOR["L"] / MOTOR["R"]) / STEP * FINE)
    result = estimate_parameters(bench(seed, lag=lag, late=late, noise=noise), workers=1)
    assert result.verdict == ("ok" if noise == 1.0 else "doubtful"), result.reasons
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.uncertainty, (name, found)
