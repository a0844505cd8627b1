"""A rectified supply, whose voltage has a ripple of twice the mains: told, and the motor right beside it."""

import numpy as np
import pytest
from fine_motor import FINE, bench, instants, off

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

COMMAND = np.repeat([0.0, 5.0, 9.0], [100, 350, 350])


def recorded(seed, *, part=0.0, frequency=100.0, line=0.0):
    """Return a bench's recording of a supply with a ripple of a part of its voltage, or of a line in the current."""
    phase = 2 * np.pi * frequency * instants(len(COMMAND)) + 0.7
    hum = line * np.cos(phase[::FINE])
    return bench(COMMAND, np.repeat(COMMAND, FINE) * (1 + part * np.cos(phase)), seed, more=hum)


@pytest.mark.parametrize("frequency", [100.02, pytest.param(359.9, marks=pytest.mark.full)])
def test_a_ripple_of_the_supply_is_told_with_its_size_and_the_motor_is_right(frequency):
    result = estimate_parameters(recorded(1, part=0.05, frequency=frequency), workers=1)
    assert "supply ripple" in result.effects and result.verdict == "ok", (result.effects, result.reasons)
    (told,) = (note for note in result.notes if "the supply has a ripple" in note)
    numbers = [float(word) for word in told.replace("%", "").split() if word[0].isdigit()]
    assert numbers == pytest.approx([frequency, 5.0], rel=0.03)
    assert numbers[0] == pytest.approx(frequency, rel=1e-3)
    assert off(result).max() < 4.5, result.parameters


def test_hum_that_the_sensor_picks_up_is_no_ripple_of_the_supply():
    """It is as large at rest, where a supply that is off has none."""
    result = estimate_parameters(recorded(2, line=0.04), workers=1)
    assert "supply ripple" not in result.effects and result.verdict == "ok", (result.effects, result.reasons)
    assert off(result).max() < 4.5, result.parameters


def test_a_supply_that_has_none_is_not_told_to():
    for seed in (3, 4, 5):
        result = estimate_parameters(recorded(seed), workers=1)
        assert "supply ripple" not in result.effects and result.verdict == "ok", (result.effects, result.reasons)
