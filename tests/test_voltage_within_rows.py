"""A voltage that moves within each sampling interval, of which the log holds the mean: L is right, or has wide bars."""

import numpy as np
import pytest
from fine_motor import FINE, STEP, bench, instants, off

from estimator import estimate_parameters

NAME = "voltage within rows"
LEVELS, ROWS = (6.0, -2.0, 4.0, -4.0, 8.0, 0.0), 60  # V; of each
FALLS = 0.4e-3  # s: the controller takes back what it gave too much at an edge


def controlled(surplus):
    """Return a current loop's voltage, held over each part of a row: more at each edge, by so much of its change."""
    levels = np.repeat(np.concatenate([[0.0], LEVELS]), ROWS)
    change = np.diff(levels, prepend=0.0)
    voltage = np.repeat(levels, FINE)
    for row in np.flatnonzero(change):
        since = instants(len(levels) - row)
        voltage[row * FINE :] += surplus * change[row] * np.exp(-since / FALLS)
    return voltage


def recorded(surplus, seed):
    """Return a recording whose voltage is the mean over each row."""
    voltage = controlled(surplus)
    return bench(voltage.reshape(-1, FINE).mean(axis=1), voltage, seed)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in range(1, 6))])
def test_it_is_found_and_the_motor_is_right(seed):
    """L was 4 % off, or 12 standard errors, and ok."""
    result = estimate_parameters(recorded(1.0, seed), workers=1)
    assert NAME in result.effects and result.verdict == "ok", (result.effects, result.reasons)
    assert any("moves within the sampling intervals" in note for note in result.notes)
    assert off(result).max() < 4.5, off(result)


@pytest.mark.full  # that it is found is asked above
def test_without_it_the_bars_do_not_hold(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", NAME)
    result = estimate_parameters(recorded(1.0, 0), workers=1)
    assert result.verdict != "ok" or off(result).max() > 4.5, off(result)


def test_of_a_voltage_that_is_held_none_is_told():
    """A sine of a converter, held over each row."""
    command = 6.0 * np.sin(2 * np.pi * 9.0 * STEP * np.arange(600)) * (np.arange(600) >= 50)
    result = estimate_parameters(bench(command, np.repeat(command, FINE), 1), workers=1)
    assert NAME not in result.effects and result.verdict == "ok", (result.effects, result.reasons)
    assert off(result).max() < 4.5, off(result)
