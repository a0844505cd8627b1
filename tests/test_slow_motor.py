"""A slow motor whose friction wanders: over a long transient it moves the speed as rows would that a logger lost."""

import numpy as np
import pytest

from estimator import estimate_parameters, recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 0.45, "K": 0.1746, "L": 1.575e-3, "J": 1.016e-2, "B": 2.1e-3}
FRICTION, RIPPLE, LINES = 0.1676, 0.01, 4096  # N.m; of K, twelve times a turn; of the encoder
STEP, PARTS = 1e-3, 10  # s; of a row


def bench(seed):
    """Return a recording of levels from a running start, its speed the mean of five rows of an encoder's counts.

    A hundredth of the friction wanders within 0.05 s.
    """
    r, constant, inductance, j, b = MOTOR.values()
    volts = np.repeat([30.0, 24.0, 18.0, 9.0, 3.0], [200, 1200, 1200, 1200, 1400])
    rng, rows, before, h = np.random.default_rng(seed), len(volts), 1500, STEP / PARTS
    keep, falls = np.exp(-h / 0.05), np.exp(-r / inductance * h)
    deviation = 0.01 * (b * 0.5 * 30.0 / constant + FRICTION)
    pushes = rng.standard_normal(rows * PARTS) * deviation * np.sqrt(1 - keep**2)
    i, w, angle, torque, shown = FRICTION / constant + b * 160.0 / constant, 160.0, 0.0, 0.0, np.zeros((rows, 3))
    for row in range(-before, rows):
        if row >= 0:
            shown[row] = i, w, angle
        for part in range(PARTS):
            torque = keep * torque + (pushes[row * PARTS + part] if row >= 0 else 0.0)
            k = constant * (1 + RIPPLE * np.cos(12 * angle))
            i = falls * i + (1 - falls) * (volts[max(row, 0)] - k * w) / r
            w += h * (k * i - b * w - FRICTION - torque) / j
            angle += h * w
    counts = np.floor(shown[:, 2] * LINES / (2 * np.pi) + rng.uniform())
    mean = np.full(rows, np.nan)
    mean[5:] = (counts[5:] - counts[:-5]) * 2 * np.pi / LINES / STEP / 5
    mean[:5] = mean[5]
    current = shown[:, 0] - 0.06 + 0.05 * (1 + 0.01 * np.abs(shown[:, 0])) * rng.standard_normal(rows)
    voltage = volts + 0.02 * rng.standard_normal(rows)
    columns = {"voltage [V]": voltage, "current [A]": np.round(current, 2), "speed [rad/s]": mean}
    return recording_from_arrays("bench", np.arange(rows) * STEP, columns)


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
def test_friction_that_wanders_is_no_lost_row(seed):
    """Rows were told as lost that would hardly have moved the signals: no row tells them from such a friction."""
    result = estimate_parameters(bench(seed), workers=1)
    assert "lost rows" not in result.effects, result.reasons
    assert all(abs(result.parameters[name].value / MOTOR[name] - 1) < 0.01 for name in "RKLJ"), result.parameters
