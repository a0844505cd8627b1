"""Excel (.xlsx) → columns. Knows openpyxl (extra: xlsx); units stand in the header, or in the row below it."""

from __future__ import annotations

import datetime
import itertools
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError, to_install
from estimator.recordings.columns import Columns
from estimator.recordings.headers import are_units, parse_header, role_of
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.text_cells import is_there, is_word
from estimator.recordings.text_header import WORDS_BELOW, begins_with_a_word, said_below
from estimator.recordings.units import FloatArray

MAGIC = b"PK\x03\x04"  # of any ZIP archive
OLD_MAGIC = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # of .xls
HEADER_ROWS = 200  # the header is looked for in so many rows
EPOCH = datetime.datetime(1970, 1, 1)

Row = tuple[Any, ...]


def is_xlsx(path: Path, head: bytes) -> bool:
    """Whether a file is an Excel workbook, from its first bytes and its table of contents."""
    if head.startswith(OLD_MAGIC):
        return True
    if not head.startswith(MAGIC):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return "xl/workbook.xml" in archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError):  # the second: a version of ZIP that no program writes
        return path.suffix.lower() in (".xlsx", ".xlsm")


def read_xlsx(path: Path, head: bytes) -> Columns:
    """Read the one sheet that has a header with a time, else the one of numbers; dates become seconds since the first.

    Raises
    ------
    RecordingError
        openpyxl is not installed, the file is damaged, no sheet or more than one holds a recording, or a cell among
        numbers is no number.
    """
    if head.startswith(OLD_MAGIC):
        raise RecordingError(f"{path.name} is an Excel file of before 2007; save it as .xlsx or as CSV")
    try:
        import openpyxl
    except ImportError:
        raise RecordingError(f"{path.name} is an Excel file, which needs openpyxl; {to_install('xlsx')}") from None
    found: dict[str, tuple[int, list[Row]]] = {}
    others: dict[str, tuple[int, list[Row]]] = {}
    try:
        with warnings.catch_warnings(), path.open("rb") as file:  # by its name openpyxl would refuse a "run.csv"
            warnings.simplefilter("ignore")  # of styles that openpyxl does not know
            book = openpyxl.load_workbook(file, read_only=True, data_only=True)
            try:
                for sheet in book.worksheets:
                    rows = [tuple(row) for row in sheet.iter_rows(values_only=True)]
                    at = next((k for k, row in enumerate(rows[:HEADER_ROWS]) if _has_time(row)), None)
                    if at is not None:
                        found[sheet.title] = (at, rows)
                    elif sum(map(_has_number, rows)) >= MIN_SAMPLES:
                        others[sheet.title] = (_above_numbers(rows), rows)
            finally:
                book.close()
    except Exception as error:  # openpyxl raises whatever it stumbles over
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise RecordingError(f"{path.name} is a damaged Excel file ({words}); save it again") from None
    long = {title: (at, rows) for title, (at, rows) in found.items() if sum(map(_has_number, rows[at:])) >= MIN_SAMPLES}
    found = long or found or (others if len(others) == 1 else {})
    if not found:
        raise RecordingError(
            f"{path.name} has no sheet with a time column; give one a header such as time [s], voltage [V], current [A]"
        )
    if len(found) > 1:
        sheets = " and ".join(repr(title) for title in found)
        raise RecordingError(f"{path.name} holds recordings on the sheets {sheets}; save each as a file of its own")
    ((title, (at, rows)),) = found.items()
    return _columns(f"{path.name} sheet {title!r}", at, rows)


def _columns(where: str, at: int, rows: list[Row]) -> Columns:
    width = max(map(len, rows))
    texts = [_text(cell) for cell in rows[at]] if at >= 0 else [f"column {j + 1}" for j in range(width)]
    first = at + 1
    while (
        at >= 0 and first < len(rows) and _has_names(rows[first])
    ):  # of groups, in cells that span several, names below
        below = [_text(cell) for cell in rows[first]]
        texts = [b or a for a, b in itertools.zip_longest(texts, below, fillvalue="")]
        first += 1
    if first < len(rows) and are_units([_text(cell) for cell in rows[first]]):
        for j, unit in enumerate(_text(cell).strip("[]() ") for cell in rows[first][: len(texts)]):
            if unit and parse_header(texts[j]).unit_text is None:
                texts[j] = f"{texts[j]} [{unit}]"
        first += 1
    first = next((k for k in range(first, min(first + WORDS_BELOW, len(rows))) if not _is_comment(rows[k])), first)
    body = [(k, row) for k, row in enumerate(rows[first:], start=first) if any(_text(cell) for cell in row)]
    words: list[tuple[int, Row]] = []
    if body and not _begins_with_a_word(body[0][1]):
        while _begins_with_a_word(body[-1][1]):
            words.insert(0, body.pop())  # "End of test", a mean
    headers, columns, held = [], [], {}
    for j, text in enumerate(texts):
        cells = [row[j] if j < len(row) else None for _, row in body]
        values, is_clock = _numbers(cells)
        if not text and all(cell is None for cell in cells):
            continue
        header = text or f"column {j + 1}"
        if is_clock and parse_header(header).unit_text is None:
            header = f"{header} [s]"
        wrong = _text_among(cells, values)
        if wrong is not None and any(value == value for value in values):
            raise RecordingError(
                f"{where} row {body[wrong][0] + 1}: {parse_header(header).name} is not a number"
                f" ({_text(cells[wrong])!r}); leave the cell of a missing sample empty"
            )
        if wrong is not None:
            held[header] = "text"
        headers.append(header)
        columns.append(values)
    return Columns(
        tuple(headers), tuple(columns), held, said_below("row", [(k + 1, _first_text(row)) for k, row in words])
    )


def _text_among(cells: Sequence[Any], values: FloatArray) -> int | None:
    """Return the first cell that is written and no number."""
    return next((k for k, cell in enumerate(cells) if is_there(_text(cell)) and np.isnan(values[k])), None)


def _numbers(cells: Sequence[Any]) -> tuple[FloatArray, bool]:
    """Return cells as numbers, NaN where there is none, and whether they were instants, now seconds since the first."""
    instants = [_instant(cell) for cell in cells]
    if cells and all(instant is not None for instant in instants):
        seconds = np.array(instants, dtype=np.float64)
        return np.asarray(seconds - seconds[0]), True
    return np.array([_number(cell) for cell in cells], dtype=np.float64), False


def _instant(cell: Any) -> float | None:
    if isinstance(cell, datetime.datetime):
        return (cell.replace(tzinfo=None) - EPOCH).total_seconds()
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    if isinstance(cell, datetime.time):
        return cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond / 1e6
    return None


def _number(cell: Any) -> float:
    if isinstance(cell, (int, float)):
        return float(cell)
    try:
        return float(_text(cell).replace(",", "."))
    except ValueError:
        return np.nan


def _text(cell: Any) -> str:
    return "" if cell is None else str(cell).strip()


def _first_text(row: Row) -> str:
    return next((text for cell in row if (text := _text(cell))), "")


def _begins_with_a_word(row: Row) -> bool:
    return begins_with_a_word(_first_text(row))


def _is_comment(row: Row) -> bool:
    """Return whether a row above the numbers holds words alone."""
    return bool(_first_text(row)) and all(
        not _text(cell) or (isinstance(cell, str) and begins_with_a_word(cell)) for cell in row
    )


def _has_number(row: Row) -> bool:
    return any(isinstance(cell, (int, float)) for cell in row)


def _above_numbers(rows: Sequence[Row]) -> int:
    """Return the row of names above the first numbers, that of units passed over; -1 where there is none."""
    first = next(k for k, row in enumerate(rows) if _has_number(row))
    named = [k for k in range(first) if any(_text(cell) for cell in rows[k])]
    return next((k for k in reversed(named) if not are_units([_text(cell) for cell in rows[k]])), -1)


def _has_names(row: Row) -> bool:
    """Return whether a row below a header holds names again, and not units or samples."""
    texts = [_text(cell) for cell in row if is_word(_text(cell))]
    if len(texts) < 2 or are_units(texts) or not all(isinstance(cell, str | None) for cell in row):
        return False
    return all(np.isnan(_number(text)) for text in texts) and any(role_of(parse_header(text).name) for text in texts)


def _has_time(row: Row) -> bool:
    texts = [cell for cell in row if isinstance(cell, str) and cell.strip()]
    return len(texts) > 1 and any(role_of(parse_header(text).name) == "time" for text in texts)
