import numpy as np
import pytest

from estimator.estimating.cuckoo import CuckooSearch, levy_scale


def sphere(points):
    return np.sum((points - 0.3) ** 2, axis=1)


def run(search, generations, *, bounded=False):
    path = []
    for _ in range(2 * generations + 1):
        eggs, bounds = search.ask()
        costs = sphere(eggs)
        search.tell(eggs, np.where(costs > bounds, np.inf, costs) if bounded else costs)
        path.append((search.nests.copy(), search.costs.copy()))
    return path


def same_path(first, second):
    return all(np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1]) for a, b in zip(first, second, strict=True))


def test_the_levy_scale_is_mantegnas():
    assert levy_scale(1.5) == pytest.approx(0.696575, abs=1e-6)  # Mantegna 1994, table 1


def test_the_search_finds_the_minimum_of_a_sphere():
    rng = np.random.default_rng(1)
    search = CuckooSearch(rng.random((25, 3)), rng=rng, alpha=0.1)
    run(search, 200)
    assert np.allclose(search.best, 0.3, atol=1e-3)


def test_no_nest_ever_gets_worse_and_none_leaves_the_cube():
    rng = np.random.default_rng(2)
    path = run(CuckooSearch(rng.random((10, 4)), rng=rng, alpha=5.0), 30)
    for (_, before), (nests, after) in zip(path, path[1:], strict=False):
        assert np.all(after <= before)
        assert nests.min() >= 0 and nests.max() <= 1


def test_a_seed_gives_the_same_path_bit_by_bit():
    paths = []
    for _ in range(2):
        rng = np.random.default_rng(3)
        paths.append(run(CuckooSearch(rng.random((8, 3)), rng=rng), 20))
    assert same_path(*paths)


def test_costs_above_a_bound_need_not_be_known():
    paths = []
    for bounded in (False, True):
        rng = np.random.default_rng(4)
        paths.append(run(CuckooSearch(rng.random((12, 3)), rng=rng), 40, bounded=bounded))
    assert same_path(*paths)


def test_discovery_moves_three_entries_of_four():
    rng = np.random.default_rng(5)
    search = CuckooSearch(rng.uniform(0.45, 0.55, (2000, 5)), rng=rng, pa=0.25)  # so narrow that none is clipped
    eggs, _ = search.ask()
    search.tell(eggs, sphere(eggs))
    eggs, _ = search.ask()  # flight
    search.tell(eggs, np.full(2000, np.inf))
    eggs, _ = search.ask()  # discovery
    moved = np.mean(eggs != search.nests)
    assert moved == pytest.approx(0.75, abs=0.03)  # 10 000 entries: 7 standard deviations


def test_eggs_that_are_not_allowed_are_drawn_again():
    rng = np.random.default_rng(6)

    def redraw(eggs, generator):
        bad = eggs[:, 0] > 0.5
        eggs[bad, 0] = generator.uniform(0, 0.5, bad.sum())
        return eggs

    search = CuckooSearch(rng.random((20, 2)) * 0.5, rng=rng, alpha=1.0, redraw=redraw)
    for nests, _ in run(search, 20):
        assert nests[:, 0].max() <= 0.5
