"""What a file holds before anything is made of it: headers, columns, cells that are no numbers. Knows no SI unit."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.clock_text import seconds_since_first
from estimator.recordings.columns import Columns
from estimator.recordings.delimited import BadCell, read_table
from estimator.recordings.formats import read_columns
from estimator.recordings.headers import ROLE_QUANTITY, are_units, parse_header, role_of
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.text_cells import is_word, numbers_in, unquoted
from estimator.recordings.text_header import HeaderRules
from estimator.recordings.time_column import is_header, no_time, time_column
from estimator.recordings.time_grid import half_last_digit
from estimator.recordings.units import FloatArray, parse_unit

_WITH_UNIT = re.compile(r"([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\s\d.,+-]\S*)")


@dataclass(frozen=True, eq=False)
class RawTable:
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
    not_read: tuple[str, ...] = ()  # what of the file is no row of it, in sentences
    motor: str | None = None  # whose rows these are, of a file whose rows are of several

    @property
    def file(self) -> str:
        """What messages call it."""
        return self.path.name if self.path else self.name

    def rows(self, first: int, last: int) -> RawTable:
        """Return the rows from one to before another."""
        half, place, text = self.half_digit, self.place, self.text
        return replace(
            self,
            columns=[column[first:last] for column in self.columns],
            place=lambda k: place(k + first),
            text=None if text is None else lambda j: itertools.islice(text(j), first, last),
            half_digit=None if half is None else lambda j, factor: half(j, factor)[first:last],
        )

    def without(self, left_out: NDArray[np.int64]) -> RawTable:
        """Return the rows but those of these indices."""
        is_kept = np.ones(len(self.columns[0]), dtype=bool)
        is_kept[left_out] = False
        kept = np.flatnonzero(is_kept)
        half, place, text = self.half_digit, self.place, self.text
        return replace(
            self,
            columns=[column[kept] for column in self.columns],
            place=lambda k: place(int(kept[k])),
            text=None if text is None else lambda j: itertools.compress(text(j), is_kept),
            half_digit=None if half is None else lambda j, factor: half(j, factor)[kept],
        )


def raw_table(path: Path, read_as: ReadAs) -> RawTable:
    """Read a file, of whatever kind."""
    columns = read_columns(path)
    if columns is None:
        return _read_text(path, read_as)
    return _with_times_at_the_end(raw_columns(path.stem, columns, path), read_as)


def raw_columns(name: str, columns: Columns, path: Path | None) -> RawTable:
    """Return columns as what a file holds."""
    where = path.name if path else name
    first = 1 if path and path.suffix.lower() == ".mat" else 0  # as the language counts that reads it
    texts = {j: columns.texts[header] for j, header in enumerate(columns.headers) if header in columns.texts}
    return RawTable(
        name,
        path,
        list(columns.headers),
        list(columns.columns),
        where=where,
        place=lambda k: f"{where} sample {k + first}",
        texts_in=texts,
        not_read=columns.not_read,
    )


def _unit_above(cells: Sequence[str], role: str) -> str | None:
    """Return the unit that stands above a column, as it is written, where it is one of the role's."""
    for cell in cells:
        header = parse_header(cell)
        unit = header.unit or parse_unit(cell)
        if unit is not None and unit.quantity == ROLE_QUANTITY.get(role):
            return header.unit_text or cell
    return None


def _with_one_unit(cells: list[str]) -> tuple[FloatArray, str] | None:
    """Return numbers and the unit that stands behind each of them, "10.5 V"; None where it is not one for all."""
    parts = [_WITH_UNIT.fullmatch(unquoted(cell)) for cell in cells if is_word(unquoted(cell))]
    units = {part[2] if part else "" for part in parts}
    unit = units.pop() if len(units) == 1 else ""
    if parse_unit(unit) is None:
        return None
    bare = [unquoted(cell).removesuffix(unit).strip() for cell in cells]
    values, fault = numbers_in(bare, "," if any("," in cell for cell in bare) else ".")
    return None if fault is not None else (values, unit)


def _are_a_count(values: FloatArray) -> bool:
    """Return whether values count the rows, or do not rise as times do."""
    steps = np.diff(values)
    return not bool((steps > 0).all()) or bool((steps == 1).all())


def _read_text(path: Path, read_as: ReadAs) -> RawTable:
    rules = HeaderRules(
        is_header=functools.partial(is_header, read_as=read_as),
        is_units=are_units,
        complain=functools.partial(no_time, read_as=read_as),
        numbers=read_as.numbers,
        rated=read_as.rate is not None,
        counted=read_as.columns.get("time") in read_as.numbers,
    )
    table = read_table(path, rules)
    texts = list(table.header)
    if table.units is not None:
        for j, unit in enumerate(table.units[: len(texts)]):
            if unit.strip("[]() ") and parse_header(texts[j]).unit_text is None:
                texts[j] = f"{texts[j]} [{unit.strip('[]() ')}]"
    if not texts[0] and not any(role_of(parse_header(text).name) == "time" for text in texts):
        texts[0] = "time" if 0 in table.bad or not _are_a_count(table.columns[0]) else ""  # an index without a name
    columns, bad = list(table.columns), dict(table.bad)
    for j in table.bad:
        header = parse_header(texts[j])
        is_clock = role_of(header.name) == "time" or read_as.columns.get("time") in (header.name, str(j + 1))
        if header.unit_text is not None or is_clock or not _WITH_UNIT.fullmatch(table.bad[j].text):
            continue
        if (split := _with_one_unit(list(table.text(j)))) is not None:
            columns[j], unit = split
            texts[j] = f"{header.name} [{unit}]"
            del bad[j]
    for role, number in read_as.columns.items() if table.above else ():
        j = int(number) - 1 if number.isdecimal() else len(texts)
        if 0 <= j < len(texts) and (above := _unit_above([cells[j] for cells in table.above], role)):
            texts[j] = f"{texts[j]} [{above}]"

    def place(k: int) -> str:
        return f"{path.name} line {table.line[k]}"

    where = path.name if read_as.numbers else f"{path.name} line {table.header_line}"
    keep = [j for j, text in enumerate(texts) if text or not np.isnan(table.columns[j]).all() or j in table.bad]
    half_digits = {}
    for j in keep:
        header = parse_header(texts[j])
        is_clock = role_of(header.name) == "time" or read_as.columns.get("time") in (header.name, str(j + 1))
        if j in bad and is_clock and (seconds := seconds_since_first(table.text(j))) is not None:
            columns[j], half_digits[j] = seconds
            texts[j] = f"{header.name} [s]"
            del bad[j]

    def half_digit(new: int, factor: float) -> FloatArray:
        if keep[new] in half_digits:
            return np.full(len(table.line), half_digits[keep[new]])
        return factor * half_last_digit(table.text(keep[new]), len(table.line))

    raw = RawTable(
        path.stem,
        path,
        [texts[j] or f"column {j + 1}" for j in keep],
        [columns[j] for j in keep],
        where=where,
        place=place,
        bad={new: bad[j] for new, j in enumerate(keep) if j in bad},
        half_digit=half_digit,
        text=lambda new: table.text(keep[new]),
        not_read=table.not_read,
    )
    return _with_times_at_the_end(raw, read_as)


def _with_times_at_the_end(raw: RawTable, read_as: ReadAs) -> RawTable:
    """Return a file without the rows at its end that have no time: of other columns that are longer."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    is_timed = "time" in read_as.columns or is_header([header.name for header in headers], read_as=read_as)
    if read_as.rate is not None or not is_timed:
        return raw
    clock, _ = time_column(headers, raw.where, read_as)
    known = np.flatnonzero(~np.isnan(raw.columns[clock]))
    if clock in raw.bad or len(known) < MIN_SAMPLES or int(known[-1]) + 1 != len(known):
        return raw
    more = len(raw.columns[clock]) - len(known)
    told = f"{more} row{'s' if more > 1 else ''} at the end without a time {'are' if more > 1 else 'is'} left out"
    return replace(raw.rows(0, len(known)), not_read=(*raw.not_read, *([told] if more else ())))
