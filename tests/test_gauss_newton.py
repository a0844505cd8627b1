"""Gauss-Newton steps whose derivatives are corrected instead of simulated again: the same minimum for less."""

import dataclasses

import effect_bench
import numpy as np
import pytest
from effect_bench import NOISE, TRUE, lagged, recording

from estimator.cases.case import Case, OutputSpec, ParameterSpec
from estimator.explaining.effects.channel_delay import ChannelDelay
from estimator.explaining.effects.delay import Delay
from estimator.explaining.effects.low_pass import LowPass
from estimator.fitting import gauss_newton
from estimator.fitting.fit import Linear, new_fit
from estimator.fitting.gauss_newton import solved, solved_roughly
from estimator.fitting.simulator import Simulator
from estimator.fmus.probe import bundled_model
from estimator.fmus.workers import Workers
from estimator.noise.noise_model import NoiseModel
from estimator.plans.planning import plan_case
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})


def test_corrected_derivatives_give_the_change_of_the_step_and_are_changed_least():
    rng = np.random.default_rng(1)
    raw, dx, change = rng.standard_normal((50, 2, 4)), rng.standard_normal(4), rng.standard_normal((50, 2))
    a = np.triu(rng.standard_normal((4, 4))) * [1.0, 1e3, 1e-3, 1.0]
    before = raw.copy()
    weights = np.sum(a**2, axis=0) * dx
    corrected = gauss_newton._corrected(raw, dx, change, weights / (weights @ dx), own=False)
    assert np.array_equal(raw, before)
    np.testing.assert_allclose(corrected @ dx, change, rtol=1e-9, atol=1e-9)
    sizes = np.linalg.norm(a, axis=0)  # the least change of a row, each derivative by its size: by the pseudoinverse
    least = (change - raw @ dx)[:, :, None] * np.linalg.pinv((dx * sizes)[:, None])[0] * sizes
    np.testing.assert_allclose(corrected - raw, least, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-8])
def test_the_minimum_is_that_of_derivatives_that_are_simulated_at_every_step(tolerance, monkeypatch):
    plan = plan_case(CASE, bundled_model("dc_motor"), recordings=[recording("two levels", i=lambda y: lagged(y, 2e-3))])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    costs, simulations = [], []
    for usual in (gauss_newton.AS_PREDICTED, (np.inf, np.inf)):  # the second corrects none
        monkeypatch.setattr(gauss_newton, "AS_PREDICTED", usual)
        with Workers(1) as crew:
            nuisances = LowPass(name="lag").nuisances(plan)
            simulator = Simulator(plan, nuisances, crew, {"i": 1.0, "w": 1.0})
            start = simulator.values({n: 1.2 * x for n, x in TRUE.items()} | {"lag of i": 1e-3})
            begun = new_fit(simulator, start, (*plan.names, "lag of i"), noise)
            before = crew.simulations
            costs.append(gauss_newton.solved(begun, tolerance=tolerance).cost)
            simulations.append(crew.simulations - before)
    assert costs[0] == pytest.approx(costs[1], abs=10 * tolerance)
    assert simulations[0] < simulations[1]


def test_a_valley_that_is_curved_is_followed_to_its_lowest_point():
    """Friction and B on a logarithm: the settled current holds their sum, and only a motor that starts tells them."""
    free = {name: ParameterSpec(name) for name in TRUE} | {"friction": ParameterSpec("friction", 0.0, 0.1)}
    case = dataclasses.replace(CASE, fmu="dc_motor_drive", parameters=free)
    plan = plan_case(case, bundled_model("dc_motor_drive"), recordings=[recording("step", friction=0.014)])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    speed, costs = 161.0, []  # at which it settles
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        for friction, solve in ((0.014, solved), (0.0005, solved_roughly), (0.025, solved_roughly)):
            start = {**TRUE, "friction": friction, "B": TRUE["B"] + (0.014 - friction) / speed}
            costs.append(solve(new_fit(simulator, simulator.values(start), plan.names, noise)).cost)
    assert costs == pytest.approx(costs[:1] * 3, abs=0.01)


def test_a_number_that_is_nearly_zero_on_a_logarithm_does_not_shorten_the_step_of_the_others(monkeypatch):
    """All friction is dry: B goes to its bound, near which a step of its logarithm is as long as one likes."""
    free = {name: ParameterSpec(name) for name in TRUE} | {"friction": ParameterSpec("friction", 0.0, 0.1)}
    case = dataclasses.replace(CASE, fmu="dc_motor_drive", parameters=free)
    settled = TRUE["B"] * 161.0
    monkeypatch.setattr(effect_bench, "B", 1e-9)
    plan = plan_case(case, bundled_model("dc_motor_drive"), recordings=[recording("step", friction=settled)])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    costs = []
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        for friction, b in ((settled, 1e-9), (1.2 * settled, 1e-8), (0.8 * settled, 3e-12), (1.1 * settled, 1e-11)):
            start = {**TRUE, "friction": friction, "B": b}
            costs.append(solved_roughly(new_fit(simulator, simulator.values(start), plan.names, noise)).cost)
    assert costs == pytest.approx(costs[:1] * 4, abs=0.2)


def test_a_fit_that_another_noise_follows_simulates_no_derivatives_where_it_ends():
    plan = plan_case(CASE, bundled_model("dc_motor"), recordings=[recording("two levels")])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    fits, simulations = [], []
    for told in (True, False):
        with Workers(1) as crew:
            simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
            begun = new_fit(simulator, simulator.values({n: 1.02 * x for n, x in TRUE.items()}), plan.names, noise)
            before = crew.simulations
            fits.append(gauss_newton.solved(begun, told=told))
            simulations.append(crew.simulations - before)
    assert fits[1].cost == pytest.approx(fits[0].cost, abs=0.01)
    assert simulations[1] == simulations[0] - len(TRUE)


def test_a_fit_that_is_led_to_a_known_least_ends_there_and_to_no_other():
    plan = plan_case(CASE, bundled_model("dc_motor"), recordings=[recording("two levels")])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    with Workers(1) as crew:
        simulator = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})
        known = solved(new_fit(simulator, simulator.values(TRUE), plan.names, noise), tolerance=1e-8)
        known.covariance()
        begun = new_fit(simulator, simulator.values({**TRUE, "L": 3 * TRUE["L"]}), plan.names, noise)
        before = crew.simulations
        assert solved(begun, beside=known) is known
        led = crew.simulations - before
        anew = Simulator(plan, (), crew, {"i": 1.0, "w": 1.0})  # which remembers nothing of that
        assert solved(dataclasses.replace(begun, simulator=anew)).cost == pytest.approx(known.cost, abs=1e-3)
        assert led < crew.simulations - before - led
        k = simulator.index["L"]
        apart = known.values * np.exp(5 * np.sqrt(np.diag(known.covariance())[k]) * (np.arange(len(known.values)) == k))
        for other in (dataclasses.replace(known, values=apart), dataclasses.replace(known, cost=known.cost - 5)):
            other.covariance()
            assert solved(begun, beside=other).cost == pytest.approx(known.cost, abs=1e-3)
            assert solved(begun, beside=other) is not other


DELAYED = "delay"
LAGGED = "lag of i"


def _lost(recording):
    """Return a recording without some samples of its current."""
    current = recording.signals["current"].copy()
    current[120:140] = np.nan
    shown = {"voltage [V]": recording.signals["voltage"], "current [A]": current,
             "speed [rad/s]": recording.signals["speed"]}  # fmt: skip
    return recording_from_arrays("lost", recording.time, shown)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-8])
@pytest.mark.parametrize(
    ("fmu", "freed", "run"),
    [
        ("dc_motor", (), recording("two levels", rows=slice(0, 600))),
        ("dc_motor", (DELAYED,), recording("two levels", rows=slice(0, 600))),
        ("dc_motor", (), _lost(recording("two levels", rows=slice(0, 600)))),
        ("dc_motor_drive", ("friction",), recording("two levels", rows=slice(0, 600), friction=0.014)),
    ],
    ids=["plain", "a delay is free", "samples are missing", "friction is free"],
)
def test_a_descent_in_the_worker_is_that_of_single_candidates(fmu, freed, run, tolerance, monkeypatch):
    free = {name: ParameterSpec(name) for name in TRUE}
    free |= {"friction": ParameterSpec("friction", 0.0, 0.1)} if "friction" in freed else {}
    plan = plan_case(dataclasses.replace(CASE, fmu=fmu, parameters=free), bundled_model(fmu), recordings=[run])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    fits, messages = [], []
    for soon in (0, gauss_newton.SOON):
        monkeypatch.setattr(gauss_newton, "SOON", soon)
        with Workers(1) as crew:
            simulator = Simulator(plan, Delay().nuisances(plan), crew, {"i": 1.0, "w": 1.0})
            start = {n: 1.2 * x for n, x in TRUE.items()} | {n: 0.01 if n == "friction" else 5e-4 for n in freed}
            wanted = (*plan.names, *(n for n in freed if n not in plan.names))
            begun = new_fit(simulator, simulator.values(start), wanted, noise)
            sent = []
            monkeypatch.setattr(crew.pool._processes[0], "send", _counting(crew.pool._processes[0].send, sent))
            fits.append(solved(begun, tolerance=tolerance))
            messages.append(len(sent))
            there = simulator.shown(fits[-1].values[None, :])[0]
            np.testing.assert_allclose(fits[-1].shown, there, rtol=1e-9, atol=1e-9)
            if soon == 0:
                bars = np.sqrt(np.diag(fits[0].covariance()))[: len(fits[0].where)]
            if tolerance == 1e-8:
                told = fits[-1].slopes.raw
                fits[-1].slopes.forget()
                np.testing.assert_allclose(told, fits[-1].slopes.raw, rtol=1e-6, atol=1e-6 * np.abs(told).max())
    one, other = fits
    moved = simulator.scaled(one.values)[one.where] - simulator.scaled(other.values)[one.where]
    assert other.cost == pytest.approx(one.cost, abs=10 * tolerance)
    assert np.all(np.abs(moved) < 3 * np.sqrt(tolerance) * bars)
    assert messages[1] == 1 < messages[0] / 4


def _counting(send, sent):
    def counted(order):
        sent.append(order)
        send(order)

    return counted


def test_what_a_worker_cannot_do_alone_is_done_by_single_candidates():
    run = recording("two levels", i=lambda y: lagged(y, 2e-3), rows=slice(0, 600))
    plan = plan_case(CASE, bundled_model("dc_motor"), recordings=[run])
    noise = NoiseModel.plain(np.array([NOISE["i"], NOISE["w"]]), (-1, -1))
    with Workers(1) as crew:
        nuisances = (*LowPass(name="lag").nuisances(plan), *ChannelDelay().nuisances(plan))
        simulator = Simulator(plan, nuisances, crew, {"i": 1.0, "w": 1.0})
        bare = new_fit(simulator, simulator.values(TRUE), plan.names, noise)
        assert gauss_newton._told_whole(bare, None, LIMITS) is not None
        for name in (LAGGED, "delay of i"):  # a filter, and a delay that may turn into one of the other output
            wider = dataclasses.replace(bare, free=(*bare.free, name))
            assert gauss_newton._told_whole(wider, None, LIMITS) is None
        column = Linear("offset i", np.ones((*bare.shown.shape, 1)), ("A",))
        assert gauss_newton._told_whole(dataclasses.replace(bare, linear=(column,)), None, LIMITS) is None
        slow = dataclasses.replace(noise, slow=np.array([[0.01, 0.1], [0.0, 1.0]]))
        coloured = dataclasses.replace(bare, whitener=bare.whitener.of(slow))
        assert gauss_newton._told_whole(coloured, None, LIMITS) is None
        filtered = dataclasses.replace(bare, values=simulator.values({**TRUE, LAGGED: 2e-3}))
        assert gauss_newton._told_whole(filtered, None, LIMITS) is None


LIMITS = {"iterations": 25, "fine": False, "told": True, "tolerance": 1e-3, "limit": np.inf}
