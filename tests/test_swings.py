"""A second inertia on an elastic shaft is named by the frequency at which the speed swings after an edge."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays
from estimator.judging.swings import _after

pytestmark = pytest.mark.usefixtures("shared_workers")

STEP, ROWS = 5e-4, 1600
R, K, L, J, B = 1.4, 0.062, 1.8e-3, 2.5e-4, 1.1e-4
LEVELS = np.repeat([0.0, 24.0, 12.0], [300, 700, 600])


def behind_a_coupling(frequency, *, part=0.6, damping=0.04):
    """Return current and speed, (n, 2), by matrix exponentials; a part of the inertia is behind a spring."""
    own, other = (1 - part) * J, part * J
    stiff = (2 * np.pi * frequency) ** 2 / (1 / own + 1 / other)
    c = 2 * damping * stiff / (2 * np.pi * frequency)
    a = np.array(
        [
            [-R / L, -K / L, 0, 0],  # i, w, w of the other, twist
            [K / own, -(B + c) / own, c / own, -stiff / own],
            [0, c / other, -c / other, stiff / other],
            [0, 1, -1, 0],
        ]
    )
    both = expm(STEP * np.block([[a, np.array([[1 / L], [0], [0], [0]])], [np.zeros((1, 5))]]))
    x, rows = np.zeros(4), []
    for v in LEVELS:
        rows.append(x[:2])
        x = both[:4, :4] @ x + both[:4, 4] * v
    return np.array(rows)


@pytest.mark.parametrize("frequency", [42.0, pytest.param(80.0, marks=pytest.mark.full)])
def test_a_speed_that_swings_after_the_edges_is_said_to_have_a_second_inertia(frequency):
    """A limit of the current, a low-pass and a dip of the voltage were told instead, and nobody named what it was."""
    noise = np.random.default_rng(1).standard_normal((ROWS, 2)) * [0.03, 0.25]
    i, w = (behind_a_coupling(frequency) + noise).T
    columns = {"voltage [V]": LEVELS, "current [A]": i, "speed [rad/s]": w}
    found = estimate_parameters(recording_from_arrays("coupled", STEP * np.arange(ROWS), columns), workers=1)
    assert found.verdict == "doubtful"
    (told,) = [reason for reason in found.reasons if reason.startswith("w swings at ")]
    assert float(told.split()[3]) == pytest.approx(frequency, rel=0.05)


@pytest.mark.parametrize(
    ("left", "is_swing"),
    [
        (lambda t: 5 * np.exp(-t / 0.05) * np.sin(2 * np.pi * 42 * t), True),
        (lambda t: 5 * np.sin(2 * np.pi * 42 * t), False),  # a hum
        (lambda t: 5 * np.exp(-t / 0.05), False),
        (lambda t: 5 * np.exp(-t / 0.02) * np.sin(2 * np.pi * 20 * t), False),  # over within a period or two
        (lambda t: 0.3 * np.exp(-t / 0.05) * np.sin(2 * np.pi * 42 * t), False),  # noise
    ],
)
def test_what_swings_is_at_one_frequency_and_falls(left, is_swing):
    t = STEP * np.arange(-200, 700)
    noise = 0.25 * np.random.default_rng(2).standard_normal(len(t))
    found = _after(np.where(t >= 0, left(np.maximum(t, 0.0)), 0.0) + noise, 200, len(t), STEP)
    assert (found is not None) == is_swing
    assert found is None or found[0] == pytest.approx(42, rel=0.05)
