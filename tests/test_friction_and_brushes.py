"""Dry friction and a brush drop together, at several levels one way, through a coarse converter."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 0.9, "K": 0.053, "L": 1e-4, "J": 1.3e-3, "B": 1.35e-5, "friction": 0.031, "brush": 0.44, "stiction": 0.0}
ROWS, STEP, LEVELS = 4000, 2e-3, 8


OTHERS = [pytest.param(k, marks=pytest.mark.full) for k in (0, 1, 2, 4)]


@pytest.mark.parametrize("seed", [6, *OTHERS])
def test_friction_and_brushes_are_no_loads_that_change(seed):
    """Each alone explains half, a load that changes as much, which was taken first, and five more made up for it."""
    rng = np.random.default_rng(seed)
    first, each = ROWS // 20, (ROWS - ROWS // 20) // LEVELS
    levels = np.round(rng.uniform(0.5, 10, LEVELS), 1)
    voltage = np.concatenate([np.zeros(first), np.repeat(levels, each)])
    voltage = np.pad(voltage, (0, ROWS - len(voltage)), mode="edge")
    times = np.arange(ROWS) * STEP
    shown = simulate_fmu("dc_motor_friction", times=times, inputs={"v": voltage}, parameters=MOTOR)
    i, w = (np.round(shown[y] / q + 0.7 * rng.standard_normal(ROWS)) * q for y, q in (("i", 0.062), ("w", 1.4)))
    result = estimate_parameters(time=times, v=voltage, i=i, w=w, workers=1)
    assert {"brush", "friction"} <= set(result.chain) and "load step" not in result.effects, result.effects
    for name in "RKJB":
        found = result.parameters[name]
        assert abs(found.value - MOTOR[name]) < 4.5 * found.uncertainty, name
        assert found.uncertainty < (0.6 if name == "B" else 0.005) * MOTOR[name], name
