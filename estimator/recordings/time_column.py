"""Which column of a file is its time, and in which unit. Knows headers, no samples."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NoReturn

from estimator.errors import RecordingError, suggestion
from estimator.recordings.headers import Header, assumed_unit, parse_header, plain, rank_in_role, role_of
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.units import Unit, examples, unit_of


def time_column(headers: list[Header], where: str, read_as: ReadAs) -> tuple[int, Unit]:
    """Return which column is the time, and its unit; the last one where the user gave the rate.

    Raises
    ------
    RecordingError
        There is none, or its unit is none of time.
    """
    if read_as.rate is not None:
        return len(headers) - 1, unit_of("time")
    if "time" in read_as.columns:
        ranked = [(0, read_as.places(headers, where=where)["time"])]
    else:
        ranked = [(rank, j) for j, h in enumerate(headers) if (rank := rank_in_role(h.name, "time")) is not None]
    if not ranked:
        no_time(where, [header.text for header in headers])
    clock = min(ranked)[1]
    header = headers[clock]
    usual = header.name if role_of(header.name) == "time" else "time"
    unit = header.unit if header.unit_text is not None else assumed_unit(usual)
    if unit is None or unit.quantity != "time":
        raise RecordingError(
            f"{where}: {header.unit_text!r} is no unit of time, in {header.text!r}; use one of {examples('time')}"
        )
    return clock, unit


def is_header(cells: Sequence[str], *, read_as: ReadAs) -> bool:
    """Return whether cells are a header: one of them is the time, or any signal where the times are not in the file."""
    names = [parse_header(cell).name for cell in cells]
    if "time" in read_as.columns:
        return plain(read_as.columns["time"]) in {plain(text) for text in (*names, *cells)}
    roles = {role_of(name) for name in names}
    if read_as.rate is None and "time" not in roles:  # a path may stand before it, or nothing may name an index
        roles |= {role_of(last) for name in names if len(last := re.split("[:/.]", name)[-1]) > 2} & {"time"}
        return "time" in roles or (not cells[0] and len(roles - {None}) > 1)
    return bool(roles - {None})


def no_time(where: str, cells: Sequence[str], *, read_as: ReadAs = AS_WRITTEN) -> NoReturn:
    """Raise the RecordingError of cells none of which is the time."""
    headers = [parse_header(cell) for cell in cells]
    free = [h for h in headers if role_of(h.name) in (None, "time")]  # no other signals
    in_unit = [h.text for h in free if h.unit is not None and h.unit.quantity == "time"]
    timed = in_unit or [h.text for h in free if rank_in_role(h.name, "time") is not None]
    meant = [h.text for h in free if h.unit is None or h.text in timed]
    usual = timed[0] if len(timed) == 1 else "time [s]"
    near = suggestion(read_as.columns.get("time", usual), cells, among=meant)
    raise RecordingError(
        f"{where}: there is no time column{near}; one column should be called time [s];"
        " --column time=… says which it is, or --rate HZ that there is none"
    )
