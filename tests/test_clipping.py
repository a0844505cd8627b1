"""What a sensor cannot show: found by its extreme value, and nothing else is."""

import numpy as np
import pytest

from estimator.recordings.clipping import clipped, cut_at_zero, limit, shared_limits

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


def test_a_peak_that_is_cut_is_found_where_what_it_settles_at_has_less_noise_and_few_digits():
    """Of the rest's samples 2 % repeat by their digits: the current was limited, curved and late instead."""
    rng = np.random.default_rng(4)
    y = np.minimum(
        1000 * np.exp(-np.maximum(T - 0.1, 0) / 0.05) * (T >= 0.1) * (1 + 0.02 * rng.standard_normal(1000)), 850
    )
    y = np.round(np.where(y < 850, y + 1.4 * rng.standard_normal(1000), y), 1)
    assert np.mean(np.diff(y) == 0) > 0.02 and np.count_nonzero(y == 850) >= 4
    assert clipped(y)[y == 850].all() and np.count_nonzero(clipped(y)[y < 600]) <= 1  # the row before it


def test_two_samples_at_one_extreme_in_each_recording_are_cut():
    def step(seed, size, cut=8.677):
        noise = np.random.default_rng(seed).standard_normal(1000)
        return np.round(np.minimum(size * np.exp(-np.maximum(T - 0.1, 0) / 0.009) * (T >= 0.1) + 0.05 * noise, cut), 3)

    cut = [step(1, 11.0), step(2, 10.5), step(3, 8.0)]
    assert [np.count_nonzero(y == 8.677) for y in cut] == [3, 2, 0]
    assert not clipped(cut[1]).any()
    known = shared_limits(cut)
    assert known == {8.677} and clipped(cut[1], known)[cut[1] == 8.677].all() and not clipped(cut[2], known).any()
    assert not shared_limits([step(1, 11.0, 20.0), step(2, 10.5, 20.0)])


def test_a_coarse_speed_that_settles_on_a_level_is_not_cut():
    """A rise of 18 samples in steps of a 47th, printed with few digits: the whole recording was refused for it."""
    rise = [39.4, 157.5, 275.6, 472.4, 629.9, 787.3, 984.2, 1102.3, 1259.8, 1377.9, 1456.6, 1535.3, 1614.1, 1692.8]
    shown = np.concatenate([np.zeros(549), rise, [1732.2, 1771.5, 1810.9, 1810.9], np.full(381, 1850.3)])
    assert not clipped(shown).any()


def test_both_ends_of_a_range_are_found():
    wave = noisy(3 * np.sin(2 * np.pi * 5 * T))
    assert clipped(np.clip(wave, -2, 2))[np.abs(wave) > 2].all()


def test_missing_samples_do_not_matter():
    cut = np.minimum(noisy(RISE * np.exp(-np.maximum(T - 0.1, 0) / 0.1)), 1.0)
    cut[::7] = np.nan
    assert clipped(cut)[np.nan_to_num(cut) == 1.0].all()


def timed_pulses(seed=2, mean=128):
    """Return a speed that steps as firmware shows it: by the time of pulses, as a mean of many rows, to 0.01 rad/s."""
    rng = np.random.default_rng(seed)
    true = 71.0 + 25.0 * (1 - np.exp(-np.maximum(np.arange(1500) - 300, 0) / 80))
    shown = np.empty(len(true))
    angle, last, value = 0.0, 0, true[0]
    for k, speed in enumerate(true):
        angle += 1e-3 * speed * (1 + 0.1 * rng.standard_normal())
        if angle >= np.pi:
            value, last, angle = np.pi / max(1e-3, 1e-3 * (k - last)) if last else value, k, angle - np.pi
        shown[k] = value
    return np.round(np.convolve(np.pad(shown, (mean - 1, 0), mode="edge"), np.ones(mean) / mean, "valid"), 2)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("sign", [1, -1])
def test_a_mean_of_what_a_slow_encoder_counts_pauses_anywhere_and_is_not_cut(seed, sign):
    speed = timed_pulses(seed)
    assert not clipped(sign * speed).any()
    assert not clipped(sign * speed[500:]).any()


def test_a_converter_that_is_coarser_than_the_noise_is_found_at_its_range():
    inrush = 3 * (np.exp(-np.maximum(T - 0.1, 0) / 0.1) - np.exp(-np.maximum(T - 0.1, 0) / 0.01))
    shown = np.round(noisy(inrush, 0.002) / 0.01) * 0.01
    found = clipped(np.minimum(shown, 1.0))
    assert found[shown > 1.0].all() and not found[shown < 0.8].any() and not clipped(shown).any()


def test_a_range_that_ends_above_zero_is_found_where_it_ends_alone():
    dip = noisy(5 - RISE * np.exp(-np.maximum(T - 0.1, 0) / 0.1))
    cut = np.maximum(dip, 4.0)
    found = clipped(cut)
    assert found[dip < 4.0].all() and not found[dip > 4.2].any() and limit(cut, found) == 4.0


@pytest.mark.parametrize("seed", range(10))
def test_noise_at_rest_that_has_its_extreme_three_times_is_not_cut(seed):
    rng = np.random.default_rng(seed)
    speed = np.round(np.concatenate([np.zeros(400), 800 * (1 - np.exp(-np.arange(2000) / 100))]), 1)
    speed = np.round(speed + 1.5 * rng.standard_normal(2400), 1)
    speed[rng.choice(300, 3, replace=False) + 50] = np.min(speed)
    assert not clipped(speed).any()


def test_both_ends_of_one_recording_are_known_to_the_others_and_the_extreme_is_told():
    wave = noisy(3 * np.sin(2 * np.pi * 5 * T))
    known = shared_limits([np.clip(wave, -2, 2), noisy(0.1 * wave)])
    assert known == {2.0, -2.0}
    once = noisy(1.5 * np.sin(2 * np.pi * 5 * T))
    once[500] = -2.0
    assert limit(once, clipped(once, known)) == -2.0


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_a_range_that_cuts_one_side_cuts_the_other_at_the_same_size(seed):
    """One sample had touched it before: the side was no cut, and what was missing there became five effects."""
    peaks = ((1.01, 0.1), (-1.8, 0.4), (1.8, 0.7))
    y = sum(size * np.exp(-np.maximum(T - t, 0) / 0.06) * (t <= T) for size, t in peaks)
    shown = np.clip(np.round(noisy(y, 0.006, seed) / 0.005) * 0.005, -1, 1)
    found = clipped(shown)
    assert found[np.abs(shown) == 1].all() and np.count_nonzero(found[np.abs(shown) < 0.9]) <= 3


@pytest.mark.parametrize(("cut", "step", "rows"), [(8.0, 0.005, 3), (8.0, 0.024, 3), (8.4, 0.001, 2)])
def test_a_peak_that_is_cut_in_two_or_three_rows_is_told_by_its_slopes(cut, step, rows):
    """A converter's noise is below its steps: a drive's limit was told instead, and J was 5 standard errors off."""
    t = np.arange(300) * 2e-3 - 0.1
    inrush = np.where(t > 0, 10 * (np.exp(-t / 0.04) - np.exp(-t / 0.0012)), 0.0)
    shown = np.round((inrush + 0.3 * step * np.random.default_rng(1).standard_normal(len(t))) / step) * step
    found = clipped(np.minimum(shown, cut))
    assert np.count_nonzero(shown > cut) == rows and found[shown > cut].all() and found.sum() <= rows + 3
    assert not clipped(shown).any()


@pytest.mark.parametrize("rows", [2, 3, 4, 5])
@pytest.mark.parametrize("curved", [0.3, 3.0, 30.0])
def test_a_rounded_top_in_coarse_steps_is_not_cut(rows, curved):
    """So many rows are equal to within a step, where the curvature allows it."""
    step = curved * ((rows - 1) / 2) ** 2 * 1.01 if rows > 2 else 0.3 * curved
    top = 500 - curved * (np.arange(60) - 30 + (rows - 1) % 2 / 2) ** 2
    assert not clipped(np.maximum(np.floor(top / step) * step, 0)).any()


@pytest.mark.parametrize("seed", range(5))
def test_a_sensor_of_one_polarity_cuts_half_of_the_noise_around_zero(seed):
    """Of a rest that is half zeros the mean is no zero: K was 7 standard errors off, and a voltage offset told."""
    t = np.arange(600) * 1e-3 - 0.1
    current = np.where(t > 0, 1 + 5 * np.exp(-np.maximum(t, 0) / 0.05), 0.0)
    shown = current + 0.05 * np.random.default_rng(seed).standard_normal(len(t))
    found = cut_at_zero(np.maximum(shown, 0.0))
    assert found[:95].mean() > 0.97 and not found[101:].any()
    coarse = np.round(np.maximum(shown, 0.0) / 0.1) * 0.1  # whose steps hide the noise
    dutied = np.where(np.arange(len(t)) % 2, current + 1.0, 0.0)  # which is off every other row
    for other in (shown, coarse, dutied, np.abs(shown), np.maximum(current, 0.0)):
        assert not cut_at_zero(other).any()
