"""Rows that hold one value beside the name of what it is → a row for each time, a column for each name. Knows no motor.

``time,topic,value`` as Foxglove exports it, ``_time,_value,_field`` as InfluxDB does, in a table for each signal; a
TwinCAT Scope gives each signal a time of its own, Teleplot a line, ``>speed:1627551892437:61.4§rpm|g``, and InfluxDB's
line protocol the values of a time, ``motor,bench=2 voltage=12,speed=61.4 1627551892437000000``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from estimator.recordings.headers import parse_header, plain, rank_in_role, role_of
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.text_cells import holds_numbers_only, number_in, split_cells

NAMES: tuple[str, ...] = ("field", "topic", "signal", "signal_name", "name", "tag_name", "tag", "variable", "channel")
NAMES += ("sensor", "sensor_id", "metric", "series", "key")
VALUES, UNITS = ("value", "val", "reading"), ("unit", "units")
CELLS = 20_000_000  # at most: so many take some ten seconds
SETTINGS = 60  # lines of them above a TwinCAT Scope's numbers, at most
MOST = 0.5  # of the lines that say anything: in more of them a Teleplot's value stands
EVERY = "sampletime[ms]"  # a TwinCAT Scope says it of each signal
_SAMPLE = r"-?\d+(?:\.\d*)?:[^:;|§]+"
_TELEPLOT = re.compile(rf">?([^\W\d][^:|§]*):({_SAMPLE}(?:;{_SAMPLE})*);?(?:§([^|]*))?(?:\|\w*)?")
_FIELD = r"[^\s,=\"]+=(?:[^\s,=\"]+|\"[^\"]*\")"
_INFLUX = re.compile(rf"([^\s,=]+(?:,[^\s,=]+=[^\s,=]+)*) ({_FIELD}(?:,{_FIELD})*) (\d+)")


class Value(NamedTuple):
    """One sample of one signal: the line that it stands in, its time and itself as written."""

    line: int
    name: str
    time: str
    value: str


def with_names_read(lines: list[str]) -> list[str]:
    """Return rows of a time, a name and a value as rows of all values of a time; other lines unchanged."""
    at = next((k for k, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), 0)
    for mark in ",;\t" if lines else "":
        header = split_cells(lines[at], mark)
        keys = [plain(cell).strip("_") for cell in header]
        name, value, unit = (
            next((keys.index(key) for key in wanted if key in keys), None) for wanted in (NAMES, VALUES, UNITS)
        )
        times = [(rank, j) for j, cell in enumerate(header) if (rank := _rank(cell)) is not None]
        others = {role_of(parse_header(cell).name) for cell in header} - {"time", None}
        if name is None or value is None or not times or others:
            continue
        clock, found, again = min(times)[1], [], []
        for k, line in enumerate(lines[at + 1 :], at + 1):
            cells = split_cells(line, mark)
            if cells == header:  # of another table
                again.append(k)
            elif len(cells) == len(header) and line.lstrip()[0] not in "#%":
                said = "" if unit is None or not cells[unit] else f" [{cells[unit]}]"
                found.append(Value(k, cells[name] + said, cells[clock], cells[value]))
        if found and all(number_in(sample.name, ".") is None for sample in found):
            return _of_all(lines, header[clock], at, found, blank=again)
    return lines


def with_twincat_read(lines: list[str]) -> list[str]:
    """Return a TwinCAT Scope's columns, a time before each, as rows of all values of a time; other lines unchanged."""
    head = lines[:SETTINGS]
    first = next((k for k, line in enumerate(head) if line.strip(",;\t ") and holds_numbers_only(line)), 0)
    for mark in "\t;," if first else "":
        said = {cells[0].strip().lower(): cells[1::2] for line in head[:first] if (cells := split_cells(line, mark))}
        if EVERY not in said or not said.get("name"):
            continue
        units = said.get("unit") or [""] * len(said["name"])
        names = [
            f"{name} [{unit}]" if unit.strip("[]()") else name for name, unit in zip(said["name"], units, strict=False)
        ]
        found = []
        for k, line in enumerate(lines[first:], first):
            cells = split_cells(line, mark)
            pairs = zip(names, cells[::2], cells[1::2], strict=False)
            found += [Value(k, name, time, value) for name, time, value in pairs if time and value]
        return _of_all(lines, "time [ms]", first - 1, found, blank=range(first))
    return lines


def with_teleplot_read(lines: list[str]) -> list[str]:
    """Return Teleplot's lines, a value and its time in each, as rows of all values of a time; other lines unchanged."""
    matches = [(k, match) for k, line in enumerate(lines) if (match := _TELEPLOT.fullmatch(line.strip()))]
    if not matches or len(matches) <= MOST * sum(bool(line.strip()) for line in lines):
        return lines
    found = []
    for k, match in matches:
        name, samples, unit = match.groups()
        for sample in samples.split(";"):
            time, value = sample.split(":")
            found.append(Value(k, f"{name} [{unit}]" if unit else name, time, value))
    return _of_all(lines, "time [ms]", found[0].line, found)


def with_influx_read(lines: list[str]) -> list[str]:
    """Return rows of InfluxDB's line protocol as rows of all values of a time; other lines unchanged.

    What several series have is named behind its series.
    """
    matches = [(k, match) for k, line in enumerate(lines) if (match := _INFLUX.fullmatch(line.strip()))]
    if not matches or len(matches) <= MOST * sum(bool(line.strip()) for line in lines):
        return lines
    several = len({match[1] for _, match in matches}) > 1
    found = []
    for k, match in matches:
        for field in re.findall(_FIELD, match[2]):
            name, value = field.split("=", 1)
            whole = value[:-1] if value[-1] in "iu" else value  # 61i: a whole number
            found.append(Value(k, f"{match[1]} {name}" if several else name, match[3], whole))
    return _of_all(lines, "time", found[0].line, found)


def _number(text: str) -> float | None:
    return number_in(text.replace(",", "."), ".")


def _rank(cell: str) -> int | None:
    return rank_in_role(parse_header(cell).name, "time")


def _of_all(lines: list[str], clock: str, at: int, values: list[Value], blank: Iterable[int] = ()) -> list[str]:
    """Return the lines: a header in line `at`, a row where the last value of its time stands, if each has a line.

    A second value of one name at one time makes a second row. What has few numbers, such as a state, makes none.

    Raises
    ------
    OverflowError
        There are too many names at too many times.
    """
    names = list(dict.fromkeys(sample.name for sample in values))
    numbers = Counter(sample.name for sample in values if _number(sample.value) is not None)
    often = {name for name, count in numbers.items() if count >= MIN_SAMPLES} or set(names)
    rows: dict[tuple[str, int], dict[str, str]] = {}
    last: dict[tuple[str, int], int] = {}
    count: dict[tuple[str, str], int] = {}
    for sample in sorted(values, key=lambda sample: sample.name not in often):
        again = count[sample.name, sample.time] = count.get((sample.name, sample.time), -1) + 1
        key = (sample.time, again)
        if sample.name in often:
            last[key] = max(sample.line, last.get(key, 0))
        elif key not in last:
            continue
        rows.setdefault(key, {})[sample.name] = sample.value
    if len(rows) * len(names) > CELLS:
        raise OverflowError(f"holds values of {len(names)} names at {len(rows)} times; keep the motor's signals alone")
    seconds = {time: _number(time) for time, _ in rows}
    if None in seconds.values():  # dates, whose order is that of their texts
        ordered = sorted(rows, key=lambda key: (key[0].removesuffix("Z"), key[1]))
    else:
        ordered = sorted(rows, key=lambda key: (seconds[key[0]] or 0.0, key[1]))
    places = sorted({line for line in last.values() if line > at})
    if len(places) < len(rows):  # several times in a line
        places = list(range(at + 1, at + 1 + len(rows)))
    written = [*lines, *[""] * max(0, at + 1 + len(rows) - len(lines))]
    for k in (*blank, *(sample.line for sample in values)):
        written[k] = ""
    written[at] = "\t".join([clock, *names])
    for k, key in zip(places, ordered, strict=True):
        written[k] = "\t".join([key[0], *(rows[key].get(name, "") for name in names)])
    return written
