"""A command that asks for more than the supply has: the limit is told, and the motor is right."""

import numpy as np
import pytest
from fine_motor import FINE, bench, off

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

LEVELS = np.repeat([0.0, 12.0, 5.0, 9.0, 3.0], [100, 250, 250, 250, 250])
BOTH_WAYS = np.repeat([0.0, 12.0, -10.0, 4.0, 8.0], [100, 250, 250, 250, 250])
CONTROLLED = np.where(np.arange(1100) < 100, 0.0, 5.0 + 12.0 * np.exp(-(np.arange(1100) - 100.0) / 60.0))


@pytest.mark.parametrize(
    ("command", "limit"),
    [(LEVELS, 7.4), *(pytest.param(*case, marks=pytest.mark.full) for case in ((BOTH_WAYS, 6.5), (CONTROLLED, 9.0)))],
    ids=["levels", "both ways", "controller"],
)
def test_a_supply_that_has_less_than_its_command_asks_for_is_told_and_the_motor_is_right(command, limit):
    """Without it current and speed of two levels were the same, and sags, loads and a coasting drive were told."""
    result = estimate_parameters(bench(command, np.repeat(np.clip(command, -limit, limit), FINE), 1), workers=1)
    assert "supply limit" in result.effects, (result.effects, result.reasons)
    told = result.chain["supply limit"]
    assert told.value == pytest.approx(limit, abs=6 * told.standard_error) and told.standard_error < 0.05
    assert result.verdict == "ok", result.reasons
    assert off(result).max() < 4.5, result.parameters


@pytest.mark.full
def test_without_the_effect_it_is_doubted(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "supply limit")
    result = estimate_parameters(bench(LEVELS, np.repeat(np.clip(LEVELS, -7.4, 7.4), FINE), 1), workers=1)
    assert result.verdict != "ok"


@pytest.mark.parametrize(
    "command", [LEVELS, pytest.param(BOTH_WAYS, marks=pytest.mark.full)], ids=["levels", "both ways"]
)
def test_a_drive_that_gives_what_it_is_asked_for_has_none(command):
    result = estimate_parameters(bench(command, np.repeat(command, FINE), 2), workers=1)
    assert result.verdict == "ok" and "supply limit" not in result.effects, (result.effects, result.reasons)
