"""Sensors on the fast path, against fmpy's own methods and against sums that share nothing with the loop."""

import dataclasses

import numpy as np
import pytest
from motors import CML050, held_response
from test_stepper import NOMINAL, experiment, job_of, noisy_voltage

from estimator import layout
from estimator.sensors import chebyshev1_sections
from estimator.workers import Workers

PLAIN = [1.0, 0.0, 1.0, 0.0]  # gain and offset of each output


@pytest.fixture(scope="module")
def crew():
    with Workers(1) as workers:
        yield workers


def with_sensors(*experiments, **options):
    return dataclasses.replace(job_of(*experiments, **options), sensor_values=5)


def shown(crew, values, **options):
    return crew.run(np.array(values).reshape(1, 1, -1), record=True, **options)


def test_filters_averages_gains_and_offsets_are_those_of_the_reference(crew):
    sections = chebyshev1_sections(order=5, ripple=0.5, cutoff=100, step=1e-3)
    chained = dataclasses.replace(experiment(noisy_voltage(), np.zeros((300, 2))), chains=((4, ()), (1, sections)))
    crew.load(with_sensors(chained, outputs=("i", "angle"), sensors=(layout.IDENTITY, layout.MEAN)))
    values = np.concatenate([NOMINAL, [0.0, 1.02, 0.01, 0.97, -3.0]])
    np.testing.assert_allclose(shown(crew, values).shown[0], crew.reference(values), rtol=0, atol=1e-10)


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.0123, 0.0999, 0.5])
def test_a_delay_is_that_of_the_closed_form_also_between_samples(crew, delay):
    n = 300
    voltage = np.where(np.arange(n) >= 20, 10.5, 0.0)
    crew.load(with_sensors(experiment(voltage, np.zeros((n, 2)))))
    batch = shown(crew, [*NOMINAL, delay, *PLAIN])
    fine = 10  # the closed form on a grid on which the delay is whole
    late = round(20 * fine + delay * 1000 * fine)
    expected = held_response(CML050, np.where(np.arange(n * fine) >= late, 10.5, 0.0), step=1e-3 / fine)[::fine]
    np.testing.assert_allclose(batch.shown[0], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(crew.reference(np.array([*NOMINAL, delay, *PLAIN])), expected, rtol=1e-9, atol=1e-9)


def test_an_fmu_of_even_steps_takes_a_mixed_input_instead(crew):
    n = 100
    voltage = np.where(np.arange(n) >= 20, 10.0, 0.0)
    crew.load(dataclasses.replace(with_sensors(experiment(voltage, np.zeros((n, 2)))), even_steps=True))
    batch = shown(crew, [*NOMINAL, 0.0103, *PLAIN])
    mixed = np.where(np.arange(n) >= 31, 10.0, np.where(np.arange(n) == 30, 7.0, 0.0))
    np.testing.assert_allclose(batch.shown[0], held_response(CML050, mixed, step=1e-3), rtol=1e-9, atol=1e-9)
    assert batch.steps[0] == n - 1


def test_an_input_that_comes_early_is_allowed(crew):
    n = 100
    voltage = np.where(np.arange(n) >= 20, 10.0, 0.0)
    crew.load(with_sensors(experiment(voltage, np.zeros((n, 2)))))
    early = held_response(CML050, np.where(np.arange(n) >= 17, 10.0, 0.0), step=1e-3)
    np.testing.assert_allclose(shown(crew, [*NOMINAL, -0.003, *PLAIN]).shown[0], early, rtol=1e-9, atol=1e-9)


def test_neutral_sensor_values_change_no_bit(crew):
    measured = np.random.default_rng(5).standard_normal((300, 2))
    crew.load(job_of(experiment(noisy_voltage(), measured)))
    plain = crew.run(NOMINAL.reshape(1, 1, 5)).costs[0]
    crew.load(with_sensors(experiment(noisy_voltage(), measured)))
    assert crew.run(np.array([*NOMINAL, 0.0, *PLAIN]).reshape(1, 1, -1)).costs[0] == plain


def test_a_bound_cuts_short_behind_sensors_too_and_only_what_costs_more(crew):
    measured = np.zeros((300, 2))
    chained = dataclasses.replace(experiment(noisy_voltage(), measured), chains=((3, ()), (1, ())))
    crew.load(with_sensors(chained))
    values = np.array([*NOMINAL, 0.0015, *PLAIN]).reshape(1, 1, -1)
    whole = crew.run(values).costs[0]
    assert np.isclose(whole, float(np.sum(crew.reference(values.ravel()) ** 2)), rtol=1e-9)
    assert crew.run(values, bounds=np.array([whole])).costs[0] == whole
    cut = crew.run(values, bounds=np.array([0.5 * whole]))
    assert cut.costs[0] == np.inf
    assert cut.steps[0] < 299
