"""JSON → columns: a list of rows, a row in each line, or a list for each name. Knows no unit and no motor.

[{"time": 0.001, "voltage": 5}, …]    {"time": [0.001, …], "voltage": [5, …]}    {"feeds": [{…}, …]}
[["time", "voltage"], [0.001, 5], …]    {"columns": ["time", "voltage"], "data": [[0.001, 5], …]}
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from estimator.errors import RecordingError
from estimator.recordings.columns import Columns
from estimator.recordings.named_columns import named_columns
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.text_cells import is_number, number_in, shortened

TESTS = (
    "slow-forward",
    "slow-backward",
    "fast-forward",
    "fast-backward",
)  # of WPILib's SysId, which sysid_json.py reads
BEGINNING = re.compile(rb"(\xef\xbb\xbf)?\s*(\[\s*)?(\{|\[\s*[-\"\d])")


def is_json(path: Path, head: bytes) -> bool:
    """Return whether a file begins as a JSON object, or a list of such or of lists, by its first bytes."""
    return BEGINNING.match(head) is not None


def json_content(path: Path) -> tuple[Any, tuple[str, ...]]:
    """Return what a JSON file holds, of one with an object in each line their list; and what of it is not read.

    Raises
    ------
    RecordingError
        It is no JSON.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        return json.loads(text), ()
    except (ValueError, RecursionError) as error:
        fault = error
    rows: list[Any] = []
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    for k, line in lines:
        try:
            rows.append(json.loads(line))
        except (ValueError, RecursionError):
            if len(rows) < MIN_SAMPLES or k != lines[-1][0]:
                raise RecordingError(
                    f"{path.name} begins as JSON and is none ({fault}); export the recording as CSV"
                ) from None
            return rows, (f"line {k}, the last row, is cut off and left out: {shortened(line)!r}",)
    return rows, ()


def read_json(path: Path, head: bytes) -> Columns:
    """Read the table that a JSON file holds.

    Raises
    ------
    RecordingError
        It is no JSON, or holds no table.
    """
    content, not_read = json_content(path)
    found = _table(content)
    if not found and isinstance(content, Mapping):  # under a name of its own
        found = next((table for value in content.values() if (table := _table(value))), {})
    if not found:
        raise RecordingError(
            f"{path.name} is JSON without the tests of WPILib's SysId ({', '.join(TESTS)}), and without a table: a list"
            " of objects or of rows, or an object of lists; export the recording as CSV"
        )
    return replace(named_columns(path.name, found, {}), not_read=not_read)


def _table(content: Any) -> dict[str, list[Any]]:
    """Return the columns that are rows, or lists, of equal length; none where content is another thing."""
    if isinstance(content, Mapping) and content and all(map(is_number, content)):  # rows under their index
        return _with_index(_table(list(content.values())), content)
    if isinstance(content, list) and content and all(isinstance(row, Mapping) for row in content):
        rows = [_flat(row) for row in content]
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: [row.get(name) for row in rows] for name in names}
    if isinstance(content, list):
        is_named = bool(content) and isinstance(content[0], list) and all(isinstance(x, str) for x in content[0])
        return _of_rows(content[1:], content[0]) if is_named else _of_rows(content, None)
    if not isinstance(content, Mapping):
        return {}
    if isinstance(content.get("columns"), list):  # apart from the rows
        tables = [_of_rows(rows, content["columns"]) for rows in content.values() if rows is not content["columns"]]
        if table := next(filter(None, tables), {}):
            index = content.get("index")
            return _with_index(table, index if isinstance(index, list) else ())
    lists = {
        name: list(value.values()) if isinstance(value, Mapping) else value  # as pandas writes a column
        for name, value in content.items()
        if isinstance(value, list | Mapping)
    }
    lists = {name: value for name, value in lists.items() if not any(isinstance(x, list | Mapping) for x in value)}
    length = max((len(value) for value in lists.values()), default=0)
    table = {name: value for name, value in lists.items() if len(value) == length >= MIN_SAMPLES}
    return _with_index(table, next((value for value in content.values() if isinstance(value, Mapping)), ()))


def _of_rows(rows: Any, names: list[Any] | None) -> dict[str, list[Any]]:
    """Return the columns of rows that are lists as long as the names, without names called by their numbers."""
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows) or len(rows) < MIN_SAMPLES:
        return {}
    names = [f"column {j + 1}" for j in range(len(rows[0]))] if names is None else [str(name) for name in names]
    fits = len(set(names)) == len(names) and all(len(row) == len(names) for row in rows)
    return {name: [row[j] for row in rows] for j, name in enumerate(names)} if fits else {}


def _with_index(table: dict[str, list[Any]], index: Collection[Any]) -> dict[str, list[Any]]:
    """Return columns with the index of their rows, where it is as long and does more than count them."""
    numbers = [number_in(str(label), ".") for label in index]
    length = len(next(iter(table.values()), ()))
    if length != len(numbers) or numbers == list(range(length)):
        return table
    return {"index": list(index) if None in numbers else numbers, **table}


def _flat(row: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return a row's values with the names of objects within it before theirs: ``motor.speed``."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        flat |= _flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {before + name: value}
    return flat
