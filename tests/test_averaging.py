"""Averaged explanations: what a mixture's standard errors hold."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.conventions import CONFIDENCE
from estimator.distributions import normal_chance, normal_quantile
from estimator.explaining.addition import Addition, Scores
from estimator.explaining.averaging import _beside, _is_untold, averaged
from estimator.explaining.effects.base import Effect
from estimator.explaining.explanation import Explanation
from estimator.explaining.mixture import Mixture, covering
from estimator.fitting.projection import Projection
from estimator.fitting.score_test import ScoreTest


def held(errors, weights, means, variances):
    """Return how much of a mixture lies within 1.96 standard errors of zero, (p,)."""
    half = normal_quantile(0.5 + CONFIDENCE / 2) * errors
    parts = [
        normal_chance((half - mean) / np.sqrt(variance)) - normal_chance((-half - mean) / np.sqrt(variance))
        for mean, variance in zip(means, variances, strict=True)
    ]
    return weights @ np.array(parts)


@pytest.mark.parametrize("far", [0.1, 1.0, 30.0, 1e6])
def test_the_errors_of_a_mixture_hold_what_they_say_however_far_its_parts_lie(far):
    rng = np.random.default_rng(5)
    for _ in range(30):
        weights = rng.dirichlet(np.full(6, 0.4))
        weights[0] += 1e-6
        weights /= weights.sum()
        means = np.vstack([np.zeros(4), far * rng.standard_normal((5, 4))])
        variances = 10.0 ** rng.uniform(-3, 1, (6, 4))
        total = np.einsum("k,ki,kj->ij", weights, means, means) + np.diag(weights @ variances)
        scaled = covering(total, np.tile(weights[:, None], 4), means, variances)
        assert held(np.sqrt(np.diag(scaled)), weights, means, variances) == pytest.approx(CONFIDENCE, abs=1e-9)
        correlation, before = (c / np.sqrt(np.outer(np.diag(c), np.diag(c))) for c in (scaled, total))
        assert correlation == pytest.approx(before, abs=1e-12)


def test_of_one_explanation_the_errors_are_its_own():
    variance = np.array([4.0, 1e-20, 0.0])
    scaled = covering(np.diag(variance), np.ones((1, 3)), np.zeros((1, 3)), variance[None, :])
    assert np.diag(scaled) == pytest.approx(variance, rel=1e-13)


def test_an_error_ends_at_a_part_that_has_none_where_that_brings_what_is_missing():
    means, variances = np.array([[0.0], [7.0]]), np.array([[1.0], [0.0]])
    for chance, end in ((0.5, 7.0), (0.01, None)):
        weights = np.array([1 - chance, chance])
        total = np.array([[weights @ [1.0, 49.0]]])
        covered = covering(total, weights[:, None], means, variances)
        half = normal_quantile(0.5 + CONFIDENCE / 2) * float(np.sqrt(covered[0, 0]))
        if end is not None:
            assert half == pytest.approx(end)
        else:
            assert (1 - chance) * (2 * normal_chance(np.array([half]))[0] - 1) == pytest.approx(CONFIDENCE)


def mixed(moving, still, odds=0.5):
    """Return the variance of two parameters of variance 1: additions move the first by 3, `still` more move nothing."""
    mixture = Mixture(np.eye(2))
    behind = -2 * np.log(odds)
    for _ in range(moving):
        mixture.add(behind, np.array([3.0, 0.0]), np.zeros((2, 2)))
    for _ in range(still):
        mixture.add(behind, np.array([0.0, 0.01]), np.zeros((2, 2)))
    return np.diag(mixture.covariance())


def test_additions_that_move_nothing_do_not_make_another_less_likely():
    few, many = mixed(1, 0), mixed(1, 40)
    assert many == pytest.approx(few, rel=1e-12) and few[0] > 3 and few[1] == pytest.approx(1.0)


def test_rivals_and_additions_are_possible_together():
    """Variance of  a 3 + b 2,  a and b independent with odds 1 to 2 and 1 to 1, before it is scaled to hold 95 %."""
    mixture = Mixture(np.eye(1))
    mixture.add(-2 * np.log(0.5), np.array([3.0]), np.zeros((1, 1)))
    mixture.add_rival(0.0, np.array([2.0]), np.eye(1))
    chances = np.outer([2 / 3, 1 / 3], [1 / 2, 1 / 2]).reshape(-1, 1)
    means = np.add.outer([0.0, 3.0], [0.0, 2.0]).reshape(-1, 1)
    exact = covering(np.atleast_2d(1 + chances[:, 0] @ means[:, 0] ** 2), chances, means, np.ones((4, 1)))
    assert mixture.covariance() == pytest.approx(exact) and mixture.weights() == pytest.approx([0.5, 0.5])


def explained(runs, columns, drifts, y, small=0.0):
    """Return what a fit of white noise of variance 1 says of its parameters, and of a drift in each of some runs."""
    covariance = np.linalg.inv(columns.T @ columns)
    values, known = covariance @ columns.T @ y, Projection(columns)
    recordings = [SimpleNamespace(recording=SimpleNamespace(name=f"run{k}")) for k in range(runs)]
    names = tuple(f"x{k}" for k in range(columns.shape[1]))
    plan = SimpleNamespace(names=names, observed=recordings)
    simulator = SimpleNamespace(plan=plan, scaled=lambda x: x, nuisances=())
    fit = SimpleNamespace(
        simulator=simulator, values=values, names=names, at_bound=np.zeros(len(names), dtype=int), cost=0.0,
        covariance_parts=lambda: (covariance, 0 * covariance), is_log=np.zeros(len(names), dtype=bool),
    )  # fmt: skip
    test, additions = ScoreTest(None, known, known.rest(y)), []
    for k in range(runs):
        scores = Scores.of(test, columns, known.rest(drifts[:, k : k + 1]), drifts[:, k : k + 1])
        additions.append(
            Addition(Effect("drift", small=small), f"drift run{k}", 1, scores.gain, scores=scores, usual=1.0)
        )
    return averaged(Explanation(fit), additions, [], len(y), [], np.zeros(columns.shape[1])), values


def test_what_all_recordings_may_have_is_in_the_errors_though_each_alone_moves_nothing():
    """A parameter of all that drifts as a torque does: one drift is held by the other recordings, all are it.

    As often as it is said to be, all drift alike. 95 % of 300 intervals cover, and fewer than 273 with a chance of 1 in
    1 000 (binomial); 78 % did.
    """
    rng = np.random.default_rng(6)
    n, runs, covered = 300, 4, 0
    drifts = np.kron(np.eye(runs), np.linspace(-0.5, 0.5, n)[:, None])
    levels = np.kron(np.eye(runs), np.ones((n, 1)))
    for _ in range(300):
        slope = np.tile(np.linspace(-0.5, 0.5, n), runs) + 0.06 * rng.standard_normal(n * runs)
        columns = np.column_stack([levels, slope])
        size = rng.standard_normal() * (rng.uniform() < Effect("drift").prior / 2)
        y = columns @ np.ones(runs + 1) + drifts @ np.full(runs, size) + rng.standard_normal(n * runs)
        mean, values = explained(runs, columns, drifts, y)
        half = normal_quantile(0.5 + CONFIDENCE / 2) * np.sqrt(mean.covariance[-1, -1])
        covered += abs(values[-1] - 1.0) < half
    assert covered >= 273, covered


def test_evidence_is_that_of_a_normal_prior_of_each_size():
    """Of a linear model in closed form: log det (1 + s2 I) + 2 log 1/prior - s2 a2 / (1 + s2 I)."""
    along, information, size, prior = 11.0, 900.0, 0.1, 0.2
    scores = Scores(np.array([along]), np.array([[information]]), 1000.0, np.zeros((1, 1)), np.zeros((1, 1)))
    addition = Addition(Effect("offset", prior=prior), "offset i", 1, scores.gain, scores=scores)
    numbers, spread, behind = addition.posterior(size)
    told = 1 + size**2 * information
    assert numbers[0] == pytest.approx(size * along / told) and spread[0, 0] == pytest.approx(1 / told)
    assert behind == pytest.approx(np.log(told) - 2 * np.log(prior) - size**2 * along**2 / told)


def test_an_offset_that_is_far_smaller_than_usual_is_in_the_errors():
    """Of a plain outside recording K was 5.1 and B 5.8 standard errors off, by 0.13 % of the largest current.

    95 % of 1 000 intervals cover where half of those with an offset have a small one, as it is said to be, and fewer
    than 924 with a chance below 1 in 5 000 (binomial); by offsets of the usual size alone they do not.
    """
    rng, covered = np.random.default_rng(8), {0.0: 0, 0.1: 0}
    n, usual = 400, 150.0
    columns, offset = np.column_stack([np.linspace(0.8, 1.2, n)]), np.ones((n, 1))
    for _ in range(1000):
        y = columns[:, 0] + 0.1 * usual * rng.standard_normal() * (rng.uniform() < Effect("drift").prior / 2) / np.sqrt(
            n
        )
        y += rng.standard_normal(n)
        for small in covered:
            mean, values = explained(1, columns, usual / np.sqrt(n) * offset, y, small)
            half = normal_quantile(0.5 + CONFIDENCE / 2) * np.sqrt(mean.covariance[0, 0])
            covered[small] += abs(values[0] - 1.0) < half
    assert covered[0.1] >= 924 > covered[0.0], covered


def test_a_rivals_parameter_that_is_hardly_told_reaches_to_zero_and_takes_the_others_no_further():
    """Its logarithm has a deviation of 30 there: L is a quarter of the best one's, not up to eight times as large."""
    of_log = np.array([[30.0**2, 0.02 * 30.0**2], [0.02 * 30.0**2, 0.02**2 * 30.0**2 + 0.003**2]])
    fit = SimpleNamespace(
        simulator=SimpleNamespace(scaled=np.log), values=np.array([0.25, 1.0]), names=("L", "R"),
        covariance_parts=lambda: (of_log, 0 * of_log),
    )  # fmt: skip
    rival = SimpleNamespace(fit=fit, sizes=dict)
    there, covariance = _beside(np.zeros(2), rival, np.ones(2, dtype=bool))
    assert there == pytest.approx([-0.75, 0.0])
    assert np.sqrt(np.diag(covariance)) == pytest.approx([0.25, np.hypot(0.02, 0.003)], rel=1e-2)


@pytest.mark.parametrize(("apart", "is_told"), [(8e-4, False), (2e-3, True)])
def test_a_rival_that_differs_by_less_than_a_thousandth_is_in_the_bars_and_no_doubt(apart, is_told):
    """A good recording of 30 000 rows was doubtful, with "K = 0.01899 instead of 0.01899"."""
    error = 2e-4
    covariance = np.eye(2) * error**2
    plan = SimpleNamespace(names=("R", "K"), observed=())

    def of(values, name):
        fit = SimpleNamespace(
            simulator=SimpleNamespace(plan=plan, scaled=np.log, nuisances=(), neutral={}, log=np.ones(2, dtype=bool)),
            values=np.array(values), names=plan.names,
            at_bound=np.zeros(2, dtype=int), cost=0.0, covariance_parts=lambda: (covariance, 0 * covariance),
            covariance=lambda: covariance, is_log=np.ones(2, dtype=bool), estimates=np.log(values),
            whitener=SimpleNamespace(log_shared=0.0),
        )  # fmt: skip
        return Explanation(fit, (Addition(Effect(name), name, 1, 0.0),))

    found = averaged(of([1.0, 1.0], "sag"), [], [of([1.0, 1 + apart], "offset")], 1000, [], np.zeros(2))
    assert bool(found.rivals) == is_told
    assert apart < 2 * np.sqrt(found.covariance[1, 1]), "either way the bar holds both"


def test_a_fit_whose_parameters_stand_in_for_each_other_moves_by_what_its_own_test_says():
    """A column that is a twentieth of the first: it moves that by 5 % and no other, whatever rounds in a later fit.

    Of derivatives that differ by a part in a million the covariance makes 100 times as much of the same products.
    """
    rng = np.random.default_rng(3)
    base = rng.standard_normal((400, 2))
    columns = np.column_stack([base, base @ [1.0, 1.0] + 1e-5 * rng.standard_normal(400), np.ones(400)]) * 1e3
    inside = np.array([True, True, True, False])
    known = Projection(columns[:, inside])
    test = ScoreTest(None, known, np.zeros(400), inside)
    explained = columns.T @ (0.05 * columns[:, :1])
    assert test.moves(explained)[:, 0] == pytest.approx([0.05, 0.0, 0.0, 0.0], abs=1e-5)
    later = columns[:, inside] * [1.0, 1.0, 1.0 + 1e-6]
    moved = np.linalg.inv(later.T @ later) @ explained[inside]
    assert np.max(np.abs(moved[:, 0] - [0.05, 0.0, 0.0])) > 1e-2


@pytest.mark.parametrize(("deviation", "is_untold"), [(0.1, False), (0.45, False), (0.6, True), (30.0, True)])
def test_a_rival_with_one_number_that_is_told_no_better_than_its_usual_size_hides(deviation, is_untold):
    """A drop of brushes at one size of voltage both ways: bars were 0.01 % in one run and 6 % in the next."""
    covariance = np.diag([1e-6, deviation**2])
    fit = SimpleNamespace(names=("K", "brush"), covariance_parts=lambda: (covariance, 0 * covariance))
    rival = SimpleNamespace(names=lambda: {"delay", "brush"}, sizes=lambda: {"brush": 0.5}, fit=fit)
    found = SimpleNamespace(names=lambda: {"delay"})
    assert _is_untold(rival, found) == is_untold
    assert not _is_untold(rival, SimpleNamespace(names=lambda: {"lag of i"}))  # it is another
