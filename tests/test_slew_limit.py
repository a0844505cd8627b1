"""A drive that changes its voltage at a limited rate: told where changes of several sizes take their own times."""

from types import SimpleNamespace

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, STEP, bench, off

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.effects import slew_limit
from estimator.explaining.effects.missing_voltage import shown_more
from estimator.noise.clock import Clock
from estimator.plans.plan import Observed
from estimator.recordings.excitation import Excitation

pytestmark = pytest.mark.usefixtures("shared_workers")

REST = Excitation("several", 50, 0.0, 0.0, False)
UNITS = {"voltage": "V", "current": "A", "speed": "rad/s"}
COMMAND = np.repeat([0.0, 3.0, 9.0, 5.0], [100, 300, 300, 300])


def limited(command, rate, late=0):
    """Return a voltage, (rows FINE,), V, that follows a command, (rows,), by V/s at most, late by parts of a row."""
    voltage, now, most = np.empty(len(command) * FINE), 0.0, rate * STEP / FINE
    for k, target in enumerate(np.repeat(command, FINE).tolist()):
        before, now = now, now + max(-most, min(most, target - now))
        voltage[k] = 0.5 * (before + now)
    return np.concatenate([np.zeros(late), voltage])[: len(voltage)]


@pytest.mark.parametrize(
    ("ms", "late"), [(4.7, 0), *(pytest.param(*case, marks=pytest.mark.full) for case in ((4.7, 35), (13.0, 0)))]
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


@pytest.mark.full
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


@pytest.mark.full  # of one from rest above
def test_a_recording_that_runs_already_is_limited_from_the_voltage_that_it_was_run_in_with():
    """It was limited from none: a sag, a rise and a delay were told, R was open by 25 %, and it took minutes."""
    whole = bench(COMMAND, limited(COMMAND, 6.0 / 4.7e-3), 1)
    columns = {f"{name} [{unit}]": whole.signals[name][1000 - 400 :] for name, unit in UNITS.items()}
    command = columns["voltage [V]"]
    assert command[0] == 9.0 and command[-1] == 5.0
    result = estimate_parameters(recording_from_arrays("b", np.arange(400) * STEP, columns), workers=1)
    assert "slew limit" not in result.effects, "one change is a ramp"
    columns = {f"{name} [{unit}]": whole.signals[name][300:] for name, unit in UNITS.items()}
    result = estimate_parameters(recording_from_arrays("b", np.arange(700) * STEP, columns), workers=1)
    assert result.verdict == "ok" and "slew limit" in result.effects, (result.reasons, result.effects)
    told = result.chain["slew limit"]
    assert told.value == pytest.approx(4.7e-3 * 6.0 / 6.0, abs=6 * told.standard_error)
    assert off(result).max() < 4.5, result.parameters


@pytest.mark.parametrize("speed", [0.0, pytest.param(1.0, marks=pytest.mark.full)])
def test_a_recording_without_any_voltage_beside_levels_of_several_sizes_is_none_of_it(speed):
    """One that rests, or is braked: a ValueError."""
    rng, rows = np.random.default_rng(3), 300
    coast = speed * 200 * np.exp(-np.arange(rows) * STEP / 0.025)
    columns = {"voltage [V]": np.zeros(rows), "current [A]": -coast * MOTOR["K"] / MOTOR["R"], "speed [rad/s]": coast}
    columns = {name: y + (name[0] != "v") * rng.standard_normal(rows) * 0.01 for name, y in columns.items()}
    still = recording_from_arrays("s", np.arange(rows) * STEP, columns)
    result = estimate_parameters([bench(COMMAND, np.repeat(COMMAND, FINE), 1), still], workers=1)
    assert result.verdict in ("ok", "doubtful") and "slew limit" not in result.effects
    assert off(result).max() < 4.5, result.parameters


def test_its_part_is_as_late_as_its_channel_also_where_the_circuit_opens_and_where_steps_differ():
    """A delay of whole rows shows what no delay does, rows later; a part of a row is one of each recording's own."""
    command = np.repeat([0.0, 9.0, 0.0, 4.0, 0.0], [50, 15, 25, 15, 100])
    values = (*MOTOR.values(), 1.0, 20e-3)
    names = (*MOTOR, "coasts", "slew limit")

    def added(late, part=0.0, steps=(STEP,)):
        named = [SimpleNamespace(name=str(h)) for h in steps]
        times = [np.arange(len(command)) * h for h in steps]
        runs = [Observed(n, {"v": command}, {}, REST, 0, late, taken=t) for n, t in zip(named, times, strict=True)]
        clocks = [Clock(o.taken, slice(k * len(command), (k + 1) * len(command))) for k, o in enumerate(runs)]
        plan = SimpleNamespace(
            fixed={}, observed=runs, chains={}, sensors={"i": 0, "w": 0}, temperatures=(), stands_at=None
        )
        own = SimpleNamespace(plan=plan, names=names, outputs=("i", "w"), observed=runs, nuisances=(), clocks=clocks)
        own.rows = len(command) * len(runs)
        return shown_more(slew_limit.SLEW, slew_limit._missing, own, np.array(values), part)

    now, late = added(0.0), added(7 * STEP)
    np.testing.assert_allclose(late[7:], now[:-7], atol=1e-9 * np.abs(now).max())
    both, slower = added(0.0, 0.5, (STEP, 4 * STEP)), added(0.0, 0.5, (4 * STEP,))
    np.testing.assert_allclose(both[len(command) :], slower, atol=1e-9 * np.abs(slower).max())


@pytest.mark.full  # a limit is told above
def test_changes_that_come_later_the_larger_they_are_are_no_latencies_of_their_own():
    """They were moved before any fit, each by its own: saturation and brushes were told, R 6 % off, in two minutes."""
    command = np.repeat([0.0, 9.0, 4.0, 8.0, 1.0, 6.0, -4.0], [100, *6 * [200]])
    recording = bench(command, limited(command, 400.0), 1)
    result = estimate_parameters(recording, workers=1)
    assert result.effects == ("slew limit",) and result.verdict == "ok", (result.effects, result.reasons)
    assert off(result).max() < 4.5, result.parameters
