"""A sensor that shows none of slow speeds: told by how the speed comes and goes, and what it hides is left out."""

import numpy as np
import pytest
from fine_motor import FINE, STEP, bench, off

from estimator import estimate_parameters, recording_from_arrays
from estimator.recordings.dead_zone import hidden_speeds, least_speed

pytestmark = pytest.mark.usefixtures("shared_workers")

COMMANDS = {
    "step": np.repeat([0.0, 9.0], [100, 500]),
    "reversal": np.repeat([0.0, 9.0, -9.0], [100, 300, 400]),
    "back to zero": np.repeat([0.0, 9.0, 0.0], [100, 300, 400]),
}
UNITS = {"voltage": "V", "current": "A", "speed": "rad/s"}
LEAST = 35.0  # rad/s, of some 210


def recorded(excitation, seed, *, least=LEAST, name="b"):
    """Return a bench's recording whose sensor shows noise alone of speeds below a least one."""
    command = COMMANDS[excitation]
    whole = bench(command, np.repeat(command, FINE), seed, name=name)
    v, i, w = (whole.signals[column] for column in ("voltage", "current", "speed"))
    quiet = np.random.default_rng(seed + 1).standard_normal(len(w)) * 0.05
    shown = np.where(np.abs(w) < least, quiet, w) if least else w
    columns = {"voltage [V]": v, "current [A]": i, "speed [rad/s]": shown}
    return recording_from_arrays(name, np.arange(len(w)) * STEP, columns)


@pytest.mark.parametrize("excitation", COMMANDS)
def test_what_a_sensor_hides_is_found_and_the_motor_is_right(excitation):
    recording = recorded(excitation, 1)
    least = least_speed(recording.signals["speed"], recording.signals["voltage"])
    assert LEAST <= least < LEAST + 10.0  # it rises by 8 rad/s in a row
    result = estimate_parameters(recording, workers=1)
    assert any("the sensor of w shows none below" in note for note in result.notes), result.notes
    assert result.verdict == "ok", result.reasons
    assert off(result).max() < 4.5, result.parameters


def test_one_recording_tells_it_of_the_others():
    several = [recorded(e, k, name=e) for k, e in enumerate(COMMANDS)]
    fast = several[0].signals["speed"]
    assert hidden_speeds(fast, several[0].signals["voltage"], LEAST).sum() >= 2
    result = estimate_parameters(several, workers=1)
    assert sum("the sensor of w shows none below" in note for note in result.notes) == 3, result.notes
    assert result.verdict == "ok" and off(result).max() < 4.5, (result.reasons, result.parameters)


@pytest.mark.parametrize("excitation", COMMANDS)
def test_a_speed_that_is_shown_whole_hides_none(excitation):
    for seed in range(5):
        recording = recorded(excitation, seed, least=0.0)
        assert least_speed(recording.signals["speed"], recording.signals["voltage"]) == 0.0


@pytest.mark.parametrize(
    "shown",
    [
        lambda w: np.rint(w / 12.0) * 12.0,  # counts of an encoder
        lambda w: np.repeat(w[::8], 8)[: len(w)],  # a logger that holds
        lambda w: np.concatenate([w[:101], w[106:], w[-5:]]),  # rows lost at the edge
        lambda w: np.where(np.arange(len(w)) < 130, 0.0, w),  # a brake that lets go at once
    ],
)
def test_steps_holds_and_lost_rows_are_no_limit_of_a_sensor(shown):
    recording = recorded("step", 7, least=0.0)
    assert least_speed(shown(recording.signals["speed"]), recording.signals["voltage"]) == 0.0


def test_rows_before_a_voltage_that_is_on_from_the_first_hide_the_speed_too():
    """All rows before the first change later were taken for those of a machine that stands."""
    voltage, speed = (
        np.repeat([9.0, 0.0], [200, 100]),
        np.concatenate([np.zeros(8), np.full(192, 200.0), np.zeros(100)]),
    )
    assert hidden_speeds(speed, voltage, LEAST).sum() == 108
    whole = recorded("step", 4)
    columns = {
        f"{n} [{u}]": whole.signals[n][100:] for n, u in (("voltage", "V"), ("current", "A"), ("speed", "rad/s"))
    }
    result = estimate_parameters(recording_from_arrays("on", np.arange(500) * STEP, columns), workers=1)
    assert result.verdict == "ok" and off(result).max() < 4.5, (result.reasons, result.parameters)


def test_a_first_sample_that_is_missing_hides_no_rest():
    """That of a speed which is told by an angle is: all rows at rest were left out."""
    speed = np.concatenate([[np.nan], np.zeros(107), np.full(192, 200.0)])
    assert hidden_speeds(speed, np.repeat([0.0, 9.0], [100, 200]), LEAST)[:100].sum() == 0
