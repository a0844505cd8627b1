"""Whole fits in a worker process: they end where those of single candidates do, which an FMU that fails is left to."""

import dataclasses

import numpy as np
import pytest
from faulty import faulty_fmu
from motors import CML050, NAMES, recording_of, step_recording
from test_containment import IF_BAD, MARK

from estimator.cases.case import Case, OutputSpec, ParameterSpec
from estimator.fitting.least_squares import LeastSquares
from estimator.fitting.problem import Problem
from estimator.fitting.whole_fits import WholeFits
from estimator.fmus.fmu import describe
from estimator.fmus.workers import Workers
from estimator.plans.planning import plan_case

NOISE = (0.02, 1.0)
DEVIATIONS = np.array(NOISE)
TRUE = np.array([CML050.parameters[n] for n in NAMES])
STARTS = [TRUE * np.exp(0.5 * np.random.default_rng(k).standard_normal(5)) for k in range(6)]
RUN = step_recording(CML050, noise=NOISE, duration=0.9, interval=3e-3, lead=0.1)


class Counted:
    """How often whole fits were asked for, and how often they were told."""

    def __init__(self, whole):
        self.whole, self.told = whole, []

    def __call__(self, *args, **more):
        found = self.whole(*args, **more)
        self.told.append(found is not None)
        return found


def squares_of(crew, *, fmu="dc_motor", recordings=(RUN,), case=None, bundled=True):
    """Return least squares by single candidates, and by whole fits, and what counts these."""
    case = dataclasses.replace(case or Case(), fmu=str(fmu), recordings=())
    description = dataclasses.replace(describe(fmu), is_bundled=bundled)
    plan = plan_case(case, description, recordings=list(recordings))
    problem = Problem(plan, crew, sigma={"i": 1.0, "w": 1.0})
    counted = Counted(WholeFits(problem).fits)
    own = {"output": problem.output_of_residual, "spread": problem.spread}
    single = LeastSquares(problem.residuals, problem.box, **own)
    return single, LeastSquares(problem.residuals, problem.box, **own, whole=counted), counted, plan


def without_some(recording):
    """Return a recording some of whose samples are missing, in one output only."""
    current = recording.signals["current"].copy()
    current[40:60] = np.nan
    shown = np.column_stack([current, recording.signals["speed"]])
    return recording_of("gaps", recording.time, recording.signals["voltage"], shown)


BOUND = Case(parameters={n: ParameterSpec(n) for n in NAMES} | {"L": ParameterSpec("L", 0.016, 0.1)})
LATE = Case(outputs={"i": OutputSpec("current", delay=1.5e-3), "w": OutputSpec("speed")})
TWO = (RUN, step_recording(dataclasses.replace(CML050, name="other", voltage=6.0), noise=NOISE, seed=1, duration=0.6,
                           interval=3e-3, lead=0.1))  # fmt: skip


@pytest.mark.parametrize(
    "how",
    [{}, {"recordings": TWO}, {"recordings": (without_some(RUN),)}, {"case": BOUND}, {"case": LATE}],
    ids=["a step", "two recordings", "samples are missing", "a bound that holds", "an output that is shown late"],
)
def test_whole_fits_end_where_fits_of_single_candidates_do(how):
    with Workers(1) as crew:
        single, whole, counted, plan = squares_of(crew, **how)
        starts = [np.clip(s, single.box.lower, single.box.upper) for s in STARTS]
        expected = single.fits(starts, DEVIATIONS)
        before = crew.simulations, crew.steps
        found = whole.fits(starts, DEVIATIONS)
        simulations, steps = crew.simulations - before[0], crew.steps - before[1]
        bar = np.sqrt(np.diag(single.judge(expected[0][0], DEVIATIONS).covariance))
    rows = sum(len(o.recording.time) - 1 for o in plan.observed)
    assert counted.told == [True] and steps >= simulations * rows > 0 and steps % simulations == 0  # each to its end
    bar[bar == 0] = 1e-3  # at a bound
    for (x, cost), (y, other) in zip(found, expected, strict=True):
        assert np.all(np.abs(np.log(x / y)) < 1e-6 * bar) and cost == pytest.approx(other, rel=1e-11)


def test_whole_fits_know_an_optimum_and_are_the_same_by_any_number_of_workers():
    ends = []
    for count in (1, 2):
        with Workers(count) as crew:
            crew.pool.busy_before_more = 0.0
            single, whole, counted, _ = squares_of(crew)
            whole.fits(STARTS, DEVIATIONS)
            while not crew.pool.all_ready():
                crew.run(np.tile(TRUE, (64, 1, 1)).reshape(64, 1, 5))
            known = single.polish(TRUE, DEVIATIONS)
            before = crew.simulations
            found = whole.fits(STARTS, known.deviations, known=known)
            assert all(values is known.values for values, _ in found)
            assert crew.simulations - before < 200
            ends.append([values.tolist() for values, _ in whole.fits(STARTS, DEVIATIONS)])
            assert len(crew.pool.pids) == count and all(counted.told)
    assert ends[0] == ends[1]


@pytest.mark.parametrize(
    "what",
    [
        pytest.param(f"{IF_BAD} return fmi2Error;", id="error"),
        pytest.param(f"{IF_BAD} abort();", id="crash"),
        pytest.param(f"{IF_BAD} for (;;) {{}}", id="hang", marks=pytest.mark.full),
    ],
)
def test_where_a_simulation_fails_the_fits_are_done_by_single_candidates(tmp_path, what, monkeypatch):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=what)
    parameters = {n: ParameterSpec(n) for n in NAMES} | {"L": ParameterSpec("L", 0.001, 0.1)}
    case = Case(parameters=parameters)
    starts = [TRUE * [1, 1, 2, 1, 1], TRUE * [1.1, 1, 1, 1, 1]]  # the first fails: L is above 0.02
    with Workers(1, time_limit=1.0) as crew:
        single, whole, counted, _ = squares_of(crew, fmu=fmu, case=case)
        monkeypatch.setattr(crew, "fit", tried := Counted(crew.fit))
        found, expected = whole.fits(starts, DEVIATIONS), single.fits(starts, DEVIATIONS)
    assert counted.told == tried.told == [False]
    assert [x.tolist() for x, _ in found] == [x.tolist() for x, _ in expected]
    assert found[1][1] < 1.3 * len(RUN.time) * 2


def test_an_fmu_that_is_not_the_packages_is_simulated_candidate_by_candidate(tmp_path):
    with Workers(1) as crew:
        fmu = faulty_fmu(tmp_path, DoStep="return ORIGINAL;")
        _, whole, counted, _ = squares_of(crew, fmu=fmu, bundled=False)
        whole.fit(TRUE, DEVIATIONS)
    assert counted.told == [False]
