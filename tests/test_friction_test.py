"""Friction that depends on the speed otherwise than it is explained: doubted whatever effects are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.friction_test import _share

MOTOR = {"R": 1.6, "K": 0.04, "L": 2.4e-3, "J": 2.5e-5, "B": 4e-5}
STEP, FINE = 1e-3, 40
LEVELS = np.repeat([0.0, 3.0, 6.0, 9.0, 12.0], [80, 300, 300, 300, 300])


def slope(x, v, friction, fan):
    """Return the derivatives of current and speed, (2,)."""
    (i, w), (r, k, inductance, j, b) = x, MOTOR.values()
    return np.array([(v - r * i - k * w) / inductance, (k * i - friction * (b * w + fan * w * abs(w))) / j])


def recording(seed, *, fan=0.0, wander=0.0):
    """Return a staircase of a motor with a load of `fan` N.m.s2/rad2, whose friction wanders by a part of itself."""
    rng, x, shown = np.random.default_rng(seed), np.zeros(2), []
    other, h, f = rng.standard_normal(), STEP / FINE, np.exp(-STEP / 0.2)
    for v in LEVELS.tolist():
        shown.append(x.copy())
        other = f * other + np.sqrt(1 - f * f) * rng.standard_normal()
        for _ in range(FINE):  # the midpoint rule, by a step far below all time constants
            middle = x + 0.5 * h * slope(x, v, 1 + wander * other, fan)
            x = x + h * slope(middle, v, 1 + wander * other, fan)
    y = np.array(shown) + rng.standard_normal((len(LEVELS), 2)) * [0.01, 0.3]
    columns = {"voltage [V]": LEVELS, "current [A]": y[:, 0], "speed [rad/s]": y[:, 1]}
    return recording_from_arrays("bench", np.arange(len(LEVELS)) * STEP, columns)


@pytest.mark.full
@pytest.mark.parametrize("seeds", [range(1), range(1, 4)], ids=["one", "three"])
def test_a_fan_that_no_effect_explains_is_no_friction_that_wanders(seeds, monkeypatch):
    """Of eight such recordings one is called ok, with an error of B that holds what another law would make of it."""
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "fan load")
    doubted = 0
    for seed in seeds:
        result = estimate_parameters(recording(seed, fan=6e-8, wander=0.005), workers=1, seed=1)
        doubted += result.verdict == "doubtful"
        found = result.parameters["B"]
        assert abs(found.value - MOTOR["B"]) < 4 * found.standard_error, seed
    assert doubted >= len(seeds) - 1


def test_friction_that_wanders_is_no_fan():
    result = estimate_parameters(recording(2, wander=0.01), workers=1, seed=1)
    assert result.verdict == "ok", result.reasons
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.standard_error, name


def test_another_law_takes_no_more_of_the_friction_than_all_of_it():
    def share(b, name="B", is_log=True):
        return _share(SimpleNamespace(names=("R", name), is_log=np.array([True, is_log])), np.array([5.0, b]))

    assert share(0.4) == 1.0 and share(-11.6) == pytest.approx(1 / 11.6)
    assert share(-11.6, is_log=False) == 1.0 and share(-11.6, name="friction") == 1.0
