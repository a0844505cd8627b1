"""A model with a friction, for a motor that has none: that nothing of it is seen is no reason to doubt the others."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 2.2, "K": 0.334, "L": 1.6e-3, "J": 1.5e-3, "B": 1.93e-3}


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.full)])
def test_a_friction_that_is_not_there_leaves_the_verdict_ok(seed):
    times = 1e-3 * np.arange(2000)
    voltage = np.repeat([0.0, 6.0, -4.0, 9.0, 2.0], 400)
    shown = simulate_fmu("dc_motor", times=times, inputs={"v": voltage}, parameters=MOTOR)
    rng = np.random.default_rng(seed)
    i, w = shown["i"] + 0.01 * rng.standard_normal(2000), shown["w"] + 0.04 * rng.standard_normal(2000)
    result = estimate_parameters(time=times, v=voltage, i=i, w=w, fmu="dc_motor_friction", workers=1)
    friction = result.parameters["friction"]
    assert friction.status == "not identified" or friction.value < 4.5 * friction.uncertainty
    assert result.verdict == "ok", result.reasons
    for name, truth in MOTOR.items():
        assert abs(result.parameters[name].value - truth) < 4.5 * result.parameters[name].uncertainty, name
