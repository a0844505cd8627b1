"""Model exchange in the stepping loop: stiff equations, inputs that jump, events, speed. Truth: exact co-simulation."""

import time

import fmpy
import numpy as np
import pytest
from foreign_fmus import foreign_fmu
from motors import CML050

from estimator.fmus.fmu import describe, with_kind
from estimator.fmus.job import Experiment, Job
from estimator.fmus.simulate import simulate
from estimator.fmus.workers import Workers
from estimator.stepping.layout import IDENTITY


def apart(name, *, parameters, inputs, times):
    """Return the largest distance between the two kinds of a bundled FMU, of an output's span."""
    kinds = [with_kind(describe(name), kind) for kind in ("model-exchange", "co-simulation")]
    own, exact = (simulate(d, parameters=parameters, inputs=inputs, times=times) for d in kinds)
    return max(float(np.max(np.abs(own[k] - exact[k])) / np.ptp(exact[k])) for k in exact)


def test_a_stiff_motor_is_integrated_over_steps_that_are_a_million_times_its_fast_time_constant():
    times = 0.1 * np.arange(11)
    stiff = {**CML050.parameters, "L": 1e-7}  # L / R = 3e-8 s: an explicit method would need 500 000 steps for one
    assert apart("dc_motor", parameters=stiff, inputs={"v": np.where(times > 0.05, 10.0, 0.0)}, times=times) < 1e-8


@pytest.mark.parametrize("L", [1e-7, pytest.param(1e-2, marks=pytest.mark.full)])
def test_a_voltage_that_jumps_at_every_sample_is_followed_to_1e_7(L):
    times = 1e-3 * np.arange(400)
    jumps = np.random.default_rng(1).uniform(-10, 10, len(times))
    assert apart("dc_motor", parameters={**CML050.parameters, "L": L}, inputs={"v": jumps}, times=times) < 1e-7


def test_a_motor_that_sticks_and_breaks_away_is_followed_through_its_events():
    times = 1e-3 * np.arange(600)
    inputs = {"v": 3.0 * np.sin(2 * np.pi * 4 * times)}
    values = {v.name: v.start for v in describe("dc_motor_friction").of_causality("parameter")}
    assert apart("dc_motor_friction", parameters=values, inputs=inputs, times=times) < 1e-6


def job_of(fmu, samples, rng):
    description = describe(fmu)

    def references(*names):
        return tuple(description.variable(n).value_reference for n in names)

    voltage = np.repeat(rng.uniform(-8, 8, samples // 50 + 1), 50)[:samples, None]
    recording = Experiment(0.0, 1e-3, 1, voltage, np.zeros((samples, 1)), np.ones(1))
    return Job(
        description=description,
        parameter_references=references("motor.Ra"),
        input_references=references("u_in"),
        output_references=references("shaft.w"),
        sensors=(IDENTITY,),
        experiments=(recording,),
    )


@pytest.mark.parametrize("version", [2, pytest.param(1, marks=pytest.mark.full)])
def test_a_simulation_gives_the_same_bits_whatever_was_simulated_before(tmp_path, version):
    fmu = foreign_fmu(tmp_path, version=version, kinds=("model-exchange",))
    values = np.linspace(0.5, 5.0, 24).reshape(-1, 1, 1)
    order = np.random.default_rng(2).permutation(24)
    with Workers(1) as one, Workers(3) as three:
        three.pool.busy_before_more = 0.0
        costs = []
        for crew, rows in ((one, values), (one, values[order]), (three, values)):
            crew.load(job_of(fmu, 300, np.random.default_rng(1)))
            costs.append(crew.run(rows).costs)
    assert np.isfinite(costs[0]).all() and len(set(costs[0])) == 24
    assert np.array_equal(costs[0][order], costs[1]) and np.array_equal(costs[0], costs[2])


@pytest.mark.parametrize("version", [2, pytest.param(1, marks=pytest.mark.full)])
def test_model_exchange_takes_less_than_a_tenth_of_what_simulate_fmu_takes(tmp_path, version):
    """Some hundredth, in truth; fmpy at its usual tolerance of 1e-5, here 1e-10."""
    fmu = foreign_fmu(tmp_path, version=version, kinds=("model-exchange",))
    with Workers(1) as workers:
        workers.load(job_of(fmu, 1000, np.random.default_rng(1)))
        rows = np.full((20, 1, 1), 2.0)
        workers.run(rows)
        took = []
        for _ in range(3):  # the quickest: what others do on the machine only adds to it
            began = time.perf_counter()
            workers.run(rows)
            took.append((time.perf_counter() - began) / len(rows))
    began = time.perf_counter()
    fmpy.simulate_fmu(str(fmu), fmi_type="ModelExchange", output=["shaft.w"], stop_time=0.999, output_interval=1e-3)
    assert min(took) < 0.1 * (time.perf_counter() - began)
