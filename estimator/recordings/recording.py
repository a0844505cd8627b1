"""Measured signals on one clock: reading, units, columns. Knows no model and no FMU.

SI inside, NaN for a missing sample. Sample k is taken at ``t0 + k * step``, or at its own time beside that where the
clock jitters.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from estimator.errors import RecordingError, suggestion
from estimator.locked import Locked
from estimator.recordings.clock_text import seconds_since_first
from estimator.recordings.columns import Columns
from estimator.recordings.delimited import BadCell, HeaderRules, read_table
from estimator.recordings.formats import read_columns
from estimator.recordings.headers import (
    Header,
    assumed_unit,
    parse_header,
    plain,
    quantity_of,
    rank_in_role,
    role_of,
)
from estimator.recordings.parts import Part, names_tests, parts
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.time_grid import Clock, half_last_digit, sampling_clock
from estimator.recordings.units import FloatArray, Unit, examples, parse_unit, unit_of

MIN_SAMPLES = 10
LARGEST = 1e10  # in any unit: no sensor shows more, nor a counter of 32 bits
DATED = 1e8  # s: a clock that begins later, some three years, counts from a date; it is told from its first row on
LARGEST_TIME = 1e20  # likewise: a clock shows up to 2e18 ns since 1970
MOST_LEFT_OUT = 2  # rows at the start, of wrong stamps


@dataclass(frozen=True, eq=False)
class Recording(Locked):
    """Measured signals on one clock."""

    name: str  # file stem
    path: Path | None
    time: FloatArray  # (n,) s, exactly t0 + k * step if even, read-only
    step: float  # s, sampling interval; the mean one if not even
    signals: Mapping[str, FloatArray]  # column without its unit → (n,) SI, NaN = missing, read-only
    units: Mapping[str, str]  # column → SI unit; "" for a strange column without a unit, "?" for a unit not known
    headers: Mapping[str, str]  # column → header as written, "speed [rpm]"
    assumed_units: tuple[str, ...] = ()  # columns without a unit, taken as SI; "time" too
    unreadable: Mapping[str, str] = field(default_factory=dict)  # columns of text → what is wrong with them
    even: bool = True  # the times are equidistant
    missing_rows: int = 0  # rows that the file lacks, as its times show; their samples are NaN
    made: Mapping[str, str] = field(default_factory=dict)  # column that follows from others → from which
    left_out: int = 0  # rows before the first whose time is before the next
    clock: str = "time [s]"  # header of the time, as written
    given_units: tuple[str, ...] = ()  # columns whose unit the user said, not their header; "time" too
    roles: Mapping[str, str] = field(default_factory=dict)  # role → column, as the user said
    origin: float = 0.0  # s, what the file's clock shows where `time` is 0; not 0 where it counts from a date

    def __post_init__(self) -> None:
        """Lock arrays and mappings."""
        for array in (self.time, *self.signals.values()):
            array.setflags(write=False)
        super().__post_init__()

    @property
    def title(self) -> str:
        """The file's name, with its folder or its test where the recording's name has it, or the recording's name."""
        if self.path is None or self.name.endswith(self.path.name):
            return self.name
        test = self.name.removeprefix(f"{self.path.stem} ")
        return f"{self.path.name} {test}" if test != self.name else self.path.name

    def between(self, first: int, last: int) -> Recording:
        """Return the samples from one to before another."""
        part = slice(first, last)
        signals = {name: signal[part].copy() for name, signal in self.signals.items()}
        return replace(self, time=self.time[part].copy(), signals=signals)

    def in_unit(self, name: str) -> Recording:
        """Return the recording with a column in the unit that ``speed [rpm]`` says, if its header says none."""
        asked = parse_header(name)
        bare = [c for c, h in self.headers.items() if plain(c) == plain(asked.name) and not parse_header(h).unit_text]
        if asked.unit is None or not bare or bare[0] not in self.signals:
            return self
        column, unit = bare[0], asked.unit
        guessed = assumed_unit(column)
        written = self.signals[column] if guessed is None else guessed.from_si(self.signals[column])
        return replace(
            self,
            signals={**self.signals, column: unit.to_si(written)},
            units={**self.units, column: unit.si},
            headers={**self.headers, column: f"{column} [{asked.unit_text}]"},
            assumed_units=tuple(c for c in self.assumed_units if c != column),
            given_units=(*self.given_units, column),
        )

    def column(self, name: str) -> str:
        """Return the column that is meant by its name, ``speed``, or its header, ``speed [rpm]``.

        Raises
        ------
        RecordingError
            There is no such column, there are several, it holds text, or its unit is not the one asked for.
        """
        asked = parse_header(name)
        if asked.text in self.unreadable or asked.name in self.unreadable:
            raise RecordingError(self.unreadable.get(asked.text) or self.unreadable[asked.name])
        if asked.text in self.signals:
            return asked.text
        written = {" ".join(header.split()): column for column, header in self.headers.items()}
        if asked.text in written:
            return written[asked.text]
        taken = {column: parse_header(header) for column, header in self.headers.items()}
        same = [c for c, header in taken.items() if asked.name in (c, header.name)]
        same = same or [c for c, header in taken.items() if plain(header.name) == plain(asked.name)]
        if asked.unit_text is not None:
            of_unit = [c for c in same if asked.unit and asked.unit == (taken[c].unit or assumed_unit(c))]
            if len(of_unit) == 1:
                return of_unit[0]
            if same and taken[same[0]].unit_text is None:
                raise RecordingError(
                    f"{self.title} has no column {name!r}: {same[0]!r} is written without a unit; put it in the header"
                )
        elif len(same) == 1:
            return same[0]
        elif same:
            several = " or ".join(repr(self.headers[c]) for c in same)
            raise RecordingError(f"{self.title} has more than one column {name!r}; say which: {several}")
        raise RecordingError(f"{self.title} has no column {name!r}{suggestion(name, self.headers.values())}")

    def signal(self, name: str, *, unit: str | None = None) -> FloatArray:
        """Return a column's samples, (n,) SI, NaN = missing, for use where a unit is expected.

        Parameters
        ----------
        name
            The column, as for ``column``.
        unit
            What it is to be used as, such as ``"A"`` (any unit of that quantity will do); by default what a
            column of that name usually holds. A unit that this package does not know is not checked.

        Raises
        ------
        RecordingError
            No such column, its unit does not fit, or it has no samples at all.
        """
        column = self.column(name)
        wanted = parse_unit(unit) if unit else None
        if wrong := self.fault(column, wanted.quantity if wanted else quantity_of(column)):
            raise RecordingError(wrong)
        return self.signals[column]

    def fault(self, column: str, quantity: str | None) -> str | None:
        """Say why a column cannot be used as a quantity (None: any), or return None if it can."""
        if column in self.unreadable:
            return self.unreadable[column]
        header = parse_header(self.headers[column])
        if quantity is not None and header.unit_text is not None and self.units[column]:
            given = parse_unit(self.units[column])
            if given is None or given.quantity != quantity:
                known = "is not a known unit" if given is None else f"is no unit of {quantity}"
                return (
                    f"{self.title}: column {header.text!r}: {header.unit_text!r} {known};"
                    f" use one of {examples(quantity)}"
                )
        if np.isnan(self.signals[column]).all():
            return f"{self.title}: column {column!r} is empty; it should hold the measured samples"
        return None


def read_recording(path: Path, read_as: ReadAs = AS_WRITTEN) -> Recording:
    """Read a recording: text with a header, MAT (v4 to v7.3), Parquet, MDF, Excel or TDMS, known by its content.

    Parameters
    ----------
    path
        The file.
    read_as
        What wins over its headers.

    Raises
    ------
    RecordingError
        One sentence: what is wrong, in which line, and what would be right.

    Examples
    --------
    >>> run = read_recording(Path("examples/cml050_step.csv"))
    >>> sorted(run.signals), run.step
    (['current', 'speed', 'voltage'], 0.001)
    """
    return _build(_raw(Path(path), read_as), read_as)


def read_recordings(path: Path, read_as: ReadAs = AS_WRITTEN) -> list[Recording]:
    """Read all tests that a file holds, each as a recording: mostly one.

    Parameters
    ----------
    path, read_as
        As `read_recording`; with `read_as.test` that test alone.

    Raises
    ------
    RecordingError
        As `read_recording`.
    """
    raw = _raw(Path(path), read_as)
    if read_as.test is not None:
        return [_build(raw, read_as)]
    labels = _labels(raw)
    try:
        whole = _build(raw, read_as)
    except RecordingError:
        tests = _tests(raw, read_as, labels)
        if len(tests) < 2:
            raise
    else:
        tests = _tests(raw, read_as, labels) if labels else []
    if len(tests) < 2:
        return [whole]
    return [_build(raw, replace(read_as, test=test.name)) for test in tests]


@dataclass(frozen=True, eq=False)
class _Raw:
    """What a file holds, before anything is made of it."""

    name: str
    path: Path | None
    texts: list[str]  # headers
    columns: list[FloatArray]
    where: str  # the header
    place: Callable[[int], str]
    bad: Mapping[int, BadCell] = field(default_factory=dict)
    texts_in: Mapping[int, str] = field(default_factory=dict)
    half_digit: Callable[[int, float], FloatArray] | None = None
    text: Callable[[int], Iterator[str]] | None = None  # column → its cells as written

    @property
    def file(self) -> str:
        """What messages call it."""
        return self.path.name if self.path else self.name

    def rows(self, first: int, last: int) -> _Raw:
        """Return the rows from one to before another."""
        half, place = self.half_digit, self.place
        return replace(
            self,
            columns=[column[first:last] for column in self.columns],
            place=lambda k: place(k + first),
            half_digit=None if half is None else lambda j, factor: half(j, factor)[first:last],
        )


def _raw(path: Path, read_as: ReadAs) -> _Raw:
    """Read a file, of whatever kind."""
    columns = read_columns(path)
    if columns is None:
        return _read_text(path, read_as)
    return _raw_columns(path.stem, columns, path)


def recording_from_columns(
    name: str, columns: Columns, *, path: Path | None = None, read_as: ReadAs = AS_WRITTEN
) -> Recording:
    """Make a recording from columns, one of them the time.

    Raises
    ------
    RecordingError
        There is no time, or something in a column is no sample.
    """
    return _build(_raw_columns(name, columns, path), read_as)


def _raw_columns(name: str, columns: Columns, path: Path | None) -> _Raw:
    """Return columns as what a file holds."""
    where = path.name if path else name
    _check_finite(where, columns.headers, columns.columns)
    texts = {j: columns.texts[header] for j, header in enumerate(columns.headers) if header in columns.texts}
    return _Raw(
        name,
        path,
        list(columns.headers),
        list(columns.columns),
        where=where,
        place=lambda k: f"{where} sample {k}",
        texts_in=texts,
    )


def _labels(raw: _Raw) -> dict[str, list[str]]:
    """Return the columns that name tests, as texts."""
    found = {}
    for j, text in enumerate(raw.texts):
        if not names_tests(parse_header(text).name):
            continue
        if j in raw.bad and raw.text is not None:
            found[text] = list(raw.text(j))
        elif j not in raw.texts_in and j not in raw.bad:
            found[text] = [f"{value:g}" for value in raw.columns[j].tolist()]
    return {name: texts for name, texts in found.items() if 1 < len(set(texts)) <= len(texts) // MIN_SAMPLES}


def _tests(raw: _Raw, read_as: ReadAs, labels: Mapping[str, Sequence[str]]) -> list[Part]:
    """Return the tests that a file holds; none where even its time is not known."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    clock, unit = _time_column(headers, raw.where, read_as)
    time = raw.columns[clock]
    if clock in raw.bad or clock in raw.texts_in or np.isnan(time).any():
        return []
    return parts(unit.to_si(time), labels, least=MIN_SAMPLES)


def _read_text(path: Path, read_as: ReadAs) -> _Raw:
    rules = HeaderRules(
        is_header=functools.partial(_is_header, read_as=read_as),
        is_units=_are_units,
        complain=functools.partial(_no_time, read_as=read_as),
        is_bare=read_as.by_number,
    )
    table = read_table(path, rules)
    texts = list(table.header)
    if table.units is not None:
        for j, unit in enumerate(table.units[: len(texts)]):
            if unit.strip("[]() ") and parse_header(texts[j]).unit_text is None:
                texts[j] = f"{texts[j]} [{unit.strip('[]() ')}]"

    def place(k: int) -> str:
        return f"{path.name} line {table.line[k]}"

    where = path.name if read_as.by_number else f"{path.name} line {table.header_line}"
    keep = [j for j, text in enumerate(texts) if text or not np.isnan(table.columns[j]).all() or j in table.bad]
    columns, bad, half_digits = list(table.columns), dict(table.bad), {}
    for j in keep:
        header = parse_header(texts[j])
        if j in bad and role_of(header.name) == "time" and (seconds := seconds_since_first(table.text(j))) is not None:
            columns[j], half_digits[j] = seconds
            texts[j] = f"{header.name} [s]"
            del bad[j]

    def half_digit(new: int, factor: float) -> FloatArray:
        if keep[new] in half_digits:
            return np.full(len(table.line), half_digits[keep[new]])
        return factor * half_last_digit(table.text(keep[new]), len(table.line))

    raw = _Raw(
        path.stem,
        path,
        [texts[j] or f"column {j + 1}" for j in keep],
        [columns[j] for j in keep],
        where=where,
        place=place,
        bad={new: bad[j] for new, j in enumerate(keep) if j in bad},
        half_digit=half_digit,
        text=lambda new: table.text(keep[new]),
    )
    return _with_times_at_the_end(raw, read_as)


def _with_times_at_the_end(raw: _Raw, read_as: ReadAs) -> _Raw:
    """Return a file without the rows at its end that have no time: of other columns that are longer."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    if read_as.rate is not None or not _is_header([header.name for header in headers], read_as=read_as):
        return raw
    clock, _ = _time_column(headers, raw.where, read_as)
    known = np.flatnonzero(~np.isnan(raw.columns[clock]))
    if clock in raw.bad or len(known) < MIN_SAMPLES or int(known[-1]) + 1 != len(known):
        return raw
    return raw.rows(0, len(known))


def recording_from_arrays(
    name: str, time: npt.ArrayLike, signals: Mapping[str, npt.ArrayLike], *, path: Path | None = None
) -> Recording:
    """Make a recording from arrays.

    Parameters
    ----------
    name
        What messages call it.
    time
        (n,) s, increasing in equal steps.
    signals
        Header → (n,) samples in the header's unit, as ``{"voltage [V]": v, "speed [rpm]": n}``; NaN is a
        missing sample.
    path
        Where it came from, if it is a file.

    Raises
    ------
    RecordingError
        An array has another shape, or something in it is no sample.

    Examples
    --------
    >>> time = [0.001 * k for k in range(10)]
    >>> run = recording_from_arrays("run", time, {"voltage [mV]": [5000.0] * 10, "speed [rpm]": [3000.0] * 10})
    >>> float(run.signals["voltage"][0]), run.units["speed"], round(float(run.signals["speed"][0]), 3)
    (5.0, 'rad/s', 314.159)
    """
    texts = ["time [s]", *signals]
    columns: list[FloatArray] = []
    for text, values in zip(texts, (time, *signals.values()), strict=True):
        try:
            columns.append(np.array(values, dtype=np.float64))
        except (ValueError, TypeError):
            raise RecordingError(f"{name}: {text!r} is not an array of numbers; give one float per sample") from None
    for text, column in zip(texts, columns, strict=True):
        if column.ndim != 1 or column.shape != columns[0].shape:
            raise RecordingError(
                f"{name}: {text!r} has shape {column.shape}; it should be one-dimensional and as long as time"
            )
    _check_finite(name, texts, columns)
    return _build(_Raw(name, path, texts, columns, where=name, place=lambda k: f"{name} sample {k}"), AS_WRITTEN)


def _check_finite(where: str, texts: Sequence[str], columns: Sequence[FloatArray]) -> None:
    for text, column in zip(texts, columns, strict=True):
        if np.isinf(column).any():
            k = int(np.argmax(np.isinf(column)))
            raise RecordingError(f"{where} sample {k}: {text!r} is infinite; use NaN for a missing sample")


def _is_header(cells: Sequence[str], *, read_as: ReadAs) -> bool:
    """Return whether cells are a header: one of them is the time, or any signal where the times are not in the file."""
    names = [parse_header(cell).name for cell in cells]
    if "time" in read_as.columns:
        return plain(read_as.columns["time"]) in {plain(text) for text in (*names, *cells)}
    roles = {role_of(name) for name in names}
    return bool(roles - {None}) if read_as.rate is not None else "time" in roles


def _no_time(where: str, cells: Sequence[str], *, read_as: ReadAs = AS_WRITTEN) -> NoReturn:
    named = read_as.columns.get("time", "time [s]")
    raise RecordingError(
        f"{where}: there is no time column{suggestion(named, cells)}; one column should be called time [s];"
        " --column time=… says which it is, or --rate HZ that there is none"
    )


def _are_units(cells: Sequence[str]) -> bool:
    bare = [cell.strip("[]() ") for cell in cells]
    return any(cell and not cell.isdigit() for cell in bare) and all(
        not cell or cell == "-" or (not cell[0].isdigit() and parse_unit(cell) is not None) for cell in bare
    )


def _build(raw: _Raw, read_as: ReadAs) -> Recording:
    """Check the columns, convert them to SI, and put them on their clock."""
    name = raw.name
    if read_as.rate is not None:
        times = np.arange(len(raw.columns[0]), dtype=np.float64) / read_as.rate
        raw = replace(raw, texts=[*raw.texts, "time [s]"], columns=[*raw.columns, times], half_digit=None)
    if read_as.test is not None:
        raw, name = _part(raw, read_as), f"{raw.name} {read_as.test}"
    left_out = _first_rows(raw, read_as)
    raw = raw.rows(left_out, len(raw.columns[0])) if left_out else raw
    columns, where, place = raw.columns, raw.where, raw.place
    headers, given = read_as.headers(raw.texts, where=where)
    written = [header.text for header in headers]
    for text in written:
        if written.count(text) > 1:
            raise RecordingError(f"{where}: two columns are called {text!r}; give each its own name")
    clock, time_unit = _time_column(headers, where, read_as)
    names = [header.name for header in headers]
    names = [h.text if names.count(h.name) > 1 else h.name for h in headers]
    unreadable = _unreadable(raw, names, clock, read_as)
    time = time_unit.to_si(columns[clock])
    if np.isnan(time).any():
        raise RecordingError(f"{place(int(np.argmax(np.isnan(time))))}: time is empty; every row needs its time")
    if time.size < MIN_SAMPLES:
        raise RecordingError(f"{raw.file} has {time.size} samples; at least {MIN_SAMPLES} are needed")
    seconds_per_unit, half_digit = time_unit.numerator / time_unit.denominator, raw.half_digit
    ticks = sampling_clock(
        time,
        place=place,
        half_digit=None if half_digit is None else lambda: half_digit(clock, seconds_per_unit),
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
    places = {role: j for role, j in read_as.places(headers, where=raw.file).items() if role != "time"}
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
        left_out=left_out,
        clock=_header_text(headers[clock], clock in given),
        given_units=tuple("time" if j == clock else names[j] for j in sorted(given)),
        roles={role: names[j] for role, j in places.items()},
    )


def _unreadable(raw: _Raw, names: Sequence[str], clock: int, read_as: ReadAs) -> dict[int, str]:
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
        return f"{raw.file} line {bad[j].line}: {names[j]} is not a number ({bad[j].text!r}); {remedy}"

    numbers = [not np.isnan(column).all() for column in columns]
    meant = {f"column {number}" for number in read_as.columns.values()} if read_as.by_number else set(names)
    broken = [
        j for j in bad if (numbers[j] and names[j] in meant) or j == clock
    ]  # a column of nothing but text harms nobody until it is used
    if broken:
        raise RecordingError(not_a_number(min(broken, key=lambda j: bad[j].line)))
    found = {}
    for j, column in enumerate(columns):
        if (k := _huge(column, LARGEST_TIME if j == clock else LARGEST)) is not None:
            sample = f"{raw.place(k)}: {names[j]} is {float(column[k]):g}"
            found[j] = f"{sample}, which nothing measures; leave the cell of a missing sample empty"
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


def _part(raw: _Raw, read_as: ReadAs) -> _Raw:
    """Return the rows of the test that is asked for."""
    found = _tests(raw, read_as, _labels(raw))
    chosen = next((part for part in found if part.name == read_as.test), None)
    if chosen is None:
        known = ", ".join(part.name for part in found[:20]) or "one test"
        raise RecordingError(f"{raw.file} has no test {read_as.test!r}; it holds {known}; take one of these")
    return raw.rows(chosen.first, chosen.last)


def _first_rows(raw: _Raw, read_as: ReadAs) -> int:
    """Return how many rows at the start are stamped no earlier than what follows: a logger's first stamps often are."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    clock, _ = _time_column(headers, raw.where, read_as)
    time = raw.columns[clock]
    falls = np.flatnonzero(np.diff(time) <= 0) + 1
    return int(falls[-1]) if len(falls) and falls[-1] <= MOST_LEFT_OUT and time.size > MIN_SAMPLES + 2 else 0


def _time_column(headers: list[Header], where: str, read_as: ReadAs) -> tuple[int, Unit]:
    if read_as.rate is not None:
        return len(headers) - 1, unit_of("time")
    if "time" in read_as.columns:
        ranked = [(0, read_as.places(headers, where=where)["time"])]
    else:
        ranked = [(rank, j) for j, h in enumerate(headers) if (rank := rank_in_role(h.name, "time")) is not None]
    if not ranked:
        _no_time(where, [header.text for header in headers])
    clock = min(ranked)[1]
    header = headers[clock]
    usual = header.name if role_of(header.name) == "time" else "time"
    unit = header.unit if header.unit_text is not None else assumed_unit(usual)
    if unit is None or unit.quantity != "time":
        raise RecordingError(
            f"{where}: {header.unit_text!r} is no unit of time, in {header.text!r}; use one of {examples('time')}"
        )
    return clock, unit
