"""A motor that follows the pulses of its drive: they are found, the parameters beside them right, and doubted."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, STEP, bench, instants

from estimator import estimate_parameters

SUPPLY = 12.0  # V
LEVELS = np.repeat([0.0, 5.2, 8.9], [100, 500, 500])


def recorded(frequency, seed, *, phase=0.3, line=0.0):
    """Return a bench's recording of a command of two levels, switched between 0 V and the supply.

    Its current has a line of 83.3 Hz, of so many A, while the voltage is on.
    """
    duty = np.repeat(LEVELS, FINE) / SUPPLY
    on = (instants(len(LEVELS)) * frequency + phase) % 1.0 < duty
    voltage = np.where(on, SUPPLY, 0.0) if frequency else duty * SUPPLY
    hum = line * np.cos(2 * np.pi * 83.3 * STEP * np.arange(len(LEVELS))) * (LEVELS > 0)
    return bench(LEVELS, voltage, seed, more=hum)


@pytest.mark.parametrize(
    ("frequency", "seed"),
    [(120.3, 0), *(pytest.param(*case, marks=pytest.mark.full) for case in ((61.7, 0), (237.3, 1)))],
)
def test_pulses_are_found_and_the_motor_is_right(frequency, seed):
    """The lines in the current alone left those of the speed and of every transient: the resistance was lost."""
    result = estimate_parameters(recorded(frequency, seed), workers=1)
    assert "slow PWM" in result.effects, (result.effects, result.reasons)
    assert result.verdict == "doubtful" and any("or switch faster" in reason for reason in result.reasons)
    (told,) = (note for note in result.notes if "follows the drive's switching" in note)
    assert float(told.split(" at ")[1].split()[0]) == pytest.approx(frequency, rel=1e-3)
    for name, value in MOTOR.items():
        found = result.parameters[name]
        wide = 0.6 if name == "L" else 0.15  # the sharpest part of the pulses behind an edge is not known
        assert abs(found.value - value) < 4.5 * found.standard_error < wide * value, (name, found)


def test_a_line_that_is_no_pulses_is_a_line():
    """The shaft's first order, of some percent of the voltage, was told as a switching of five real motors."""
    result = estimate_parameters(recorded(0.0, 2, line=0.1), workers=1)
    assert "switching ripple" in result.effects and "slow PWM" not in result.effects, result.effects
    assert result.verdict == "ok", result.reasons
