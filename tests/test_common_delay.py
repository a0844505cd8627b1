"""Recordings of one bench that are all as late: one delay of all of them, beside what each is later by itself."""

from types import SimpleNamespace

import fine_motor
import numpy as np
import pytest
from fine_motor import FINE, STEP, bench, off

from estimator import estimate_parameters
from estimator.explaining import common_number
from estimator.explaining.addition import Addition
from estimator.explaining.effects.delay import Delay
from estimator.plans.plan import Observed

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


def explained(own):
    """Return an explanation of three recordings whose delays are these, each with its standard error, in ms."""
    names, effect = [f"delay {chr(97 + k)}" for k in range(len(own))], Delay()
    additions = tuple(Addition(effect, name, 1, 50.0, free=(name,)) for name in names)
    values, errors = (1e-3 * np.array(column) for column in zip(*own, strict=True))
    observed = [SimpleNamespace(recording=SimpleNamespace(name=chr(97 + k))) for k in range(len(own))]
    fit = SimpleNamespace(
        simulator=SimpleNamespace(plan=SimpleNamespace(observed=observed), index=dict.fromkeys([*names, "delay"], 0)),
        free=tuple(names), names=tuple(names), estimates=values, cost=1000.0,
        covariance_parts=lambda: (np.diag(errors**2), 0.0),
    )  # fmt: skip
    return SimpleNamespace(fit=fit, additions=additions)


@pytest.mark.parametrize(("second", "tried"), [(0.21, True), (0.5, False)])
def test_one_number_is_tried_where_those_of_all_recordings_are_alike(monkeypatch, second, tried):
    found = []
    monkeypatch.setattr(common_number, "_with_one", lambda e, own, one, mean, limit: found.append((one, mean, limit)))
    own = [(0.20, 0.01), (second, 0.01), (0.19, 0.02)]
    list(common_number.in_common(explained(own), 1000))
    assert bool(found) == tried
    for one, mean, limit in found:  # it saves two numbers of log 1000 each, and their priors
        assert one.name == "delay" and one.free == ("delay",)
        assert mean == pytest.approx(1e-3 * np.average([0.20, second, 0.19], weights=[1, 1, 0.25]))
        assert limit == pytest.approx(1000 + 2 * (np.log(1000) + 2 * np.log(1 / Delay().prior)))


def test_that_a_measured_voltage_shows_a_jump_late_costs_nothing():
    for noise, penalty in ((0.0, np.log(1000) + 2 * np.log(1 / Delay().prior)), (0.02, 2 * np.log(2))):
        v = np.repeat([0.0, 9.0], 50) + noise * np.random.default_rng(1).standard_normal(100)
        recording = SimpleNamespace(name="a", step=STEP, time=STEP * np.arange(100))
        observed = Observed(recording, {"v": v}, {}, SimpleNamespace(kind="step"), 0)
        plan = SimpleNamespace(observed=[observed], declared=(), case=SimpleNamespace(linear=()))
        (delay,) = Delay().nuisances(plan)
        assert Addition(Delay(), "delay", 1, 0.0, foretold=delay.foretold).penalty(1000) == pytest.approx(penalty)
