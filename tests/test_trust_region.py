"""Bounded least squares: the steps and the optima of SciPy's, over problems with and without bounds that hold."""

import numpy as np
import pytest
from scipy.optimize import least_squares as scipys

from estimator.fitting.trust_region import steps, triangle_of
from estimator.motor.state_space import sampled
from estimator.noise.recursion import recursion


def least_squares(residuals, jacobian, x, **more):
    """Return the optimum that is reached from x, and its sum of squares."""
    asking, answer, known = steps(x, **more), None, {}
    while True:
        try:
            at, slope = asking.send(answer)
        except StopIteration as end:
            return end.value
        if slope:
            answer = triangle_of(jacobian(at), known[at.tobytes()])
        else:
            answer = known[at.tobytes()] = residuals(at)


TRUE = np.log([3.1363, 0.048774, 0.01307, 9.0e-6, 1.69e-4])  # R, K, L, J, B


def motor(seed, rows=300):
    """Return residuals of a motor's noisy step by the logarithms of its parameters."""
    voltage = np.full(rows, 10.5)

    def shown(x):
        f, g = sampled(dict(zip("RKLJB", np.exp(x), strict=True)), 1e-3)
        back = [-np.trace(f), np.linalg.det(f)]
        second = (f - np.trace(f) * np.eye(2)) @ g
        return np.concatenate([recursion([0.0, g[k, 0], second[k, 0]], back, voltage) for k in (0, 1)])

    noise = np.repeat([0.02, 1.0], rows)
    measured = shown(TRUE) + noise * np.random.default_rng(seed).standard_normal(2 * rows)
    return lambda x: (shown(x) - measured) / noise


def rosenbrock(seed):
    return lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 0.1 * x[2] * x[0], 0.3 * (x[3] - x[1])])


def exponentials(seed):
    """Two decays: a narrow valley, and parameters that may be exchanged."""
    t = np.linspace(0, 3, 40)
    y = np.exp(-t) + 0.5 * np.exp(-3 * t) + 0.01 * np.random.default_rng(seed).standard_normal(40)
    return lambda x: x[0] * np.exp(-x[1] * t) + x[2] * np.exp(-x[3] * t) - y


def dependent(seed):
    """Only the sums of two parameters each can be told."""
    a = np.random.default_rng(seed).standard_normal((30, 2))
    return lambda x: np.tanh(a[:, 0] * (x[0] + x[1])) + a[:, 1] * (x[2] + x[3]) - 0.3


PROBLEMS = {  # residuals, where it begins, how far the start varies, a bound
    "motor": (motor, TRUE, 1.0, 6.0),
    "motor at its bounds": (motor, TRUE, 0.5, 0.6),
    "Rosenbrock": (rosenbrock, np.array([-1.2, 1.0, 0.5, 0.2]), 0.3, 3.0),
    "Rosenbrock at its bounds": (rosenbrock, np.array([-1.2, 1.0, 0.5, 0.2]), 0.3, 0.8),
    "exponentials": (exponentials, np.array([1.0, 1.0, 1.0, 2.0]), 0.3, 0.9),
    "dependent": (dependent, np.zeros(4), 0.5, 2.0),
}


def solve(name, seed, ftol=1e-14, evaluations=60):
    make, centre, spread, width = PROBLEMS[name]
    residuals = make(seed)
    low, high = centre - width, centre + width
    start = np.clip(centre + spread * np.random.default_rng(1000 + seed).standard_normal(len(centre)),
                    low + 1e-6, high - 1e-6)  # fmt: skip
    asked = []

    def value(x):
        asked.append(x.copy())
        return residuals(x)

    def jacobian(x):
        return np.column_stack([(residuals(x + h) - residuals(x - h)) / 2e-6 for h in 1e-6 * np.eye(len(x))])

    x, cost = least_squares(value, jacobian, start, low=low, high=high, evaluations=evaluations, ftol=ftol, xtol=1e-11)
    own, asked = asked, []
    theirs = scipys(value, start, jac=jacobian, bounds=(low, high), x_scale="jac", ftol=ftol, xtol=1e-11, gtol=1e-15,
                    max_nfev=evaluations)  # fmt: skip
    assert np.all((x > low) & (x < high)) and cost == pytest.approx(float(residuals(x) @ residuals(x)))
    return own, asked, cost, 2 * theirs.cost


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_optimum_is_that_of_scipy(name, seed):
    *_, own, theirs = solve(name, seed)
    assert own <= theirs * (1 + 1e-9) + 1e-12


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", [n for n in PROBLEMS if n != "dependent"])  # whose rounding is free to move
def test_its_first_steps_are_those_of_scipy(name, seed):
    own, theirs, *_ = solve(name, seed, evaluations=9)
    for one, other in zip(own, theirs, strict=False):
        assert np.allclose(one, other, rtol=0, atol=1e-3)


def test_a_point_at_which_the_model_fails_is_left_out():
    def residuals(x):
        return np.array([x[0] - 2.0, 0.1 * x[0]]) if x[0] < 1.5 else np.full(2, np.nan)

    x, cost = least_squares(residuals, lambda x: np.array([[1.0], [0.1]]), np.array([0.0]), low=np.array([-9.0]),
                            high=np.array([9.0]), evaluations=40, ftol=1e-14, xtol=1e-11)  # fmt: skip
    assert 1.2 < x[0] < 1.5 and np.isfinite(cost)
