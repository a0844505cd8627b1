"""A supply that reaches its command more slowly than the winding: which of both is slow no recording tells."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, STEP, bench, instants, off
from scipy.signal import lfilter

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


@pytest.mark.full
def test_a_command_that_moves_in_every_row_may_rise_behind_too():
    """Of a chirp whose amplifier was slow a sag, a delay and a filter were told: ok, L 48 standard errors off."""
    rows, part = 600, -np.expm1(-STEP / FINE / 1.5e-3)
    since = np.arange(rows) * STEP
    command = 9.0 * np.sin(2 * np.pi * (2.0 + 90.0 * since / since[-1]) * since)
    voltage = lfilter([part], [1.0, part - 1.0], np.repeat(command, FINE))
    result = estimate_parameters(bench(command, voltage, 4), workers=1)
    assert result.verdict == "doubtful" and "voltage rise" in result.effects, (result.effects, result.reasons)
    assert np.max(off(result)) < 4.5, off(result)
