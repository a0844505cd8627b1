"""LabVIEW measurement files (.lvm, text) → columns. Knows no unit and no motor.

A head of the file, then segments: a head of their own, with a cell for each channel, the names, and rows. A row begins
with the time (X_Columns One), has one before each channel (Multi), or an empty cell (No: then it is X0 + k Delta_X).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.clock_text import seconds_since_first
from estimator.recordings.columns import Columns, Signal, distinct, on_one_clock
from estimator.recordings.headers import parse_header
from estimator.recordings.units import FloatArray

END = "***End_of_Header***"
FIRST = "Channels"  # begins a segment's head
STAMP = len("hh:mm:ss.123456789")  # of a time of day: more digits than nanoseconds are none

Row = tuple[int, list[str]]  # line, cells


@dataclass
class _Segment:
    """A part of the file with a head of its own."""

    head: dict[str, list[str]]
    names: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)

    def cell(self, key: str, column: int) -> str:
        cells = self.head.get(key, [])
        return cells[column].strip() if column < len(cells) else ""

    def channels(self) -> list[int]:
        """Return in which columns the samples stand."""
        return [j for j in range(1, len(self.names)) if self.cell("Samples", j)]


def read_lvm(path: Path) -> Columns:
    """Read all channels, each on its clock; segments follow each other as their dates say.

    Raises
    ------
    RecordingError
        There are no samples, a cell is no number, or the segments hold different channels.
    """
    data = path.read_bytes()
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    words, segments = _segments(text.replace("\r\n", "\n"))
    if not segments or not any(segment.rows for segment in segments):
        raise RecordingError(f"{path.name} holds no samples below {END}; write the measurement again")
    columns, names = segments[0].channels(), segments[0].names
    if any(segment.names != names for segment in segments):
        raise RecordingError(f"{path.name} holds segments of different channels; save each as a file of its own")
    late = _late(segments)
    has_times = words.get("X_Columns") == "Multi"
    signals = []
    for j in columns:
        parts = []
        for begin, segment in zip(late, segments, strict=True):
            values = _numbers(path, segment.rows, j, names[j])
            times = _numbers(path, segment.rows, j - 1 if has_times else 0, "X_Value")
            if np.isnan(times).all():
                start, step = (_number(segment.cell(key, j)) for key in ("X0", "Delta_X"))
                times = np.asarray(start + np.arange(len(values)) * step)
            parts.append((begin + times, values))
        time, samples = (np.concatenate(part) for part in zip(*parts, strict=True))
        there = ~np.isnan(time)
        if not np.isnan(samples[there]).all():
            unit = segments[0].cell("Y_Unit_Label", j)
            said = parse_header(names[j]).unit is not None or not unit
            signals.append(Signal(names[j] if said else f"{names[j]} [{unit}]", samples[there], time[there]))
    if not signals:
        raise RecordingError(f"{path.name} holds no channel with samples and a clock (X_Value, or X0 and Delta_X)")
    headers = [signal.header for signal in signals]
    renamed = distinct(headers, headers)
    return on_one_clock(path, [Signal(h, s.values, s.time) for h, s in zip(renamed, signals, strict=True)])


def _segments(text: str) -> tuple[dict[str, str], list[_Segment]]:
    """Return what the file's head says, and the segments."""
    lines = text.split("\n")
    words: dict[str, str] = {}
    found: list[_Segment] = []
    comma = "," if any(line.rstrip(" ,\t") == "Separator,Comma" for line in lines[:30]) else "\t"
    in_head = True
    for k, line in enumerate(lines, start=1):
        cells = line.split(comma)
        if line.startswith(FIRST):
            found.append(_Segment({}))
            in_head = True
        if line.startswith(END):
            in_head = False
        elif not line.strip():
            continue
        elif not found:
            words[cells[0]] = cells[1].strip() if len(cells) > 1 else ""
        elif in_head:
            found[-1].head[cells[0]] = cells
        elif not found[-1].names:
            found[-1].names = [cell.strip() for cell in cells]
        else:
            found[-1].rows.append((k, cells))
    return words, found


def _late(segments: Sequence[_Segment]) -> FloatArray:
    """Return how much later than the first each segment began, (n,) s; 0 where X0 says it."""
    none = np.zeros(len(segments))
    starts = {segment.cell("X0", segment.channels()[0]) if segment.channels() else "" for segment in segments}
    stamps = [f"{segment.cell('Date', 1)} {segment.cell('Time', 1)[:STAMP]}" for segment in segments]
    since = seconds_since_first(stamps)
    return none if len(starts) > 1 or since is None else since[0]


def _numbers(path: Path, rows: Sequence[Row], column: int, name: str) -> FloatArray:
    """Return a column's numbers, (n,), with a decimal point or comma; NaN where there is none."""
    values = np.full(len(rows), np.nan)
    for k, (line, cells) in enumerate(rows):
        text = cells[column].strip() if column < len(cells) else ""
        if not text:
            continue
        values[k] = _number(text)
        if np.isnan(values[k]) and text.lower() != "nan":
            raise RecordingError(
                f"{path.name} line {line}: {name} is not a number ({text!r}); leave the cell of a missing sample empty"
            )
    return values


def _number(text: str) -> float:
    """Return a number with a decimal point or comma; NaN where it is none."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return np.nan
