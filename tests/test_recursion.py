"""Filters of the search's effects: the same numbers as SciPy's, which takes longer to import than a clean start."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter

from estimator.explaining.effects.low_pass import lag, second_order, through
from estimator.noise.recursion import behind, recursion


@pytest.mark.parametrize("n", [0, 1, 2, 3, 200, 20_000])
@pytest.mark.parametrize(
    ("b", "a"), [([0.3, 0.2], [-0.9]), ([0.0, 0.1, 0.2], [-1.98, 0.9802]), ([1.0], [-0.5, -0.2, 0.1])]
)
def test_a_recursion_is_that_of_scipy(n, b, a):
    x = np.random.default_rng(n).standard_normal(n)
    right = lfilter(b, [1.0, *a], x)
    assert np.allclose(recursion(b, a, x), right, rtol=0, atol=1e-11 * np.abs(right).max(initial=0))


def test_a_recursion_leaves_its_signal_as_it_was():
    x = np.random.default_rng(1).standard_normal(50)
    before = x.copy()
    recursion([1.0], [-0.5], x)
    assert np.array_equal(x, before)


@pytest.mark.parametrize("tau", [3e-4, 3e-3, 5e-2])
@pytest.mark.parametrize(
    ("of", "below"),
    [(lag, lambda tau: [tau, 1.0]), (second_order, lambda tau: [tau**2, np.sqrt(2) * tau, 1.0])],
)
def test_a_low_pass_is_exact_between_the_samples_and_at_rest_before_the_first(of, below, tau):
    h = 1e-3
    y = 5.0 + np.cumsum(np.random.default_rng(2).standard_normal(300))
    exact = cont2discrete(([1.0], below(tau)), h, method="foh")
    _, right = dlsim(exact, y - y[0])
    assert np.allclose(through(of, y, tau, h), y[0] + right[:, 0], rtol=0, atol=1e-11 * np.abs(y).max())
    assert np.array_equal(through(of, np.full(20, 3.7), tau, h), np.full(20, 3.7))
    assert through(of, y, 0.0, h) is y


@pytest.mark.parametrize("c", [1, 2, 7])
@pytest.mark.parametrize(("b", "a"), [([0.3, 0.2], [-0.9]), ([1.0], [-0.5, -0.2, 0.1])])
def test_several_signals_have_the_recursion_of_each(b, a, c):
    rng = np.random.default_rng(c)
    x, own = rng.standard_normal((300, c)), rng.uniform(0.5, 1, c)
    each = np.column_stack([recursion(np.array(b) * k, a, np.ascontiguousarray(x[:, j])) for j, k in enumerate(own)])
    assert np.array_equal(recursion(np.outer(b, own), a, x), each)
    assert np.array_equal(recursion(b, a, x)[:, 0], recursion(b, a, np.ascontiguousarray(x[:, 0])))


@pytest.mark.parametrize("sections", [[([0.4, 0.6], [])], [([0.3, 0.2], [-0.5])], [([0.1, 0.2, 0.1], [-1.1, 0.5])] * 2])
@pytest.mark.parametrize("c", [1, 4])
def test_a_filter_shows_a_signal_as_it_lies_in_memory_as_the_recursions_of_its_sections_do(sections, c):
    phases = np.random.default_rng(c).standard_normal((c, 500, 2)) + 5.0  # each a part of a row later than the next
    rows = phases[::-1, :, 1].T
    right, shown = rows.ravel(), np.full((500, 3), np.nan)
    for b, a in sections:
        right = right[0] + recursion(b, a, right - right[0])
    behind(sections, rows, shown[:, 2])
    assert np.array_equal(shown[:, 2], right[c - 1 :: c]) and np.isnan(shown[:, :2]).all()
    if c == 1:
        behind(sections, rows, phases[0, :, 1])
        assert np.array_equal(phases[0, :, 1], right)
