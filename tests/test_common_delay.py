"""Recordings of one bench that are all as late: one delay of all of them, beside what each is later by itself."""

import fine_motor
import numpy as np
import pytest
from fine_motor import FINE, STEP, bench, off

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

LATE = 8  # parts of a row: 0.16 ms, of a command that a board takes behind its sampling


def late_by(parts, seed, levels=(0.0, 4.0, 9.0)):
    """Return a recording of levels that reach the motor so many parts of a row late."""
    command = np.repeat(levels, [50, 200, 200])
    voltage = np.repeat(command, FINE)
    return bench(command, np.concatenate([np.zeros(parts), voltage])[: len(voltage)], seed, name=f"run{seed}")


def test_recordings_that_are_all_as_late_have_one_delay():
    """Each its own costs three numbers: two filters, of both channels, were told in its place, and L was doubted."""
    result = estimate_parameters([late_by(LATE, 1), late_by(LATE, 2, (0.0, 9.0, 5.0)), late_by(LATE, 3)], workers=1)
    assert result.verdict == "ok" and result.effects == ("delay",), (result.effects, result.reasons)
    delay = result.chain["delay"]
    assert abs(delay.value - LATE * STEP / FINE) < 4.5 * delay.standard_error
    assert off(result).max() < 4.5, result.parameters


def test_one_that_is_later_by_itself_is_so_beside_the_others():
    recordings = [late_by(LATE, 1), late_by(LATE + 20, 2), late_by(LATE, 3)]
    result = estimate_parameters(recordings, workers=1)
    assert result.verdict == "ok" and result.effects == ("delay",), (result.effects, result.reasons)
    late = {
        name: result.chain[name] for name in ("delay", "delay run1", "delay run2", "delay run3") if name in result.chain
    }
    common = late["delay"].value if "delay" in late else 0.0
    for name, parts in (("run1", LATE), ("run2", LATE + 20), ("run3", LATE)):
        own = late[f"delay {name}"].value if f"delay {name}" in late else 0.0
        assert common + own == pytest.approx(parts * STEP / FINE, abs=0.01e-3), late
    assert off(result).max() < 4.5, result.parameters


def test_each_ones_delay_is_exchanged_for_one_of_all_where_that_is_enough(monkeypatch):
    """Windings that differ were told later: before, each recording was late by another time."""
    recordings = []
    for seed, resistance in enumerate((1.6, 1.66, 1.55), start=1):
        monkeypatch.setitem(fine_motor.MOTOR, "R", resistance)
        recordings.append(late_by(LATE, seed))
    monkeypatch.setitem(fine_motor.MOTOR, "R", float(np.mean((1.6, 1.66, 1.55))))
    result = estimate_parameters(recordings, workers=1)
    assert result.verdict == "ok" and set(result.effects) == {"delay", "between runs"}, (result.effects, result.reasons)
    assert [name for name in result.chain if name.startswith("delay")] == ["delay"]
    assert result.chain["delay"].value == pytest.approx(LATE * STEP / FINE, abs=0.01e-3)
    assert off(result).max() < 4.5, result.parameters


def test_a_measured_voltage_that_jumps_is_in_the_row_behind_its_jump():
    """Eddy currents and no delay at all explained such a step nearly as well: L was known forty times worse."""
    command = np.repeat([0.0, 9.0, -9.0], [50, 300, 300])
    early = np.append(np.repeat(command, FINE)[45:], np.full(45, command[-1]))
    result = estimate_parameters(bench(command, early, 1, noise=0.02), workers=1)
    assert result.verdict == "ok" and "delay" in result.effects, (result.effects, result.reasons)
    assert result.chain["delay"].value == pytest.approx(-45 * STEP / FINE, abs=0.02e-3)
    assert not any("eddy" in rival.what for rival in result.rivals)
    found = result.parameters["L"]
    assert off(result).max() < 4.5 and found.standard_error < 0.01 * found.value, found
