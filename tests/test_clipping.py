"""What a sensor cannot show: found by its extreme value, and nothing else is."""

import numpy as np
import pytest

from estimator.recordings.clipping import clipped

T = np.arange(1000) * 1e-3
RISE = 3.0 * (1 - np.exp(-np.maximum(T - 0.1, 0) / 0.05))


def noisy(y, deviation=0.02, seed=1):
    return y + deviation * np.random.default_rng(seed).standard_normal(len(y))


def test_a_peak_that_is_cut_is_found_with_the_samples_beside_it():
    peak = noisy(RISE * np.exp(-np.maximum(T - 0.1, 0) / 0.1))
    cut = np.minimum(peak, 1.0)
    found = clipped(cut)
    assert found[peak > 1.0].all() and not found[peak < 0.8].any()


@pytest.mark.parametrize("times", [2, 3])
def test_a_peak_that_is_cut_is_found_where_a_logger_shows_each_sample_several_times(times):
    peak = noisy(RISE * np.exp(-np.maximum(T - 0.1, 0) / 0.1))
    shown = np.repeat(np.minimum(peak, 1.0)[::times], times)[: len(T)]
    found = clipped(shown)
    held = np.repeat(peak[::times], times)[: len(T)]
    assert found[held > 1.0].all() and not found[held < 0.8].any()


@pytest.mark.parametrize(
    "shown",
    [
        RISE,  # settles at one value to the last digit
        np.where(T < 0.1, 0.0, 3.0),
        noisy(RISE),
        np.minimum(RISE, 1.2),  # a drive's limit, simulated without noise
        np.round(noisy(RISE, 0.01) / 0.05) * 0.05,  # a converter's steps
        np.repeat(noisy(RISE)[::4], 4),  # a logger that holds
        np.floor(RISE * 20) / 20,  # an encoder
    ],
)
def test_what_settles_is_counted_or_is_held_is_not_taken_for_cut(shown):
    assert not clipped(shown).any()


def test_both_ends_of_a_range_are_found():
    wave = noisy(3 * np.sin(2 * np.pi * 5 * T))
    assert clipped(np.clip(wave, -2, 2))[np.abs(wave) > 2].all()


def test_missing_samples_do_not_matter():
    cut = np.minimum(noisy(RISE * np.exp(-np.maximum(T - 0.1, 0) / 0.1)), 1.0)
    cut[::7] = np.nan
    assert clipped(cut)[np.nan_to_num(cut) == 1.0].all()
