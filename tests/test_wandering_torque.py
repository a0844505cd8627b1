"""Torques that wander more slowly than a recording shows: as possible as the one that it does, and B holds them."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from fine_motor import MOTOR, bench, off

from estimator import estimate_parameters
from estimator.explaining import wandering_torque
from estimator.explaining.parameter_drift import friction_variance
from estimator.noise.noise_model import NoiseModel

COMMAND = np.repeat([0.0, 9.0], [100, 500])
FINE = 50


def test_a_slower_torque_is_the_same_random_walk_for_a_while():
    """Over times far below its own a process of deviation s and time tau diffuses by 2 s^2 / tau."""
    noise = dataclasses.replace(NoiseModel.plain(np.array([0.01, 0.3]), (0, 1)), torque=(2e-4, 0.3))
    slower = wandering_torque._more_slowly(noise)
    assert [own.torque[1] for own in slower] == pytest.approx([0.3 * times for times in wandering_torque.SLOWER])
    assert [own.torque[0] ** 2 / own.torque[1] for own in slower] == pytest.approx([2e-4**2 / 0.3] * len(slower))


def test_a_short_recording_knows_b_no_better_than_slower_torques_let_it(monkeypatch):
    """A torque of 2 % of the friction that wanders over 0.5 s, as the voltage that does the same at this one speed."""
    rng, tau, step = np.random.default_rng(4), 0.5, 1e-3
    left, wander = np.exp(-step / tau), [rng.standard_normal()]
    for _ in COMMAND[1:]:
        wander.append(left * wander[-1] + np.sqrt(1 - left**2) * rng.standard_normal())
    size = 0.02 * MOTOR["B"] * 210 * MOTOR["R"] / MOTOR["K"]  # V
    recording = bench(COMMAND, np.repeat(COMMAND + size * np.array(wander) * (COMMAND > 0), FINE), 1)
    bars = []
    for slower in (wandering_torque.SLOWER, ()):
        monkeypatch.setattr(wandering_torque, "SLOWER", slower)
        result = estimate_parameters(recording, workers=1)
        assert off(result).max() < 4.5
        bars.append(result.parameters["B"].standard_error)
    assert bars[0] > 1.02 * bars[1], bars


def friction_of(*speeds):
    """Return the variance of ln B by a torque of 2e-4 N.m that wanders over 0.3 s, of recordings at 1 kHz."""
    ends = np.cumsum([0, *map(len, speeds)])
    rows = [slice(first, last) for first, last in itertools.pairwise(ends.tolist())]
    clocks = [SimpleNamespace(rows=own, step=1e-3) for own in rows]
    plan = SimpleNamespace(names=("B",))
    simulator = SimpleNamespace(outputs=("w",), clocks=clocks, plan=plan, log=[True])
    whitener = SimpleNamespace(noise=SimpleNamespace(torque=(2e-4, 0.3)), moving=np.ones(ends[-1], dtype=bool))
    shown = np.concatenate(speeds)[:, None]
    return friction_variance(SimpleNamespace(simulator=simulator, whitener=whitener, shown=shown, values=[1e-4]))


def test_a_recording_that_tells_little_of_b_takes_nothing_of_what_another_tells():
    """Twelve slow rows beside a second at full speed made the standard error of B five times as large."""
    fast, brief = np.full(1000, 200.0), np.full(12, 10.0)
    alone = friction_of(fast)
    assert friction_of(fast, fast) == pytest.approx(alone / 2)
    assert alone * 0.99 < friction_of(fast, brief) < alone


def test_the_usual_torque_is_that_of_friction_also_where_it_is_always_driven_elsewhere():
    """K i - B w is what speeds a motor up; by a PRBS that is most of it, but it comes back."""
    prbs = 9.0 * np.repeat(np.random.default_rng(3).integers(0, 2, 180), 12)
    for command, alike in ((COMMAND, 0.03), (prbs, 0.3)):
        signals = bench(command, np.repeat(command, FINE), 1).signals
        current, speed = (signals[name][150:] for name in ("current", "speed"))
        moving = speed > 0.02 * speed.max()
        friction = MOTOR["B"] * np.mean(speed[moving])
        usual = MOTOR["K"] * wandering_torque._usual_current(current[moving], speed[moving])
        assert usual == pytest.approx(friction, rel=alike)
    assert MOTOR["K"] * np.median(np.abs(current[moving])) > 2 * friction
