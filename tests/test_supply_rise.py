"""A supply that reaches its command more slowly than the winding: which of both is slow no recording tells."""

import numpy as np
import pytest
from fine_motor import MOTOR, STEP, bench, instants

from estimator import estimate_parameters

COMMAND = np.repeat([0.0, 9.0], [80, 400])


@pytest.mark.parametrize("slower", [8.0, *(pytest.param(k, marks=pytest.mark.full) for k in (0.5, 2.0))])
def test_both_time_constants_exchanged_are_told(slower):
    """The winding was told as slow as the supply, 36 standard errors off, and no word of the exchange."""
    winding = MOTOR["L"] / MOTOR["R"]
    since = np.maximum(instants(len(COMMAND)) - 80 * STEP, 0.0)
    voltage = 9.0 * -np.expm1(-since / (slower * winding))
    result = estimate_parameters(bench(COMMAND, voltage, 3), workers=1)
    assert result.verdict == "doubtful" and "voltage rise" in result.effects, result.effects
    assert any("with other values would explain" in reason for reason in result.reasons), result.reasons
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 3 * found.standard_error, (name, found)
