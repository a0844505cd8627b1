"""Signals as CSV, exact to the bit. Knows no motor and no file."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from estimator.results.result import FloatArray


def csv_bytes(columns: Mapping[str, FloatArray]) -> bytes:
    """Return columns of equal length as CSV, exact to the bit; a missing sample (NaN) is an empty cell."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    writer.writerows(["" if value != value else repr(value) for value in row] for row in rows)
    return stream.getvalue().encode()
