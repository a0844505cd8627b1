"""A drive that changes its voltage at a limited rate: told where changes of several sizes take their own times."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, STEP, bench, off

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

COMMAND = np.repeat([0.0, 3.0, 9.0, 5.0], [100, 300, 300, 300])


def limited(command, rate, late=0):
    """Return a voltage, (rows FINE,), V, that follows a command, (rows,), by V/s at most, late by parts of a row."""
    voltage, now = np.empty(len(command) * FINE), 0.0
    for k, target in enumerate(np.repeat(command, FINE).tolist()):
        before, now = now, now + float(np.clip(target - now, -rate * STEP / FINE, rate * STEP / FINE))
        voltage[k] = 0.5 * (before + now)
    return np.concatenate([np.zeros(late), voltage])[: len(voltage)]


@pytest.mark.parametrize(
    ("ms", "late"), [(4.7, 35), *(pytest.param(ms, 0, marks=pytest.mark.full) for ms in (4.7, 13.0))]
)
def test_changes_that_take_as_long_as_they_are_large_are_told_and_the_motor_is_right(ms, late):
    """By one time for all of them, and what made up for it, R, K, J and B were not told at all."""
    result = estimate_parameters(bench(COMMAND, limited(COMMAND, 6.0 / (ms * 1e-3), late), 1), workers=1)
    assert "slew limit" in result.effects, (result.effects, result.reasons)
    told = result.chain["slew limit"]
    assert told.value == pytest.approx(ms * 1e-3, abs=6 * told.standard_error) and told.standard_error < 3e-4
    assert result.verdict == "ok", result.reasons
    assert off(result).max() < 4.5, result.parameters


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in range(1, 4))])
def test_a_drive_that_follows_at_once_has_none(seed):
    result = estimate_parameters(bench(COMMAND, np.repeat(COMMAND, FINE), seed), workers=1)
    assert result.verdict == "ok" and "slew limit" not in result.effects, (result.effects, result.reasons)


def test_a_command_beside_a_voltage_that_is_measured_has_its_limit():
    """What is measured has its ramps; the two changes of the command alone are of two sizes."""
    rate, command = 6.0 / 4.7e-3, np.repeat([0.0, 3.0, 9.0], [100, 300, 300])
    voltage = limited(command, rate)
    measured = bench(voltage[::FINE], voltage, 2, noise=1e-3, name="m")
    result = estimate_parameters([bench(command, voltage, 1), measured], workers=1)
    assert "slew limit" in result.effects, (result.effects, result.reasons)
    told = result.chain["slew limit"]
    assert told.value == pytest.approx(4.7e-3, abs=6 * told.standard_error)
    for name in "KJB":
        found = result.parameters[name]
        assert abs(found.value - MOTOR[name]) < 4.5 * found.standard_error, name
