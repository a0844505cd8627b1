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


def of_coarse_voltage(part, motor, times, voltage_step, *, sensors, steps_of_noise):
    """Return the result of a motor at a level so far between two values of v, whose converter shows few others.

    Sensors of i and w have noise of these deviations.
    """
    noise = np.random.default_rng(3)
    driven = np.where(times >= 0.05, (67 + part) * voltage_step, 0.0)
    motion = simulate_fmu("dc_motor", times=times, inputs={"v": driven}, parameters=motor)
    v = np.round(driven / voltage_step + steps_of_noise * noise.standard_normal(len(times)))
    shown = {n: motion[n] + noise.normal(0, deviation, len(times)) for n, deviation in sensors.items()}
    return estimate_parameters(time=times, v=np.round(voltage_step * v, 2), **shown, workers=1)  # as it is printed


@pytest.mark.parametrize("part", [0.3, pytest.param(0.2, marks=pytest.mark.full)])
def test_a_voltage_between_two_values_of_a_converter_is_measured_and_known_less_than_their_mean_says(part):
    """Most samples are alike: it was taken for a command, and the noise for one (R and J 26 % wide, after a minute).

    Noise of 0.3 steps leaves 0.04 steps of the level (0.06 %): K was 9 standard errors off.
    """
    sensors = {name: 0.1 * step for name, step in STEPS.items()}
    result = of_coarse_voltage(part, MOTOR, TIMES, 0.162, sensors=sensors, steps_of_noise=0.3)
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()}
    assert max(map(abs, off.values())) < 4.5 and result.verdict == "ok", (off, result.reasons)


SLOW_MOTOR = {"R": 0.92, "K": 0.0735, "L": 7.76e-3, "J": 4.8e-4, "B": 6.8e-4}


@pytest.mark.full  # where the current tells it: above
@pytest.mark.parametrize("part", [0.27, 0.28])
def test_a_level_is_known_no_better_where_the_current_does_not_tell_what_noise_reaches_the_motor(part):
    """L / R of 8 ms: the current answers to no noise, so v is used as logged, 0.04 steps off. K was 6.7 bars off."""
    sensors = {"i": 0.09, "w": 0.3}
    result = of_coarse_voltage(part, SLOW_MOTOR, 1e-4 * np.arange(8000), 0.078, sensors=sensors, steps_of_noise=0.2)
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in SLOW_MOTOR.items()}
    assert max(map(abs, off.values())) < 4.5 and result.verdict == "ok", (off, result.reasons)
    assert not any("does not reach the motor" in note for note in result.notes), result.notes
