"""Printed sampling times → a clock: the uniform grid t0 + k*step, or times beside it. Knows no files.

Printed times are rounded, so the step is what all of them together say: a least-squares line, then the
plainest numbers (fewest digits in the step or in the sampling rate) that fit the print as well as that line
does. Times printed as 0.001, 0.002, … give 0.001 exactly; 0.0003, 0.0007, 0.0010, … over a few hundred
samples give 1/3000.

Rows that are missing are found by their times, one step and more apart, and kept as places without a sample. A clock
that jitters is taken as it is printed, whatever its spread: its times are real. One time that is off, or a pause in a
clock that is even, is an error: nobody can tell what happened there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.errors import RecordingError
from estimator.recordings.samples import median
from estimator.recordings.text_cells import ungrouped
from estimator.recordings.units import FloatArray

OFF_GRID = 0.01  # of the step: further off is no uniform grid
JITTER = 0.25  # of the step: an interval further off a whole number of steps is an error
TENTH, SEVERAL = 0.1, 20  # of the steps that are off, or so many steps: no mistake
ONCE, EXACT = 1, 1e-3  # row off the grid, of the step the others: one alone is a mistake, else the clock jitters
LATE = 3.0  # half digits: a row off the grid by no more was stamped one tick late, such as by a loop at its millis()
OFTEN, PAUSE = 3, 20  # intervals off any grid that are a clock without one; times the usual interval: a pause
COARSE = 0.9  # of a step: a digit of a time that is above this tells no lost row from rounding
RARE = 0.01  # of the rows: so many may have the time of the row before
MISSING = 3  # times the rows that are there: more missing ones are an error
SHARED = 8  # rows that share a time with the one before: fewer are rows that are there twice


@dataclass(frozen=True, eq=False)
class Clock:
    """When samples were taken.

    Attributes
    ----------
    time : (n,) array, s
        Increasing; exactly t0 + k * step where `even`.
    step : float
        s, the mean interval.
    rows : (m,) integer array, or None
        Which of the n times has a row; None: every one.
    even : bool
        Whether the times lie on the uniform grid.
    printed : float
        s, the steps in which the times are printed, where they are so coarse that rows share one; else 0.
    """

    time: FloatArray
    step: float
    rows: NDArray[np.int64] | None = None
    even: bool = True
    printed: float = 0.0


def sampling_clock(
    times: FloatArray, *, place: Callable[[int], str], half_digit: Callable[[], FloatArray] | None = None
) -> Clock:
    """Return the clock of printed times, (m,) s, m ≥ 3.

    Raises
    ------
    RecordingError
        Time does not increase, is off a uniform grid in one row only, or pauses.
    """
    try:
        start, step = uniform_grid(times, place=place, half_digit=half_digit)
    except RecordingError:
        found = _in_coarse_print(times) or _with_gaps(times, half_digit) or _without_grid(times, half_digit)
        if found is not None:
            return found
        if (k := _pause(times)) is not None:
            raise RecordingError(_paused(times, k, place)) from None
        raise
    return Clock(start + np.arange(times.size, dtype=np.float64) * step, step)


def _in_coarse_print(times: FloatArray) -> Clock | None:
    """Return the even clock of times that are printed in steps above its own; None if there is none.

    Rounded, or cut, all times of an even clock lie on a line but for one step of the print. A row that is missing
    shifts all that follow: fewer than this step holds are not seen.
    """
    steps = np.diff(times)
    if (steps < 0).any() or np.count_nonzero(steps == 0) < max(SHARED, RARE * times.size) or not (steps > 0).any():
        return None
    printed = float(steps[steps > 0].min())
    rows = np.arange(times.size, dtype=np.float64)
    centred = rows - rows.mean()
    step = float(centred @ (times - times.mean()) / (centred @ centred))
    spread = float(np.ptp(times - centred * step))
    line = 2.4 / np.sqrt(times.size)  # four deviations of its ends, in steps of the print
    if not 0 < step < printed or spread > (1 + line) * printed:
        return None
    _, step = _plainest(times, step, spread / 2, rows)
    return Clock(float(times[0]) + rows * step, step, printed=printed)


def _with_gaps(times: FloatArray, half_digit: Callable[[], FloatArray] | None) -> Clock | None:
    """Return the clock of times with missing rows or jitter; None if it is none."""
    steps = np.diff(times)
    if (steps <= 0).any():
        return None
    half = np.zeros(times.size) if half_digit is None else half_digit()
    usual = median(steps)
    half[2 * half > COARSE * usual] = 0.0
    beside = JITTER * usual + 2 * float(half.max())  # a step is off by twice half a digit, too
    usual = float(np.mean(steps[np.abs(steps - usual) <= beside]))
    multiples = np.round(steps / usual)
    if (multiples < 1).any() or (np.abs(steps - multiples * usual) > beside).any():
        return None
    rows = np.concatenate([[0], np.cumsum(multiples)])
    n = int(rows[-1]) + 1
    if n > (1 + MISSING) * times.size:
        return None
    index = rows.astype(np.int64)
    centred = rows - rows.mean()
    step = float(centred @ (times - times.mean()) / (centred @ centred))
    off = times - times.mean() - centred * step
    missing = None if n == times.size else index
    away = np.abs(off) > np.maximum(OFF_GRID * step, half * (1 + 3 / np.sqrt(times.size)))
    stamped_late = away.sum() <= ONCE and bool((np.abs(off) <= np.maximum(OFF_GRID * step, LATE * half)).all())
    if not away.any() or stamped_late:
        start, step = _plainest(times, step, float(np.abs(off).max()), rows)
        return Clock(start + np.arange(n, dtype=np.float64) * step, step, missing)
    if away.sum() <= ONCE and _is_exact(times[~away], rows[~away], half[~away]):
        return None
    return Clock(np.interp(np.arange(n), rows, times), step, missing, even=False)


def times_again(times: FloatArray) -> NDArray[np.int64]:
    """Return which rows have the time of the row before, of times, (m,) s, whose clock jitters; none if they are many.

    The clock of a computer that reads a serial line shows two rows of one buffer at one time. Of an exact clock such a
    row is a mistake, and many are a clock that is printed too coarsely.
    """
    steps = np.diff(times)
    again = np.flatnonzero(steps == 0) + 1
    if not len(again) or len(again) > RARE * times.size or (steps < 0).any():
        return np.empty(0, dtype=np.int64)
    usual = median(steps)
    jitters = median(np.abs(steps - usual)) > EXACT * usual
    return again if jitters else np.empty(0, dtype=np.int64)


def _pause(times: FloatArray) -> int | None:
    """Return the first row after a pause of a clock that jitters; None where there is none."""
    steps = np.diff(times)
    usual = median(steps)
    if (steps <= 0).any() or not (steps > PAUSE * usual).any():
        return None
    jitters = np.count_nonzero(np.abs(steps - usual) > OFF_GRID * usual) >= OFTEN
    return int(np.argmax(steps > PAUSE * usual)) + 1 if jitters else None


def _paused(times: FloatArray, k: int, place: Callable[[int], str]) -> str:
    usual = median(np.diff(times))
    return (
        f"{place(k)}: time is {float(times[k] - times[k - 1]):.4g} s after the row before, where {usual:.4g} s is"
        " usual; save what was logged before and after this pause as two recordings"
    )


def _is_exact(times: FloatArray, rows: FloatArray, half: FloatArray) -> bool:
    """Return whether times, (m,) s, are on their grid as well as they are printed: a clock that does not jitter."""
    step, start = np.polyfit(rows, times, 1)
    off = median(np.abs(times - start - step * rows))
    return off <= max(EXACT * float(step), 1.5 * median(half))


def _without_grid(times: FloatArray, half_digit: Callable[[], FloatArray] | None) -> Clock | None:
    """Return the clock of times that lie on no grid at all; None if they do but for a mistake or a pause."""
    steps = np.diff(times)
    usual = median(steps)
    if (steps <= 0).any() or (steps > PAUSE * usual).any():
        return None
    away = np.abs(steps - usual * np.round(steps / usual))  # lost rows are none
    off = (away > JITTER * usual) | (steps < usual / 2)
    print_error = 0.0 if half_digit is None else 2 * median(half_digit())
    jitters = median(np.abs(steps - usual)) > max(EXACT * usual, print_error)
    # Of a timer that counts few ticks most are even, and of a computer that is late at times.
    jitters |= int(np.count_nonzero(away > max(OFF_GRID * usual, print_error))) > min(TENTH * len(away), SEVERAL)
    if np.count_nonzero(off) < OFTEN and not jitters:
        return None
    return Clock(times.copy(), usual, even=False)


def uniform_grid(
    times: FloatArray, *, place: Callable[[int], str], half_digit: Callable[[], FloatArray] | None = None
) -> tuple[float, float]:
    """Return t0 and the step of a uniform grid.

    Parameters
    ----------
    times
        (n,) s, n ≥ 3, as printed.
    place
        Says where sample k stands: ``"run3.csv line 812"``.
    half_digit
        Gives half of the last printed digit of each time, (n,) s; called only if times are off by over 1 %.

    Raises
    ------
    RecordingError
        Time does not increase, or is off its grid by more than 1 % of the step and half a printed digit (which
        only counts where a step has two digits at least).
    """
    n = times.size
    steps = np.diff(times)
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0)) + 1
        is_coarse = steps.min() == 0 and np.count_nonzero(steps == 0) >= OFTEN  # no rows that are there twice
        if is_coarse and times[-1] > times[0]:
            rate = f"some {(n - 1) / (times[-1] - times[0]):.4g} Hz, if none was lost"
            remedy = f"; or say with --rate HZ how often the rows were taken: {rate}"
        else:
            remedy = ""
        raise RecordingError(
            f"{place(k)}: time does not increase ({_shown(times, k)} s after {_shown(times, k - 1)} s);"
            f" each row needs a later time than the one before, printed with enough digits{remedy}"
        )
    centred = np.arange(n, dtype=np.float64) - (n - 1) / 2
    since = times - times[0]
    step = float(centred @ since / (centred @ centred))
    off = since - since.mean() - centred * step
    worst = float(np.abs(off).max())
    allowed: FloatArray = np.full(n, OFF_GRID * step)
    half = np.zeros(n)
    if worst > OFF_GRID * step and half_digit is not None:
        half = half_digit()
        half[2 * half > COARSE * step] = 0.0  # rows share a digit of a step; one that is as coarse tells no lost row
        allowed = np.maximum(allowed, half * (1 + 3 / np.sqrt(n)))  # the line itself is as uncertain as that
    if (np.abs(off) > allowed).any():
        raise RecordingError(_off_grid(times, half, allowed, place))
    return _plainest(times, step, worst, np.arange(n, dtype=np.float64))


def half_last_digit(cells: Iterable[str], n: int) -> FloatArray:
    """Return half of the last printed digit of n numbers, the finest within each power of ten.

    (Programs that print with a fixed count of digits leave zeros at the end out.)
    """
    digits = np.zeros(n)
    decade = np.zeros(n)
    for k, cell in enumerate(cells):
        text = ungrouped(cell.strip().strip('"').replace(",", ".").lower())
        text = text.replace(".", "", text.count(".") - 1)  # the last mark; those before it part thousands
        mantissa, _, exponent = text.partition("e")
        _, _, decimals = mantissa.partition(".")
        digits[k] = len(decimals) - int(exponent or 0)
        value = abs(float(text))
        decade[k] = np.floor(np.log10(value)) if value else -999
    for power in np.unique(decade):
        here = decade == power
        digits[here] = digits[here].max()
    digits[decade == -999] = digits.max()  # a plain 0 says nothing
    return np.asarray(0.5 * 10.0**-digits)


def half_single_step(times: FloatArray, half_digit: FloatArray | float) -> FloatArray:
    """Return half the distance of neighbouring single-precision numbers, (n,), where all times are such, else 0.

    A clock that is kept in single precision, as a timer's seconds since power-on, is as coarse as that: 0.12 ms after
    1 024 s. Times are such numbers where each is its nearest one within half of its last digit, as (n,) numbers.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        nearest = times.astype(np.float32)
        are_single = bool((np.abs(nearest - times) <= 1.001 * np.asarray(half_digit)).all())
    return 0.5 * np.spacing(np.abs(nearest)).astype(np.float64) if are_single else np.zeros(len(times))


def _plainest(times: FloatArray, step: float, worst: float, k: FloatArray) -> tuple[float, float]:
    allowed = 1.2 * worst + 4 * float(np.spacing(np.abs(times).max()))
    first = float(times[0])
    for candidate in _candidates(step):
        if abs((times[-1] - first) - k[-1] * candidate) > 2 * allowed:
            continue
        off = times - k * candidate
        low, high = float(off.max()) - allowed, float(off.min()) + allowed
        if low <= first <= high:
            return first, candidate
        if low <= high:
            middle = (low + high) / 2
            for digits in range(18):
                rounded = round(middle, digits)
                if low <= rounded <= high:
                    return rounded, candidate
    return float(np.mean(times - k * step)), step


def _shown(times: FloatArray, k: int) -> str:
    """Return a time with digits enough to tell it from the next: one that counts from a date needs many."""
    usual = median(np.abs(np.diff(times)))
    digits = 9 if usual == 0 else int(np.log10(max(abs(float(times[k])) / usual, 1.0))) + 4
    return f"{float(times[k]):.{min(max(digits, 9), 17)}g}"


def _candidates(step: float) -> Iterator[float]:
    for digits in range(17):
        yield float(f"{step:.{digits}e}")
        yield 1 / float(f"{1 / step:.{digits}e}")


def _off_grid(times: FloatArray, half: FloatArray, allowed: FloatArray, place: Callable[[int], str]) -> str:
    """Name the first time that is off the grid of the regular ones."""
    steps = np.diff(times)
    usual = median(steps)
    regular = np.abs(steps - usual) <= np.maximum(0.9 * OFF_GRID * usual, 2 * half[1:])
    step = float(steps[regular].mean()) if regular.any() else usual  # of few rows none may be as long as the usual one
    due = times[0] + np.arange(times.size) * step
    off = np.abs(times - due) - allowed
    k = int(np.argmax(off > 0)) if (off > 0).any() else int(np.argmax(off))
    return (
        f"{place(k)}: time is off its uniform grid by {abs(float(times[k] - due[k])) / step:.3g} of a step"
        f" ({_shown(times, k)} s where {_shown(due, k)} s was due);"
        " correct it, print time with enough digits, or resample to equal steps"
    )
