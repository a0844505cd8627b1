"""Signals that a program has smoothed: running means, over the last samples or about each, told by their noise."""

import numpy as np
import pytest
from motors import CML050, held_response
from scipy.signal import lfilter

from estimator import estimate_parameters, recording_from_arrays
from estimator.recordings.smoothed_noise import samples_of_mean

pytestmark = pytest.mark.usefixtures("shared_workers")

STEP, LEVELS = 1e-3, np.repeat([0.0, 5.0, 10.5], [200, 500, 700])


def last(y, n):
    return np.convolve(np.concatenate([np.repeat(y[0], n - 1), y]), np.full(n, 1 / n), "valid")


def about(y, n):
    return last(np.concatenate([y, np.repeat(y[-1], n // 2)]), n)[n // 2 :]


def recorded(smooth, n, *, both, levels=LEVELS, seed=1):
    shown = held_response(CML050, levels, step=STEP)
    i, w = (shown + np.random.default_rng(seed).standard_normal(shown.shape) * [0.02, 1.0]).T
    columns = {"voltage [V]": levels, "current [A]": smooth(i, n) if both else i, "speed [rad/s]": smooth(w, n)}
    return recording_from_arrays("smoothed", STEP * np.arange(len(levels)), columns)


def worst(found):
    truth = CML050.parameters
    return max(abs(p.value - truth[name]) / p.standard_error for name, p in found.parameters.items())


@pytest.mark.parametrize(
    ("smooth", "n", "both", "told"),
    [
        pytest.param(last, 8, True, "all signals is a mean over the last 8 samples", marks=pytest.mark.full),
        pytest.param(about, 21, True, "all signals is a mean over 21 samples, as many", marks=pytest.mark.full),
        (about, 5, False, "w is a mean over 5 samples, as many before it as behind"),
        (last, 5, True, "all signals is a mean over the last 5 samples"),
        pytest.param(about, 11, False, "w is a mean over 11 samples, as many", marks=pytest.mark.full),
    ],
)
def test_means_are_told_and_the_motor_is_right(smooth, n, both, told):
    """They were told as ramps, current limits, load steps and delays: after 110 s, R 20 standard errors off."""
    found = estimate_parameters(recorded(smooth, n, both=both), workers=1)
    assert found.verdict == "ok" and worst(found) < 4.5, (found.reasons, found.effects)
    assert f"each sample of {told}" in " ".join(found.notes), found.notes
    for name in "RKLJ":
        assert found.parameters[name].standard_error < 0.05 * found.parameters[name].value, name


@pytest.mark.full
@pytest.mark.parametrize(("smooth", "n", "both"), [(last, 8, True), (about, 9, True), (about, 9, False)])
def test_without_the_effect_they_are_doubted(smooth, n, both, monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "smoothing")
    found = estimate_parameters(recorded(smooth, n, both=both), workers=1)
    assert found.verdict != "ok" or worst(found) < 4.5


def test_the_noise_of_a_mean_tells_of_how_many_samples_it_is():
    rng = np.random.default_rng(2)
    for n in (2, 3, 8, 25, 50):
        found = [samples_of_mean(last(rng.standard_normal(400), n)[n:]) for _ in range(100)]
        assert found.count(n) >= 95 and set(found) <= {1, n}, (n, found)


def test_no_other_noise_is_that_of_a_mean():
    """Of 2 000 signals with white, coloured or rounded noise, drift or hum none; by chance fewer than one in 1e4."""
    rng = np.random.default_rng(3)
    for k in range(2000):
        rows = int(rng.integers(100, 1000))
        white = rng.standard_normal(rows)
        kept = rng.uniform(0.2, 0.99)
        coloured = lfilter([1.0], [1.0, -kept], white)
        hum = np.sin(2 * np.pi * np.arange(rows) / rng.uniform(3, 40))
        kinds = (white, coloured, np.rint(white), np.cumsum(white), white + 2 * hum, coloured + 0.3 * white)
        assert samples_of_mean(kinds[k % 6]) == 1, (k % 6, rows)
    assert samples_of_mean(np.zeros(300)) == samples_of_mean(white[:50]) == 1
