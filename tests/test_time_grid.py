"""The uniform grid behind printed times; truth is the grid that was printed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.errors import RecordingError
from estimator.recordings.time_grid import half_last_digit, half_single_step, sampling_clock, uniform_grid


def grid(cells: list[str]) -> tuple[float, float]:
    return uniform_grid(
        np.array([float(cell) for cell in cells]),
        place=lambda k: f"sample {k}",
        half_digit=lambda: half_last_digit(cells, len(cells)),
    )


@pytest.mark.parametrize("n", [30, 300, 3000])
@pytest.mark.parametrize(
    ("step", "form"),
    [
        (1e-3, ".3f"),
        (1e-3, ".6f"),
        (1 / 3000, ".4f"),
        (1 / 3000, ".6f"),
        (1 / 3000, ".9e"),
        (1 / 1024, ".6f"),
        (0.0007, ".4f"),
        (1e-4, ".4f"),
        (2e-6, ".6f"),
        (0.0125, ".4f"),
        (0.1, ".1f"),
        (1 / 3, ".2f"),
    ],
)
def test_the_step_comes_back_exactly_from_rounded_print(n: int, step: float, form: str) -> None:
    assert grid([format(k * step, form) for k in range(n)]) == (0.0, step)


@pytest.mark.parametrize("start", [0.5, -1.0, 12.345, 3600.0, 1.7e9])
def test_time_need_not_start_from_zero(start: float) -> None:
    assert grid([f"{start + k * 0.001:.6f}" for k in range(2801)]) == (start, 0.001)


def test_six_significant_digits_without_zeros_at_the_end_are_on_the_grid() -> None:
    assert grid([f"{k / 3000:g}" for k in range(9000)]) == (0.0, 1 / 3000)


def test_a_few_times_of_which_none_is_as_far_from_the_next_as_usual_are_a_clock_that_jitters() -> None:
    """The mean of no interval ended in an internal error."""
    times = np.cumsum([0.0, 7.6, 17.6, 15.3, 25.1, 13.0, 6.1, 23.9, 38.8, 9.0, 26.0, 41.6, 9.3, 19.7]) * 1e-3
    clock = sampling_clock(times, place=str)
    assert not clock.even and np.array_equal(clock.time, times)


def test_a_jitter_below_one_percent_is_on_the_grid() -> None:
    rng = np.random.default_rng(1)
    start, step = grid([f"{k * 1e-3 + rng.uniform(-5e-6, 5e-6):.9f}" for k in range(1000)])
    assert step == 1e-3
    assert abs(start) < 1e-6


@pytest.mark.parametrize("at", [1, 5, 500, 998])
def test_a_jitter_above_one_percent_is_named_where_it_is(at: int) -> None:
    cells = [f"{k * 1e-3:.6f}" for k in range(1000)]
    cells[at] = f"{at * 1e-3 + 2e-5:.6f}"
    with pytest.raises(RecordingError, match=rf"^sample {at}: time is off its uniform grid by 0\.02 of a step"):
        grid(cells)


@pytest.mark.parametrize("at", [1, 40, 500, 998])
def test_a_lost_row_is_named_where_it_is_missing(at: int) -> None:
    cells = [f"{k * 1e-3:.3f}" for k in range(1000) if k != at]
    sentence = rf"^sample {at}: .* by 1 of a step \({(at + 1) * 1e-3:g} s where {at * 1e-3:g} s was due\)"
    with pytest.raises(RecordingError, match=sentence):
        grid(cells)


def test_time_that_stands_still_is_named() -> None:
    cells = [f"{k / 3000:.3f}" for k in range(100)]  # too few digits: 0.000, 0.000, 0.001
    with pytest.raises(RecordingError, match=r"^sample 1: time does not increase \(0 s after 0 s\)"):
        grid(cells)


def test_half_a_digit_follows_the_print() -> None:
    half = half_last_digit(["0", "0.5", "1.25", "2", "12.5", "1e-3", "2.50e-3"], 7)
    assert half == pytest.approx([0.5e-5, 0.05, 0.005, 0.005, 0.05, 0.5e-5, 0.5e-5])
    assert half_last_digit(["999.5", '"1,000.25"', "-1.001,5"], 3) == pytest.approx([0.05, 0.005, 0.005])


@settings(max_examples=200, deadline=None)
@given(
    digits=st.integers(1, 999_999),
    power=st.integers(-9, -3),
    start=st.integers(-10_000, 10_000),
    n=st.integers(10, 400),
)
def test_a_decimal_grid_printed_in_full_comes_back_to_the_bit(digits: int, power: int, start: int, n: int) -> None:
    step, first = float(f"{digits}e{power}"), start / 1000
    times = first + np.arange(n) * step
    if np.diff(times).min() < 1e3 * np.spacing(np.abs(times).max()):
        return  # time has no room for the step
    found = grid([repr(float(t)) for t in times])
    assert (found[0] + np.arange(n) * found[1]).tolist() == times.tolist()


@pytest.mark.parametrize("rounded", [np.round, np.floor])
@pytest.mark.parametrize("rate", [1250.0, 3000.0, 7919.0])
def test_an_even_clock_is_found_behind_times_that_rows_share(rate, rounded):
    true = 5.0 + np.arange(4000) / rate
    clock = sampling_clock(rounded(1e3 * true) / 1e3, place=lambda k: f"sample {k}")
    assert clock.even and clock.printed == pytest.approx(1e-3)
    assert np.ptp(clock.time - true) < 0.2e-3 and clock.time[0] == 5.0  # of the print's 1 ms
    uneven = np.sort(true + np.random.default_rng(1).normal(0, 1e-3, 4000))
    with pytest.raises(RecordingError, match="does not increase"):
        sampling_clock(rounded(1e3 * uneven) / 1e3, place=lambda k: f"sample {k}")


@pytest.mark.parametrize("step", [0.0005, 0.000125])
def test_a_clock_in_single_precision_is_even(step: float) -> None:
    """1 156 s after power-on neighbouring numbers are 0.12 ms apart, after 541 s 0.06 ms."""
    start = 1155.784 if step > 0.0003 else 541.3573
    times = (start + step * np.arange(3000)).astype(np.float32)
    cells = [f"{x:.9g}" for x in times]
    printed = np.array([float(cell) for cell in cells])
    half = np.maximum(half_last_digit(cells, 3000), half_single_step(printed, half_last_digit(cells, 3000)))
    clock = sampling_clock(printed, place=str, half_digit=lambda: half)
    assert clock.even and clock.step == pytest.approx(step, rel=1e-6) and len(clock.time) == 3000
    without = np.delete(np.arange(3000), 1700)  # a row is missing
    gap = sampling_clock(printed[without], place=str, half_digit=lambda: half[without])
    assert gap.even and gap.rows is not None and len(gap.time) == 3000 and 1700 not in gap.rows
    jitter = printed + np.random.default_rng(1).uniform(-0.3, 0.3, 3000) * step  # these are no such numbers
    assert not half_single_step(jitter, 5e-7).any()
    assert not sampling_clock(jitter, place=str, half_digit=lambda: np.full(3000, 5e-7)).even


def test_a_timer_of_few_ticks_a_row_jitters_though_most_steps_are_even() -> None:
    """One step of 1 203 was off by more than a quarter, and the file was not read."""
    rng = np.random.default_rng(3)
    ticks = 7 + rng.choice([-1, 0, 1], 1200, p=[0.13, 0.74, 0.13])
    ticks[400] = 5
    times = np.concatenate([[0.0], np.cumsum(ticks)]) * 0.5e-3 / 7
    clock = sampling_clock(np.round(times, 6), place=str)
    assert not clock.even and np.array_equal(clock.time, np.round(times, 6))


def test_a_long_log_that_is_late_at_times_jitters() -> None:
    """Of 15 043 rows 1.7 % of the steps were off by a hundredth and two by a quarter, and the file was not read."""
    rng = np.random.default_rng(4)
    times = 2e-3 * np.arange(6000) + rng.normal(0, 0.4e-6, 6000)
    late = rng.choice(np.arange(1, 5999), 60, replace=False)
    times[late] += 5e-5
    times[3000] += 0.55e-3
    times = np.round(times, 9)
    clock = sampling_clock(times, place=str, half_digit=lambda: np.full(len(times), 5e-10))
    assert not clock.even and np.array_equal(clock.time, times)


@pytest.mark.parametrize("lost", [0.05, 0.15])
def test_lost_rows_are_no_jitter_of_the_clock(lost: float) -> None:
    """With one stamp that is a mistake among them they were taken for an uneven clock without its missing rows."""
    rng = np.random.default_rng(6)
    times = 1e-3 * np.flatnonzero(rng.random(800) > lost)
    times[300] += 0.4e-3
    with pytest.raises(RecordingError, match="time is off its uniform grid"):
        sampling_clock(times, place=lambda k: f"row {k}", half_digit=lambda: np.full(len(times), 5e-7))
