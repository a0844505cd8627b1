"""Text with a signal in each line, its name (and its unit) before its samples → columns. Knows no unit and no motor.

time [s],0,0.001,0.002,…    speed;rpm;0;0,1;…    voltage: [0, 5, 5, …]    v = [0 5 5 …];

A list may go over several lines, as YAML writes it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
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
LISTED = re.compile(r"(\w[^:=\[\]\n]*?)\s*[:=]\s*\[([^\]]*)\]?[,;]?")
BLOCK = re.compile(r"\w[^:=\n]*:[ \t\r]*\n\s*- [-+.\d]")  # a list of YAML, an item in each line


class _Line(NamedTuple):
    """A line's name, the unit behind it, and its other cells."""

    name: str
    unit: str
    cells: list[str]


def are_signals_in_lines(path: Path, head: bytes) -> bool:
    """Whether each of a text's first signals is a name, another in each, and samples, as many as make a recording."""
    beginning = head.decode("utf-8-sig", "ignore").lstrip()
    first = beginning.split("\n")[0]
    is_listed = LISTED.match(beginning) is not None or BLOCK.match(beginning) is not None
    if b"\0" in head or not (is_listed or _samples(first) is not None):
        return False
    found = [_samples(text) for _, text in itertools.islice(_signals(path), LOOKED_AT)]
    names = {line.name for line in found if line is not None}
    return len(names) == LOOKED_AT and any(role_of(parse_header(name).name) is not None for name in names)


def read_signals_in_lines(path: Path, head: bytes) -> Columns:
    """Read a signal of each line, or list.

    Raises
    ------
    RecordingError
        A line holds something else than samples, or not as many as the first.
    """
    columns: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    for k, text in _signals(path):
        line = _parted(text)
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


def _signals(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the number and the text of each line that says anything, a list that goes over several as one."""
    open_list: list[str] = []
    begin = 0
    for k, written in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").split("\n"), 1):
        line = written.strip()
        if open_list and line[:1] in ("", *"-+.[]0123456789"):
            open_list.append(f"{line[2:]}," if line.startswith("- ") else line)
        elif not line.strip(EMPTY):
            continue
        elif re.fullmatch(r"\w[^:=]*:|.*[:=]\s*\[[^\]]*", line):
            if open_list:
                yield begin, " ".join(open_list)
            open_list, begin = [f"{line} [" if line.endswith(":") else line], k
        else:
            yield k, line
        if open_list and "]" in open_list[-1]:
            yield begin, " ".join(open_list)
            open_list = []
    if open_list:
        yield begin, " ".join(open_list)


def _parted(text: str) -> _Line | None:
    """Return what a line holds; None where nothing parts its cells."""
    listed = LISTED.fullmatch(text)
    if listed is not None:
        cells = listed[2].rstrip("], ")
        return _Line(listed[1].strip("\"' "), "", split_cells(cells, "," if "," in cells else None))
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
