"""A process that may crash itself steps the package's own FMUs: what it finds is what a worker process finds."""

import dataclasses
import shutil

import numpy as np
import pytest
from motors import CML050, NAMES, step_recording

from estimator.batches.case_worker import CaseWorker
from estimator.cases.case import Case
from estimator.estimating.checkpoint import JournalledWorkers
from estimator.fitting.problem import Problem
from estimator.fitting.whole_fits import WholeFits
from estimator.fmus.fmu import describe
from estimator.fmus.workers import Workers
from estimator.plans.planning import plan_case

RUN = step_recording(CML050, noise=(0.02, 1.0), duration=0.6, interval=3e-3, lead=0.1)
TRUE = np.array([CML050.parameters[n] for n in NAMES])
CANDIDATES = TRUE * np.exp(0.3 * np.random.default_rng(1).standard_normal((40, 5)))


def problem_of(crew, fmu="dc_motor"):
    description = describe(fmu)
    plan = plan_case(dataclasses.replace(Case(), fmu=str(fmu), recordings=()), description, recordings=[RUN])
    return Problem(plan, crew, sigma={"i": 0.02, "w": 1.0})


def told_by(problem):
    """Return all that a problem's workers tell, and how often they have simulated."""
    shown = problem.signals(CANDIDATES[:3])
    costs = problem.costs(CANDIDATES, np.full(len(CANDIDATES), 1e5))
    weights = np.array([50.0, 1.0])
    fits = WholeFits(problem).fits(np.log(CANDIDATES[:2]), weights, evaluations=20, ftol=1e-8, xtol=1e-8)
    return shown, costs, fits, (problem.workers.simulations, problem.workers.steps)


def test_the_packages_own_fmu_is_stepped_here_as_a_process_does():
    with Workers(1) as crew, Workers(1, inside=True) as own:
        there, here = told_by(problem_of(crew)), told_by(problem_of(own))
        assert len(crew.pool.pids) == 1 and not own.pool.pids
    for one, other in zip(there[:2], here[:2], strict=True):
        assert one.tobytes() == other.tobytes()
    assert np.isinf(here[1]).any() and np.isfinite(here[1]).any()  # some are cut short
    for (x, cost), (y, same) in zip(there[2], here[2], strict=True):
        assert x.tobytes() == y.tobytes() and cost == same
    assert there[3] == here[3]


def test_another_fmu_has_a_process_though_the_packages_own_has_none(tmp_path):
    copy = tmp_path / "other.fmu"
    shutil.copy(describe("dc_motor").path, copy)
    with Workers(1, inside=True) as own:
        first = problem_of(own)
        costs = first.costs(CANDIDATES)
        assert not own.pool.pids
        other = problem_of(own, copy)
        assert other.costs(CANDIDATES).tobytes() == costs.tobytes()
        assert len(own.pool.pids) == 1
        assert first.costs(CANDIDATES).tobytes() == costs.tobytes()  # each may be asked again
        assert other.costs(CANDIDATES).tobytes() == costs.tobytes()


@pytest.mark.parametrize("inside", [True, False])
def test_a_case_worker_has_a_process_only_if_it_is_not_one(inside):
    with CaseWorker(inside=inside) as case_worker:
        found = case_worker.estimate(Case(), recordings=(RUN,))
        assert isinstance(case_worker._crew, JournalledWorkers)
        assert bool(case_worker._crew.pool.pids) == (not inside)
    assert found.verdict == "ok"
