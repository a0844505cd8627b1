"""A table of motors → one document a row. Knows tables and texts, no FMU and no recording.

``[motors]`` names a CSV; every ``{column}`` in the case file's texts then stands for that column of the row.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from estimator.cases import keys
from estimator.cases.keys import Keys
from estimator.cases.strict_toml import Document, Table

MOTORS = Keys(
    None,
    file=keys.text("CSV; {column} in this file's texts then stands for each row's cell", required=True),
    name=keys.text("column with the motors' names; default: the first"),
)


def expanded(document: Document) -> Iterator[tuple[str, Document]]:
    """Yield (motor, document) for each row of the table of motors; ("", document) if there is none.

    Raises
    ------
    CaseError
        The table cannot be read, a row is short or long, two rows have one name, or a column is missing.
    """
    if "motors" not in document.content:
        yield "", document
        return
    motors = document.table().table("motors")
    motors.only(*MOTORS)
    file = motors.file("file", what="table of motors")
    columns, rows, decimal = _table(motors, file)
    name = motors.text("name", default=columns[0])
    if name not in columns:
        motors.fail(("name",), f"{file.name} has no column {name!r} ({', '.join(columns)})")
    seen: dict[str, int] = {}
    for line, row in rows:
        motor = row[name]
        if not motor:
            motors.fail(("file",), f"{file.name} line {line} has no {name}; every row needs one")
        if motor in seen:
            motors.fail(("file",), f"{file.name} lines {seen[motor]} and {line} are both {motor!r}; each needs its own")
        seen[motor] = line
        yield motor, document.filled(row, row=f"with {file.name} line {line}, {motor}", decimal=decimal)


def told_apart(files: Sequence[Path], *, stems: Sequence[str] = ()) -> list[str]:
    """Return the shortest names that tell the files apart: their stems, else the ends of their paths."""
    names = list(stems) or [file.stem for file in files]
    depth = 1
    while len(set(names)) < len(names) and depth <= max(len(file.parts) for file in files):
        names = ["/".join(file.parts[-depth:]) for file in files]
        depth += 1
    return names


def _table(motors: Table, file: Path) -> tuple[list[str], list[tuple[int, dict[str, str]]], str]:
    """Read a CSV with a header → its columns, rows and decimal mark: a comma may be one where none separates the cells.

    Empty lines and lines that begin with # are left out.
    """
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        motors.fail(("file",), f"{file.name} cannot be read; save it as CSV in UTF-8")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), start=1) if line.strip() and line[0] != "#"]
    if len(lines) < 2:
        motors.fail(("file",), f"{file.name} has no row below its header; add one for each motor")
    header = lines[0][1]
    delimiter = max(",;\t", key=header.count)
    (_, header_cells), *below = _cells(motors, file, lines, delimiter)
    columns = [cell.strip() for cell in header_cells]
    for column in columns:
        if columns.count(column) > 1 or not column:
            motors.fail(
                ("file",), f"{file.name} line {lines[0][0]}: the column {column!r} is not unique; name each once"
            )
    rows = []
    for line, row in below:
        if len(row) != len(columns):
            motors.fail(("file",), f"{file.name} line {line} has {len(row)} cells, the header {len(columns)}")
        rows.append((line, dict(zip(columns, (cell.strip() for cell in row), strict=True))))
    return columns, rows, "." if delimiter == "," else ","


def _cells(motors: Table, file: Path, lines: Sequence[tuple[int, str]], delimiter: str) -> list[tuple[int, list[str]]]:
    """Return the cells of each row and the number of its first line; a cell in quotes may go over several."""
    reader = csv.reader((f"{line}\n" for _, line in lines), delimiter=delimiter, skipinitialspace=True)
    found, begins = [], 0
    try:
        for row in reader:
            found.append((lines[begins][0], row))
            begins = reader.line_num
    except csv.Error as error:
        motors.fail(("file",), f"{file.name} line {lines[begins][0]} cannot be read ({error}); end its quotes")
    return found
