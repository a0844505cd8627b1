"""Sequences under their names, of whatever cells → columns of numbers. Knows no file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.array_values import array_values
from estimator.recordings.columns import Columns
from estimator.recordings.headers import parse_header


def named_columns(name: str, columns: Mapping[str, Any], units: Mapping[str, str]) -> Columns:
    """Return header → (n,) samples as columns of numbers; dates and durations become seconds since the first.

    Parameters
    ----------
    name
        What messages call it.
    columns
        Header → samples; what holds no numbers is told as text.
    units
        Header → the unit of a column whose name says none.

    Raises
    ------
    RecordingError
        A column has another length than the first.
    """
    headers, arrays, held = [], [], {}
    for header, column in columns.items():
        if header in units and parse_header(header).unit_text is None:
            header = f"{header} [{units[header]}]"
        values, is_clock = array_values(column)
        if values is None:
            held[header] = "text"
            values = np.full(len(column), np.nan)
        if is_clock and parse_header(header).unit_text is None:
            header = f"{header} [s]"
        headers.append(header)
        arrays.append(values)
    for header, array in zip(headers, arrays, strict=True):
        if array.ndim != 1 or array.shape != arrays[0].shape:
            raise RecordingError(
                f"{name}: {header!r} has shape {array.shape}; it should be one-dimensional and as long as"
                f" {headers[0]!r}, {arrays[0].shape}"
            )
    return Columns(tuple(headers), tuple(arrays), held)
