"""Colour, ripple and outliers of residuals, on series whose truth is known."""

import numpy as np
import pytest

from estimator.fitting.noise import averaged, find_colour, find_outliers, find_ripple, quadratic

N = 2800
ANGLE = np.cumsum(0.176 * (1 - np.exp(-np.arange(N) / 20)))


def test_white_residuals_are_white():  # 2 in 100 by chance are fewer than 8 with p > 1 - 1e-5
    found = [find_colour([np.random.default_rng(s).standard_normal(N)]).is_white for s in range(100)]
    assert sum(found) > 92


def test_the_spectrum_of_an_autoregression_is_found():
    x = np.zeros(N)
    e = np.random.default_rng(1).standard_normal(N)
    for k in range(1, N):
        x[k] = 0.8 * x[k - 1] + e[k]
    colour = find_colour([x])
    assert colour.coefficients[0] == pytest.approx(0.8, abs=0.06)
    assert colour.spectrum(64)[0] == pytest.approx(25, rel=0.5)
    assert float(np.mean(np.concatenate([colour.spectrum(4096), colour.spectrum(4096)[1:-1]]))) == pytest.approx(
        colour.variance, rel=0.05
    )


def test_the_variance_of_a_mean_of_coloured_noise_is_that_of_many_draws():
    rng = np.random.default_rng(2)
    draws = np.array([np.convolve(rng.standard_normal(N + 3), np.full(4, 0.25), "valid") for _ in range(300)])
    colour = find_colour([draws[0]])
    expected = np.var(draws.sum(axis=1))
    assert quadratic([np.ones((N, 1))], colour)[0, 0] == pytest.approx(expected, rel=0.4)


def test_ripple_is_found_with_its_order_and_amplitude_and_none_in_noise():
    noise = np.random.default_rng(3).standard_normal(N)
    ripples, columns = find_ripple(noise + 0.5 * np.cos(14 * ANGLE + 1), ANGLE)
    assert [r.order for r in ripples] == [14]
    assert ripples[0].amplitude == pytest.approx(0.5, abs=0.1)
    assert columns.shape == (N, 2)
    assert sum(len(find_ripple(np.random.default_rng(s).standard_normal(N), ANGLE)[0]) for s in range(40)) == 0


def test_averaged_noise_is_no_ripple():
    for s in range(20):
        noise = averaged(np.random.default_rng(s).standard_normal((N, 1)), 4)[:, 0]
        assert find_ripple(noise, ANGLE)[0] == ()


def test_outliers_are_found_and_noise_is_not():
    x = np.random.default_rng(5).standard_normal(N)
    assert not find_outliers(x).any()
    x[[100, 900, 2000]] += 20
    assert np.flatnonzero(find_outliers(x)).tolist() == [100, 900, 2000]


def test_a_misfit_of_many_samples_is_no_outlier():
    x = np.random.default_rng(6).standard_normal(N)
    x[500:560] += 30
    assert find_outliers(x).sum() <= 2  # its edges
