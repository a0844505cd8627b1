"""Delimited text → a header and columns of numbers, in any usual dialect. Knows no time, units or motors."""

from __future__ import annotations

import codecs
import csv
import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.plain_text import plain_columns
from estimator.recordings.serial_lines import are_serial, delimited_lines
from estimator.recordings.suffixes import SUFFIXES
from estimator.recordings.units import FloatArray

HEADER_EXAMPLE = "time [s],voltage [V],current [A],speed [rad/s]"
HEADER_LINES = 200  # the header is looked for in so many lines
WORDS_BELOW = 3  # lines between the names and the numbers, at most: of units, of comments
COUNTED = 20  # rows that show whether they are counted
CHUNK = 16384  # rows converted at a time
_MISSING = frozenset(("nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "1.#qnan", "-nan", "nan(ind)"))
_SKIPPED = ("", "#", "%")  # first characters of empty lines and comments
_EMPTY = ' \t,;"'
_KEEP = {
    ",": "leave the cell of a missing sample empty, but keep its comma",
    ";": "leave the cell of a missing sample empty, but keep its semicolon",
    "\t": "leave the cell of a missing sample empty, but keep its tab",
    None: "to leave the cell of a missing sample empty, separate the columns by commas",
}
_CONTROL = bytes(set(range(32)) - set(b"\t\n\v\f\r\x1a\x1b"))  # never in a text
_LIKE_A_NUMBER = re.compile(r"[-+]?[.,]?\d[-+\d.,:/eETZ ]*")  # or a time of day, or a date
_TIMES = {word.encode(code): code for word, code in (("时间", "gb18030"), ("時間", "big5"), ("時間", "shift_jis"))}
_HEAD = 4096  # bytes within which a word for the time tells how a Chinese or Japanese file is written
_THOUSANDS = {  # decimal mark → a number in which the other one parts thousands: by both marks, no doubt
    ".": re.compile(r"[-+]?\d{1,3}(?:,\d{3})+\.\d+"),
    ",": re.compile(r"[-+]?\d{1,3}(?:\.\d{3})+,\d+"),
}
_TOKENS = re.compile(r'"[^"]*"|\S+')
_BRACKETED = re.compile(r"\s*([^\[\]()]+(?:\[[^\[\]]*\]|\([^()]*\)))")

Cells = list[str]


@dataclass(frozen=True)
class HeaderRules:
    """How to know a header from its cells."""

    is_header: Callable[[Sequence[str]], bool]
    is_units: Callable[[Sequence[str]], bool]  # the line below the header holds the units
    complain: Callable[[str, Sequence[str]], NoReturn]  # place, cells that come nearest: no line is a header
    numbers: frozenset[str] = frozenset()  # columns that are asked for by number: none are the header's own names
    counted: bool = False  # the time is one of them: then none of them is a name


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
    written, encoding = _read_text(path)
    if (plain := _plain_table(path, written, encoding, rules)) is not None:
        return plain
    as_written = written.split("\n")
    lines, is_labelled = delimited_lines(as_written, rules.is_header)
    while lines and not lines[-1].strip(_EMPTY):
        lines.pop()  # rows of empty cells at the end
    if not lines:
        raise RecordingError(f"{path.name} is empty; it should begin with a header such as {HEADER_EXAMPLE}")
    bare = rules.numbers and (rules.counted or not _has_header(path, lines, rules))
    at, delimiter, header = _numbered(path, lines) if bare else _find_header(path, lines, rules)
    rows = [k for k in range(at + 1, len(lines)) if lines[k].lstrip()[:1] not in _SKIPPED]
    units, words = (None, 0) if bare else _words_below(lines, rows, delimiter, rules)
    again = set() if bare else {lines[k] for k in (at, *rows[:words])}
    rows = [k for k in rows if lines[k] not in again]  # a logger that starts anew writes its header anew
    below: list[int] = []
    if rows and not _begins_with_a_word(lines[rows[0]]):
        while _begins_with_a_word(lines[rows[-1]]):
            below.insert(0, rows.pop())  # "End of test", "Mean,12.0,…"
    if not rows:
        raise RecordingError(f"{path.name} has no samples below line {at + 1}, {_short(lines[at])!r}")
    width = len(header)
    decimal = _decimal_mark(lines, rows, delimiter)
    first = 0 if is_labelled else 1  # number of the first line
    not_read = _said_between(as_written, lines[is_labelled:])
    if len(rows) > 1:
        before, last = (_trimmed(_split(lines[k], delimiter), width) for k in rows[-2:])
        is_open = rows[-1] == len(lines) - 1 and not written.endswith("\n")
        if _is_cut(before, last, width=width, decimal=decimal, is_open=is_open):
            cut = rows.pop()
            not_read.append(f"line {cut + first}, the last row, is cut off and left out: {_short(lines[cut])!r}")
    not_read += _said_below([k + first for k in below], [lines[k] for k in below])
    values = np.empty((width, len(rows)))
    bad: dict[int, BadCell] = {}
    for start in range(0, len(rows), CHUNK):
        numbers = rows[start : start + CHUNK]
        chunk = [lines[k] for k in numbers]
        here = slice(start, start + len(numbers))
        block = _plain_block(chunk, delimiter=delimiter, width=width, decimal=decimal)
        if block is not None:
            values[:, here] = block.T
            continue
        cells = _rows(path, chunk, numbers, delimiter=delimiter, width=width)
        for j, column in enumerate(zip(*cells, strict=True)):
            values[j, here], first_bad = _numbers(column, decimal)
            if first_bad is not None:
                bad.setdefault(j, BadCell(numbers[first_bad] + 1, _bare(column[first_bad])))

    def text(column: int) -> Iterator[str]:
        for k in rows:
            yield _split(lines[k], delimiter)[column]

    return Table(
        header=tuple(header),
        header_line=at + 1,
        units=units,
        columns=tuple(values),
        bad=bad,
        line=[k + first for k in rows],
        text=text,
        not_read=tuple(not_read),
    )


def _is_cut(before: Cells, last: Cells, *, width: int, decimal: str, is_open: bool) -> bool:
    """Tell whether the last row is a part of one, as of a logger that was stopped; open: without a line end."""
    if len(before) != width or len(last) > width:
        return False
    end = _bare(last[-1])
    ends_midway = _number(end, decimal) is None and _number(f"{end}0", decimal) is not None  # "1e-"
    return len(last) < width or (is_open and bool(end) and ends_midway)


def _said_below(numbers: list[int], lines: list[str]) -> list[str]:
    """Say which lines below the last row are none."""
    if not lines:
        return []
    if len(lines) == 1:
        return [f"line {numbers[0]}, below the last row, is left out: {_short(lines[0])!r}"]
    return [f"lines {numbers[0]} to {numbers[-1]}, below the last row, are left out: {_short(lines[0])!r}, …"]


def _said_between(written: list[str], read: list[str]) -> list[str]:
    """Say which lines of what an Arduino printed hold anything else than the others."""
    said = [k for k, (line, kept) in enumerate(zip(written, read, strict=False)) if line.strip() and not kept.strip()]
    if not said:
        return []
    first = f"line {said[0] + 1}, {_short(written[said[0]].strip())!r},"
    return [f"{first} is no row and left out" if len(said) == 1 else f"{first} and {len(said) - 1} more are no rows"]


def _plain_table(path: Path, written: str, encoding: str, rules: HeaderRules) -> Table | None:
    """Read a long file of nothing but numbers below its header at once; None where it is another."""
    head = written.split("\n", HEADER_LINES)[:HEADER_LINES]
    if len(head) < HEADER_LINES or rules.numbers or are_serial(head):
        return None
    at, delimiter, header = _find_header(path, head, rules)
    if delimiter is None:
        return None
    units, words = _words_below(head, range(at + 1, len(head)), delimiter, rules)
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
            yield _split(line, delimiter)[column]

    return Table(tuple(header), at + 1, units, tuple(values), {}, range(first + 1, first + n + 1), text)


def _words_below(
    lines: list[str], rows: Sequence[int], delimiter: str | None, rules: HeaderRules
) -> tuple[Cells | None, int]:
    """Return the units that stand below the header, and how many rows there hold words: units, comments."""
    units, words = None, 0
    for k in rows[:WORDS_BELOW]:
        cells = _split(lines[k], delimiter)
        if units is None and rules.is_units(cells):
            units = cells
        elif any(_LIKE_A_NUMBER.fullmatch(cell) for cell in cells) or not any(map(_is_word, cells)):
            break
        words += 1
    return units, words


def _begins_with_a_word(line: str) -> bool:
    first = re.match(r'[\s"^]*([^\W\d][^\s,;"]*)', line)
    return first is not None and _is_word(first[1])


def _is_word(cell: str) -> bool:
    return bool(cell) and cell.lower() not in _MISSING


def _meant(path: Path) -> str:
    """Return a question for who names a file that does not exist, where a recording beside it has nearly its name."""
    with suppress(OSError):
        beside = sorted(p.name for p in path.parent.iterdir() if p.suffix.lower() in SUFFIXES)
        same = [name for name in beside if Path(name).stem == path.name]
        for near in same or get_close_matches(path.name, beside, n=1):
            return f"; did you mean {near}?"
    return ""


def _read_text(path: Path) -> tuple[str, str]:
    """Return a file's text, its lines ended by line feeds, and how it is written."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise RecordingError(
            f"there is no recording {path}; give the path of a text file (CSV){_meant(path)}"
        ) from None
    except IsADirectoryError:
        raise RecordingError(f"{path} is a folder; give one of its files") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror or error}); make it readable") from None
    data = data.removeprefix(codecs.BOM_UTF8)
    encodings: tuple[str, ...] = ("utf-8", "latin-1")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ("utf-16",)
    elif len(data) != len(data.translate(None, _CONTROL)):
        raise RecordingError(f"{path.name} is not a text file; export the recording as CSV")
    encodings = (*(code for word, code in _TIMES.items() if word in data[:_HEAD]), *encodings)
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        return (text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text), encoding
    raise RecordingError(f"{path.name} begins as UTF-16 text and is none; export the recording as CSV in UTF-8")


def _find_header(path: Path, lines: list[str], rules: HeaderRules) -> tuple[int, str | None, Cells]:
    """Return the header's line index, the delimiter, and its cells."""
    content = [k for k in range(min(len(lines), HEADER_LINES)) if lines[k].lstrip()[:1] not in _SKIPPED]
    if not content:
        raise RecordingError(f"{path.name} has no header; it should have one such as {HEADER_EXAMPLE}")
    first = content[0]
    above = list(itertools.takewhile(lambda k: not _is_numeric(lines[k]), content))
    below = dict(zip(content, content[1:], strict=False))
    if not above:
        for k in [k for k in range(first) if lines[k].strip()][-1:]:  # numpy.savetxt comments its header out
            line = lines[k].lstrip(" \t#%")
            for delimiter, cells in _splits(line):
                if rules.is_header(cells) and _width(lines[first], delimiter, len(cells)) == len(cells):
                    return k, delimiter, cells
        _no_header(path, lines, first)
    ways = [(k, *way) for k in above for way in _splits(lines[k]) if rules.is_header(way[1])]
    if not ways:
        named = [cells for _, cells in _splits(lines[first]) if len(cells) > 1]
        if any(_numbers_in(cells) > 1 and 2 * _numbers_in(cells) > sum(map(bool, cells)) for cells in named):
            _no_header(path, lines, first)  # a word among numbers makes no header
        rules.complain(f"{path.name} line {first + 1}", named[0] if named else [lines[first].strip()])

    def likeliness(way: tuple[int, str | None, Cells]) -> tuple[bool, bool, bool]:
        """Rate a header: as wide as the line below, names above numbers or units, more than one cell."""
        k, delimiter, cells = way
        under = lines[below[k]] if k in below else ""
        fits = _width(under, delimiter, len(cells)) == len(cells)
        is_above = _is_numeric(under) or rules.is_units(_split(under, delimiter))
        return fits and is_above and not rules.is_units(cells), fits, len(cells) > 1

    best = max(ways, key=likeliness)
    if not likeliness(best)[1]:  # by another delimiter a line of names is as wide as the numbers below it
        for k in above:
            for way in _splits(lines[k]):
                if likeliness((k, *way)) == (True, True, True):
                    rules.complain(f"{path.name} line {k + 1}", way[1])
    at, delimiter, cells = best
    under = [_split(lines[k], delimiter) for k in content if k > at][:COUNTED]
    return at, delimiter, ["", *cells] if _are_counted(under, len(cells)) else cells


def _are_counted(rows: Sequence[Cells], width: int) -> bool:
    """Tell whether rows begin with their number, which the header has no name for, as R and pandas write them."""
    counts = [_bare(row[0]) for row in rows if len(_trimmed(row, width)) == width + 1]
    return len(rows) > 1 and counts in ([str(k + begin) for k in range(len(rows))] for begin in (0, 1))


def _no_header(path: Path, lines: list[str], first: int) -> NoReturn:
    columns = _columns_of_numbers(path, lines)
    example = "--column time={} --column v={}".format(*columns) if len(columns) > 1 else "--column v=1 --rate HZ"
    raise RecordingError(
        f"{path.name} line {first + 1}: there is no header above the numbers;"
        f" name the columns, as in {HEADER_EXAMPLE}, or by their numbers, as in {example}"
    )


def _columns_of_numbers(path: Path, lines: list[str]) -> list[int]:
    """Return by number which columns of a file without a header hold nothing but numbers."""
    at, delimiter, header = _numbered(path, lines)
    rows = [_split(line, delimiter) for line in lines[at + 1 :] if line.lstrip()[:1] not in _SKIPPED]
    whole = [row for row in rows[:HEADER_LINES] if len(row) >= len(header)]
    return [
        j + 1
        for j in range(len(header))
        if all(_is_number(row[j]) or ":" in row[j] and _LIKE_A_NUMBER.fullmatch(row[j]) for row in whole)
    ]


def _has_header(path: Path, lines: list[str], rules: HeaderRules) -> bool:
    """Tell whether names stand above the numbers, though columns are asked for by number."""
    with suppress(RecordingError):
        return bool(_find_header(path, lines, rules))
    return False


def _numbered(path: Path, lines: list[str]) -> tuple[int, str | None, Cells]:
    """Return the line before the first of numbers, the delimiter, and numbers as names."""
    numbered = [(k, line) for k, line in enumerate(lines) if line.lstrip()[:1] not in _SKIPPED]
    for begins in (True, False):  # a scope's settings may stand before the samples, in the same lines
        for k, line in numbered:
            ways = [(d, _split(line, d)) for d in (";", "\t", ",", None)]
            ways = [(d, _trimmed(cells, len(cells) - 1)) for d, cells in ways if not begins or _is_number(cells[0])]
            delimiter, cells = max(ways, key=lambda way: _numbers_in(way[1]), default=(None, []))
            if _numbers_in(cells) > (0 if begins else 1):
                return k - 1, delimiter, [f"column {j + 1}" for j in range(len(cells))]
    raise RecordingError(f"{path.name} has no line that begins with a number; it should hold the samples")


def _is_number(cell: str) -> bool:
    return _number(_bare(cell), ".") is not None


def _numbers_in(cells: Cells) -> int:
    return sum(map(_is_number, cells))


def _width(line: str, delimiter: str | None, width: int) -> int:
    return len(_trimmed(_split(line, delimiter), width))


def _splits(line: str) -> list[tuple[str | None, Cells]]:
    """Return each way to split a header, the likeliest first; spaces may be within names."""
    ways: list[tuple[str | None, Cells]] = []
    for delimiter in ("\t", ";", ","):
        cells = _split(line, delimiter)
        if len(cells) > 1 and not cells[-1]:
            cells.pop()  # a delimiter at the end of the line
        ways.append((delimiter, cells))
    ways.append((None, re.split(r"\s{2,}", line.strip())))
    bracketed = [cell.strip() for cell in _BRACKETED.findall(line)]
    if "".join("".join(bracketed).split()) == "".join(line.split()):
        ways.append((None, bracketed))
    ways.append((None, _split(line, None)))
    return ways


def _split(line: str, delimiter: str | None) -> Cells:
    if delimiter is None:
        return [cell.strip('"') for cell in _TOKENS.findall(line)]
    if '"' in line:
        with suppress(csv.Error):  # an endless cell
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(delimiter)]


def _trimmed(cells: Cells, width: int) -> Cells:
    """Leave out what a delimiter at the end of the line adds."""
    return cells[:width] if len(cells) == width + 1 and not cells[width].strip() else cells


def _rows(path: Path, lines: list[str], numbers: list[int], *, delimiter: str | None, width: int) -> list[Cells]:
    """Split lines into cells, ``width`` a line."""
    quoted = any('"' in line for line in lines)
    rows = [_split(line, delimiter) if quoted else line.split(delimiter) for line in lines]
    if all(len(row) == width for row in rows):
        return rows
    rows = [_trimmed(row, width) for row in rows]
    for row, k in zip(rows, numbers, strict=True):
        if len(row) != width:
            few = "few" if len(row) < width else "many"
            if len(row) < width:
                hint = _KEEP[delimiter]
            elif delimiter == ",":
                hint = "with decimal commas, separate the columns by semicolons"
            else:
                hint = "every column needs a name in the header"
            raise RecordingError(
                f"{path.name} line {k + 1} has too {few} cells ({len(row)}, the header has {width}); {hint}"
            )
    return rows


def _plain_block(lines: list[str], *, delimiter: str | None, width: int, decimal: str) -> FloatArray | None:
    """Return rows of nothing but finite numbers, NaN and empty cells, (rows, width), or None; the fast way."""
    if decimal == ",":
        if delimiter == "," or any("." in line for line in lines):
            return None
        lines = [line.replace(",", ".") for line in lines]
    block = _load(lines, delimiter, width)
    if block is not None:
        return None if np.isinf(block).any() else block
    text = "\n" + "\n".join(lines) + "\n"
    if delimiter is None:
        return None
    for before, after in (
        ("\n", delimiter),
        (delimiter, delimiter),
        (delimiter, delimiter),
        (delimiter, "\n"),
    ):
        text = text.replace(before + after, before + "nan" + after)
    block = _load(text[1:-1].split("\n"), delimiter, width)
    return None if block is None or np.isinf(block).any() else block


def _load(lines: list[str], delimiter: str | None, width: int) -> FloatArray | None:
    try:
        block = np.loadtxt(lines, dtype=np.float64, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    return block if block.shape == (len(lines), width) else None


def _decimal_mark(lines: list[str], rows: list[int], delimiter: str | None) -> str:
    """Return the decimal mark of the first number that has one."""
    for k in rows:
        line = lines[k]
        if delimiter == ",":
            line = " ".join(_split(line, delimiter))  # a comma within quotes is a decimal comma
        if mark := re.search(r"[.,](?=\d)", line):
            return mark[0]
    return "."


def _numbers(cells: Sequence[str], decimal: str) -> tuple[FloatArray, int | None]:
    """Return one column's numbers (NaN where there is none) and where the first bad cell is."""
    values = np.full(len(cells), np.nan)
    first_bad = None
    for k, cell in enumerate(cells):
        text = _bare(cell)
        if not text or text.lower() in _MISSING:
            continue
        value = _number(text, decimal)
        if value is not None:
            values[k] = value
        elif first_bad is None:
            first_bad = k
    return values, first_bad


def _number(text: str, decimal: str) -> float | None:
    if _THOUSANDS[decimal].fullmatch(text):
        text = text.replace("." if decimal == "," else ",", "")
    if "_" in text or (decimal == "," and "." in text):
        return None
    try:
        value = float(text.replace(",", ".") if decimal == "," else text)
    except ValueError:
        return None
    return value if -np.inf < value < np.inf else None


def _is_numeric(line: str) -> bool:
    """Tell whether a line holds numbers only, in whatever dialect."""
    cells = re.split(r'[\s,;"]+', line.strip(_EMPTY))
    return all(_number(cell, ".") is not None for cell in cells)


def _bare(cell: str) -> str:
    return cell.strip().strip('"').strip()


def _short(line: str) -> str:
    return line if len(line) <= 40 else line[:39] + "…"
