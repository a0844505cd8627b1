"""Tables in memory → columns: a pandas or polars DataFrame, a mapping of arrays. Imports neither pandas nor polars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.headers import parse_header, role_of
from estimator.recordings.made_columns import with_made_columns
from estimator.recordings.named_columns import named_columns
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.reading import recording_from_columns
from estimator.recordings.recording import Recording


def is_table(thing: object) -> bool:
    """Whether a thing is a mapping of columns or a data frame."""
    return isinstance(thing, Mapping) or (hasattr(thing, "columns") and hasattr(thing, "__getitem__"))


def recording_from_table(name: str, table: Any, read_as: ReadAs = AS_WRITTEN) -> Recording:
    """Make a recording from a table.

    Parameters
    ----------
    name
        What messages call it.
    table
        A mapping of header → (n,) samples, or a DataFrame of pandas or polars. One column is the time; of pandas the
        index may be. Dates and durations become seconds since the first. What pandas' ``attrs["units"]`` says of a
        column is its unit where its name says none.
    read_as
        What wins over the headers.

    Raises
    ------
    RecordingError
        There is no time, a column has another length, or `read_as` names no column, or a test.
    """
    if read_as.test is not None:
        raise RecordingError(f"{name} is read as one test; give its rows of test {read_as.test!r} alone")
    columns = {str(header): table[header] for header in (table if isinstance(table, Mapping) else table.columns)}
    index = getattr(table, "index", None)
    if index is not None and not any(role_of(parse_header(header).name) == "time" for header in columns):
        named = getattr(index, "name", None)
        if named is not None or np.asarray(index).dtype.kind in "mM":
            header = str(named) if named is not None else "time"
            columns = {header if role_of(parse_header(header).name) == "time" else "time": index, **columns}
    attributes = getattr(table, "attrs", None)
    kept = attributes.get("units", {}) if isinstance(attributes, Mapping) else {}
    recording = recording_from_columns(name, named_columns(name, columns, kept), read_as=read_as)
    return with_made_columns(recording, read_as)
