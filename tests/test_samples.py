"""What is told of a signal, and remembered."""

import numpy as np

from estimator.recordings.samples import MULTIPLIED, REMEMBERED, median, medians, quantile, sum_of_logs, told_once


def test_a_number_of_a_signal_is_told_once_for_as_long_as_the_signal_is_the_same():
    asked = []

    @told_once
    def largest(y):
        asked.append(len(y))
        return float(np.max(y))

    y = np.arange(6.0)
    assert [largest(y), largest(y.copy()), largest(y[:3]), largest(y[::2])] == [5.0, 5.0, 2.0, 4.0]
    assert asked == [6, 3, 3]
    y[0] = 9.0
    assert largest(y) == 9.0
    for k in range(2 * REMEMBERED):
        assert largest(y + k) == 9.0 + k


def test_sums_of_logarithms_are_those_of_single_ones_up_to_where_a_product_overflows():
    rng = np.random.default_rng(1)
    for shape in ((3, 5), (2, 8 * MULTIPLIED + 3), (4, 100, 2)):
        numbers = rng.choice([1e-30, 1.0, 1e30], shape) * rng.uniform(1, 2, shape)
        np.testing.assert_allclose(sum_of_logs(numbers), np.log(numbers).sum(axis=1), rtol=1e-12, atol=1e-9)


def test_the_median_is_the_middle_one_or_between_the_two_in_the_middle():
    rng = np.random.default_rng(2)
    for n in (1, 2, 3, 4, 101, 1000):
        for numbers in (rng.standard_normal(n), np.round(rng.standard_normal(n)), np.diff(1e-4 * np.arange(n + 1.0))):
            assert median(numbers) == np.median(numbers) == medians(numbers[None, :])[0]
    assert np.isnan(median(np.zeros(0))) and np.isnan(median(np.array([1.0, np.nan, 2.0])))


def test_a_quantile_is_that_of_the_numbers_that_are_there():
    rng = np.random.default_rng(3)
    for n in (1, 2, 7, 1000):
        numbers = np.append(rng.standard_normal(n), np.nan)
        for part in (0.0, 0.3, 0.995, 1.0):
            np.testing.assert_allclose(quantile(numbers, part), np.nanquantile(numbers, part), rtol=1e-14)
    assert np.isnan(quantile(np.array([np.nan]), 0.5))
