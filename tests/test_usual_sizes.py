"""How usual a number is that an explanation has: by what is tried of it, and of what stands beside it."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining.addition import Addition
from estimator.explaining.effects.voltage_rise import VoltageRise
from estimator.explaining.explanation import Explanation, _nearest_try
from estimator.fitting.simulator import Nuisance

RISE = Nuisance("rise", "s", 0.0, 1.0, 0.0, 1e-4, tries=(1e-4, 3e-4, 1e-3, 3e-3))
SAG = Nuisance("sag", "Ohm", 0.0, 9.0, 0.0, 0.1, tries=(0.1, 0.1), usual=0.5, together=({"time": 3e-3}, {"time": 0.1}))


@pytest.mark.parametrize(("value", "size"), [(0.016, 3e-3), (4e-4, 3e-4), (1e-5, 1e-4), (0.0, 0.0)])
def test_the_tried_size_that_is_nearest_is_usual(value, size):
    """A rise of 16 ms, 5 times the longest that is tried, was as usual as one of a sample: bars of R were 48 % wide."""
    assert _nearest_try(SimpleNamespace(nuisance=lambda name: RISE), "rise", value) == size


def test_of_a_number_whose_usual_size_is_known_it_is_no_try():
    assert _nearest_try(SimpleNamespace(nuisance=lambda name: SAG), "sag", 0.1) == 0.0


@pytest.mark.parametrize(("tau", "least", "most"), [(3e-3, 0.0, 1e-12), (5e-3, 0.0, 0.5), (3e-5, 6.0, 7.0)])
def test_a_time_constant_far_from_those_that_are_tried_is_unusual(tau, least, most):
    """A supply of 0.04 ms made up for a delay: R had bars of 24 %. Cauchy's prior, a factor of e wide."""
    simulator = SimpleNamespace(nuisance=lambda name: SAG, neutral={"sag": 0.0})
    fit = SimpleNamespace(
        simulator=simulator, names=("time",), estimates=np.array([tau]), is_log=np.array([True]),
        covariance_parts=lambda: (np.zeros((1, 1)), None),
    )  # fmt: skip
    addition = Addition(VoltageRise(), "sag", 2, 1.0, free=("sag", "time"), usual=0.5)
    assert least <= Explanation(fit, (addition,))._unusual() <= most
