"""The header of delimited text, and the words below it. Knows cells, no unit and no motor."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from estimator.errors import RecordingError
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.text_cells import (
    Cells,
    count_of_numbers,
    holds_numbers_only,
    is_number,
    is_word,
    number_in,
    shortened,
    split_cells,
    trimmed,
    unquoted,
    ways_to_split,
    width_of,
)

HEADER_EXAMPLE = "time [s],voltage [V],current [A],speed [rad/s]"
HEADER_LINES = 200  # the header is looked for in so many lines
WORDS_BELOW = 3  # lines between the names and the numbers, at most: of units, of comments
COUNTED = 20  # rows that show whether they are counted
RESTARTS = 3  # rows of the first at which a time may stand still or begin anew
SKIPPED = ("", "#", "%")  # first characters of empty lines and comments
_LIKE_A_NUMBER = re.compile(r"[-+]?[.,]?\d[-+\d.,:/eEdDTZ ]*")  # or a time of day, or a date

_WITH_UNIT = re.compile(r"[-+]?[\d.,]+\s?[^\s\d.,]{1,8}")  # "10.5 V"


@dataclass(frozen=True)
class HeaderRules:
    """How to know a header from its cells."""

    is_header: Callable[[Sequence[str]], bool]
    is_units: Callable[[Sequence[str]], bool]  # the line below the header holds the units
    complain: Callable[[str, Sequence[str]], NoReturn]  # place, cells that come nearest: no line is a header
    numbers: frozenset[str] = frozenset()  # columns that are asked for by number: none are the header's own names
    rated: bool = False  # the times are not in the file: each row stands for its place
    counted: bool = False  # the time is one of them: then none of them is a name


def find_header(path: Path, lines: list[str], rules: HeaderRules) -> tuple[int, str | None, Cells]:
    """Return the header's line index, the delimiter, and its cells."""
    content = [k for k in range(min(len(lines), HEADER_LINES)) if lines[k].lstrip()[:1] not in SKIPPED]
    if not content:
        raise RecordingError(f"{path.name} has no header; it should have one such as {HEADER_EXAMPLE}")
    first = content[0]
    above = list(itertools.takewhile(lambda k: not holds_numbers_only(lines[k]), content))
    below = dict(zip(content, content[1:], strict=False))
    numbers = content[len(above)] if len(above) < len(content) else None
    ways = [(k, *way) for k in above for way in ways_to_split(lines[k]) if rules.is_header(way[1])]
    if not ways and (commented := _commented_header(lines, first, rules)) is not None:
        return commented
    if not above:
        _no_header(path, lines, first)
    if not ways:
        named = [cells for _, cells in ways_to_split(lines[first]) if len(cells) > 1]
        if any(count_of_numbers(cells) > 1 and 2 * count_of_numbers(cells) > sum(map(bool, cells)) for cells in named):
            _no_header(path, lines, first)  # a word among numbers makes no header
        rules.complain(f"{path.name} line {first + 1}", named[0] if named else [lines[first].strip()])

    def likeliness(way: tuple[int, str | None, Cells]) -> tuple[bool, bool, bool, bool]:
        """Rate a header: names above numbers or units, as wide as the line below, and as the numbers, several cells."""
        k, delimiter, cells = way
        under = lines[below[k]] if k in below else ""
        fits = width_of(under, delimiter, len(cells)) == len(cells)
        is_above = holds_numbers_only(under) or rules.is_units(split_cells(under, delimiter))
        is_as_wide = numbers is not None and width_of(lines[numbers], delimiter, len(cells)) == len(cells)
        return fits and is_above and not rules.is_units(cells), fits, fits and is_as_wide, len(cells) > 1

    best = max(ways, key=likeliness)
    if not likeliness(best)[1]:  # by another delimiter a line of names is as wide as the numbers below it
        for k in above:
            for way in ways_to_split(lines[k]):
                if all(likeliness((k, *way))):
                    rules.complain(f"{path.name} line {k + 1}", way[1])
    at, delimiter, cells = best
    under = [split_cells(lines[k], delimiter) for k in content if k > at][:COUNTED]
    return at, delimiter, ["", *cells] if _are_counted(under, len(cells)) else cells


def _commented_header(lines: list[str], first: int, rules: HeaderRules) -> tuple[int, str | None, Cells] | None:
    """Return the header that is commented out above the first row, as numpy.savetxt and rostopic write it."""
    for k in [k for k in range(first) if lines[k].strip()][-1:]:
        for delimiter, cells in ways_to_split(lines[k].lstrip(" \t#%")):
            if rules.is_header(cells) and width_of(lines[first], delimiter, len(cells)) == len(cells):
                return k, delimiter, cells
    return None


def words_below(
    lines: list[str], rows: Sequence[int], delimiter: str | None, rules: HeaderRules
) -> tuple[Cells | None, int]:
    """Return the units that stand below the header, and how many rows there hold words: units, comments."""
    units, words = None, 0
    for k in rows[:WORDS_BELOW]:
        cells = split_cells(lines[k], delimiter)
        if units is None and rules.is_units(cells):
            units = cells
        elif any(_LIKE_A_NUMBER.fullmatch(cell) for cell in cells) or all(
            map(_WITH_UNIT.fullmatch, filter(is_word, cells))
        ):
            break
        words += 1
    return units, words


def begins_with_a_word(line: str) -> bool:
    """Tell whether a line begins with a word, which no row of numbers does."""
    first = re.match(r'[\s"^]*([^\W\d][^\s,;"]*)', line)
    return first is not None and is_word(first[1])


def said_below(place: str, words: Sequence[tuple[int, str]]) -> tuple[str, ...]:
    """Say which lines, or rows, below the last one of numbers are left out: their numbers and texts."""
    if not words:
        return ()
    (first, text), (last, _) = words[0], words[-1]
    if first == last:
        return (f"{place} {first}, below the last row, is left out: {shortened(text)!r}",)
    return (f"{place}s {first} to {last}, below the last row, are left out: {shortened(text)!r}, …",)


def has_header(path: Path, lines: list[str], rules: HeaderRules) -> bool:
    """Tell whether names stand above the numbers, though columns are asked for by number."""
    with suppress(RecordingError):
        return bool(find_header(path, lines, rules))
    return False


def numbered_columns(path: Path, lines: list[str]) -> tuple[int, str | None, Cells]:
    """Return the line before the first of numbers, the delimiter, and numbers as names."""
    numbered = [(k, line) for k, line in enumerate(lines) if line.lstrip()[:1] not in SKIPPED]
    for begins in (True, False):  # a scope's settings may stand before the samples, in the same lines
        for k, line in numbered:
            ways = [(d, split_cells(line, d)) for d in (";", "\t", ",", None)]
            ways = [(d, trimmed(cells, len(cells) - 1)) for d, cells in ways if not begins or is_number(cells[0])]
            delimiter, cells = max(ways, key=lambda way: count_of_numbers(way[1]), default=(None, []))
            if count_of_numbers(cells) > (0 if begins else 1):
                return k - 1, delimiter, [f"column {j + 1}" for j in range(len(cells))]
    raise RecordingError(f"{path.name} has no line that begins with a number; it should hold the samples")


def cells_above(lines: list[str], at: int, delimiter: str | None, width: int) -> tuple[Cells, ...]:
    """Return the cells of the lines above the numbers, the last first, that have as many as these: names, units."""
    written = [lines[k].lstrip(" \t#%") for k in range(at, -1, -1)]
    split = [split_cells(line, delimiter) for line in written if line][:WORDS_BELOW]
    return tuple(cells for cells in split if len(cells) == width)


def _are_counted(rows: Sequence[Cells], width: int) -> bool:
    """Tell whether rows begin with their number, which the header has no name for, as R and pandas write them."""
    counts = [unquoted(row[0]) for row in rows if len(trimmed(row, width)) == width + 1]
    return len(rows) > 1 and counts in ([str(k + begin) for k in range(len(rows))] for begin in (0, 1))


def _no_header(path: Path, lines: list[str], first: int) -> NoReturn:
    said = [line for line in lines if line.lstrip()[:1] not in SKIPPED]
    samples = max(count_of_numbers(cells) for cells in (split_cells(said[0], d) for d in (";", "\t", ",", None)))
    if len(said) < MIN_SAMPLES <= samples:
        raise RecordingError(
            f"{path.name} holds a signal in each line ({len(said)} lines of {samples} numbers) and no names; write the"
            f" name before each line's samples, or one column a signal, below a header such as {HEADER_EXAMPLE}"
        )
    columns, rising = _columns_of_numbers(path, lines)
    others = [j for j in columns if j != rising] or [1]
    example = f"--column v={others[0]}"
    if len(columns) > 1 and rising is not None:
        example = f"--column time={rising} {example}"
    elif len(columns) > 1:
        example += f" --column w={others[1]} --rate HZ, as no column rises like a time"
    else:
        example += " --rate HZ"
    raise RecordingError(
        f"{path.name} line {first + 1}: there is no header above the numbers;"
        f" name the columns, as in {HEADER_EXAMPLE}, or by their numbers, as in {example}"
    )


def _columns_of_numbers(path: Path, lines: list[str]) -> tuple[list[int], int | None]:
    """Return by number which columns of a file without a header hold nothing but numbers, and the first that rises."""
    at, delimiter, header = numbered_columns(path, lines)
    rows = [split_cells(line, delimiter) for line in lines[at + 1 :] if line.lstrip()[:1] not in SKIPPED]
    whole = [row for row in rows[:HEADER_LINES] if len(row) >= len(header)]
    found = [
        j
        for j in range(len(header))
        if all(is_number(row[j]) or ":" in row[j] and _LIKE_A_NUMBER.fullmatch(row[j]) for row in whole)
    ]
    rising = next((j for j in found if _rises([unquoted(row[j]) for row in whole])), None)
    return [j + 1 for j in found], None if rising is None else rising + 1


def _rises(cells: Cells) -> bool:
    """Tell whether a column's cells, of one test, rise as times do; times of day are taken to."""
    values = [number_in(cell, ",") if number_in(cell, ".") is None else number_in(cell, ".") for cell in cells]
    known = [value for value in values if value is not None]
    if len(known) < len(cells):
        return True
    falls = sum(after <= before for before, after in itertools.pairwise(known))
    return known[-1] > known[0] and falls <= RESTARTS
