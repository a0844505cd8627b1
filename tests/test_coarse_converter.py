"""Recordings through a converter whose steps are as large as the noise."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 4.5, "K": 0.0135, "L": 2.5e-3, "J": 1.4e-6, "B": 1.4e-6}
TIMES = 5e-4 * np.arange(6000)
VOLTAGE = np.where(TIMES >= 0.05, 8.4, 0.0)
STEPS = {"i": 0.0207, "w": 7.05}  # of eight bits: three current steps are the level of three seconds


def shown(seed, name, signal):
    """Return a signal, (n,), with noise of 0.57 steps, as a converter shows it."""
    noisy = signal / STEPS[name] + 0.57 * np.random.default_rng(seed).standard_normal(len(signal))
    return np.round(noisy) * STEPS[name]


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.full), pytest.param(3, marks=pytest.mark.full)])
def test_a_sample_one_step_beside_a_long_level_is_no_outlier(seed):
    """Most samples of the level were one value, and those beside it weighed less: K was 8 standard errors off."""
    motion = simulate_fmu("dc_motor", times=TIMES, inputs={"v": VOLTAGE}, parameters=MOTOR)
    i, w = (shown(10 * seed + k, name, motion[name]) for k, name in enumerate(STEPS))
    result = estimate_parameters(time=TIMES, v=VOLTAGE, i=i, w=w, workers=1)
    assert not any("outlier" in note for note in result.notes), result.notes
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()}
    assert max(map(abs, off.values())) < 4.5, off
