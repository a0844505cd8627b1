"""What is told of a signal, and remembered."""

import numpy as np

from estimator.recordings.samples import REMEMBERED, told_once


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
