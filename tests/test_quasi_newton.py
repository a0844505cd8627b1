"""A minimum within bounds: the steps and the values of SciPy's L-BFGS-B, and what it is stopped by."""

import numpy as np
import pytest
from scipy.optimize import minimize

from estimator.noise.quasi_newton import minimise


def rosenbrock(seed):
    return lambda x: float(np.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2))


def bowl(seed):
    rng = np.random.default_rng(seed)
    a, centre = rng.standard_normal((4, 4)), rng.uniform(-3, 3, 4)
    return lambda x: float(np.sum((a @ (x - centre)) ** 2) + 0.1 * np.sum((x - centre) ** 4))


def likelihood(seed):
    """-2 log L of a sum of two noises, by the logarithms of their sizes."""
    rng = np.random.default_rng(seed)
    fast, slow = 0.5 + rng.random(400), 0.1 + 2 * np.linspace(0, 1, 400) ** 2
    y = rng.standard_normal(400) * np.sqrt(2 * fast + 0.5 * slow)

    def value(x):
        variance = np.exp(2 * x[0]) * fast + np.exp(2 * x[1]) * slow + np.exp(2 * x[2])
        return float(np.sum(np.log(variance) + y**2 / variance) + 1e-2 * x[3] ** 2)

    return value


def wavy(seed):
    phase = np.random.default_rng(seed).uniform(0, 6, 4)
    return lambda x: float(np.sum(x**2) + np.sum(np.cos(4 * x + phase)))


PROBLEMS = {"Rosenbrock": rosenbrock, "bowl": bowl, "likelihood": likelihood, "wavy": wavy}


def of_rows(value):
    """Return values of points, (k,), of what tells the value of one."""
    return lambda points: np.array([value(x) for x in points])


def solve(name, seed, width, *, iterations=12, ftol=1e-6, step=1e-3):
    value = PROBLEMS[name](seed)
    x = np.random.default_rng(100 + seed).uniform(-1.5, 1.5, 4)
    low, high = x - width * np.array([1, 0.1, 0.3, 1]), x + width
    asked = []

    def told(x):
        asked.append(x.copy())
        return value(x)

    own, least = minimise(of_rows(told), x, low, high, step=step, iterations=iterations, ftol=ftol)
    assert np.all((own >= low) & (own <= high)) and least == value(own)
    mine, asked = asked, []
    theirs = minimize(told, x, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)),
                      options={"maxiter": iterations, "eps": step, "ftol": ftol})  # fmt: skip
    return mine, asked, own, least, theirs


@pytest.mark.parametrize("width", [0.3, 1.0, 7.0])
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("name", PROBLEMS)
def test_its_steps_are_those_of_scipy(name, seed, width):
    mine, theirs, own, least, found = solve(name, seed, width)
    assert least == pytest.approx(found.fun, rel=1e-8, abs=1e-8) and np.allclose(own, found.x, atol=1e-5)
    # At the minimum differences are rounding, and so is what a line search makes of them.
    value, enough = PROBLEMS[name](seed), least + 1e-6 * max(1.0, abs(least))
    before = next(k for k, x in enumerate(mine) if value(x) <= enough)
    assert before > 0 and len(theirs) >= before
    assert all(np.allclose(a, b, rtol=0, atol=1e-5) for a, b in zip(mine[:before], theirs[:before], strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_it_reaches_a_minimum_in_a_corner_of_the_bounds(seed):
    rng = np.random.default_rng(seed)
    centre = rng.uniform(2, 3, 3) * rng.choice([-1, 1], 3)
    x, _ = minimise(of_rows(lambda x: float(np.sum((x - centre) ** 2))), np.zeros(3), np.full(3, -1.0), np.ones(3),
                    step=1e-4, iterations=50, ftol=1e-12)  # fmt: skip
    assert np.array_equal(x, np.sign(centre))


def test_a_value_that_is_infinite_beside_the_start_ends_it_there():
    def value(x):
        return float(x @ x) if np.all(x == 1.0) else np.inf

    x, f = minimise(of_rows(value), np.ones(2), np.zeros(2), np.full(2, 3.0), step=1e-3, iterations=9, ftol=1e-6)
    assert np.array_equal(x, np.ones(2)) and f == 2.0


def test_a_value_that_is_infinite_on_the_way_is_kept_away_from():
    def value(x):
        return float((x[0] - 2) ** 2 + x[1] ** 2) if x[0] < 1.3 else np.inf

    x, f = minimise(
        of_rows(value), np.array([0.0, 0.5]), np.full(2, -5.0), np.full(2, 5.0), step=1e-3, iterations=30, ftol=1e-9
    )
    assert 1.0 < x[0] < 1.3 and f < 1.0


@pytest.mark.parametrize("digits", [0, 1, 2, 4])
def test_a_value_that_is_flat_to_its_last_digit_ends_it(digits):
    def value(x):
        return round(float(np.sum((x - 0.3) ** 2)), digits)

    x, f = minimise(
        of_rows(value), np.array([2.0, -1.0]), np.full(2, -5.0), np.full(2, 5.0), step=1e-3, iterations=30, ftol=1e-12
    )
    assert np.isfinite(f) and f <= value(np.array([2.0, -1.0])) and f == value(x)
