"""Where the user wants a search to begin, beside its own start: values, or tables of earlier results. Runs nothing.

A table is a CSV file with a column for each parameter, named as it, with a unit or without (a batch's results.csv, or
one of your own, with decimal commas where no comma parts its cells), or the result.json of an earlier estimate. Other
columns, refused estimates and empty cells are passed over.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from estimator.cases.keys import CELL, TEXT, Key
from estimator.cases.strict_toml import Table, number_in
from estimator.errors import InputError, is_sized, suggestion
from estimator.recordings.headers import parse_header
from estimator.recordings.text_cells import number_in as cell_number

Start = Mapping[str, float] | str  # values in SI units, or a file's absolute path
REFUSED = ("refused", "failed")


def values_of(
    starts: Iterable[Start], reach: Mapping[str, tuple[float, float]], fixed: Collection[str]
) -> list[dict[str, float]]:
    """Return every start as parameter → value, SI, those of files read.

    Parameters
    ----------
    reach : each free parameter's bounds, SI; a table's values beyond them are left to whoever searches
    fixed : others that a start may name, which are held

    Raises
    ------
    InputError
        A start names what is no parameter or is beyond its bounds, or a file holds no value of one.
    """
    found: list[dict[str, float]] = []
    for start in starts:
        if isinstance(start, str):
            rows = [{n: x for n, x in row.items() if n in reach} for row in read_starts(Path(start))]
            rows = [row for row in rows if row]
            if not rows:
                raise InputError(
                    f"{Path(start).name} holds no start: no column is called as a free parameter ({', '.join(reach)})"
                )
            found += rows
            continue
        for name, value in start.items():
            if name not in reach and name not in fixed:
                raise InputError(f"a start is given for {name!r}, which is no parameter{suggestion(name, reach)}")
            low, high = reach.get(name, (value, value))
            if not low <= value <= high:
                raise InputError(f"the start {name} = {value:g} lies outside its bounds {low:g} to {high:g}")
        found.append({n: x for n, x in start.items() if n in reach})
    return found


def read_starts(path: Path) -> list[dict[str, float]]:
    """Return what a table of earlier results holds: column or parameter → value, SI; one mapping a row.

    Raises
    ------
    InputError
        It cannot be read, or is neither such a table nor a result.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = "there is no such file" if isinstance(error, FileNotFoundError) else "it cannot be read as text"
        raise InputError(f"the starts' file {path}: {why}; give a CSV of values or a result.json") from None
    if path.suffix.lower() == ".json":
        return [_of_result(path, text)]
    return _of_table(text)


def _of_result(path: Path, text: str) -> dict[str, float]:
    try:
        parameters = json.loads(text)["parameters"]
        return {name: float(p["value"]) for name, p in parameters.items() if p["value"] is not None}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{path.name} is no result of an estimate; give a result.json, or a CSV of values") from None


def _of_table(text: str) -> list[dict[str, float]]:
    delimiter = _delimiter(text)
    decimals = "." if delimiter == "," else ".,"
    lines = list(csv.reader(text.splitlines(), delimiter=delimiter))
    if not lines:
        return []
    headers = [parse_header(cell) for cell in lines[0]]
    verdict = next((k for k, h in enumerate(headers) if h.name == "verdict"), None)
    rows = []
    for line in lines[1:]:
        if verdict is not None and verdict < len(line) and line[verdict] in REFUSED:
            continue
        row = {}
        for header, cell in zip(headers, line, strict=False):
            known = (cell_number(cell.strip(), decimal) for decimal in decimals)
            value = next((number for number in known if number is not None), None)
            if value is not None and is_sized(value):
                row[header.name] = header.unit.to_si(value) if header.unit is not None else value
        rows.append(row)
    return rows


def _delimiter(text: str) -> str:
    first = text.split("\n", 1)[0]
    return max(",;\t", key=first.count)


def _read(table: Table, key: str) -> tuple[Start, ...]:
    given = table.value[key]
    entries = given if isinstance(given, list) else [given]
    found: list[Start] = []
    for entry in entries:
        if isinstance(entry, str):
            found.append(str(Table(table.document, table.way, {key: entry}).file(key, what="table of starts")))
            continue
        numbers = {name: number_in(value) for name, value in entry.items()} if isinstance(entry, dict) else {}
        start = {name: number for name, number in numbers.items() if number is not None}
        if not numbers or len(start) < len(numbers):
            table.fail((key,), f"{table.full(key)} must be files, or values such as {{ R = 3, K = 0.05 }}")
        found.append(start)
    return tuple(found)


_ENTRY = {"anyOf": [TEXT, {"type": "object", "additionalProperties": {"type": "number"}, "minProperties": 1}, CELL]}
STARTS = Key(
    _read,
    {
        "anyOf": [TEXT, {"type": "array", "items": _ENTRY, "minItems": 1}],
        "description": "further starts, each polished beside the search: values, or a CSV, a result.json",
    },
    lambda starts: [dict(s) if isinstance(s, Mapping) else s for s in starts],
)
