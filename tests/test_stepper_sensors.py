"""Sensors on the fast path, against fmpy's own methods and against sums that share nothing with the loop."""

import dataclasses

import numpy as np
import pytest
from faulty import faulty_fmu
from foreign_fmus import foreign_fmu
from motors import CML050, held_response
from test_stepper import NOMINAL, experiment, job_of, noisy_voltage

from estimator.cases.case_signals import MAX_AVERAGE
from estimator.fmus.fmu import describe
from estimator.fmus.job import Job
from estimator.fmus.workers import Workers
from estimator.recordings.sensors import chebyshev1_sections
from estimator.stepping import layout

PLAIN = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]  # gain, offset and delay of each output


@pytest.fixture(scope="module")
def crew():
    with Workers(1) as workers:
        yield workers


def with_sensors(*experiments, **options):
    return dataclasses.replace(job_of(*experiments, **options), sensor_values=7)


def shown(crew, values, **options):
    return crew.run(np.array(values).reshape(1, 1, -1), record=True, **options)


@pytest.mark.parametrize("average", [4, MAX_AVERAGE])
def test_filters_averages_gains_and_offsets_are_those_of_the_reference(crew, average):
    sections = chebyshev1_sections(order=5, ripple=0.5, cutoff=100, step=1e-3)
    chained = dataclasses.replace(
        experiment(noisy_voltage(), np.zeros((300, 2))), chains=((average, ()), (1, sections))
    )
    crew.load(with_sensors(chained, outputs=("i", "angle"), sensors=(layout.IDENTITY, layout.MEAN)))
    values = np.concatenate([NOMINAL, [0.0, 1.02, 0.01, 0.0, 0.97, -3.0, 0.0]])
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


def test_an_output_that_is_late_parts_every_interval_alike(crew, tmp_path):
    """Two lengths of step, to the bit, wherever in time: the FMU computes for each once. A third is an error here."""
    count = "static double seen[3]; static int n; int k = 0; while (k < n && seen[k] != h) k++;"
    fmu = faulty_fmu(tmp_path, DoStep=f"{count} if (k == n) seen[n++] = h; return n > 2 ? fmi2Error : ORIGINAL;")
    job = with_sensors(experiment(noisy_voltage(), np.zeros((300, 2))))
    crew.load(dataclasses.replace(job, description=describe(fmu)))
    batch = shown(crew, [*NOMINAL, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.37e-3])
    assert not batch.failed.any() and batch.steps[0] == 2 * 299


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


def smooth(n=300):
    """Return a voltage whose rows all differ."""
    k = np.arange(n)
    return 5 + 4 * np.sin(0.03 * k) + np.where(k > 120, 2.0, 0.0)


def solved(voltage, at, *, breaks=()):
    """Return current and speed, (n, 2), at instants, by a solver; `voltage` is a function of time."""
    from scipy.integrate import solve_ivp

    R, K, L, J, B = (getattr(CML050, name) for name in ("R", "K", "L", "J", "B"))

    def derivatives(t, x):
        return [(voltage(min(max(t, inner[0]), inner[1])) - R * x[0] - K * x[1]) / L, (K * x[0] - B * x[1]) / J]

    edges = np.unique([0.0, *[b for b in breaks if 0 < b < max(at)], max(at)])
    state, found = [0.0, 0.0], np.zeros((len(at), 2))
    inner = [0.0, 0.0]
    for left, right in zip(edges, edges[1:], strict=False):
        inner[:] = left + 1e-12, right - 1e-12
        inside = (at >= left) & (at <= right)
        times = np.unique([*at[inside], right])
        solution = solve_ivp(derivatives, (left, right), state, t_eval=times, rtol=1e-9, atol=1e-10, method="Radau")
        found[inside] = solution.y[:, np.searchsorted(times, at[inside])].T
        state = solution.y[:, -1]
    return found


@pytest.mark.parametrize("late", [(0.0, 0.0021), (0.0004, 0.0), (0.00025, 0.0125), (0.003, 0.0007)])
def test_outputs_shown_late_are_those_of_the_closed_form_at_their_own_instants(crew, late):
    n, fine = 200, 20
    voltage = np.where(np.arange(n) >= 20, 10.5, 0.0)
    crew.load(with_sensors(experiment(voltage, np.zeros((n, 2)))))
    values = [*NOMINAL, 0.0033, 1.0, 0.0, late[0], 1.0, 0.0, late[1]]
    batch = shown(crew, values)
    begins = round((0.020 + 0.0033) * 1000 * fine)
    dense = held_response(CML050, np.where(np.arange(n * fine) >= begins, 10.5, 0.0), step=1e-3 / fine)
    for j in range(2):
        rows = np.maximum(np.arange(n) * fine - round(late[j] * 1000 * fine), 0)
        np.testing.assert_allclose(batch.shown[0][:, j], dense[rows, j], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(crew.reference(np.array(values)), batch.shown[0], rtol=1e-9, atol=1e-9)


def test_an_input_that_goes_linearly_is_met_to_the_square_of_the_step(crew):
    n = 150
    voltage = smooth(n)
    times = np.arange(n) * 1e-3
    truth = solved(lambda t: np.interp(t, times, voltage), times, breaks=times)
    crew.load(dataclasses.replace(job_of(experiment(voltage, np.zeros((n, 2)))), linear=(True,)))
    errors = []
    for refine in (1, 2, 4):
        batch = crew.run(NOMINAL.reshape(1, 1, 5), record=True, refine=refine)
        errors.append(np.abs(batch.shown[0] - truth).max(axis=0))
        np.testing.assert_allclose(crew.reference(NOMINAL, refine=refine), batch.shown[0], rtol=1e-9, atol=1e-9)
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(np.abs(ratios - 4) < 0.2), ratios
    assert np.all(errors[0] < np.array([3e-3, 0.1])), errors[0]


def test_a_linear_input_that_comes_late_is_that_of_the_solver(crew):
    n = 150
    voltage, times = smooth(n), np.arange(n) * 1e-3
    truth = solved(lambda t: np.interp(t - 0.0034, times, voltage), times, breaks=times + 0.0034)
    job = dataclasses.replace(with_sensors(experiment(voltage, np.zeros((n, 2)))), linear=(True,))
    crew.load(job)
    batch = shown(crew, [*NOMINAL, 0.0034, *PLAIN], refine=8)
    np.testing.assert_allclose(batch.shown[0], truth, rtol=0, atol=1e-3)
    values = np.array([*NOMINAL, 0.0034, *PLAIN])
    np.testing.assert_allclose(crew.reference(values, refine=8), batch.shown[0], rtol=1e-9, atol=1e-9)


def jumping(n):
    """Return a voltage on lines that jumps at a row, (n,), where it ends before each next one, and its course."""
    times = np.arange(n) * 1e-3
    voltage = smooth(n) + np.where(np.arange(n) >= 60, 9.0, 0.0)
    ends = np.append(voltage[1:], voltage[-1])
    ends[59] = voltage[59]

    def course(t):
        row = int(np.clip(np.floor(t / 1e-3 + 1e-9), 0, n - 1))
        if t < 0 or row == n - 1:
            return voltage[row]
        return voltage[row] + (ends[row] - voltage[row]) * (t - times[row]) / 1e-3

    return voltage, ends[:, None], course


@pytest.mark.parametrize("delay", [0.0034, pytest.param(0.0, marks=pytest.mark.full)])
def test_a_linear_input_that_jumps_at_a_row_is_that_of_the_solver(crew, delay):
    n = 150
    voltage, ends, course = jumping(n)
    times = np.arange(n) * 1e-3
    truth = solved(lambda t: course(t - delay), times, breaks=times + delay)
    jumped = dataclasses.replace(experiment(voltage, np.zeros((n, 2))), ends=ends)
    crew.load(dataclasses.replace(with_sensors(jumped), linear=(True,)))
    values = np.array([*NOMINAL, delay, *PLAIN])
    batch = shown(crew, values, refine=8)
    np.testing.assert_allclose(batch.shown[0], truth, rtol=0, atol=1e-3)
    np.testing.assert_allclose(crew.reference(values, refine=8), batch.shown[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.00234])
def test_a_clock_that_jitters_is_simulated_at_its_own_times(crew, delay):
    n = 200
    times = np.cumsum(1e-3 * (1 + 0.2 * np.random.default_rng(3).uniform(-1, 1, n)))
    times -= times[0]
    voltage = np.where(np.arange(n) >= 20, 10.5, np.where(np.arange(n) >= 120, 3.0, 0.0))
    step_at = times[20] + delay
    truth = solved(lambda t: 10.5 * (t >= step_at), times, breaks=[step_at])
    jittered = dataclasses.replace(experiment(voltage, np.zeros((n, 2))), times=times)
    crew.load(with_sensors(jittered))
    values = [*NOMINAL, delay, *PLAIN]
    np.testing.assert_allclose(shown(crew, values).shown[0], truth, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(crew.reference(np.array(values)), truth, rtol=1e-7, atol=1e-7)


def test_the_mean_over_an_interval_of_a_jittering_clock_is_over_that_interval(crew):
    n = 100
    times = np.cumsum(1e-3 * (1 + 0.2 * np.random.default_rng(3).uniform(-1, 1, n)))
    times -= times[0]
    jittered = dataclasses.replace(experiment(smooth(n), np.zeros((n, 1))), times=times, weights=np.ones(1))
    crew.load(job_of(jittered, outputs=("angle",), sensors=(layout.MEAN,)))
    speed = crew.run(NOMINAL.reshape(1, 1, 5), record=True).shown[0][:, 0]
    crew.load(job_of(jittered, outputs=("angle",), sensors=(layout.IDENTITY,)))
    angle = crew.run(NOMINAL.reshape(1, 1, 5), record=True).shown[0][:, 0]
    np.testing.assert_allclose(speed[1:], np.diff(angle) / np.diff(times), rtol=1e-9, atol=1e-9)


def test_an_fmu_of_even_steps_takes_means_and_interpolates(crew):
    n = 100
    voltage = smooth(n)
    job = with_sensors(experiment(voltage, np.zeros((n, 2))))
    crew.load(dataclasses.replace(job, even_steps=True, linear=(True,)))
    values = np.array([*NOMINAL, 0.0034, 1.0, 0.0, 0.0002, 1.0, 0.0, 0.0])
    batch = shown(crew, values)
    assert batch.steps[0] == n - 1
    times = np.arange(n) * 1e-3
    middles = [np.linspace(t, t + 1e-3, 2001) - 0.0034 for t in times]
    means = np.array([np.trapezoid(np.interp(m, times, voltage), m) / 1e-3 for m in middles])
    held = held_response(CML050, means, step=1e-3)
    np.testing.assert_allclose(batch.shown[0][:, 1], held[:, 1], rtol=1e-6, atol=1e-6)
    late = np.interp(times - 0.0002, times, held[:, 0])
    np.testing.assert_allclose(batch.shown[0][:, 0], late, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(crew.reference(values), batch.shown[0], rtol=1e-9, atol=1e-9)


def test_a_bound_cuts_short_where_times_are_not_those_of_the_steps(crew):
    measured = np.zeros((300, 2))
    crew.load(dataclasses.replace(with_sensors(experiment(smooth(), measured)), linear=(True,)))
    values = np.array([*NOMINAL, 0.0015, 1.0, 0.0, 0.0004, 1.0, 0.0, 0.0]).reshape(1, 1, -1)
    whole = crew.run(values).costs[0]
    assert crew.run(values, bounds=np.array([whole])).costs[0] == whole
    cut = crew.run(values, bounds=np.array([0.5 * whole]))
    assert cut.costs[0] == np.inf and cut.steps[0] < crew.run(values).steps[0]


def test_an_fmu_that_interpolates_is_told_the_slopes(crew, tmp_path):
    fmu = foreign_fmu(
        tmp_path, "INTERPOLATES", change=[("canHandleVariable", 'canInterpolateInputs="true" canHandleVariable')]
    )
    described = describe(fmu)
    by_name = {v.name: v.value_reference for v in described.variables}
    names = {"R": "motor.Ra", "L": "motor.La", "J": "motor.Jm", "B": "motor.c"}
    parameters = {v: getattr(CML050, k) for k, v in names.items()} | {n: CML050.K for n in ("motor.Ke", "motor.Km")}
    n = 150
    voltage, times = smooth(n), np.arange(n) * 1e-3
    job = Job(
        description=described,
        parameter_references=tuple(by_name[name] for name in parameters),
        input_references=(by_name["u_in"],),
        output_references=(by_name["motor.ia"], by_name["shaft.w"]),
        sensors=(layout.IDENTITY, layout.IDENTITY),
        experiments=(experiment(voltage, np.zeros((n, 2))),),
        sensor_values=7,
        linear=(True,),
    )
    crew.load(job)
    for delay in (0.0, 0.0034):
        truth = solved(lambda t, d=delay: np.interp(t - d, times, voltage), times, breaks=times + delay)
        batch = shown(crew, [*parameters.values(), delay, *PLAIN])
        np.testing.assert_allclose(batch.shown[0], truth, rtol=1e-6, atol=1e-6)
    voltage, ends, course = jumping(n)
    crew.load(
        dataclasses.replace(job, experiments=(dataclasses.replace(experiment(voltage, np.zeros((n, 2))), ends=ends),))
    )
    truth = solved(course, times, breaks=times)
    np.testing.assert_allclose(shown(crew, [*parameters.values(), 0.0, *PLAIN]).shown[0], truth, rtol=1e-6, atol=1e-6)
