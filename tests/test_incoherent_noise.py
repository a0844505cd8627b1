"""Noise of a measured voltage: whether the current answers to it, as it does to a change, and what is simulated."""

from types import SimpleNamespace

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, bench, off
from scipy.linalg import expm

from estimator import estimate_parameters
from estimator.explaining.effects.voltage_noise import noise_of
from estimator.explaining.incoherent_noise import answer_to_changes, answered

COMMAND = np.repeat([0.0, 5.0, 9.0, 3.0], [100, 300, 300, 300])
NOISE = 0.1  # V


def recorded(seed, *, reaches, late=0):
    """Return a recording of which this part of the voltage's noise reaches the motor, and how it was logged."""
    noise = NOISE * np.random.default_rng([seed, 7]).standard_normal(len(COMMAND))
    seen = bench(COMMAND + noise, np.repeat(COMMAND + reaches * noise, FINE), seed, late=late)
    return seen, SimpleNamespace(inputs={"v": seen.signals["voltage"]}, outputs={"i": seen.signals["current"]})


@pytest.mark.parametrize(
    ("reaches", "late"),
    [
        (0.0, 0),
        (0.5, 130),
        (1.0, 0),
        *(pytest.param(*more, marks=pytest.mark.full) for more in ((0.0, 130), (0.5, 0), (1.0, 130))),
    ],
)
def test_the_part_of_a_noise_that_reaches_the_motor_is_told_by_its_answer_to_changes(reaches, late):
    """Over seeds: a chi-square number of as many degrees of freedom, whose limit a run exceeds by 1e-5."""
    z = []
    for seed in range(8):
        _, o = recorded(seed, reaches=reaches, late=late)
        around = noise_of(o.inputs["v"], np.zeros((len(COMMAND), 0)))
        part, error = answered([o], [around])
        assert error < 0.1
        z.append((part - reaches) / np.hypot(error, 0.03 * reaches))  # the answer itself is known to 3 %
    assert np.sum(np.square(z)) < 37.3, z


def test_the_answer_to_a_volt_is_that_of_the_motor_as_late_as_it_is_shown():
    _, o = recorded(1, reaches=0.0, late=2 * FINE)
    answer = answer_to_changes(o)
    r, k, inductance, j, b = MOTOR.values()
    whole = np.array([[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0], [0, 0, 0]])
    steps = [expm(whole * rows * 1e-3)[0, 2] for rows in range(5)]  # held: A of 1 V after so many rows
    np.testing.assert_allclose(answer[:6], 0, atol=0.01)
    np.testing.assert_allclose(answer[6:9], np.diff(steps)[:3], atol=0.01)


@pytest.mark.parametrize("reaches", [0.0, 1.0])
def test_what_reaches_the_motor_is_simulated_and_what_does_not_is_not(reaches):
    seen, _ = recorded(3, reaches=reaches)
    result = estimate_parameters(seen, workers=1)
    quiet = any("voltage's noise does not reach the motor" in note for note in result.notes)
    assert quiet == (reaches == 0.0), result.notes
    assert result.verdict == "ok" and off(result).max() < 4.5, (result.reasons, result.parameters)


def test_a_recording_of_a_command_beside_one_of_a_noisy_voltage_is_as_it_was():
    """The noise was told by fits that it misled, where not every voltage was measured: three stories in 75 s."""
    measured, _ = recorded(4, reaches=0.0)
    command = bench(COMMAND, np.repeat(COMMAND, FINE), 5, name="c")
    result = estimate_parameters([measured, command], workers=1)
    assert any("voltage's noise does not reach the motor" in note for note in result.notes), result.notes
    assert result.verdict == "ok" and off(result).max() < 4.5, (result.reasons, result.parameters)


@pytest.mark.parametrize("reaches", [pytest.param(0.0, marks=pytest.mark.full), 1.0])
def test_where_the_current_is_too_noisy_to_answer_the_first_fit_tells_whether_it_reaches_the_motor(reaches):
    """Latencies, a drift and an overshoot were told of a good recording, of noise that the motor did not have."""
    rng = np.random.default_rng(11)
    noise = NOISE * np.random.default_rng([5, 7]).standard_normal(len(COMMAND))
    more = 2.0 * rng.standard_normal(len(COMMAND))
    seen = bench(COMMAND + noise, np.repeat(COMMAND + reaches * noise, FINE), 5, more=more)
    o = SimpleNamespace(inputs={"v": seen.signals["voltage"]}, outputs={"i": seen.signals["current"]})
    part, error = answered([o], [noise_of(o.inputs["v"], np.zeros((len(COMMAND), 0)))])
    assert abs(part - reaches) < 4 * error and error > 0.25, "the current alone does not tell"
    result = estimate_parameters(seen, workers=1)
    quiet = any("voltage's noise does not reach the motor" in note for note in result.notes)
    assert quiet == (reaches == 0.0), result.notes
    assert result.verdict == "ok" and off(result).max() < 4.5, (result.reasons, result.parameters)
