"""Differential evolution by ask and tell takes the path of scipy's, which calls the cost function."""

import numpy as np
import pytest
from scipy.optimize import Bounds, differential_evolution

from estimator.estimating.differential_evolution import DifferentialEvolution
from estimator.estimating.search import SearchRecord, run_search


def valley(points):
    """Return Rosenbrock's valley over the unit cube, infinity where the first entry is large."""
    x = 4 * points - 2
    costs = np.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)
    return np.where(points[:, 0] > 0.97, np.inf, costs)


def scipys(seed, n, d, generations):
    rng = np.random.default_rng(seed)

    def cost(x):
        found = valley(np.atleast_2d(x.T))
        found = np.where(np.isfinite(found), found, 1e300)
        return found if x.ndim > 1 else found[0]

    return differential_evolution(
        cost,
        Bounds(np.zeros(d), np.ones(d)),
        init=rng.random((n, d)),
        maxiter=generations,
        tol=1e-8,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )


def ours(seed, n, d, generations, *, bounded=True):
    rng = np.random.default_rng(seed)
    search, record, asked = DifferentialEvolution(rng.random((n, d)), rng=rng), SearchRecord(), []

    def costs(points, bounds):
        asked.append(points)
        found = valley(points)
        return np.where(found > bounds, np.inf, found)

    run_search(search, costs, generations=generations, record=record, bounded=bounded)
    return search, record, np.concatenate(asked)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("n", "d", "generations"), [(30, 2, 25), (75, 5, 40), (6, 3, 10)])
def test_the_same_seed_gives_the_same_bits_as_scipy(n, d, generations):
    for seed in range(3):
        known, (search, record, _) = scipys(seed, n, d, generations), ours(seed, n, d, generations)
        assert search.best.tolist() == known.x.tolist() and search.best_cost == known.fun
        assert len(record.best) == known.nit + 1


def test_it_ends_where_its_points_cost_alike_and_reaches_the_optimum():
    search, record, _ = ours(1, 40, 2, 1000)
    assert search.done and len(record.best) < 300
    assert search.best == pytest.approx(0.75, abs=1e-6) and search.best_cost < 1e-10


def test_bounds_do_not_change_its_path():
    for seed in range(3):
        bounded, unbounded = (ours(seed, 20, 3, 30, bounded=b)[2] for b in (True, False))
        assert np.array_equal(bounded, unbounded)


def test_fewer_than_five_points_are_drawn_anew():
    rng = np.random.default_rng(1)
    assert DifferentialEvolution(rng.random((2, 3)), rng=rng).points.shape == (5, 3)


def test_a_search_of_which_nothing_can_be_simulated_ends():
    rng = np.random.default_rng(1)
    search = DifferentialEvolution(rng.random((10, 2)), rng=rng)
    run_search(search, lambda p, _: np.full(len(p), np.inf), generations=50, record=SearchRecord())
    assert search.done and search.best_cost == np.inf
