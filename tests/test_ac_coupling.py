"""A sensor of the current that shows changes alone is told; without the effect it is doubted, or within the errors."""

import numpy as np
import pytest

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.effects.ac_coupling import without_mean
from estimator.explaining.effects.low_pass import through
from estimator.motor.exponential import exponential
from estimator.motor.state_space import matrices

MOTOR = {"R": 1.2, "K": 0.04, "L": 8e-4, "J": 2e-5, "B": 4e-5}
STEP = 5e-4
LEVELS = np.repeat([0.0, 8.0, 4.0, -6.0], [100, 700, 700, 700])


def recording(seed, *, fades=np.inf):
    """Return a recording of levels, whose current fades by a time constant, s, where it is constant."""
    a, b, *_ = matrices(MOTOR)
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = a, b[:, 0]
    after = exponential(whole * STEP)
    x, shown = np.zeros(2), []
    for v in LEVELS:
        shown.append(x)
        x = after[:2, :2] @ x + after[:2, 2] * v
    i, w = np.array(shown).T
    if np.isfinite(fades):  # a recursion of fine steps, none of the program's
        fine = np.interp(np.arange(8 * len(i)) / 8, np.arange(len(i)), i)
        y, out = 0.0, []
        for now, before in zip(fine, np.insert(fine[:-1], 0, 0.0), strict=True):
            y = y * (1 - STEP / 8 / fades) + now - before
            out.append(y)
        i = np.array(out)[::8]
    rng = np.random.default_rng(seed)
    i, w = i + 0.02 * rng.standard_normal(len(i)), w + 0.2 * rng.standard_normal(len(w))
    return recording_from_arrays(
        "bench", np.arange(len(i)) * STEP, {"voltage [V]": LEVELS, "current [A]": i, "speed [rad/s]": w}
    )


@pytest.mark.parametrize("fades", [0.3, pytest.param(1.5, marks=pytest.mark.full)])
def test_what_fades_is_told_and_the_motor_is_right(fades):
    result = estimate_parameters(recording(1, fades=fades), workers=1, seed=1)
    assert any("AC-coupled" in note for note in result.notes)
    assert result.reasons and all("couple it to DC" in r for r in result.reasons)  # measure better, and nothing else
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.5 * found.standard_error, name


@pytest.mark.full
def test_without_the_effect_it_is_doubted_or_within_the_errors(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "AC coupling")
    result = estimate_parameters(recording(1, fades=0.3), workers=1, seed=1)
    found = [(result.parameters[name], value) for name, value in MOTOR.items()]
    far = [p for p, value in found if p.standard_error and abs(p.value - value) > 4.5 * p.standard_error]
    assert result.verdict == "doubtful" or not far


def test_a_sensor_that_shows_all_is_none():
    result = estimate_parameters(recording(2), workers=1, seed=1)
    assert result.verdict == "ok" and not any("AC-coupled" in note for note in result.notes)


def test_a_line_behind_it_is_exact():
    """Of y = t it is 1 - exp(-t), over a time constant of 1 s."""
    t = np.arange(50) * 0.1
    assert through(without_mean, t, 1.0, 0.1) == pytest.approx(1 - np.exp(-t), abs=1e-12)
    assert without_mean(0.0, 0.1) == ()
