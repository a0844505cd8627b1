"""The noise model: what is found again of simulated noise, and what whitening and score test make of it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import cheby1, lfilter, sosfilt
from scipy.stats import kstest

from estimator.explaining.explanation_noise import _of_steps
from estimator.fitting.projection import Projection
from estimator.fitting.score_test import ScoreTest
from estimator.noise.autoregression import autoregression
from estimator.noise.clock import Clock
from estimator.noise.jitter import find_jitter, without_responses
from estimator.noise.noise_estimate import fit_noise
from estimator.noise.noise_growth import growths_of
from estimator.noise.noise_model import LEAST_MOTION, WAYS, NoiseModel, held
from estimator.noise.repeating import repeat_themselves
from estimator.noise.restricted_likelihood import RestrictedLikelihood
from estimator.noise.whitener import Whitener
from estimator.plans.part import LONG

pytestmark = pytest.mark.usefixtures("shared_workers")

STEP = 1e-3
MACHINE = (np.array([[-240.0, -3.7], [5400.0, -19.0]]), np.array([0.0, 1.1e5]))  # a small motor, torque in N.m


def whitener_of(noise, n, q=1, *, time=None, level=None, missing=()):
    time = STEP * np.arange(n) if time is None else time
    present = np.ones((n, q), dtype=bool)
    present[list(missing)] = False
    level = np.zeros((n, q)) if level is None else level
    return Whitener(
        noise, (Clock(time, slice(0, n)),), present, level, np.ones((n, q)), np.ones(n, dtype=bool), np.zeros((n, q))
    )


def plain(*white):
    return NoiseModel.plain(np.array(white), tuple(-1 for _ in white))


def wandering(rng, n, deviation, tau, step=STEP):
    """Return an Ornstein-Uhlenbeck process, (n,)."""
    f = np.exp(-step / tau)
    shocks = deviation * np.sqrt(1 - f * f) * rng.standard_normal(n)
    shocks[0] = deviation * rng.standard_normal()
    return lfilter([1.0], [1.0, -f], shocks)


def found(residuals, *, start=None, columns=None, level=None, **more):
    n, q = residuals.shape
    whitener = whitener_of(plain(*np.ones(q)) if start is None else start, n, q, level=level)
    columns = np.zeros((n, q, 0)) if columns is None else columns
    how = {
        "steps": np.zeros(q),
        "resolution": np.zeros(q),
        "is_held": np.zeros(q, dtype=bool),
        "counts": np.zeros(q),
        "colour": True,
    }
    how |= {"again": False, **more}
    return fit_noise(whitener, residuals, columns, np.ones(n, dtype=bool), np.zeros(n, dtype=bool), **how)


def total(noise, channel=0):
    return noise.deviation(np.zeros((1, len(noise.white))), np.ones(1, dtype=bool))[0, channel]


def test_the_deviation_is_unbiased_whatever_the_parameters_have_taken():
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((400, 1, 60))
    basis = np.linalg.qr(columns[:, 0])[0]
    squares = []
    for _ in range(8):
        r = 0.3 * rng.standard_normal(400)
        left = r - basis @ (basis.T @ r)
        squares.append(found(left[:, None], columns=columns).white[0] ** 2)
    # 339 degrees of freedom (a level, too) of 8 draws: the mean square is told to 2.7 %; else it is 15 % low
    assert np.mean(squares) == pytest.approx(0.09, rel=0.09)


@pytest.mark.parametrize("deviation", [0.9, pytest.param(4.0, marks=pytest.mark.full)])  # steps
def test_a_rounded_signal_has_the_same_noise_at_a_level_and_in_motion(deviation):
    """Differences of a level are whole steps: their median told a growth that was not there."""
    n, level = 8000, np.repeat([[0.0], [1.0]], 4000, axis=0)
    with_steps, without = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        true = np.where(level == 0, 0.0, 0.37 * np.arange(n)[:, None])
        residuals = np.rint(true + deviation * rng.standard_normal((n, 1))) - true
        with_steps.append(found(residuals, level=level, steps=np.ones(1)))
        without.append(found(residuals, level=level))
    assert all(noise.growth[0] == 0 for noise in with_steps)
    assert any(noise.growth[0] > 0 for noise in without), "else this shows nothing"
    whole = np.hypot(deviation, 12**-0.5)
    assert all(noise.white[0] == pytest.approx(whole, rel=0.05) for noise in with_steps)


def test_what_a_level_hides_of_a_converters_noise_is_there_in_motion():
    """A quarter of a step of noise about the middle of a step: five samples of a hundred show another value."""
    residuals = np.rint(0.25 * np.random.default_rng(0).standard_normal((4000, 1)))
    assert residuals.std() < 0.25
    assert found(residuals, steps=np.ones(1)).white[0] == pytest.approx(np.hypot(0.25, 12**-0.5), rel=0.1)


def test_numbers_of_other_residuals_that_overflow_here_are_estimated_afresh():
    residuals = 1e10 * np.random.default_rng(0).standard_normal((2000, 1))
    far = dataclasses.replace(plain(1e-200), slow=np.array([[1e-200, 1.0]]))
    noise = found(residuals, start=far, again=True)
    assert noise.white[0] == pytest.approx(1e10, rel=0.1) and len(noise.short) == 2


def test_a_noise_that_is_estimated_again_with_another_growth_begins_as_large_as_it_was():
    """Else it begins forty times too large where it grows so, and ends in another optimum."""
    rng = np.random.default_rng(3)
    level = np.where(np.arange(4000) < 400, 0.0, np.abs(np.sin(np.arange(4000) / 300)))[:, None]
    r = (0.006 * np.hypot(1.0, 40 * level)) * (
        rng.standard_normal((4000, 1)) + wandering(rng, 4000, 1.0, 0.05)[:, None]
    )
    start = dataclasses.replace(plain(0.1), slow=np.array([[0.1, 0.05]]))
    again, afresh = (found(r, start=start, level=level, again=way) for way in (True, False))
    assert again.growth == afresh.growth and again.growth[0] > 20
    assert again.white[0] == pytest.approx(0.006, rel=0.2) and again.white[0] == pytest.approx(
        afresh.white[0], rel=0.02
    )
    assert again.slow[0, 0] == pytest.approx(afresh.slow[0, 0], rel=0.2)


def test_a_sensor_that_shows_zero_at_rest_tells_its_noise_in_motion():
    rng, settled = np.random.default_rng(0), np.arange(2000) < 1000
    residuals = np.column_stack([rng.standard_normal(2000), np.where(settled, 0.0, rng.standard_normal(2000))])
    how = {"steps": np.zeros(2), "resolution": np.zeros(2), "is_held": np.zeros(2, dtype=bool), "counts": np.zeros(2)}
    noise = fit_noise(
        whitener_of(plain(1.0, 1.0), 2000, 2), residuals, np.zeros((2000, 2, 0)), settled, ~settled, colour=False,
        again=False, **how,
    )  # fmt: skip
    assert noise.white[0] == pytest.approx(1, rel=0.1) and noise.white[1] == pytest.approx(0.5**0.5, rel=0.1)


def test_white_noise_shows_neither_slow_parts_nor_growth():
    rng = np.random.default_rng(2)
    level = np.linspace(0, 1, 2000)[:, None] * np.ones(2)
    for _ in range(15):
        noise = found(rng.standard_normal((2000, 2)) * [0.02, 1.0], level=level)
        assert np.all(noise.slow[:, 0] == 0) and np.all(noise.growth == 0)
        assert noise.white == pytest.approx([0.02, 1.0], rel=0.08)


@pytest.mark.parametrize("tau", [0.1, pytest.param(0.01, marks=pytest.mark.full)])
def test_a_slow_part_is_found_with_its_deviation_and_time(tau):
    rng = np.random.default_rng(3)
    deviations, times = [], []
    for _ in range(10):
        r = 0.02 * rng.standard_normal(4000) + wandering(rng, 4000, 0.02, tau)
        noise = found(r[:, None])
        assert noise.white[0] == pytest.approx(0.02, rel=0.1)
        deviations.append(noise.slow[0, 0])
        times.append(noise.slow[0, 1])
    # 4 s hold some 20 independent samples of 0.1 s, of which a level is taken: a fifth to a third for the mean of ten
    assert np.mean(deviations) == pytest.approx(0.02, rel=0.3)
    assert np.exp(np.mean(np.log(times))) == pytest.approx(tau, rel=0.5)


def test_the_difference_of_white_errors_is_found():
    rng = np.random.default_rng(4)
    errors = 0.7 * rng.standard_normal((3001, 1))
    start = dataclasses.replace(plain(1.0), differenced=np.array([1.0]))
    noise = found(np.diff(errors, axis=0), start=start)
    assert noise.differenced[0] == pytest.approx(0.7, rel=0.05) and noise.white[0] < 0.1
    assert total(noise) == pytest.approx(0.7 * np.sqrt(2), rel=0.05)


def test_a_torque_that_wanders_is_found_in_current_and_speed_at_once():
    rng = np.random.default_rng(5)
    start = dataclasses.replace(plain(1.0, 1.0), machine=MACHINE, seat=(0, 1))
    deviations, times = [], []
    for _ in range(6):
        torque = wandering(rng, 4000, 2e-4, 0.1)
        step = held(MACHINE[0].tobytes(), MACHINE[1].tobytes(), STEP)
        x, shown = np.zeros(2), np.empty((4000, 2))
        for k in range(4000):
            shown[k] = x
            x = step[:2, :2] @ x + step[:2, 2] * torque[k]
        noise = found(shown + rng.standard_normal((4000, 2)) * [0.005, 0.3], start=start)
        assert np.all(noise.slow[:, 0] == 0), "one torque explains both channels"
        deviations.append(noise.torque[0])
        times.append(noise.torque[1])
    assert np.mean(deviations) == pytest.approx(2e-4, rel=0.3)
    assert np.exp(np.mean(np.log(times))) == pytest.approx(0.1, rel=0.5)


def test_a_noise_that_is_estimated_afresh_is_no_less_likely_than_that_of_before():
    """Component by component a likelihood is reached of which there is a larger one: of four runs it was 33 less."""
    n, counts = 4000, np.array([0.0, 3.1])
    rng = np.random.default_rng(8)
    step, torque = held(MACHINE[0].tobytes(), MACHINE[1].tobytes(), STEP), wandering(rng, n, 2e-4, 0.3)
    state, residuals = np.zeros(2), np.zeros((n, 2))
    for k in range(n):
        residuals[k] = state = step[:2, :2] @ state + step[:2, 2] * torque[k]
    errors = counts[1] * rng.standard_normal(n + 1)
    residuals[:, 0] += 0.0056 * rng.standard_normal(n) + wandering(rng, n, 0.0015, 0.15)
    residuals[:, 1] += np.diff(errors) + wandering(rng, n, 0.3, 0.15)
    bare = dataclasses.replace(NoiseModel.plain(np.array([0.0056, 0.02]), (0, 1)), differenced=counts, machine=MACHINE)
    before = dataclasses.replace(bare, slow=np.array([[0.0015, 0.15], [0.3, 0.15]]), torque=(2e-4, 0.3))
    stacked = np.stack([residuals, np.ones((n, 2))], axis=2)
    likelihood = RestrictedLikelihood(whitener_of(bare, n, 2), stacked)
    from_white, from_before = (
        likelihood.misfit(dataclasses.replace(found(residuals, start=start, counts=counts), short=()))
        for start in (bare, before)
    )
    assert from_before < from_white - 3


def of_wandering_friction(seed, part):
    """Return the noise of a machine whose torque wanders, times a part of each row, (n,), and what it shows, (n, 2)."""
    n, tau, rng = len(part), 0.1, np.random.default_rng(seed)
    noise = dataclasses.replace(plain(1e-4, 1e-2), machine=MACHINE, seat=(0, 1), torque=(2e-4, tau))
    torque, x, shown = wandering(rng, n, 2e-4, tau) * part, np.zeros(2), np.empty((n, 2))
    step = held(MACHINE[0].tobytes(), MACHINE[1].tobytes(), STEP)
    for k in range(n):
        shown[k] = x
        x = step[:2, :2] @ x + step[:2, 2] * torque[k]
    return noise, shown + rng.standard_normal((n, 2)) * noise.white


def test_friction_that_wanders_against_the_motion_is_whitened_as_it_comes():
    """Of a machine that turns back every 50 rows: whitened by that the torque is white, without it is not."""
    way = np.where(np.arange(6000) // 50 % 2, 1, -1)
    noise, shown = of_wandering_friction(2, way)
    knows_not = whitener_of(noise, len(way), 2)
    ratios = []
    for whitener in (dataclasses.replace(knows_not, way=(WAYS * way).astype(np.int8)), knows_not):
        z = whitener(shown[:, :, None])[0][200:, :, 0]
        ratios.append(float(np.mean(z**2)))
    assert abs(ratios[0] - 1) < 5 * np.sqrt(2 / z.size) and ratios[1] > 1.05, ratios


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_friction_wanders_by_a_share_of_itself(share):
    """At a part of its speed a machine's torque changes by as much less, and whitens as it comes."""
    part = np.where(np.arange(6000) // 1500 % 2, 1.0, share)
    noise, shown = of_wandering_friction(3, part)
    whitener = dataclasses.replace(whitener_of(noise, len(part), 2), way=(WAYS * part).astype(np.int8))
    z = whitener(shown[:, :, None])[0][200:, :, 0]
    assert abs(float(np.mean(z**2)) - 1) < 5 * np.sqrt(2 / z.size)


def test_a_torque_that_all_rows_tell_is_kept_while_the_rest_of_the_noise_is_told():
    """Levels of few rows each hold the torque: asked for both they tell none, and a slow part in its place."""
    rng = np.random.default_rng(4)
    r = rng.standard_normal((4000, 2)) * [1e-4, 1e-2]
    start = dataclasses.replace(plain(1e-4, 1e-2), machine=MACHINE, seat=(0, 1))
    noise = found(r, start=start, torque=(3e-5, 0.1))
    assert noise.torque == (3e-5, 0.1)
    assert found(r, start=start, torque=(0.0, 1.0)).torque[0] == 0


def test_a_noise_out_of_all_proportion_is_as_unlikely_as_can_be_and_no_error():
    rng = np.random.default_rng(0)
    stacked = np.concatenate([1e160 * rng.standard_normal((600, 2, 1)), rng.standard_normal((600, 2, 2))], axis=2)
    usual = plain(1.0, 1.0)
    coloured = dataclasses.replace(usual, slow=np.array([[1.0, 0.03], [1.0, 0.03]]))
    likelihood = RestrictedLikelihood(whitener_of(usual, 600, 2), stacked)
    assert likelihood.misfit(usual) == likelihood.misfit(coloured) == np.inf


def test_noise_that_grows_with_the_signal_is_found():
    rng = np.random.default_rng(6)
    level = np.concatenate([np.zeros(500), 0.9 * np.ones(1500)])[:, None]
    r = 0.02 * np.sqrt(1 + (3 * level) ** 2) * rng.standard_normal((2000, 1))
    noise = found(r, level=level)
    assert noise.white[0] == pytest.approx(0.02, rel=0.1) and noise.growth[0] == pytest.approx(3, rel=0.15)


@pytest.mark.parametrize("bends", [False, True])
def test_noise_of_a_machine_that_runs_is_told_from_that_at_rest_and_from_what_grows_with_the_signal(bends):
    """As on real benches: 6 mA at rest, 20 mA running, and as many times as the current is above the steady one."""
    rng = np.random.default_rng(7)
    moving = np.arange(6000) >= 1000
    level = np.where(moving, np.abs(np.sin(np.arange(6000) / 300)) ** 3, 0.0)[:, None]
    least, more = np.where(moving, 3.0, 1.0)[:, None], 40 * level
    g = np.maximum(least, more) if bends else np.hypot(least, more)
    r = 0.006 * g * rng.standard_normal((6000, 1))
    whitener = dataclasses.replace(whitener_of(plain(1.0), 6000, level=level), moving=moving)
    how = {"steps": np.zeros(1), "resolution": np.zeros(1), "is_held": np.zeros(1, dtype=bool), "counts": np.zeros(1)}
    rows = np.ones(6000, dtype=bool)
    noise = fit_noise(whitener, r, np.zeros((6000, 1, 0)), rows, ~rows, colour=False, again=False, **how)
    assert noise.white[0] == pytest.approx(0.006, rel=0.1)
    assert noise.running[0] == pytest.approx(3, rel=0.2) and noise.growth[0] == pytest.approx(40, rel=0.2)
    assert noise.bends[0] == bends
    z = r[:, 0] / noise.deviation(level, moving)[:, 0]
    for part in (~moving, moving & (level[:, 0] < 0.05), level[:, 0] > 0.3):
        assert np.std(z[part]) == pytest.approx(1, abs=0.12)


def growths(r, level, moving):
    whitener = dataclasses.replace(whitener_of(plain(1.0), len(r), level=level), moving=moving)
    no = np.zeros(len(r), dtype=bool)
    return growths_of(r, whitener, no, steps=np.zeros(1))


def test_a_machine_that_hardly_moves_may_be_as_quiet_as_at_rest():
    """A speed that fades: below 2 % of its largest its sensor shows a third of the noise, as at rest."""
    rng = np.random.default_rng(11)
    level = np.concatenate([np.zeros(60), np.ones(1400), np.exp(-np.arange(1500) / 180)])[:, None]
    r = np.where(level > 0.02, 0.5, 0.15) * rng.standard_normal(level.shape)
    (told,), stands = growths(r, level, level[:, 0] > 1e-3)
    assert stands == 0.02 and told.running == pytest.approx(0.5 / 0.15, rel=0.25) and told.growth < 1.5
    assert told.white == pytest.approx(0.15, rel=0.1)
    assert growths(0.15 * rng.standard_normal(level.shape), level, level[:, 0] > 1e-3)[1] == LEAST_MOTION


def test_rest_and_one_speed_do_not_tell_how_noise_grows_between_where_the_larger_is_taken():
    rng = np.random.default_rng(12)
    level = np.concatenate([np.zeros(200), np.ones(400)])[:, None]
    for _ in range(10):
        (told,), _ = growths(np.where(level > 0, 0.5, 0.15) * rng.standard_normal(level.shape), level, level[:, 0] > 0)
        assert told.growth == 0 and told.running > 2 and not told.bends


def test_a_growth_is_not_charged_for_two_numbers_where_one_is_as_likely():
    """A noise of two sizes at rest and running, and two speeds: as a growth it would be off by 30 % at both."""
    rng = np.random.default_rng(13)
    level = np.concatenate([np.zeros(450), np.full(200, 0.7), np.ones(200)])[:, None]
    (told,), _ = growths(np.where(level > 0, 0.55, 0.14) * rng.standard_normal(level.shape), level, level[:, 0] > 0)
    assert told.growth == 0 and told.running == pytest.approx(0.55 / 0.14, rel=0.15)


def test_a_machine_that_runs_as_quietly_as_it_rests_is_not_told_to_be_louder():
    """Ratios of medians beyond four standard errors, and 13 of -2 log L besides: below 1e-5 in 15 draws."""
    rng = np.random.default_rng(8)
    moving = np.arange(2000) >= 600
    how = {"steps": np.zeros(1), "resolution": np.zeros(1), "is_held": np.zeros(1, dtype=bool), "counts": np.zeros(1)}
    rows = np.ones(2000, dtype=bool)
    for _ in range(15):
        whitener = dataclasses.replace(whitener_of(plain(1.0), 2000, level=moving[:, None] * 0.9), moving=moving)
        r = rng.standard_normal((2000, 1))
        noise = fit_noise(whitener, r, np.zeros((2000, 1, 0)), rows, ~rows, colour=False, again=False, **how)
        assert noise.running[0] == 1.0 and noise.growth[0] == 0


def test_each_channel_tells_its_noise_where_it_can_in_a_long_recording():
    """A current that settles in the first rows only, beside a speed that tells it in all, had a noise of 1 A."""
    n = 6000
    rng = np.random.default_rng(10)
    settled = np.arange(n) < 300
    r = np.column_stack([0.02 * rng.standard_normal(n), np.where(settled, 0.0, rng.standard_normal(n))])
    whitener = whitener_of(plain(1.0, 1.0), n, 2)
    how = {"steps": np.zeros(2), "resolution": np.zeros(2), "is_held": np.zeros(2, dtype=bool), "counts": np.zeros(2)}
    noise = fit_noise(whitener, r, np.zeros((n, 2, 0)), settled, ~settled, colour=False, again=False, **how)
    assert noise.white == pytest.approx([0.02, 1.0], rel=0.2)


def test_white_noise_beside_counts_that_are_differenced_is_told():
    """By the counts alone what moves slowly is out of all proportion: they seemed thirty times as large."""
    rng = np.random.default_rng(9)
    r = np.diff(0.2 * rng.standard_normal(3001)) + 1.5 * rng.standard_normal(3000)
    start = dataclasses.replace(plain(1.0), differenced=np.array([0.2]))
    noise = found(r[:, None], start=start, counts=np.array([0.2]), colour=False)
    assert noise.white[0] == pytest.approx(1.5, rel=0.06) and noise.differenced[0] < 0.5


def coloured(seed, n, missing=()):
    """Return noise of a known model, with gaps and a clock that jitters, and its whitener."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(STEP * (1 + 0.3 * rng.uniform(-1, 1, n)))
    slow = np.empty(n)
    slow[0] = 0.05 * rng.standard_normal()
    for k in range(1, n):
        f = np.exp(-(time[k] - time[k - 1]) / 0.02)
        slow[k] = f * slow[k - 1] + 0.05 * np.sqrt(1 - f * f) * rng.standard_normal()
    r = (slow + 0.02 * rng.standard_normal(n))[:, None]
    noise = dataclasses.replace(plain(0.02), slow=np.array([[0.05, 0.02]]))
    return r, whitener_of(noise, n, time=time, missing=missing)


def test_whitened_noise_is_white_and_of_variance_one_with_gaps_and_jitter():
    missing = [*range(200, 260), 700, 1500]
    r, whitener = coloured(7, 3000, missing)
    z = whitener(r[:, :, None])[0].ravel()
    assert np.all(z[missing] == 0)
    z = np.delete(z, missing)
    assert kstest(z, "norm").pvalue > 1e-3 and np.mean(z**2) == pytest.approx(1, abs=0.1)
    for lag in (1, 2, 20):
        assert abs(np.mean(z[lag:] * z[:-lag])) < 4 / np.sqrt(len(z))


def test_the_score_test_of_an_effect_that_is_not_there_is_chi_square():
    gains = []
    for seed in range(200):
        r, whitener = coloured(seed, 400)
        rng = np.random.default_rng(1000 + seed)
        fitted = whitener(np.cumsum(rng.standard_normal((400, 1, 3)), axis=0))[0].reshape(400, 3)
        basis = np.linalg.qr(fitted)[0]
        z = whitener(r[:, :, None])[0].ravel()
        test = ScoreTest(whitener, Projection(basis), z - basis @ (basis.T @ z))
        gains.append(test.gain(test.across(rng.standard_normal((400, 1, 2)))))
    assert kstest(gains, "chi2", args=(2,)).pvalue > 1e-3


def test_the_score_test_tells_how_large_an_effect_is():
    r, whitener = coloured(8, 1000)
    column = np.sin(np.linspace(0, 30, 1000))[:, None, None]
    z = whitener((r + 0.2 * column[:, :, 0])[:, :, None])[0].ravel()
    test = ScoreTest(whitener, Projection(np.zeros((1000, 0))), z)
    gain, (along, power) = test.gain(test.across(column)), test.scores(column)
    assert gain > 20 and along[0] / power[0] == pytest.approx(0.2, abs=4 * 0.2 / np.sqrt(gain))
    assert gain == pytest.approx(along[0] ** 2 / power[0])


def test_what_the_fit_explains_itself_is_no_effect():
    r, whitener = coloured(9, 500)
    column = np.linspace(0, 1, 500)[:, None, None]
    basis = np.linalg.qr(whitener(column)[0].reshape(500, 1))[0]
    test = ScoreTest(whitener, Projection(basis), np.zeros(500))
    assert test.gain(test.across(3 * column)) == 0.0


def test_an_autoregression_is_found_and_none_in_white_noise():
    rng = np.random.default_rng(10)
    white = rng.standard_normal(5000)
    coefficients, deviation = autoregression([white], 5000)
    assert len(coefficients) == 0 and deviation == pytest.approx(1, rel=0.05)
    coloured_ones = lfilter([1.0], [1.0, -0.6, 0.3], white)
    coefficients, deviation = autoregression([coloured_ones], 5000)
    assert coefficients[:2] == pytest.approx([0.6, -0.3], abs=0.06) and deviation == pytest.approx(1, rel=0.05)


def test_columns_of_a_few_rows_of_a_long_recording_are_whitened_there_as_among_all():
    noise = dataclasses.replace(
        plain(0.5, 1.0), slow=np.array([[0.5, 0.05], [0.0, 1.0]]), torque=(1e-4, 0.03), machine=MACHINE, seat=(0, 1),
        short=(((np.array([0.3]), 1.2), (np.zeros(0), 1.0)), ((np.array([0.5, -0.2]), 0.9), (np.array([0.1]), 1.0))),
    )  # fmt: skip
    whitener = whitener_of(noise, LONG + 1, 2, missing=[12100])
    columns = np.zeros((LONG + 1, 2, 3))
    columns[12050:12120] = np.random.default_rng(1).standard_normal((70, 2, 3))
    rows, few = whitener.of_rows(columns[12050:12120], slice(12050, 12120))
    whole = whitener(columns)[0]
    near = whole[rows].reshape(few.shape)
    assert len(few) < 6000 and np.max(np.abs(few - near)) < 1e-9 * np.max(np.abs(whole))
    assert np.linalg.norm(near) > (1 - 1e-9) * np.linalg.norm(whole)


def test_a_jitter_is_told_the_same_whatever_settled_rows_stand_beside():
    rng = np.random.default_rng(3)
    slope = 10 * np.abs(rng.standard_normal((3000, 1))) / STEP
    z = rng.standard_normal((3000, 1)) * np.sqrt(1 + (0.2 * STEP * slope) ** 2)
    still = rng.standard_normal((20000, 1))
    among = find_jitter(np.concatenate([z, still]), np.concatenate([slope, np.full((20000, 1), 1e-9)]), STEP)
    nearly = find_jitter(np.concatenate([z, still]), np.concatenate([slope, np.full((20000, 1), 3e-6 / STEP)]), STEP)
    assert among[0] == nearly[0] == pytest.approx(0.2 * STEP, rel=0.3)
    assert among[2] == pytest.approx(nearly[2], rel=1e-6)


@pytest.mark.parametrize("with_state", [False, True])
def test_the_scores_of_columns_of_a_few_rows_are_those_of_whole_columns(with_state):
    _, whitener = coloured(10, 600, missing=(310, 311))
    short = (np.array([0.5, -0.2, 0.1]), 0.9), (np.array([0.3]), 1.1)
    noise = whitener.noise if with_state else dataclasses.replace(whitener.noise, slow=np.array([[0.0, 1.0]]))
    noise = dataclasses.replace(noise, short=((short[0],), (short[1],)))
    assert noise.has_state == with_state
    whitener = whitener.of(noise)
    rng = np.random.default_rng(10)
    basis = np.linalg.qr(rng.standard_normal((600, 4)))[0]
    left = rng.standard_normal(600)
    test = ScoreTest(whitener, Projection(basis), left - basis @ (basis.T @ left))
    few, whole = rng.standard_normal((60, 1, 3)), np.zeros((600, 1, 3))
    whole[290:350] = few
    across = test.across(whole)
    along, power = test.scores(few, slice(290, 350))
    assert np.allclose(along, across.T @ test.left, rtol=1e-10)
    assert np.allclose(power, np.sum(across**2, axis=0), rtol=1e-10)


def test_what_is_alike_after_all_edges_is_a_response_and_no_jitter():
    """Four edges of other sizes and signs: samples alone would take a response for a jitter."""
    rng = np.random.default_rng(5)
    edges = [np.arange(100 + 200 * e, 250 + 200 * e) for e in range(4)]
    slope, response = np.zeros((900, 1)), np.zeros((900, 1))
    for rows, size in zip(edges, (1.0, -2.0, 1.5, -0.7), strict=True):
        slope[rows, 0] = 60 * size * np.exp(-np.arange(150) / 4) / STEP
        response[rows[:8], 0] = slope[rows[:8], 0] * STEP * np.array([0.3, 0.1, -0.3, 0.2, 0.2, -0.1, -0.2, 0.1])
    noise = rng.standard_normal((900, 1))
    jitter = slope * 0.15 * STEP * rng.standard_normal((900, 1))
    assert find_jitter(response + noise, slope, STEP)[0] > 0
    assert find_jitter(*without_responses(response + noise, slope.copy(), edges), STEP)[0] == 0
    assert find_jitter(*without_responses(jitter + noise, slope.copy(), edges), STEP)[0] == pytest.approx(
        0.15 * STEP, rel=0.4
    )
    one = without_responses(jitter + noise, np.where(np.arange(900)[:, None] < 300, slope, 0.0), edges[:1])
    assert find_jitter(*one, STEP)[0] == 0, "one edge does not tell them apart"


def test_responses_of_transients_that_end_at_once_take_part_as_far_as_they_go():
    """What is alike after edges: of two transients in their first rows, of the longer one alone behind these."""
    rng = np.random.default_rng(6)
    z, slope = rng.standard_normal((2, 40, 2))
    edges = [np.arange(5, 25), np.arange(28, 31)]
    cleared, steep = without_responses(z.copy(), slope.copy(), edges)
    first = np.array([5, 28])
    share = slope[first] ** 2 / np.sum(slope[first] ** 2, axis=0)
    told, mean = share < 0.9, np.sum(slope[first] * z[first], axis=0) / np.sum(slope[first] ** 2, axis=0)
    left = (z[first] - slope[first] * mean) / np.sqrt(1 - share)
    assert np.allclose(cleared[first], np.where(told, left, 0.0)) and told.any()
    assert np.array_equal(steep[first], np.where(told, slope[first], 0.0))
    assert not cleared[8:17].any() and not steep[8:17].any(), "one transient tells nothing of its own"
    others = np.r_[:5, 17:28, 31:40]
    assert np.array_equal(cleared[others], z[others]) and np.array_equal(steep[others], slope[others])
    none = without_responses(z.copy(), slope.copy(), [])
    assert np.array_equal(none[0], z) and np.array_equal(none[1], slope)


def test_noise_without_a_memory_is_whitened_as_the_kalman_filter_does():
    rng, n = np.random.default_rng(9), 40
    growing = dataclasses.replace(plain(0.1, 2.0), growth=np.array([1.5, 0.0]))
    noise = dataclasses.replace(growing, short=(((np.zeros(0), 1.1), (np.zeros(0), 1.0)),) * 2)
    whitener = whitener_of(noise, n, q=2, level=rng.random((n, 2)), missing=[(3, 1), (20, 0)])
    whitener.inflate[7, 0] = 30.0
    columns = rng.standard_normal((n, 2, 3))
    columns[3, 1] = np.nan
    assert not whitener.remembers
    white, log = whitener(columns)
    filtered, rest = whitener._part(columns, slice(0, n), 0)
    assert np.allclose(white, filtered, rtol=1e-14, atol=0) and not white[3, 1].any()
    assert log == pytest.approx(rest + whitener._log_size, rel=1e-12)
    rows = slice(10, 15)
    where, some = whitener.of_rows(columns[rows], rows)
    assert where == rows and np.array_equal(some, white[rows].reshape(10, 3))


def test_errors_of_counts_at_a_steady_speed_repeat_themselves_and_filtered_noise_does_not():
    rng = np.random.default_rng(1)
    steady = np.diff(np.floor(81.3731 * np.arange(2000) + 0.2)) - 81.3731
    changing = np.diff(np.floor(81.3731 * np.arange(2000) + 1e-3 * np.arange(2000) ** 2)) - 81.3731
    white = rng.standard_normal(2000)
    smooth = sosfilt(cheby1(4, 0.5, 0.2, output="sos"), white)
    assert repeat_themselves([steady])
    assert repeat_themselves([sosfilt(cheby1(4, 0.5, 0.2, output="sos"), steady)])
    assert not any(repeat_themselves([x]) for x in (changing - changing.mean(), white, smooth, np.cumsum(white)))


def test_random_noise_is_not_taken_for_one_that_repeats_itself():
    """In 1000 series of any colour none."""
    rng = np.random.default_rng(2)
    for k in range(1000):
        x = rng.standard_normal(rng.integers(240, 2000))
        assert not repeat_themselves([lfilter([1.0], [1.0, -rng.uniform(-0.95, 0.95)], x)]), k


def test_digits_far_below_the_noise_are_no_steps_of_it():
    """Of a printed signal whose neighbours told the noise it did not grow: three ripples were told, R 5 errors off."""

    def fit(steps):
        return SimpleNamespace(
            simulator=SimpleNamespace(steps=np.array(steps)),
            whitener=SimpleNamespace(noise=SimpleNamespace(white=np.array([0.1, 0.1]))),
        )

    assert _of_steps(fit([0.001, 0.3]), np.zeros(2)).tolist() == [False, True]
    assert _of_steps(fit([0.0, 0.0]), np.array([0.0, 0.2])).tolist() == [False, True]


@pytest.mark.parametrize("size", [1e200, np.inf, np.nan])
def test_shared_errors_beyond_all_numbers_are_left_out(size):
    """As parameters or a noise out of all proportion make them: eigenvalues did not converge, an internal error."""
    rng = np.random.default_rng(3)
    bare = whitener_of(plain(0.1), 200)
    shared = rng.standard_normal((200, 1, 2))
    columns = rng.standard_normal((200, 1, 3))
    some = dataclasses.replace(bare, shared=shared)
    assert not np.allclose(some(columns)[0], bare(columns)[0])
    shared[7, 0, 1] = size
    most = dataclasses.replace(bare, shared=shared)
    np.testing.assert_array_equal(most(columns)[0], bare(columns)[0])
    assert most(columns)[1] == bare(columns)[1] and most.by_noise_alone(columns[:, 0])[1].shape[1] == 0
