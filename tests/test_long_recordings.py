"""Recordings of many rows: what is found of them, and that it is what shorter ones say."""

import dataclasses
import os
import tracemalloc

import effect_bench as bench
import numpy as np
import pytest
from effect_bench import NOISE, TRUE

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining import addition_tests
from estimator.explaining.addition_tests import AdditionTests
from estimator.explaining.effects.average import Average
from estimator.explaining.effects.delay import Delay
from estimator.explaining.effects.low_pass import LowPass
from estimator.explaining.explained import explain
from estimator.explaining.selection import Selection
from estimator.explaining.selection_of_plan import freed_by_the_case
from estimator.fitting import gauss_newton
from estimator.fitting.fit import new_fit, refreshed, set_aside
from estimator.fitting.gauss_newton import solved
from estimator.fitting.projection import BLOCK, triangle
from estimator.fitting.simulator import CELLS, KEPT_ANSWERS, KEPT_VALUES, Simulator
from estimator.fmus.fmu import describe
from estimator.fmus.simulate import simulate
from estimator.fmus.workers import Workers
from estimator.noise.noise_model import NoiseModel
from estimator.plans.part import LONG, part_of
from estimator.plans.planning import plan_case
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
STEP, ROWS = 1e-3, LONG + 6_000


def switched(rows=ROWS, *, lost=(), seed=0, i=lambda y, t: y, w=lambda y, t: y):
    """Return a recording of a motor that is switched on and off every second; some rows are not logged."""
    times = np.arange(rows + len(lost)) * STEP
    v = np.where(times % 2.0 < 1.0, 0.0, 10.5)
    shown = simulate("dc_motor", parameters=TRUE, inputs={"v": v}, times=times)
    rng = np.random.default_rng(seed)
    logged = np.delete(np.arange(len(times)), lost)
    columns = {"voltage [V]": v[logged]}
    for header, name, act in (("current [A]", "i", i), ("speed [rad/s]", "w", w)):
        columns[header] = (act(shown[name], times) + NOISE[name] * rng.standard_normal(len(times)))[logged]
    return recording_from_arrays("long", times[:rows], columns)


def run(recording):
    return estimate_recordings([CASE], [[recording]], workers=1)[0]


def test_rows_that_a_long_recording_lost_are_found_where_they_are():
    result = run(switched(lost=range(11_020, 11_026)))
    assert any("lost rows at t = 11.0" in reason for reason in result.reasons), (result.effects, result.reasons)


def test_a_derivative_by_what_is_one_recordings_simulates_no_other_anew():
    case = Case(inputs=CASE.inputs, outputs={y: OutputSpec(o.column, offset="free") for y, o in CASE.outputs.items()})
    runs = [switched(2_500, seed=k) for k in range(3)]
    plan = plan_case(case, describe("dc_motor"), recordings=runs)
    wanted = freed_by_the_case(plan)
    with Workers(1) as crew:
        simulator = Simulator(plan, wanted, crew, {"i": 1.0, "w": 1.0})
        home = simulator.values({**TRUE, **{n.name: 0.1 for n in wanted}})
        many = np.repeat(home[None, :], 1 + len(home), axis=0)
        many[1:] += np.diag(1e-3 * np.maximum(np.abs(home), 1e-3))
        before = crew.steps
        together = simulator.shown(many)
        asked = crew.steps - before
        alone = np.concatenate([simulator.shown(one[None, :]) for one in many])
        assert len(wanted) == 6 and asked == (1 + len(TRUE) + 2) * (crew.steps - before - asked) // len(many)
    assert np.array_equal(together, alone)
    assert np.ptp(together[:, :2_500], axis=0).max() > 0


def test_a_candidate_that_fails_in_one_recording_leaves_the_others_as_they_are():
    case = Case(inputs=CASE.inputs, outputs={"i": OutputSpec("current", offset="free")})
    plan = plan_case(case, describe("dc_motor"), recordings=[switched(500, seed=k) for k in range(2)])
    with Workers(1) as crew:
        simulator = Simulator(plan, freed_by_the_case(plan), crew, {"i": 1.0})
        good = simulator.values(TRUE)
        many = np.array([good, good, good, good])
        many[1, simulator.index["J"]] = np.nan
        many[2:, simulator.index[simulator.names[-1]]] = 0.3, 0.4
        shown = simulator.shown(many)
        assert np.isnan(shown[1]).all() and np.isfinite(shown[[0, 2, 3]]).all()
        assert np.array_equal(shown[0], simulator.shown(good[None, :])[0])


def test_what_was_asked_of_late_is_not_simulated_again_and_cannot_be_changed_by_who_asked():
    plan = plan_case(CASE, describe("dc_motor"), recordings=[switched(500)])
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        one = simulator.values(TRUE)[None, :]
        first = simulator.shown(one)
        kept, before = first.copy(), crew.simulations
        with pytest.raises(ValueError, match="read-only"):
            first[:] = 0.0
        assert np.array_equal(simulator.shown(one), kept) and crew.simulations == before
        for k in range(KEPT_ANSWERS):
            simulator.shown(one * (1 + 1e-3 * (k + 1)))
        before = crew.simulations
        assert np.array_equal(simulator.shown(one), kept) and crew.simulations == before + 1
        simulator.shown(one, refine=2)
        assert crew.simulations == before + 2


@pytest.mark.full
def test_an_estimate_holds_so_many_columns_of_all_rows_and_no_more():
    rows, outputs, free = 200_000, 2, len(TRUE)
    recording = switched(rows)
    run(switched(2_000))  # what is imported and remembered
    tracemalloc.start()
    try:
        run(recording)
        most = tracemalloc.get_traced_memory()[1] / 8 / rows
    finally:
        tracemalloc.stop()
    fits = (
        2 * 3 * outputs
    )  # the one that a descent begins at, and where it ends: shown, whitened, one over the deviation
    held = (
        2 + outputs + 2 * outputs + 2 * free * outputs + fits
    )  # recording, compared, derivatives as both ask for them
    held += 2 * outputs + 3  # where the first fit began, weights of outliers; windows, masks
    simulated = 2 * outputs * CELLS / rows + KEPT_VALUES / rows  # at once, beside those before; and of late
    assert most < held + simulated


def test_a_fit_that_is_set_aside_is_made_again_as_it_was():
    plan = plan_of(switched(2_000))
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
        for grown in (noise, dataclasses.replace(noise, growth=np.array([2.0, 0.0]))):
            fit = solved(
                new_fit(simulator, simulator.values({n: 1.01 * x for n, x in TRUE.items()}), plan.names, grown)
            )
            again = set_aside(fit)()
            assert again.cost == fit.cost and np.array_equal(again.values, fit.values)
            assert np.array_equal(again.z, fit.z) and np.array_equal(again.shown, fit.shown)
            assert np.array_equal(again.raw, fit.raw) and np.array_equal(again.covariance(), fit.covariance())


def of_the_whole(recording, monkeypatch):
    """Return the estimate without a search of a part."""
    with monkeypatch.context() as changed:
        changed.setattr("estimator.estimating.search_and_polish.part_of", lambda plan: None)
        return run(recording)


LATE = {"i": lambda y, t: np.interp(t - 3.4e-3, t, y), "w": lambda y, t: np.interp(t - 3.4e-3, t, y)}
SHAKEN_LATER = {"w": lambda y, t: y + np.where(t > 20.0, 0.5, 0.0)}  # an offset that the first rows do not have


@pytest.mark.parametrize("bench", [{}, *(pytest.param(b, marks=pytest.mark.full) for b in (LATE, SHAKEN_LATER))])
def test_a_search_of_the_first_rows_gives_what_a_search_of_all_gives(bench, monkeypatch):
    recording = switched(**bench)
    whole, found = of_the_whole(recording, monkeypatch), run(recording)
    assert bench or found.steps < 0.97 * whole.steps
    assert (found.verdict, sorted(found.effects)) == (whole.verdict, sorted(whole.effects))
    for name, p in whole.parameters.items():
        assert abs(found.parameters[name].value - p.value) < 0.01 * p.standard_error
        assert found.parameters[name].standard_error == pytest.approx(p.standard_error, rel=0.01)


def plan_of(recording):
    return plan_case(CASE, describe("dc_motor"), recordings=[recording])


def test_the_part_that_is_searched_holds_what_the_inputs_do():
    times = np.arange(200_000) * STEP
    at_rest_for_long = np.where(times < 21.0, 0.0, 10.5)
    shown = simulate("dc_motor", parameters=TRUE, inputs={"v": at_rest_for_long}, times=times)
    columns = {"voltage [V]": at_rest_for_long, "current [A]": shown["i"], "speed [rad/s]": shown["w"]}
    part = part_of(plan_of(recording_from_arrays("rested", times, columns)))
    rows = len(part.observed[0].recording.time)
    assert 2 * 21_000 < rows <= 100_000 and len(part.observed[0].outputs["i"]) == rows


def test_of_a_short_recording_or_one_that_moves_at_its_end_all_rows_are_searched():
    assert part_of(plan_of(switched(LONG))) is None and part_of(plan_of(switched(LONG + 5000))) is not None
    times = np.arange(30_000) * STEP
    late = np.where(times < 29.0, 0.0, 10.5)
    shown = simulate("dc_motor", parameters=TRUE, inputs={"v": late}, times=times)
    columns = {"voltage [V]": late, "current [A]": shown["i"], "speed [rad/s]": shown["w"]}
    assert part_of(plan_of(recording_from_arrays("late", times, columns))) is None


def test_derivatives_of_a_fit_are_simulated_when_they_are_asked_and_once(monkeypatch):
    monkeypatch.setattr(gauss_newton, "SOON", 0)  # by single candidates, as of many rows
    plan = plan_of(switched(2_000))
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
        begun = new_fit(simulator, simulator.values({n: 1.01 * x for n, x in TRUE.items()}), plan.names, noise)
        found = solved(begun)
        before, derivatives = crew.simulations, found.raw
        assert crew.simulations == before + 2 * len(TRUE)  # central differences
        louder = refreshed(found, found.whitener.of(dataclasses.replace(noise, white=2 * noise.white)))
        assert louder.raw is derivatives and np.allclose(2 * louder.jacobian, found.jacobian)
        simulator._late.clear()
        asked = crew.simulations
        again = solved(louder)  # which stays where it is
        moved = dataclasses.replace(found.slopes._point, values=1.001 * found.values)
        assert np.array_equal(again.raw, derivatives) and crew.simulations == asked + len(TRUE)  # one-sided ones
        asked = crew.simulations
        assert not np.array_equal(moved.slopes(central=True), derivatives) and crew.simulations > asked


def test_a_fit_by_another_noise_keeps_its_values_until_it_is_solved():
    plan = plan_of(switched(2_000))
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
        found = solved(new_fit(simulator, simulator.values(TRUE), plan.names, noise))
        louder = found.whitener.of(dataclasses.replace(noise, white=2 * noise.white))
        other = refreshed(found, louder)
        assert other.cost == pytest.approx(found.cost / 4) and np.array_equal(other.values, found.values)
        assert solved(other).cost == pytest.approx(other.cost, rel=1e-6)


def test_the_triangular_factor_of_many_rows_is_that_of_all_at_once():
    columns = np.random.default_rng(1).standard_normal((2 * BLOCK + 17, 4)) * [1.0, 1e3, 1e-3, 1.0]
    found, whole = triangle(columns), np.linalg.qr(columns, mode="r")
    assert found.shape == whole.shape
    assert np.allclose(np.abs(found), np.abs(whole), rtol=1e-10, atol=1e-12 * np.abs(whole).max(axis=0))
    assert triangle(columns[:3]).shape == (3, 4) and triangle(columns[:0]).shape == (0, 4)


def test_more_trajectories_than_the_shared_memory_holds_are_each_what_it_is_alone(monkeypatch):
    monkeypatch.setattr("estimator.fmus.loaded_job.SHOWN_VALUES", 3_000)
    plan = plan_of(switched(500))
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        many = simulator.values(TRUE) * np.linspace(0.9, 1.1, 8)[:, None]
        many[5, 0] = np.nan
        batch = simulator.problem.trajectories(many)
        alone = [simulator.problem.trajectories(one[None, :]) for one in many]
    assert batch.failed.tolist() == [k == 5 for k in range(8)] and np.isnan(batch.shown[5]).all()
    for name in ("costs", "steps", "shown"):
        assert np.array_equal(getattr(batch, name), np.concatenate([getattr(b, name) for b in alone]), equal_nan=True)


def test_rivals_are_not_looked_for_where_the_explanation_is_not_wanted(monkeypatch):
    plan, asked = plan_of(switched(2_000)), []
    monkeypatch.setattr(
        "estimator.explaining.explained.settled", lambda selection, best: asked.append(best) or (best, [])
    )
    begun, noise = np.array(list(TRUE.values())), np.array([NOISE["i"], NOISE["w"]])
    with Workers(1) as crew:
        for wanted in (False, True):
            explain(
                plan, crew, [begun], sigma={"i": 1.0, "w": 1.0}, deviations=noise, effects=(),
                is_wanted=lambda checked, wanted=wanted: wanted and not checked.failures,
            )  # fmt: skip
            assert len(asked) == wanted


def test_filters_and_means_are_tried_on_signals_that_are_simulated_once():
    plan = plan_of(switched(2_000))
    lags, mean = LowPass("lag").nuisances(plan), Average().nuisances(plan)[0]
    with Workers(1) as crew:
        simulator = Simulator(plan, (*lags, mean, *Delay().nuisances(plan)), crew, {"i": 1.0, "w": 1.0})
        neutral = simulator.values(TRUE)
        slow = neutral.copy()
        slow[simulator.index[lags[0].name]] = 2 * STEP
        other = neutral.copy()
        other[simulator.index[lags[1].name]] = 3 * STEP
        first = simulator.shown(slow[None, :]).copy()
        before = crew.simulations
        second = simulator.shown(other[None, :])
        averaged = neutral.copy()
        averaged[simulator.index[mean.name]] = 3.0
        shown = simulator.shown(averaged[None, :])[0]
        assert crew.simulations == before
        plain = simulator.shown(neutral[None, :])[0]
        assert np.allclose(shown[2:, 0], (plain[2:, 0] + plain[1:-1, 0] + plain[:-2, 0]) / 3)
        assert np.array_equal(shown[:, 1], plain[:, 1])
        simulator._late.clear()
        anew = [simulator.shown(one[None, :]) for one in (other, slow)]
        assert crew.simulations == before + 1 + simulator.between
    assert np.array_equal(anew, [second, first]) and not np.array_equal(first, second)


@pytest.mark.full
def test_offsets_of_several_recordings_are_seen_at_rest_and_not_looked_for_one_after_the_other(monkeypatch):
    rounds: list[int] = []
    best = Selection.best_addition

    def counted(selection, explanation, effects, rejected, share):
        found = best(selection, explanation, effects, rejected, share)
        rounds[-1] += found is not None and found.additions[-1].effect.name == "offset"
        return found

    monkeypatch.setattr(Selection, "best_addition", counted)
    offsets = (0.05, -0.08, 0.06)
    runs = [switched(1_200, seed=k, i=lambda y, t, off=off: y + off) for k, off in enumerate(offsets)]
    for many in (2, 3):
        rounds.append(0)
        found = estimate_recordings([CASE], [runs[:many]], workers=1)[0]
        told = [p.value for name, p in found.chain.items() if name.startswith("offset i")]
        assert sorted(told) == pytest.approx(sorted(offsets[:many]), abs=0.005), found.effects
    assert rounds == [0, 0]


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="what is shared lies in files there")
def test_jobs_of_the_same_numbers_share_them_and_one_that_rests_gives_up_its_trajectories():
    plan, rows = plan_of(switched(80_000)), 80_000
    sigma = {"i": 1.0, "w": 1.0}
    with Workers(1) as crew:
        first, second = (Simulator(plan, (), crew, sigma) for _ in range(2))
        other = Simulator(plan, (), crew, {"i": 2.0, "w": 1.0})
        jobs = {id(k.job): k for k in crew._kept}
        a, b, c = (jobs[id(s.problem._job)] for s in (first, second, other))
        places = [os.fstat(loaded._numbers[0]).st_ino for loaded in (a, b, c)]
        assert places[0] == places[1] != places[2] and a._numbers != b._numbers
        candidate = first.values(TRUE)[None, :]
        before = first._simulated(candidate, 1)
        held = os.fstat(a._descriptors[0]).st_blocks * 512
        assert held > rows * 2 * 8
        assert np.array_equal(second._simulated(candidate, 1), before)
        assert os.fstat(a._descriptors[0]).st_blocks * 512 < held - rows * 2 * 8 / 2
        a.close()  # the numbers are the other's too
        crew._kept.remove(a)
        assert np.array_equal(second._simulated(1.01 * candidate, 1), other._simulated(1.01 * candidate, 1))
        assert np.array_equal(first._simulated(candidate, 1), before)  # made ready anew


def test_what_one_recording_has_keeps_its_columns_in_the_other(monkeypatch):
    """Those of what is not likely are given up in long recordings, before it was known to be likelier: an error."""
    tested = []

    def additions(self, explanation, effects, **kwargs):
        found = test_all(self, explanation, effects, **kwargs)
        for a in (a for a in found if a.again and a.linear is not None):
            alone = dataclasses.replace(a, again=False)
            tested.append((a.penalty(self.samples) < a.gain <= alone.penalty(self.samples), len(a.linear.columns)))
        return found

    test_all = AdditionTests.additions
    monkeypatch.setattr(AdditionTests, "additions", additions)
    monkeypatch.setattr(addition_tests, "LONG", 0)
    both = [
        bench.recording("two levels", seed=3, name=name, i=lambda y, off=off: y + off)
        for name, off in (("a", 0.02), ("b", 0.0035))
    ]
    result = estimate_recordings([CASE], [both], workers=1)[0]
    assert {"offset i a", "offset i b"} <= set(result.parameters) | set(result.chain), result.chain
    assert (True, len(both[0].time) + len(both[1].time)) in tested
