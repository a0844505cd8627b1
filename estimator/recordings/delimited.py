"""Delimited text → a header and columns of numbers, in any usual dialect. Knows no time, units or motors."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.plain_text import plain_columns
from estimator.recordings.rewritten_lines import rewriter
from estimator.recordings.serial_lines import are_serial, delimited_lines
from estimator.recordings.text_cells import (
    EMPTY,
    Cells,
    decimal_mark,
    number_in,
    numbers_in,
    plain_block,
    shortened,
    split_cells,
    trimmed,
    unquoted,
    width_of,
)
from estimator.recordings.text_file import read_text
from estimator.recordings.text_header import (
    HEADER_EXAMPLE,
    HEADER_LINES,
    SKIPPED,
    HeaderRules,
    begins_with_a_word,
    cells_above,
    find_header,
    has_header,
    numbered_columns,
    said_below,
    words_below,
)
from estimator.recordings.units import FloatArray

CHUNK = 16384  # rows converted at a time
RARE = 0.01  # of the rows: so many may have too few cells, or too many
_KEEP = {
    ",": "leave the cell of a missing sample empty, but keep its comma",
    ";": "leave the cell of a missing sample empty, but keep its semicolon",
    "\t": "leave the cell of a missing sample empty, but keep its tab",
    None: "to leave the cell of a missing sample empty, separate the columns by commas",
}


@dataclass(frozen=True)
class BadCell:
    """A cell that is no number."""

    line: int
    text: str


@dataclass(frozen=True, eq=False)
class Table:
    """What a file of delimited text holds."""

    header: tuple[str, ...]
    header_line: int
    units: Sequence[str] | None  # a line of units below the header
    columns: tuple[FloatArray, ...]  # each (n,); NaN where a cell is empty or bad
    bad: dict[int, BadCell]  # column → its first cell that is no number
    line: Sequence[int]  # (n,) line number of each row
    text: Callable[[int], Iterator[str]]  # column → its n cells as written
    above: tuple[
        Cells, ...
    ] = ()  # of columns that are asked for by number: what stands above them, the last line first
    not_read: tuple[str, ...] = ()  # what of the lines below the header is no row, in sentences


def read_table(path: Path, rules: HeaderRules) -> Table:
    """Read a file of delimited text.

    Parameters
    ----------
    path
        The file: UTF-8, UTF-16 with its mark, or Latin-1; any line ends; cells separated by tab, semicolon,
        comma or spaces; decimal point, or decimal comma where the separator is another.
    rules
        How to know a header.

    Raises
    ------
    RecordingError
        The file is missing, no text, empty, without a header, or a row has too few or too many cells.
    """
    written, encoding = read_text(path)
    rewritten = _rewritten(path, written)
    if rewritten is None and (plain := _plain_table(path, written, encoding, rules)) is not None:
        return plain
    as_written = written.split("\n") if rewritten is None else rewritten
    lines, is_labelled = delimited_lines(as_written, rules.is_header)
    while lines and not lines[-1].strip(EMPTY):
        lines.pop()  # rows of empty cells at the end
    if not lines:
        lacks = "is empty" if rewritten is None else "holds no table of samples"
        raise RecordingError(f"{path.name} {lacks}; it should begin with a header such as {HEADER_EXAMPLE}")
    bare = bool(rules.numbers) and (rules.counted or not has_header(path, lines, rules))
    at, delimiter, header = numbered_columns(path, lines) if bare else find_header(path, lines, rules)
    rows = [k for k in range(at + 1, len(lines)) if lines[k].lstrip()[:1] not in SKIPPED]
    units, words = (None, 0) if bare else words_below(lines, rows, delimiter, rules)
    again = set() if bare else {lines[k] for k in (at, *rows[:words])}
    rows = [k for k in rows if lines[k] not in again]  # a logger that starts anew writes its header anew
    below: list[int] = []
    if rows and not begins_with_a_word(lines[rows[0]]):
        while begins_with_a_word(lines[rows[-1]]):
            below.insert(0, rows.pop())  # "End of test", "Mean,12.0,…"
    if not rows:
        raise RecordingError(f"{path.name} has no samples below line {at + 1}, {shortened(lines[at])!r}")
    width = len(header)
    decimal = decimal_mark(lines, rows, delimiter)
    first = 0 if is_labelled else 1  # number of the first line
    not_read = _said_between(as_written, lines[is_labelled:])
    if len(rows) > 1:
        before, last = (trimmed(split_cells(lines[k], delimiter), width) for k in rows[-2:])
        is_open = rows[-1] == len(lines) - 1 and not written.endswith("\n")
        if _is_cut(before, last, width=width, decimal=decimal, is_open=is_open):
            cut = rows.pop()
            not_read.append(f"line {cut + first}, the last row, is cut off and left out: {shortened(lines[cut])!r}")
    not_read += said_below("line", [(k + first, lines[k]) for k in below])
    rows, broken = _whole_rows(lines, rows, delimiter=delimiter, width=width, few=0 if rules.rated else RARE)
    not_read += _said_of_broken([k + first for k in broken], [lines[k] for k in broken])
    values = np.empty((width, len(rows)))
    bad: dict[int, BadCell] = {}
    for start in range(0, len(rows), CHUNK):
        numbers = rows[start : start + CHUNK]
        chunk = [lines[k] for k in numbers]
        here = slice(start, start + len(numbers))
        block = plain_block(chunk, delimiter=delimiter, width=width, decimal=decimal)
        if block is not None:
            values[:, here] = block.T
            continue
        cells = _rows(path, chunk, numbers, delimiter=delimiter, width=width, is_bare=bare)
        for j, column in enumerate(zip(*cells, strict=True)):
            values[j, here], first_bad = numbers_in(column, decimal)
            if first_bad is not None:
                bad.setdefault(j, BadCell(numbers[first_bad] + 1, unquoted(column[first_bad])))

    def text(column: int) -> Iterator[str]:
        for k in rows:
            yield split_cells(lines[k], delimiter)[column]

    return Table(
        header=tuple(header),
        header_line=at + 1,
        units=units,
        columns=tuple(values),
        bad=bad,
        line=[k + first for k in rows],
        text=text,
        above=cells_above(lines, at, delimiter, width) if bare else (),
        not_read=tuple(not_read),
    )


def _rewritten(path: Path, written: str) -> list[str] | None:
    """Return the lines of a text that is no header above rows, written so; None where it is."""
    way = rewriter(written.split("\n", HEADER_LINES)[:HEADER_LINES])
    try:
        return None if way is None else way(written.split("\n"))
    except OverflowError as error:
        raise RecordingError(f"{path.name} {error}") from None


def _plain_table(path: Path, written: str, encoding: str, rules: HeaderRules) -> Table | None:
    """Read a long file of nothing but numbers below its header at once; None where it is another."""
    head = written.split("\n", HEADER_LINES)[:HEADER_LINES]
    if len(head) < HEADER_LINES or rules.numbers or are_serial(head):
        return None
    at, delimiter, header = find_header(path, head, rules)
    if delimiter is None:
        return None
    units, words = words_below(head, range(at + 1, len(head)), delimiter, rules)
    first = at + 1 + words
    values = plain_columns(
        path,
        written,
        encoding=encoding,
        skipped=first,
        offset=sum(len(line) + 1 for line in head[:first]),
        delimiter=delimiter,
        width=len(header),
    )
    if values is None:
        return None
    n = values.shape[1]

    def text(column: int) -> Iterator[str]:
        for line in itertools.islice(written.split("\n"), first, first + n):
            yield split_cells(line, delimiter)[column]

    return Table(tuple(header), at + 1, units, tuple(values), {}, range(first + 1, first + n + 1), text)


def _whole_rows(
    lines: list[str], rows: list[int], *, delimiter: str | None, width: int, few: float
) -> tuple[list[int], list[int]]:
    """Part rows into those with as many cells as there are columns and the few others; none where they are not few.

    A serial line loses characters now and then; the times of the other rows show that a row is missing.
    """
    if len(rows) * few < 1:
        return rows, []
    if delimiter is None:
        odd = [k for k in rows if len(lines[k].split()) != width]
    else:
        odd = [k for k in rows if lines[k].count(delimiter) != width - 1]
    others = [k for k in odd if width_of(lines[k], delimiter, width) != width]
    if not others or len(others) > few * len(rows):
        return rows, []
    left_out = set(others)
    return [k for k in rows if k not in left_out], others


def _rows(
    path: Path, lines: list[str], numbers: list[int], *, delimiter: str | None, width: int, is_bare: bool
) -> list[Cells]:
    """Split lines into cells, ``width`` a line; bare: without a header that names them."""
    quoted = any('"' in line for line in lines)
    rows = [split_cells(line, delimiter) if quoted else line.split(delimiter) for line in lines]
    if all(len(row) == width for row in rows):
        return rows
    rows = [trimmed(row, width) for row in rows]
    for row, k in zip(rows, numbers, strict=True):
        if len(row) != width:
            few = "few" if len(row) < width else "many"
            if len(row) < width:
                hint = _KEEP[delimiter]
            elif delimiter == ",":
                hint = "with decimal commas, separate the columns by semicolons"
            else:
                hint = "every column needs a name in the header"
            above = "first row" if is_bare else "header"
            raise RecordingError(
                f"{path.name} line {k + 1} has too {few} cells ({len(row)}, the {above} has {width}); {hint}"
            )
    return rows


def _is_cut(before: Cells, last: Cells, *, width: int, decimal: str, is_open: bool) -> bool:
    """Tell whether the last row is a part of one, as of a logger that was stopped; open: without a line end."""
    if len(before) != width or len(last) > width:
        return False
    end = unquoted(last[-1])
    ends_midway = number_in(end, decimal) is None and number_in(f"{end}0", decimal) is not None  # "1e-"
    return len(last) < width or (is_open and bool(end) and ends_midway)


def _said_of_broken(numbers: list[int], lines: list[str]) -> list[str]:
    """Say which rows have not as many cells as the others."""
    if not lines:
        return []
    others = "" if len(lines) == 1 else f" and {len(lines) - 1} more"
    are_left = "is left out: it has" if len(lines) == 1 else "are left out: they have"
    return [
        f"line {numbers[0]}, {shortened(lines[0].strip())!r},{others} {are_left} not as many cells as the other rows"
    ]


def _said_between(written: list[str], read: list[str]) -> list[str]:
    """Say which lines of what an Arduino printed hold anything else than the others."""
    said = [k for k, (line, kept) in enumerate(zip(written, read, strict=False)) if line.strip() and not kept.strip()]
    if not said:
        return []
    first = f"line {said[0] + 1}, {shortened(written[said[0]].strip())!r},"
    return [f"{first} is no row and left out" if len(said) == 1 else f"{first} and {len(said) - 1} more are no rows"]
