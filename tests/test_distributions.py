"""Chances and quantiles: SciPy's, over the range that the program asks for."""

import numpy as np
import pytest
from scipy import special

from estimator.distributions import (
    chi_square_beyond,
    chi_square_limit,
    f_beyond,
    f_limit,
    normal_chance,
    normal_quantile,
)

CHANCES = [0.5, 0.2, 0.05, 1e-2, 1e-3, 1e-5, 1e-8, 1e-12]


@pytest.mark.parametrize("tail", CHANCES)
def test_a_normal_quantile_is_that_of_scipy(tail):
    for chance in (tail, 1 - tail):
        assert normal_quantile(chance) == pytest.approx(float(special.ndtri(chance)), rel=1e-13, abs=1e-15)


def test_normal_chances_are_those_of_scipy():
    x = np.linspace(-9, 9, 60).reshape(3, 20)
    assert np.allclose(normal_chance(x), special.ndtr(x), rtol=1e-13, atol=0)


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 5, 9, 20, 41, 300])
def test_chi_square_is_that_of_scipy(degrees):
    for x in degrees * np.array([0.0, 0.1, 0.9, 1.1, 2.0, 5.0]):
        assert chi_square_beyond(degrees, x) == pytest.approx(float(special.chdtrc(degrees, x)), rel=1e-11, abs=1e-290)
    for chance in CHANCES:
        assert chi_square_limit(degrees, chance) == pytest.approx(float(special.chdtri(degrees, chance)), rel=1e-12)


@pytest.mark.parametrize("above", [2, 5, 40, 801, 2801, 100_000])
@pytest.mark.parametrize("below", [2, 11, 500, 4000, 1_000_000])
def test_f_is_that_of_scipy(above, below):
    for x in (0.2, 0.99, 1.0, 1.05, 1.6, 8.0):
        assert f_beyond(above, below, x) == pytest.approx(float(special.fdtrc(above, below, x)), rel=1e-8, abs=1e-14)
    for chance in CHANCES[2:7]:
        assert f_limit(above, below, chance) == pytest.approx(float(special.fdtri(above, below, 1 - chance)), rel=1e-8)
