"""The exponential of a small matrix: SciPy's, and what is known exactly."""

import numpy as np
import pytest
from mpmath import expm as exact
from mpmath import matrix, workdps
from scipy.linalg import expm

from estimator.motor.exponential import exponential
from estimator.motor.state_space import matrices


@pytest.mark.parametrize("seed", range(40))
def test_an_exponential_is_that_of_scipy(seed):
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((n := int(rng.integers(1, 6)), n)) * 10 ** rng.uniform(-3, 1)
    right = expm(a)
    assert np.allclose(exponential(a), right, rtol=0, atol=1e-12 * np.abs(right).max())


@pytest.mark.parametrize("step", [1e-6, 1e-3, 1.0])
def test_a_sampled_motors_exponential_is_exact_to_a_few_roundings(step):
    values = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.69e-4}
    a = matrices(values)[0] * step
    with workdps(50):
        right = np.array(exact(matrix(a.tolist()), method="taylor").tolist(), dtype=float)
    assert np.allclose(exponential(a), right, rtol=0, atol=2e-13 * np.abs(a).max().clip(1) * np.abs(right).max())


def test_the_exponential_of_nothing_is_one():
    assert np.allclose(exponential(np.zeros((3, 3))), np.eye(3), rtol=0, atol=1e-15)
