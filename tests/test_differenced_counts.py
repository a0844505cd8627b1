"""Speeds of encoders, printed with all their digits or few of them, and speeds that are none."""

import numpy as np
import pytest

from estimator.recordings.differenced_counts import (
    as_counted,
    counts_a_turn,
    counts_of_uneven_rows,
    is_made_up_for,
)
from estimator.recordings.quantum import quantum

INTERVAL = 1e-3


def speed(seed, rows=3000):
    """Return a speed that rises and wanders, rad/s."""
    rng = np.random.default_rng(seed)
    rise = rng.uniform(50, 200) * (1 - np.exp(-np.arange(rows) / rng.uniform(50, 300)))
    return rise + np.cumsum(rng.standard_normal(rows)) * 0.1


def counted(w, counts, seed=0):
    """Return the speed of an encoder's differenced counts."""
    angle = np.cumsum(w) * INTERVAL * counts / (2 * np.pi) + np.random.default_rng(seed).random()
    return np.diff(np.floor(angle), prepend=np.floor(angle[0])) * 2 * np.pi / counts / INTERVAL


@pytest.mark.parametrize("digit", [0.0, 1e-7, 0.1, 0.3])
@pytest.mark.parametrize("counts", [500, 3484])
def test_counts_are_told_however_few_digits_are_printed(counts, digit):
    speeds = [counted(speed(seed), counts, seed) for seed in range(3)]
    if digit == 1e-7:
        speeds = [w.astype(np.float32).astype(np.float64) for w in speeds]
    elif digit:
        speeds = [digit * np.rint(w / digit) for w in speeds]
    assert counts_a_turn(speeds, [INTERVAL] * 3) == counts
    for seed, w in enumerate(speeds):
        assert as_counted(w, INTERVAL, counts) == pytest.approx(counted(speed(seed), counts, seed), rel=1e-6)


@pytest.mark.parametrize("unit", [1.0, 30 / np.pi])
@pytest.mark.parametrize(("counts", "digits"), [(1000, 5), (2000, 6), (4096, 6), (8192, 6), (8192, 7)])
def test_counts_are_told_where_small_speeds_are_printed_with_finer_digits_than_large_ones(counts, digits, unit):
    """As %.6g prints, in rad/s or rpm: a third of an outside judge's encoders were told as a low-pass of the speed."""
    for seed in range(3):
        shown = counted(speed(seed), counts, seed) * unit
        printed = np.array([float(f"{x:.{digits}g}") for x in shown]) / unit
        assert counts_a_turn([printed], [INTERVAL]) == counts
        rounding = 1e-4 * 2 * np.pi / (counts * INTERVAL)
        assert as_counted(printed, INTERVAL, counts) == pytest.approx(shown / unit, abs=rounding)


def test_steps_of_a_converter_that_are_printed_likewise_are_no_counts():
    """Of 200, each in one or two of 10 widths of where a number of counts would be whole."""
    found = 0
    for seed in range(200):
        step = np.random.default_rng(seed).uniform(2, 4)
        printed = np.array([float(f"{x:.6g}") for x in step * np.rint(speed(seed) / step)])
        found += bool(counts_a_turn([printed], [INTERVAL]))
    assert found < 40


def test_more_counts_than_an_encoder_has_lines_are_a_multiple_of_four():
    """Of two channels all edges are counted: of fine steps one in ten is a whole number of counts by chance."""
    for counts, told in ((8192, 8192), (20000, 20000), (17446, 0), (8191, 0), (3485, 3485)):
        step = 2 * np.pi / counts / INTERVAL
        assert counts_a_turn([step * np.rint(speed(1) / step)], [INTERVAL]) == told
        assert counts_a_turn([counted(speed(1), counts)], [INTERVAL]) == counts


def test_steps_of_a_converter_are_no_counts():
    """Of 200 converters whose steps are a number of counts by chance, few."""
    found = [0, 0]
    for seed in range(200):
        step = np.random.default_rng(seed).uniform(2, 4)
        w = step * np.rint(speed(seed) / step)
        found[0] += bool(counts_a_turn([0.3 * np.rint(w / 0.3)], [INTERVAL]))
        found[1] += bool(counts_a_turn([w], [INTERVAL]))
    assert max(found) < 40, "some are a whole number of counts as nearly as the digits tell"


def test_what_a_count_has_too_many_its_neighbour_has_too_few():
    for seed in range(20):
        w = speed(seed)
        assert is_made_up_for(counted(w, 3000, seed) * INTERVAL * 3000 / (2 * np.pi))
        noise = np.random.default_rng(seed).standard_normal(len(w))
        assert not is_made_up_for(np.rint(w)) and not is_made_up_for(np.rint(w + noise))
    assert not is_made_up_for(np.diff(np.floor(np.arange(250) * 7.3))), "too few rows"


def test_digits_alone_are_the_step_of_what_is_on_no_lattice():
    rng = np.random.default_rng(4)
    for _ in range(300):
        levels = np.round(np.cumsum(rng.standard_normal(rng.integers(20, 400))) * rng.uniform(0.2, 5), 1)
        assert quantum(rng.choice(levels, 3 * len(levels))) < 0.11


@pytest.mark.parametrize(("counts", "digits"), [(8192, 6), (8192, 7), (4096, 5), (20000, 7)])
def test_few_levels_that_are_printed_with_few_digits_tell_the_counts(counts, digits):
    """Of 8192 counts a turn in six digits, 16 levels gave 8191.97: not whole, and the errors passed for noise."""
    step = 2 * np.pi / counts / 1e-3
    shown = step * np.random.default_rng(1).integers(-3, 14, 2000)
    printed = np.array([float(f"{w:.{digits}g}") for w in shown])
    assert counts_a_turn([printed], [1e-3]) == counts


def by_loops(w, counts, seed, *, jitter=0.05):
    """Return when a loop that jitters ran, printed to a microsecond, and the counts of each round over its time."""
    rng = np.random.default_rng(seed)
    time = np.round(np.cumsum(INTERVAL * (1 + jitter * rng.uniform(-1, 1, len(w)))), 6)
    angle = np.concatenate([[0.0], np.cumsum(w[1:] * np.diff(time))]) * counts / (2 * np.pi) + rng.random()
    shown = np.zeros(len(time))
    shown[1:] = np.diff(np.floor(angle)) * 2 * np.pi / counts / np.diff(time)
    return time, shown


@pytest.mark.parametrize("counts", [48, 484, 2000, 16384])
def test_counts_are_told_of_a_loop_that_jitters_and_divides_by_its_own_time(counts):
    """They were taken for a low-pass of the speed, and L's bar was a hundred times as wide."""
    for seed in range(3):
        time, shown = by_loops(speed(seed), counts, seed)
        assert counts_of_uneven_rows(np.round(shown, 4), time) == counts
        shown[100] = np.nan
        assert counts_of_uneven_rows(shown, time) == counts


def test_a_speed_by_another_sensor_is_no_counts_of_uneven_rows():
    for seed in range(20):
        time, _ = by_loops(speed(seed), 500, seed)
        assert counts_of_uneven_rows(np.round(speed(seed), 2), time) == 0.0
    assert counts_of_uneven_rows(np.zeros(50), np.arange(50.0)) == 0.0
