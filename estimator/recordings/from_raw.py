"""A file's columns made a recording: checked, in SI, on their clock. Knows no file format."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.errors import RecordingError
from estimator.recordings.headers import Header, assumed_unit, parse_header, rank_in_role, role_of
from estimator.recordings.raw_table import RawTable
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import MIN_SAMPLES, Recording
from estimator.recordings.samples import LARGEST, median
from estimator.recordings.tests_in_file import asked_test
from estimator.recordings.time_column import is_header, time_column
from estimator.recordings.time_grid import Clock, half_single_step, sampling_clock, times_again
from estimator.recordings.turns import OVERFLOW, clock_counted_on
from estimator.recordings.units import FloatArray

DATED = 1e8  # s: a clock that begins later, some three years, counts from a date; it is told from its first row on
LARGEST_TIME = 1e20  # as LARGEST: a clock shows up to 2e18 ns since 1970
DATES = (1e9, 4.1e9)  # s since 1970, of recordings: 2001 to 2099
FRACTIONS = {"ms": 1e3, "us": 1e6, "ns": 1e9}  # in which clocks count from 1970, a second
STEPS = (1e-6, 60.0)  # s, of rows of such a clock; a counter of ns since a start, as long as a date in ms, has others
TOO_FAST = 1e-7  # s, of a sampling interval: the header's unit is doubted
_THOUSANDS = re.compile(r"[-+]?\d{1,3}([.,]\d{3})+")  # or a decimal mark that the other numbers do not have
MOST_LEFT_OUT = 2  # rows at the start, of wrong stamps
EVEN = 0.1  # of a step: steps of a column that differ by less are even
OTHER_RATE = 0.01  # from a rate that is said, relative: that of times is another
LONG = 100  # rows: of fewer, one whose time is off is missed more than the clock
ALL, ALL_BUT_FIRST, ALL_BUT_LAST = slice(None), slice(1, None), slice(None, -1)  # rows


def timed(raw: RawTable, read_as: ReadAs) -> RawTable:
    """Return a table with a time, its last column, where a rate says it; it wins over one of the file's own.

    Raises
    ------
    RecordingError
        No column is called time, no rate is given, and one column rises as a time does.
    """
    if read_as.rate is None:
        _called_no_time(raw, read_as)
        return _with_fractions_since_1970(_with_clock_counted_on(raw, read_as), read_as)
    times = np.arange(len(raw.columns[0]), dtype=np.float64) / read_as.rate
    own = ["time as logged [s]" if text == "time [s]" else text for text in raw.texts]
    told = (*raw.not_read, *_times_not_used(raw, read_as.rate))
    return replace(raw, texts=[*own, "time [s]"], columns=[*raw.columns, times], half_digit=None, not_read=told)


def _with_clock_counted_on(raw: RawTable, read_as: ReadAs) -> RawTable:
    """Return a table whose times go on where its clock overflows."""
    asked = read_as.columns.get("time")
    for j, text in enumerate(raw.texts):
        name = parse_header(text).name
        is_time = rank_in_role(name, "time") is not None or asked in (name, text)
        if not is_time or j in raw.bad or j in raw.texts_in:
            continue
        times, bits = clock_counted_on(raw.columns[j])
        if bits is not None:
            columns = [*raw.columns[:j], times, *raw.columns[j + 1 :]]
            raw = replace(raw, columns=columns, not_read=(*raw.not_read, f"{text}: {OVERFLOW.format(bits)}"))
    return raw


def _with_fractions_since_1970(raw: RawTable, read_as: ReadAs) -> RawTable:
    """Return a table whose times without a unit have that of a clock that can only count from 1970 in it."""
    asked = read_as.columns.get("time")
    for j, text in enumerate(raw.texts):
        header, times = parse_header(text), raw.columns[j]
        is_time = rank_in_role(header.name, "time") is not None or asked in (header.name, text)
        said = header.unit_text is not None or {"time", header.name, text} & read_as.units.keys()
        if not is_time or said or j in raw.bad or j in raw.texts_in or len(times) < MIN_SAMPLES:
            continue
        for unit, count in FRACTIONS.items():
            dated = np.all((times >= DATES[0] * count) & (times <= DATES[1] * count))
            if dated and STEPS[0] < median(np.diff(times)) / count < STEPS[1]:
                texts = [*raw.texts[:j], f"{text} [{unit}]", *raw.texts[j + 1 :]]
                return replace(raw, texts=texts, not_read=(*raw.not_read, f"{text}: counts {unit} since 1970"))
    return raw


def _told_apart(headers: Sequence[Header], read_as: ReadAs, where: str) -> list[Header]:
    """Return headers each with its own text: of several of one text, those that the user names by number have it."""
    written = [header.text for header in headers]
    alike = {text for text in written if written.count(text) > 1}
    numbers = {int(number) - 1 for number in read_as.numbers}
    headers = [
        replace(header, text=f"column {j + 1}: {header.text}") if header.text in alike and j in numbers else header
        for j, header in enumerate(headers)
    ]
    written = [header.text for header in headers]
    again = next((j for j, text in enumerate(written) if written.count(text) > 1), None)
    if again is not None:
        raise RecordingError(
            f"{where}: two columns are called {written[again]!r}; give each its own name, or say by their numbers what"
            f" they are, as in --column v={again + 1}"
        )
    return list(headers)


def _times_not_used(raw: RawTable, rate: float) -> Iterator[str]:
    """Say which column of times a rate, Hz, is used instead of, and which rate these tell, if it is another."""
    for text, column in zip(raw.texts, raw.columns, strict=True):
        header = parse_header(text)
        unit = header.unit or (assumed_unit(header.name) if header.unit_text is None else None)
        if rank_in_role(header.name, "time") is None or unit is None or unit.quantity != "time":
            continue
        lasts = float(unit.to_si(column[-1:])[0] - unit.to_si(column[:1])[0])
        told = (len(column) - 1) / lasts if lasts > 0 else np.nan
        other = f", and they tell {told:.4g} Hz" if abs(told / rate - 1) > OTHER_RATE else ""
        yield f"the times of {text!r} are not used: you said {rate:g} Hz{other}"


def recording_of(raw: RawTable, read_as: ReadAs) -> Recording:
    """Check the columns of a table that is `timed`, convert them to SI, and put them on their clock."""
    name = raw.name
    if read_as.test is not None:
        raw, name = asked_test(raw, read_as), f"{raw.name} {read_as.test}"
    left_out = _first_rows(raw, read_as)
    not_read = raw.not_read
    if left_out:
        raw = raw.rows(left_out, len(raw.columns[0]))
        first = "the first row is" if left_out == 1 else f"the first {left_out} rows are"
        not_read = (f"{first} left out: the next is stamped no later", *not_read)
    raw, not_read = _without_times_again(raw, read_as, not_read)
    columns, where, place = raw.columns, raw.where, raw.place
    headers, given = read_as.headers(raw.texts, where=where)
    headers = _told_apart(headers, read_as, where)
    clock, time_unit = time_column(headers, where, read_as)
    names = [header.name for header in headers]
    names = [h.text if names.count(h.name) > 1 else h.name for h in headers]
    unreadable = _unreadable(raw, names, clock, read_as)
    time = time_unit.to_si(columns[clock])
    if np.isnan(time).any():
        raise RecordingError(f"{place(int(np.argmax(np.isnan(time))))}: time is empty; every row needs its time")
    if time.size < MIN_SAMPLES:
        have = "1 sample" if time.size == 1 else f"{time.size} samples"
        raise RecordingError(f"{raw.file} has {have}; at least {MIN_SAMPLES} are needed")
    seconds_per_unit = time_unit.numerator / time_unit.denominator
    try:
        ticks, kept = _ticks(time, place, lambda: _half_step(raw, clock, seconds_per_unit))
    except RecordingError as error:
        if clock in given or not 0 < median(np.diff(time)) < TOO_FAST:
            raise
        raise RecordingError(
            f"{error}; if the times of {headers[clock].text!r} are seconds, say so with --unit time=s"
        ) from None
    if kept != ALL:
        columns, time = [column[kept] for column in columns], time[kept]
        which = "first" if kept == ALL_BUT_FIRST else "last"
        not_read = (f"the {which} row is left out: its time is off the clock of all others", *not_read)
    if ticks.printed:
        not_read = (
            f"the digits of the times are not used: they tell {ticks.printed:.4g} s, and rows share them; taken as"
            f" even, at {1 / ticks.step:.6g} Hz (--rate HZ if it was another)",
            *not_read,
        )
    signals, units = {}, {}
    for j, (column, header) in enumerate(zip(names, headers, strict=True)):
        if j == clock:
            continue
        unit = header.unit or (assumed_unit(header.name) if header.unit_text is None else None)
        units[column] = unit.si if unit else ("" if header.unit_text is None else "?")
        if j not in unreadable:
            signals[column] = _on_clock(unit.to_si(columns[j]) if unit else columns[j], ticks)
    origin = float(ticks.time[0]) if abs(ticks.time[0]) > DATED else 0.0
    shown = ticks.time
    if origin:
        shown = np.asarray(np.arange(shown.size) * ticks.step if ticks.even else shown - origin, dtype=np.float64)
    places = {role: j for role, j in read_as.places(headers, where=raw.file, clock=clock).items() if role != "time"}
    return Recording(
        name=name,
        path=raw.path,
        time=shown,
        origin=origin,
        step=ticks.step,
        signals=signals,
        units=units,
        headers={
            n: _header_text(h, j in given) for j, (n, h) in enumerate(zip(names, headers, strict=True)) if j != clock
        },
        assumed_units=tuple(n for n, h in zip(names, headers, strict=True) if h.unit_text is None and role_of(h.name)),
        unreadable={names[j]: told for j, told in unreadable.items()},
        even=ticks.even,
        missing_rows=ticks.time.size - time.size,
        not_read=not_read,
        clock=_header_text(headers[clock], clock in given),
        given_units=tuple("time" if j == clock else names[j] for j in sorted(given)),
        roles={role: names[j] for role, j in places.items()},
        motor=raw.motor,
    )


def _first_rows(raw: RawTable, read_as: ReadAs) -> int:
    """Return how many rows at the start are stamped no earlier than what follows: a logger's first stamps often are."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    clock, _ = time_column(headers, raw.where, read_as)
    time = raw.columns[clock]
    if not time.size:
        return 0
    falls = np.flatnonzero(np.diff(time) <= 0) + 1
    alike = int(np.argmax(time != time[0]))  # rows of one time, as a logger that waits for its clock writes
    most = min(max(MOST_LEFT_OUT, alike), time.size - MIN_SAMPLES - 3)
    return int(falls[-1]) if len(falls) and falls[-1] <= most else 0


def _called_no_time(raw: RawTable, read_as: ReadAs) -> None:
    """Raise the RecordingError of columns none of which is called time, and one of which rises as a time does."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    if "time" in read_as.columns or is_header([h.name for h in headers], read_as=read_as):
        return
    rising = [j for j, column in enumerate(raw.columns) if _rises_evenly(column)]
    if len(rising) == 1:
        (j,) = rising
        first, last = (float(raw.columns[j][k]) for k in (0, -1))
        raise RecordingError(
            f"{raw.where}: there is no time column ({', '.join(header.text for header in headers)}), but"
            f" {headers[j].text!r} rises evenly, from {first:.6g} to {last:.6g}: if it is the time, say so with"
            f" --column time={j + 1}, else --rate HZ"
        )


def _rises_evenly(column: FloatArray) -> bool:
    """Tell whether a column, (n,), has an even clock's steps, and not those of a counter."""
    steps = np.diff(column)
    if len(steps) < MIN_SAMPLES or not (steps > 0).all() or np.ptp(steps) > EVEN * steps.mean():
        return False
    return bool(abs(steps.mean() - 1) > 1e-9)


def _half_step(raw: RawTable, clock: int, factor: float) -> FloatArray:
    """Return half of the step in which each time, times the factor, can be told as it is written, (n,) s."""
    times = raw.columns[clock]
    half = np.zeros(times.size) if raw.half_digit is None else raw.half_digit(clock, 1.0)
    return np.asarray(factor * np.maximum(half, half_single_step(times, half)))


def _ticks(time: FloatArray, place: Callable[[int], str], half_digit: Callable[[], FloatArray]) -> tuple[Clock, slice]:
    """Return the clock of times, (m,) s, and the rows that are on it: all but the first or last, where that is off."""

    def of(kept: slice) -> tuple[Clock, slice]:
        return sampling_clock(time[kept], place=place, half_digit=lambda: half_digit()[kept]), kept

    try:
        return of(ALL)
    except RecordingError:
        for kept in (ALL_BUT_FIRST, ALL_BUT_LAST) if time.size >= LONG else ():
            with suppress(RecordingError):
                return of(kept)
        raise


def _without_times_again(raw: RawTable, read_as: ReadAs, not_read: tuple[str, ...]) -> tuple[RawTable, tuple[str, ...]]:
    """Leave out the few rows that a jittering clock stamps as the row before, and say so."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    clock, _ = time_column(headers, raw.where, read_as)
    if (whole := _stored_twice(raw, clock)) is not None:
        (again, left), why = whole, "the row before once more, its time too"
    else:
        again, why = times_again(raw.columns[clock]), "stamped as the row before"
        left = raw.without(again)
    if not len(again):
        return raw, not_read
    first = (
        f"{raw.place(int(again[0]))} is"
        if len(again) == 1
        else f"{len(again)} rows, the first at {raw.place(int(again[0]))}, are"
    )
    return left, (*not_read, f"{first} left out: {why}")


def _stored_twice(raw: RawTable, clock: int) -> tuple[NDArray[np.int64], RawTable] | None:
    """Return which rows are the row before in every column, where all others have a later time, and the file without.

    A cell that is empty in one of both says nothing, and is filled by the other. None: there are none.
    """
    same = np.diff(raw.columns[clock], prepend=np.nan) == 0
    first = np.flatnonzero(~same)
    if not same.any() or len(first) < MIN_SAMPLES or not np.all(np.diff(raw.columns[clock][first]) > 0):
        return None
    kept = [np.fmax.reduceat(column, first) for column in raw.columns]
    least = [np.fmin.reduceat(column, first) for column in raw.columns]
    if not all(np.array_equal(one, other, equal_nan=True) for one, other in zip(kept, least, strict=True)):
        return None
    again = np.flatnonzero(same)
    return again, replace(raw.without(again), columns=kept)


def _unreadable(raw: RawTable, names: Sequence[str], clock: int, read_as: ReadAs) -> dict[int, str]:
    """Return columns that cannot be used, and what is wrong with them; of columns by number only those that are meant.

    Raises
    ------
    RecordingError
        It is the time, or a column of numbers with a cell that is none.
    """
    bad, held, columns = raw.bad, raw.texts_in, raw.columns

    def not_a_number(j: int) -> str:
        if j in held:
            return f"{raw.file}: column {names[j]!r} holds {held[j]}, not numbers; export it as numbers"
        remedy = "every row needs its time" if j == clock else "leave the cell of a missing sample empty"
        if _THOUSANDS.fullmatch(bad[j].text):
            remedy = "write it without a mark between thousands, or all numbers with the same decimal mark"
        return f"{raw.file} line {bad[j].line}: {names[j]} is not a number ({bad[j].text!r}); {remedy}"

    has_numbers = [not np.isnan(column).all() for column in columns]
    numbers = read_as.numbers
    broken = [
        j
        for j in bad
        if (has_numbers[j] and (not numbers or names[j] in numbers or str(j + 1) in numbers)) or j == clock
    ]  # a column of nothing but text harms nobody until it is used
    if broken:
        raise RecordingError(not_a_number(min(broken, key=lambda j: bad[j].line)))
    found = {}
    for j, column in enumerate(columns):
        if (k := _huge(column, LARGEST_TIME if j == clock else LARGEST)) is not None:
            sample = f"{raw.place(k)}: {names[j]} is {float(column[k]):g}"
            remedy = "use NaN for a missing sample" if raw.text is None else "leave the cell of a missing sample empty"
            found[j] = f"{sample}, which nothing measures; {remedy}"
    if clock not in found and clock in held:
        found[clock] = not_a_number(clock)
    if clock in found:
        raise RecordingError(found[clock])
    return found | {j: not_a_number(j) for j in (*bad, *held)}


def _on_clock(column: FloatArray, clock: Clock) -> FloatArray:
    """Return samples, (n,), on their clock's grid, NaN where it has a row that the file lacks."""
    if clock.rows is None:
        return column
    spread = np.full(clock.time.size, np.nan)
    spread[clock.rows] = column
    return spread


def _header_text(header: Header, given: bool) -> str:
    """Return a header as written, but with the unit that the user said."""
    return f"{header.name} [{header.unit_text}]" if given else header.text


def _huge(column: FloatArray, largest: float) -> int | None:
    """Return the first sample that is too large to be one."""
    above = np.abs(column) > largest
    return int(np.argmax(above)) if above.any() else None
