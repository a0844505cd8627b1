"""What sensors show, against scipy.signal and plain sums."""

import numpy as np
import pytest

from estimator.recordings.sensors import Sensor, chebyshev1_sections, response, transfer_sections


def _shown(sensor, x):
    return np.array([sensor.show(float(value)) for value in x])


@pytest.mark.parametrize("order", [1, 2, 3, 4, 7])
@pytest.mark.parametrize(("ripple", "cutoff"), [(0.5, 50.0), (3.0, 400.0), (0.01, 5.0)])
def test_a_chebyshev_filter_is_that_of_scipy(order, ripple, cutoff):
    signal = pytest.importorskip("scipy.signal")
    x = np.random.default_rng(1).standard_normal(500)
    sections = chebyshev1_sections(order=order, ripple=ripple, cutoff=cutoff, step=1e-3)
    expected = signal.sosfilt(signal.cheby1(order, ripple, cutoff, fs=1000, output="sos"), x)
    np.testing.assert_allclose(_shown(Sensor(sections=sections), x), expected, rtol=0, atol=1e-11)


def test_an_even_order_scales_the_settled_signal_by_its_ripple_and_an_odd_one_does_not():
    for order, gain in ((4, 10 ** (-0.5 / 20)), (3, 1.0)):
        sections = chebyshev1_sections(order=order, ripple=0.5, cutoff=50, step=1e-3)
        assert response(sections, frequency=0.0, step=1e-3).real == pytest.approx(gain, rel=1e-12)


@pytest.mark.parametrize(
    ("b", "a"),
    [
        ([1.0], [1.0]),
        ([0.2, 0.3], [1.0, -0.5]),
        ([0, 0, 0.1], [2.0, -0.5, 0.3]),
        ([1, -2, 3, 1, 0.5], [1, 0.1, -0.2, 0.05]),
    ],
)
def test_a_filter_given_by_coefficients_is_that_of_scipy(b, a):
    signal = pytest.importorskip("scipy.signal")
    x = np.random.default_rng(2).standard_normal(200)
    np.testing.assert_allclose(
        _shown(Sensor(sections=transfer_sections(b, a)), x), signal.lfilter(b, a, x), rtol=0, atol=1e-12
    )


def test_a_mean_over_the_interval_is_the_difference_of_angles():
    angle = np.cumsum(np.random.default_rng(3).random(50))
    shown = _shown(Sensor(mean=True, interval=0.01), angle)
    np.testing.assert_allclose(shown, np.concatenate([[0], np.diff(angle) / 0.01]), rtol=1e-12)


def test_an_average_is_the_mean_of_the_last_samples_and_starts_from_the_first():
    x = np.arange(1.0, 9.0)
    expected = [np.mean(np.concatenate([np.full(3, 1.0), x])[k + 1 : k + 4]) for k in range(8)]
    np.testing.assert_allclose(_shown(Sensor(average=3), x), expected, rtol=1e-15)


def test_gain_and_offset_come_last():
    assert _shown(Sensor(gain=2.0, offset=0.5), [1.0, 2.0]).tolist() == [2.5, 4.5]


def test_a_cutoff_above_half_the_sampling_rate_is_refused():
    with pytest.raises(ValueError, match="not below half the sampling rate, 500 Hz"):
        chebyshev1_sections(order=3, ripple=0.5, cutoff=500, step=1e-3)


def test_coefficients_of_an_unstable_or_empty_filter_are_refused():
    with pytest.raises(ValueError, match="unstable"):
        transfer_sections([1.0], [1.0, -1.5])
    with pytest.raises(ValueError, match=r"a\[0\] not zero"):
        transfer_sections([1.0], [0.0, 1.0])
