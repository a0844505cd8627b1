"""The evidence of an explanation, by Laplace's method, against the integral of a linear model."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining.addition import Addition
from estimator.explaining.effects.base import Effect
from estimator.explaining.explanation import Explanation

SIZE = 0.7  # usual size of the number that is added


def explanation_of(y, columns, names, added):
    """Return the least-squares fit of white noise of variance 1 as an explanation."""
    covariance = np.linalg.inv(columns.T @ columns)
    left = y - columns @ (covariance @ columns.T @ y)
    fit = SimpleNamespace(
        cost=float(left @ left), names=names, at_bound=np.zeros(len(names), dtype=int),
        estimates=covariance @ columns.T @ y, is_log=np.zeros(len(names), dtype=bool),
        covariance_parts=lambda: (covariance, 0 * covariance), simulator=SimpleNamespace(nuisances=(), neutral={}),
        whitener=SimpleNamespace(log_shared=0.0),
    )  # fmt: skip
    return Explanation(fit, tuple(added))


@pytest.mark.parametrize("size", [0.5, 8.0])  # of the number, in usual sizes
@pytest.mark.parametrize("told", [0.02, 0.3, 30.0])  # by the standard error of a number over its usual size
def test_the_evidence_of_one_number_more_is_the_integral_over_it(told, size):
    rng = np.random.default_rng(3)
    n = 200
    wide = rng.standard_normal((n, 2))
    column = rng.standard_normal(n)
    column -= wide @ np.linalg.lstsq(wide, column, rcond=None)[0] * 0.4  # a part of it is explained
    apart = column - wide @ np.linalg.lstsq(wide, column, rcond=None)[0]
    column /= np.linalg.norm(apart) * told * SIZE
    y = wide @ [3.0, -2.0] + size * SIZE * column + rng.standard_normal(n)
    addition = Addition(Effect("drift", prior=0.2), "drift", 1, 0.0, free=("drift",), usual=SIZE)
    bare = explanation_of(y, wide, ("a", "b"), ())
    more = explanation_of(y, np.column_stack([wide, column]), ("a", "b", "drift"), (addition,))
    # p(y | more) / p(y | bare), the number's prior Cauchy's of scale SIZE, those of a and b flat
    error, x = told * SIZE, SIZE * np.sinh(np.linspace(-12.0, 12.0, 2_000_001))
    likelihood = np.exp(-((x - more.fit.estimates[2]) ** 2) / (2 * error**2))
    prior = 1 / (np.pi * SIZE * (1 + (x / SIZE) ** 2))
    bayes_factor = more.fit.cost - bare.fit.cost - 2 * np.log(np.trapezoid(likelihood * prior, x))
    # Normal within, for all but log(pi / 2): the approximation's error is below what tells two explanations apart.
    assert more.evidence(n) - bare.evidence(n) == pytest.approx(bayes_factor + 2 * np.log(1 / 0.2), abs=0.7)
    assert more.criterion(n) - bare.criterion(n) == pytest.approx(
        more.fit.cost - bare.fit.cost + np.log(n) + 2 * np.log(5)
    )


def test_a_number_of_no_known_size_is_charged_as_by_the_criterion():
    rng = np.random.default_rng(4)
    columns, y = rng.standard_normal((100, 2)), rng.standard_normal(100)
    line = SimpleNamespace(size=0.0, foretold=False)
    addition = Addition(Effect("ripple", prior=0.5), "ripple", 1, 0.0, linear=line)
    found = explanation_of(y, columns, ("a", "ripple"), (addition,))
    assert found.evidence(100) == pytest.approx(found.criterion(100))


def test_what_is_not_known_of_a_form_is_charged():
    """Errors of a form take in what it leaves, the more the less of it is known: without a charge no form is best."""
    y, columns = np.arange(6.0), np.ones((6, 1))
    known, unknown = (explanation_of(y, columns, ("a",), ()) for _ in range(2))
    unknown.fit.whitener.log_shared = 3.0
    for charged in (Explanation.criterion, Explanation.evidence):
        assert charged(unknown, 6) - charged(known, 6) == pytest.approx(3.0)
