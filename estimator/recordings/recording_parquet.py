"""Parquet → columns. Knows pyarrow (extra: parquet); units stand in the names, the fields or pandas' attributes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError, to_install
from estimator.recordings.columns import Columns
from estimator.recordings.headers import parse_header, role_of

MAGIC = b"PAR1"


def read_parquet(path: Path) -> Columns:
    """Read a table; timestamps become seconds since the first.

    Raises
    ------
    RecordingError
        pyarrow is not installed, or the file is damaged.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise RecordingError(f"{path.name} is a Parquet file, which needs pyarrow; {to_install('parquet')}") from None
    try:
        table = parquet.read_table(path)
    except (pyarrow.ArrowException, OSError) as error:
        words = " ".join(str(error).split())[:100]
        raise RecordingError(f"{path.name} is a damaged Parquet file ({words}); export it again") from None
    units = _units(table.schema)
    index = _index(table.schema)
    headers, columns, texts = [], [], {}
    for j, name in enumerate(table.schema.names):
        header = str(name)
        if header in index and role_of(parse_header(header).name) is None:
            header = "time" if header.startswith("__") else header
        if header in units and parse_header(header).unit_text is None:
            header = f"{header} [{units[header]}]"
        values, in_seconds = _numbers(table.column(j), pyarrow)
        if values is None:
            texts[header] = str(table.schema.field(j).type)
            values = np.full(table.num_rows, np.nan)
        if in_seconds and parse_header(header).unit_text is None:
            header = f"{header} [s]"
        headers.append(header)
        columns.append(values)
    return Columns(tuple(headers), tuple(columns), texts)


def _numbers(column: Any, pyarrow: Any) -> tuple[Any, bool]:
    """Return a column as numbers, None if it holds none, and whether they are seconds."""
    kind = column.type
    if pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind):
        ticks = column.cast(pyarrow.int64()).to_numpy().astype(np.float64)
        exact = column.cast(pyarrow.int64())
        first = exact[0].as_py() if len(exact) and exact[0].is_valid and pyarrow.types.is_timestamp(kind) else 0
        if exact.null_count == 0:
            ticks = (exact.to_numpy() - first).astype(np.float64)
        return ticks / {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit], True
    if pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_decimal(kind):
        return column.cast(pyarrow.float64(), safe=False).to_numpy().astype(np.float64), False
    if pyarrow.types.is_boolean(kind):
        return column.cast(pyarrow.int8()).cast(pyarrow.float64()).to_numpy().astype(np.float64), False
    return None, False


def _units(schema: Any) -> dict[str, str]:
    """Return column → unit, from the fields' metadata and from pandas' attributes."""
    found: dict[str, str] = {}
    attributes = _pandas(schema).get("attributes") or {}
    given = attributes.get("units", {}) if isinstance(attributes, dict) else {}
    if isinstance(given, dict):
        found |= {str(name): str(unit) for name, unit in given.items()}
    for field in schema:
        for key in (b"unit", b"units"):
            if field.metadata and key in field.metadata:
                found[field.name] = field.metadata[key].decode("utf-8", "replace")
    return {name: unit for name, unit in found.items() if unit.strip()}


def _index(schema: Any) -> set[str]:
    return {name for name in _pandas(schema).get("index_columns", []) if isinstance(name, str)}


def _pandas(schema: Any) -> dict[str, Any]:
    try:
        content = json.loads((schema.metadata or {}).get(b"pandas", b"{}"))
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
