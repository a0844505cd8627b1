"""Text with a signal in each line, its name (and its unit) before its samples → columns. Knows no unit and no motor.

time [s],0,0.001,0.002,…    speed;rpm;0;0,1;…    voltage: [0, 5, 5, …]
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from estimator.errors import RecordingError
from estimator.recordings.columns import Columns
from estimator.recordings.headers import parse_header, role_of
from estimator.recordings.named_columns import named_columns
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.text_cells import EMPTY, decimal_mark, is_word, number_in, numbers_in, split_cells
from estimator.recordings.units import FloatArray, parse_unit

LOOKED_AT = 2  # lines that show how all are written
LISTED = re.compile(r"(\w[^:=\[\]]*?)\s*[:=]\s*\[(.*)\]?[,;]?")


class _Line(NamedTuple):
    """A line's name, the unit behind it, and its other cells."""

    name: str
    unit: str
    cells: list[str]


def are_signals_in_lines(path: Path, head: bytes) -> bool:
    """Whether each of a text's first lines is a name, another in each, and samples, as many as make a recording."""
    beginning = head.decode("utf-8-sig", "ignore").lstrip().split("\n")[0]
    if b"\0" in head or _samples(beginning[: beginning.rfind(",")] if "[" in beginning else beginning) is None:
        return False
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = [line for line, _ in zip(filter(str.strip, file), range(LOOKED_AT), strict=False)]
    found = [line for text in lines if (line := _samples(text.strip())) is not None]
    names = {line.name for line in found}
    return len(names) == LOOKED_AT and any(role_of(parse_header(name).name) is not None for name in names)


def read_signals_in_lines(path: Path, head: bytes) -> Columns:
    """Read a signal of each line.

    Raises
    ------
    RecordingError
        A line holds something else than samples, or not as many as the first.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    columns: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    for k, written in enumerate(text.split("\n"), 1):
        if not written.strip(EMPTY):
            continue
        line = _parted(written.strip())
        cells = [] if line is None else line.cells
        values, fault = numbers_in(cells, _decimal(cells))
        length = len(next(iter(columns.values()), values))
        if line is None or fault is not None or len(values) != length or line.name in columns:
            raise RecordingError(
                f"{path.name} holds a signal in each line, and line {k} is none, or not as long as the first ({length}"
                " samples); write one column a signal, below a header such as time [s],voltage [V],speed [rad/s]"
            )
        columns[line.name] = values
        units |= {line.name: line.unit} if line.unit else {}
    return named_columns(path.name, columns, units)


def _parted(text: str) -> _Line | None:
    """Return what a line holds; None where nothing parts its cells."""
    listed = LISTED.fullmatch(text)
    if listed is not None:
        return _Line(listed[1].strip("\"' "), "", split_cells(listed[2].rstrip("] "), ","))
    mark = next((mark for mark in "\t;," if mark in text), None)
    if mark is None:
        return None
    name, *cells = split_cells(text.rstrip(mark), mark)
    has_unit = len(cells) > 1 and is_word(cells[0]) and parse_unit(cells[0].strip("[]()")) is not None
    return _Line(name, cells[0].strip("[]()") if has_unit else "", cells[1:] if has_unit else cells)


def _samples(text: str) -> _Line | None:
    """Return a line that is a name and samples; None where it is not."""
    line = _parted(text)
    if line is None or not is_word(line.name) or number_in(line.name, ".") is not None:
        return None
    cells = line.cells[:-1]  # the last one may be cut
    _, fault = numbers_in(cells, _decimal(cells))
    return line if fault is None and len(cells) >= MIN_SAMPLES else None


def _decimal(cells: list[str]) -> str:
    return decimal_mark([" ".join(cells)], [0], None)
