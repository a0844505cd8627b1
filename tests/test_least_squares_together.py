"""Fits from several starts, whose simulations go together: what each would come to alone, with fewer batches."""

import dataclasses

import numpy as np
import pytest

from estimator.fitting import least_squares
from estimator.fitting.least_squares import LeastSquares
from estimator.plans.parameters import Box

T = np.linspace(0, 2, 50)
MEASURED = 2.0 * np.exp(-3.0 * T) + 0.5 + 0.01 * np.random.default_rng(1).standard_normal(50)


def fitted(batches, loss):
    def residuals(points):
        batches.append(len(points))
        a, b, c = points.T[:, :, None]
        result = a * np.exp(-b * T) + c - MEASURED
        result[points[:, 1] > 80] = np.nan  # a model that fails
        return result

    box = Box(np.array([0.1, 0.1, -1.0]), np.array([50.0, 100.0, 3.0]), np.array([True, True, False]))
    return LeastSquares(residuals, box, output=np.zeros(50, dtype=np.int64), spread=np.ones(1), loss=loss)


@pytest.mark.parametrize("soon", [0, 50_000])
@pytest.mark.parametrize("at_once", [2_000_000, 300])
@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_fits_together_are_those_of_each_start_alone(monkeypatch, loss, at_once, soon):
    monkeypatch.setattr(least_squares, "TOGETHER", at_once)
    monkeypatch.setattr(least_squares, "SOON", soon)
    rng, together, alone = np.random.default_rng(2), [], []
    starts = [np.array([2.0, 3.0, 0.5]) * np.exp(0.8 * rng.standard_normal(3)) for _ in range(7)]
    starts.append(np.array([2.0, 90.0, 0.5]))
    found = fitted(together, loss).fits(starts, np.array([0.01]))
    for (values, cost), start in zip(found, starts, strict=True):
        own, own_cost = fitted(alone, loss).fit(start, np.array([0.01]))
        assert values == pytest.approx(own, rel=1e-9) and cost == pytest.approx(own_cost, rel=1e-12)
    assert sum(together) == sum(alone) and len(together) < len(alone)
    ends = [values for values, _ in found]
    squares = fitted(together, loss)
    each = [squares.deviations(values) for values in ends]
    assert np.array_equal(squares.deviations_of(ends), each)


def test_a_fit_that_comes_next_to_a_known_optimum_ends_there_and_one_elsewhere_goes_on():
    start, deviations = np.array([4.0, 5.0, 0.2]), np.array([0.01])
    whole, short, elsewhere = [], [], []
    squares = fitted(whole, "linear")
    known = squares.polish(np.array([2.0, 3.0, 0.5]), deviations)
    whole.clear()
    values, _ = squares.fit(start, known.deviations)
    ((end, cost),) = fitted(short, "linear").fits([start], known.deviations, known=known)
    assert np.array_equal(end, known.values) and cost == known.cost
    assert np.allclose(end, values, rtol=1e-6) and sum(short) < sum(whole)
    assert len(short) == 3  # derivatives have told it before it was there, a fourth batch
    far = dataclasses.replace(known, values=2 * known.values)
    ((end, _),) = fitted(elsewhere, "linear").fits([start], known.deviations, known=far)
    assert np.array_equal(end, values) and sum(elsewhere) == sum(whole)


@pytest.mark.parametrize("central", [False, True])
def test_derivatives_of_few_residuals_are_simulated_with_them_and_lead_to_the_same(monkeypatch, central):
    start, found, batches = np.array([4.0, 5.0, 0.2]), [], []
    for soon in (0, 50_000):
        monkeypatch.setattr(least_squares, "SOON", soon)
        batches.append([])
        found.append(fitted(batches[-1], "linear").fit(start, np.array([0.01]), central=central))
    assert np.array_equal(found[0][0], found[1][0]) and found[0][1] == found[1][1]
    assert len(batches[1]) < 0.7 * len(batches[0]) and sum(batches[1]) >= sum(batches[0])


def test_a_fit_that_stands_far_above_a_known_cost_ends_before_its_evaluations_are_spent():
    def residuals(points):
        asked.append(len(points))
        x, y = points.T[:, :, None]
        return np.concatenate([10 * (y - x**2), 1 - x + 0 * y, 0 * x + 3.0], axis=1)  # a bent valley

    asked, start = [], np.array([-1.9, 3.5])
    box = Box(np.array([-5.0, -5.0]), np.array([5.0, 5.0]), np.array([False, False]))
    squares = LeastSquares(residuals, box, output=np.zeros(3, dtype=np.int64), spread=np.ones(1))
    best = squares.judge(np.array([1.0, 1.0]), np.ones(1))
    asked.clear()
    ((reached, _),) = squares.fits([start], np.ones(1), known=best)
    assert np.allclose(reached, best.values)  # slowly, but ever nearer
    asked.clear()
    ((_, cost),) = squares.fits([start], np.ones(1), known=dataclasses.replace(best, cost=best.cost - 1e4))
    assert cost > best.cost - 1e-9 and len(asked) < 12
