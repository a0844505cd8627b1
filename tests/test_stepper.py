"""The C stepping loop against fmpy's own methods, and against the sums that numpy makes of its trajectories."""

import contextlib
import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from motors import CML050, RMCS2004, held_response, step_recording

from estimator.fmus.fmu import describe
from estimator.fmus.job import Experiment, Job
from estimator.fmus.workers import KEPT_JOBS, Workers
from estimator.stepping import layout

NOMINAL = np.array([CML050.R, CML050.K, CML050.L, CML050.J, CML050.B])


def experiment(voltage, measured, *, weights=(1.0, 1.0), substeps=1, interval=1e-3, start=0.0):
    inputs = np.asarray(voltage, dtype=float)[:, None]
    return Experiment(start, interval, substeps, inputs, np.asarray(measured, dtype=float), np.array(weights))


def job_of(
    *experiments,
    sensors=(layout.IDENTITY, layout.IDENTITY),
    outputs=("i", "w"),
    reinstantiate=False,
    fmu="dc_motor",
):
    description = describe(fmu)

    def references(names):
        return tuple(description.variable(n).value_reference for n in names)

    return Job(
        description=description,
        parameter_references=references("RKLJB"),
        input_references=references("v"),
        output_references=references(outputs),
        sensors=sensors,
        experiments=experiments,
        reinstantiate=reinstantiate,
    )


def noisy_voltage(n=300, seed=1):
    return np.repeat(np.random.default_rng(seed).uniform(-10, 10, n // 10), 10)


@pytest.fixture(scope="module")
def crew():
    with Workers(1) as workers:
        yield workers


def test_the_loop_and_fmpys_methods_agree_bit_by_bit(crew):
    crew.load(job_of(experiment(noisy_voltage(), np.zeros((300, 2)))))
    rng = np.random.default_rng(2)
    for _ in range(5):
        values = NOMINAL * np.exp(rng.standard_normal(5))
        batch = crew.run(values.reshape(1, 1, 5), record=True)
        assert np.array_equal(batch.shown[0], crew.reference(values))


def test_they_agree_at_finer_steps_with_a_mean_sensor_and_a_later_start(crew):
    job = job_of(
        experiment(noisy_voltage(), np.zeros((300, 2)), substeps=3, start=2.5),
        outputs=("i", "angle"),
        sensors=(layout.IDENTITY, layout.MEAN),
    )
    crew.load(job)
    batch = crew.run(NOMINAL.reshape(1, 1, 5), record=True, refine=2)
    assert np.array_equal(batch.shown[0], crew.reference(NOMINAL, refine=2))
    assert batch.steps[0] == 299 * 6


def test_the_trajectory_is_the_exact_response(crew):
    voltage = noisy_voltage()
    crew.load(job_of(experiment(voltage, np.zeros((300, 2)))))
    shown = crew.run(NOMINAL.reshape(1, 1, 5), record=True).shown[0]
    truth = held_response(CML050, voltage, step=1e-3)
    assert np.all(np.abs(shown - truth) <= 1e-11 * np.abs(truth).max(axis=0))


def test_a_mean_sensor_shows_the_mean_over_the_interval_before(crew):
    voltage = noisy_voltage()
    fine = held_response(CML050, np.repeat(voltage, 50), step=1e-3 / 50)[:, 1]
    crew.load(
        job_of(experiment(voltage, np.zeros((300, 2))), outputs=("i", "angle"), sensors=(layout.IDENTITY, layout.MEAN))
    )
    shown = crew.run(NOMINAL.reshape(1, 1, 5), record=True).shown[0, :, 1]
    integral = np.concatenate([[0], np.cumsum((fine[1:] + fine[:-1]) / 2)])[::50] / 50
    assert shown[0] == 0
    assert np.allclose(np.diff(integral), shown[1:], rtol=0, atol=1e-3 * np.abs(shown).max())


def test_the_cost_is_the_weighted_sum_of_squares_over_all_recordings(crew):
    rng = np.random.default_rng(3)
    measured = [rng.standard_normal((300, 2)), rng.standard_normal((200, 2))]
    weights = [(4.0, 0.25), (1.0, 2.0)]
    voltages = [noisy_voltage(300), noisy_voltage(200, seed=4)]
    crew.load(job_of(*(experiment(v, m, weights=w) for v, m, w in zip(voltages, measured, weights, strict=True))))
    batch = crew.run(np.tile(NOMINAL, (1, 2, 1)), record=True)
    parts = np.split(batch.shown[0], [300])
    expected = sum(float(np.sum(np.array(w) * (y - m) ** 2)) for y, m, w in zip(parts, measured, weights, strict=True))
    assert batch.costs[0] == pytest.approx(expected, rel=1e-12)
    assert crew.run(np.tile(NOMINAL, (1, 2, 1))).costs[0] == batch.costs[0]


def test_missing_samples_are_left_out_of_the_cost(crew):
    measured = np.random.default_rng(5).standard_normal((300, 2))
    gaps = measured.copy()
    gaps[50:60, 0] = np.nan
    crew.load(job_of(experiment(noisy_voltage(), gaps)))
    batch = crew.run(NOMINAL.reshape(1, 1, 5), record=True)
    expected = np.nansum((batch.shown[0] - gaps) ** 2)
    assert batch.costs[0] == pytest.approx(expected, rel=1e-12)


def test_a_candidate_stops_once_it_costs_more_than_its_bound(crew):
    crew.load(job_of(experiment(noisy_voltage(), np.zeros((300, 2)))))
    values = NOMINAL.reshape(1, 1, 5)
    full = crew.run(values).costs[0]
    assert crew.run(values, bounds=np.array([full])).costs[0] == full
    cut = crew.run(values, bounds=np.array([full / 2]))
    assert np.isinf(cut.costs[0]) and not cut.failed[0]
    assert 0 < cut.steps[0] < 299


def test_starting_from_a_new_instance_costs_the_same_bits_as_a_reset(crew):
    measured = held_response(RMCS2004, noisy_voltage(), step=1e-3)
    values = (NOMINAL * np.exp(0.3 * np.random.default_rng(6).standard_normal((20, 5)))).reshape(20, 1, 5)
    costs = []
    for reinstantiate in (False, True):
        crew.load(job_of(experiment(noisy_voltage(), measured), reinstantiate=reinstantiate))
        costs.append(crew.run(values).costs)
    assert np.array_equal(*costs)


def test_a_parameter_that_the_fmu_refuses_is_a_failed_candidate_with_its_words(crew):
    crew.load(job_of(experiment(noisy_voltage(), np.zeros((300, 2)))))
    values = np.stack([NOMINAL, NOMINAL * [1, 1, 1, -1, 1], NOMINAL]).reshape(3, 1, 5)
    batch = crew.run(values)
    assert batch.failed.tolist() == [False, True, False]
    assert np.isinf(batch.costs[1]) and batch.costs[0] == batch.costs[2]
    assert crew.failures[0].reason.startswith("set returned Discard")
    assert crew.failures[0].values[3] == -CML050.J


def test_the_number_of_workers_changes_no_bit():
    recording = step_recording(CML050, noise=(0.02, 1.0), duration=0.8)
    measured = np.column_stack([recording.signals["current"], recording.signals["speed"]])
    values = (NOMINAL * np.exp(0.5 * np.random.default_rng(7).standard_normal((600, 5)))).reshape(600, 1, 5)
    costs = []
    for count in (1, 2, 7):
        with Workers(count) as workers:
            workers.pool.busy_before_more = 0.0
            workers.load(job_of(experiment(recording.signals["voltage"], measured)))
            workers.run(values[:1])
            costs.append([workers.run(values).costs for _ in range(3)])
            assert len(workers.pool.pids) == count
    assert all(np.array_equal(costs[0][0], c) for row in costs for c in row)


def test_the_layout_of_an_experiment_is_what_the_recording_says(crew):
    first = experiment(noisy_voltage(), np.zeros((300, 2)))
    crew.load(job_of(dataclasses.replace(first, interval=7e-3)))
    shown = crew.run(NOMINAL.reshape(1, 1, 5), record=True).shown[0]
    truth = held_response(CML050, noisy_voltage(), step=7e-3)
    assert np.all(np.abs(shown - truth) <= 1e-11 * np.abs(truth).max(axis=0))


def memories():
    """Return the inodes of the files in memory that this process holds for its workers."""
    found = set()
    for name in os.listdir("/proc/self/fd") if Path("/proc/self/fd").is_dir() else ():
        with contextlib.suppress(OSError):  # the folder's own
            if "memfd:fmu-estimator" in os.readlink(f"/proc/self/fd/{name}"):
                found.add(os.stat(int(name)).st_ino)
    return found


@pytest.mark.parametrize("in_memory", [True, False])
def test_a_job_of_late_gives_the_same_bits_again_and_old_ones_leave_no_files(in_memory, monkeypatch):
    if not in_memory:
        monkeypatch.delattr(os, "memfd_create", raising=False)
    elif not hasattr(os, "memfd_create"):
        pytest.skip("Linux has files in memory")
    jobs = [
        job_of(experiment(noisy_voltage(seed=k), np.zeros((300, 2))), fmu=fmu)
        for k in range(3)
        for fmu in ("dc_motor", "dc_motor_drive")
    ]
    before = memories()
    with Workers(1) as workers:
        first, again = [], []
        for shown, order in ((first, jobs), (again, [j for k in (0, 2, 4) for j in jobs[k : k + 2] * 3])):
            for job in order:
                workers.load(job)
                shown.append(workers.run(NOMINAL.reshape(1, 1, 5), record=True).shown)
                assert workers.simulations == 1
        files = [p.name for p in workers._folder.path.iterdir() if p.name.startswith(("shared", "numbers"))]
        held = memories() - before
    shared = KEPT_JOBS + KEPT_JOBS // 2  # what each shows; numbers, which two FMUs have in common
    assert len(held) == (shared if in_memory else 0)
    for k, shown in enumerate(again):
        assert np.array_equal(shown, first[k // 6 * 2 + k % 2])
    assert len(files) == (0 if in_memory else 2 * KEPT_JOBS)
