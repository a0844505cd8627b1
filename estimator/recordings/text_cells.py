"""Lines of delimited text → cells, and cells → numbers. Knows no file and no header."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from estimator.recordings.units import FloatArray

Cells = list[str]
_NOT_THERE = frozenset(
    ("nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "1.#qnan", "-1.#ind", "-nan", "nan(ind)")
)
_NOT_THERE |= {"#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!"}  # of a spreadsheet that could not compute it
_BEYOND = {"ol", "o.l", "o.l.", "overload", "over", "ovrflw", "overflow", "overrange"}  # of a meter beyond its range
_MISSING = _NOT_THERE | _BEYOND
EMPTY = ' \t,;"'
_THOUSANDS = {  # decimal mark → a number in which the other one parts thousands: by both marks, no doubt
    ".": re.compile(r"[-+]?\d{1,3}(?:,\d{3})+\.\d+"),
    ",": re.compile(r"[-+]?\d{1,3}(?:\.\d{3})+,\d+"),
}
_BETWEEN_THOUSANDS = dict.fromkeys(map(ord, "'’\u00a0\u202f"))
_GROUPED = re.compile(r"[-+]?\d{1,3}(?:['’\u00a0\u202f]\d{3})+(?:[.,]\d+)?")  # as in Switzerland and France: no doubt
_INSTANTS = re.compile(r"\d{1,4}([./-])\d{1,2}\1\d{1,4}\b|\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?")  # dates, times of day
_NOTHING = re.compile(r"(?!)")
_TOKENS = re.compile(r'"[^"]*"|\S+')
_FORTRAN = re.compile(r"([-+]?[\d.,]+)[dD]([-+]?\d+)")  # 1.0D-03, of double precision
_BRACKETED = re.compile(r"[^\[\]()]+(?:\[[^\[\]]*\]|\([^()]*\))")
_BEHIND_BRACKETS = re.compile(r"(?<=[\])])")


def split_cells(line: str, delimiter: str | None) -> Cells:
    """Return the cells of a line, without the spaces about them; no delimiter: what spaces part, or quotes hold."""
    if delimiter is None:
        return [cell.strip('"') for cell in _TOKENS.findall(line)]
    if '"' in line:
        with suppress(csv.Error):  # an endless cell
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(delimiter)]


def ways_to_split(line: str) -> list[tuple[str | None, Cells]]:
    """Return each way to split a header, the likeliest first; spaces may be within names."""
    ways: list[tuple[str | None, Cells]] = []
    for delimiter in ("\t", ";", ","):
        cells = split_cells(line, delimiter)
        ways.append((delimiter, cells))
        if len(cells) > 1 and not cells[-1]:
            ways.append((delimiter, cells[:-1]))  # a delimiter at the end of the line
    ways.append((None, re.split(r"\s{2,}", line.strip())))
    bracketed = [cell.strip() for cell in _BEHIND_BRACKETS.split(line.strip()) if cell.strip()]
    if all(map(_BRACKETED.fullmatch, bracketed)):
        ways.append((None, bracketed))
    ways.append((None, split_cells(line, None)))
    return ways


def trimmed(cells: Cells, width: int) -> Cells:
    """Leave out what a delimiter at the end of the line adds."""
    return cells[:width] if len(cells) == width + 1 and not cells[width].strip() else cells


def width_of(line: str, delimiter: str | None, width: int) -> int:
    """Return how many cells a line has, beside a header of `width` cells."""
    return len(trimmed(split_cells(line, delimiter), width))


def unquoted(cell: str) -> str:
    """Return a cell without quotes and the spaces about them."""
    return cell.strip().strip('"').strip()


def shortened(line: str) -> str:
    """Return a line as a sentence shows it."""
    return line if len(line) <= 40 else line[:39] + "…"


def ungrouped(text: str) -> str:
    """Return a number's text without what parts its thousands, and is never a decimal mark."""
    return text.translate(_BETWEEN_THOUSANDS)


def number_in(text: str, decimal: str) -> float | None:
    """Return the finite number that a text is, by its decimal mark; None where it is none."""
    if _GROUPED.fullmatch(text):
        text = ungrouped(text)
    if _THOUSANDS[decimal].fullmatch(text):
        text = text.replace("." if decimal == "," else ",", "")
    if "_" in text or (decimal == "," and "." in text):
        return None
    if (fortran := _FORTRAN.fullmatch(text)) is not None:
        text = f"{fortran[1]}e{fortran[2]}"
    try:
        value = float(text.replace(",", ".") if decimal == "," else text)
    except ValueError:
        return None
    return value if -np.inf < value < np.inf else None


def is_number(cell: str) -> bool:
    """Tell whether a cell holds a number with a decimal point, or a whole one."""
    return number_in(unquoted(cell), ".") is not None


def count_of_numbers(cells: Cells) -> int:
    """Return how many cells hold numbers."""
    return sum(map(is_number, cells))


def numbers_in(cells: Sequence[str], decimal: str) -> tuple[FloatArray, int | None]:
    """Return one column's numbers (NaN where there is none) and where the first bad cell is."""
    values = np.full(len(cells), np.nan)
    first_bad = None
    for k, cell in enumerate(cells):
        text = unquoted(cell)
        if not text or text.lower() in _MISSING:
            continue
        value = number_in(text, decimal)
        if value is not None:
            values[k] = value
        elif first_bad is None:
            first_bad = k
    return values, first_bad


def holds_numbers_only(line: str) -> bool:
    """Tell whether a line holds numbers only, in whatever dialect."""
    cells = re.split(r'[\s,;"]+', line.strip(EMPTY))
    return all(number_in(cell, ".") is not None for cell in cells)


def is_there(cell: str) -> bool:
    """Tell whether a cell is written, and not by a program that had no sample."""
    return bool(cell) and cell.lower() not in _NOT_THERE


def is_word(cell: str) -> bool:
    """Tell whether a cell says anything, and not that a sample is missing."""
    return bool(cell) and cell.lower() not in _MISSING


def decimal_mark(lines: list[str], rows: list[int], delimiter: str | None) -> str:
    """Return the decimal mark of the first number that has one; of dates and times of day if no number has."""
    for ignored in (_INSTANTS, _NOTHING):
        for k in rows:
            line = lines[k]
            if delimiter == ",":
                line = " ".join(split_cells(line, delimiter))  # a comma within quotes is a decimal comma
            if mark := re.search(r"[.,](?=\d)", ignored.sub(" ", line)):
                return mark[0]
    return "."


def plain_block(lines: list[str], *, delimiter: str | None, width: int, decimal: str) -> FloatArray | None:
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
