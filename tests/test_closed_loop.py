"""A speed loop passes the noise of its sensor on to the voltage: what this selects are no edges."""

import numpy as np
import pytest
from motors import CML050
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays

WANTED = np.repeat([0.0, 150.0, 60.0, 120.0, -80.0], [100, 300, 300, 300, 300])  # rad/s
PROPORTIONAL, INTEGRAL, NOISE = 0.2, 5.0, np.array([0.02, 5.0])  # V s/rad, V/rad; A, rad/s
STEP = 1e-3  # s


def controlled(seed):
    """Return a recording of a PI loop, its voltage held from row to row and logged exactly."""
    r, k, inductance, j, b = (getattr(CML050, name) for name in "RKLJB")
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after = expm(whole * STEP)
    noise = np.random.default_rng(seed).standard_normal((len(WANTED), 2)) * NOISE
    state, total, rows = np.zeros(2), 0.0, []
    for wanted, off_by in zip(WANTED, noise, strict=True):
        shown = state + off_by
        total += INTEGRAL * (wanted - shown[1]) * STEP
        voltage = float(np.clip(PROPORTIONAL * (wanted - shown[1]) + total, -24, 24))
        rows.append((voltage, *shown))
        state = after[:2, :2] @ state + after[:2, 2] * voltage
    columns = dict(zip(("voltage [V]", "current [A]", "speed [rad/s]"), np.array(rows).T, strict=True))
    return recording_from_arrays("loop", STEP * np.arange(len(rows)), columns)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in range(1, 10))])
def test_it_is_no_doubt(seed):
    """Rows that the noise itself had selected were "no plain noise: neighbours are alike", of 14 in 24."""
    result = estimate_parameters(controlled(seed), workers=1)
    assert result.verdict == "ok", result.reasons
    for name in "RKLJB":
        found = result.parameters[name]
        assert abs(found.value - getattr(CML050, name)) < 4.5 * found.standard_error, (name, found)
