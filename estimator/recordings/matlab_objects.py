"""Objects in MAT files → signals with their clocks. Knows mat-io (extra: mat), and no motor.

What is looked for, wherever it lies in the file:

    timeseries                     its samples; the times are given, or a start and an interval
    Simulink.SimulationData…       the time series that it holds, by the names of their signals
    Simulink.SimulationOutput      what lies in it, and arrays of To Workspace blocks over its tout
    the same, kept on disk         Simulink's signal streams: bytes in the file, with a start, an interval and a count
    timetable                      its columns over its row times
    iddata                         inputs and outputs of an experiment, with their names and units
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.columns import Signal, distinct
from estimator.recordings.headers import parse_header
from estimator.recordings.units import FloatArray, parse_unit

STREAMS = "#sigstream#"
DEPTH = 24  # of what lies in one another
TYPES = {"double": "<f8", "single": "<f4", "boolean": "<u1", "logical": "<u1"} | {
    f"{sign}int{bits}": f"<{'u' if sign else 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def object_signals(path: Path) -> list[Signal]:
    """Return the signals of a MAT file's objects; none where it holds no such objects.

    Raises
    ------
    ImportError
        mat-io is not installed.
    RecordingError
        It cannot be read.
    """
    streams, names = _streams(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from matio import load_from_mat

            content = load_from_mat(str(path), variable_names=names)
        found = [s for name, value in content.items() for s in _signals(value, _Context(streams, name))]
    except (RecordingError, ImportError):
        raise
    except Exception as error:  # mat-io raises whatever it stumbles over
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise RecordingError(f"the objects of {path.name} cannot be read ({words}); save vectors instead") from None
    headers = distinct([s.header for s in found], [s.header for s in found])
    return [Signal(header, s.values, s.time) for header, s in zip(headers, found, strict=True)]


class _Context:
    """Where one is in a file: its streams, and the name that what comes next has."""

    def __init__(self, streams: dict[int, bytes], name: str, depth: int = 0) -> None:
        self.streams, self.name, self.depth = streams, name, depth

    def inside(self, name: str = "") -> _Context:
        return _Context(self.streams, name or self.name, self.depth + 1)


def _streams(path: Path) -> tuple[dict[int, bytes], list[str] | None]:
    """Return Simulink's signal streams of a file of version 7.3, and the names of its variables."""
    import h5py

    if not h5py.is_hdf5(path):
        return {}, None
    with h5py.File(path, "r") as file:
        found = {}
        if STREAMS in file:
            for key in file[STREAMS]:
                if key.isdecimal():
                    found[int(key)] = np.asarray(file[STREAMS][key]["#data#"], dtype=np.uint8).tobytes()
        return found, [name for name in file if not name.startswith("#")]


def _signals(value: Any, at: _Context) -> Iterator[Signal]:
    if at.depth > DEPTH:
        return
    kind = getattr(value, "classname", "")
    if hasattr(value, "columns") and hasattr(value, "index"):
        yield from _of_timetable(value)
    elif isinstance(kind, str) and hasattr(value, "properties"):
        own = value.properties if isinstance(value.properties, dict) else {}
        if kind == "timeseries":
            yield from _of_timeseries(own, at)
        else:
            name = _text(own.get("Name")) or _block(own.get("BlockPath"))
            for item in own.values():
                yield from _signals(item, at.inside(name))
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _signals(item, at.inside(str(name)))
    elif isinstance(value, np.ndarray) and value.dtype.names:
        for record in value.ravel():
            yield from _of_structure({n: record[n] for n in value.dtype.names}, at)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for item in value.ravel():
            yield from _signals(item, at.inside())


def _of_structure(record: dict[str, Any], at: _Context) -> Iterator[Signal]:
    if {"CompressedTime", "DataR2", "SignalAttributes"} <= record.keys():
        signal = _of_stream(record, at)
        if signal is not None:
            yield signal
        return
    if {"OutputData", "InputData", "Ts"} <= record.keys():
        yield from _of_experiment(record)
        return
    yield from _of_output(record)
    name = _text(record.get("Name")) or _block(record.get("BlockPath"))
    for key, item in record.items():
        if key != "Name":
            yield from _signals(item, at.inside(name))


def _of_output(record: dict[str, Any]) -> Iterator[Signal]:
    """Yield the arrays of a simulation's output, (n,) or (n, columns), over the n times of its tout."""
    time = _numbers(record.get("tout"))
    for key, item in record.items() if len(time) > 1 else ():
        array = _cell(item)
        if key == "tout" or array is None or array.dtype.kind not in "iufb" or array.ndim != 2:
            continue
        block = array if array.shape[0] == len(time) else array.T
        if block.shape[0] == len(time):
            for k, column in enumerate(block.T):
                yield Signal(key if block.shape[1] == 1 else f"{key} {k + 1}", column.astype(float), time)


def _of_timeseries(own: dict[str, Any], at: _Context) -> Iterator[Signal]:
    clock = getattr(own.get("TimeInfo"), "properties", {})
    data = np.squeeze(np.asarray(own.get("Data_", own.get("Data"))))
    time = _numbers(own.get("Time_", own.get("Time")))
    time = time if len(time) else _numbers(clock.get("Time_"))
    if data.ndim == 0 or data.dtype.kind not in "iufb":
        return
    if not len(time):
        step, count = _numbers(clock.get("Increment_")), max(data.shape)
        start = _numbers(clock.get("Start_"))
        if not len(step) or not np.isfinite(step[0]):
            return
        time = (start[0] if len(start) else 0.0) + step[0] * np.arange(count)
    time = time * _seconds(_text(clock.get("Units")))
    if data.shape[0] != len(time):
        data = np.moveaxis(data, -1, 0)
    if data.shape[0] != len(time):
        return
    name = _text(own.get("Name"))
    name = at.name if name in ("", "unnamed") else name
    unit = _unit(getattr(own.get("DataInfo"), "properties", {}).get("Units"))
    columns = data.reshape(len(time), -1).astype(float)
    for k, column in enumerate(columns.T):
        yield Signal(_titled(name if columns.shape[1] == 1 else f"{name} {k + 1}", unit), column, time)


def _of_stream(record: dict[str, Any], at: _Context) -> Signal | None:
    """Return a signal whose samples lie in a stream; None where its times do too, or it has several columns."""
    attributes = _record(record["SignalAttributes"])
    kind = TYPES.get(_text(attributes.get("ClassName")))
    clock, number = _numbers(record["CompressedTime"]), _numbers(record["DataR2"])
    if kind is None or len(clock) != 3 or len(number) != 1 or int(number[0]) not in at.streams:
        return None
    samples = at.streams[int(number[0])]
    samples = samples[: len(samples) // int(kind[2]) * int(kind[2])]
    values = np.frombuffer(samples, kind).astype(float)
    count = int(clock[2])
    if len(values) != count:
        return None
    time = (clock[0] + clock[1] * np.arange(count)) * _seconds(_text(_record(record.get("TimeUnits")).get("Value")))
    unit = _unit(_record(record.get("DataUnits")).get("Value"))
    return Signal(_titled(_text(record.get("Name")) or at.name, unit), values, time)


def _of_timetable(table: Any) -> Iterator[Signal]:
    index = table.index
    if "timedelta" not in str(index.dtype):
        return
    time = index.total_seconds().to_numpy(dtype=float)
    for name in table.columns:
        values = table[name].to_numpy()
        if values.dtype.kind in "iufb":
            yield Signal(str(name), values.astype(float), time)


def _of_experiment(record: dict[str, Any]) -> Iterator[Signal]:
    """Yield the signals of the first experiment of an iddata."""
    step, start = _numbers(record["Ts"]), _numbers(record.get("Tstart"))
    if len(step) != 1:
        return
    seconds = _seconds(_text(record.get("TimeUnit")))
    for side in ("Input", "Output"):
        data = _cell(record[f"{side}Data"])
        if data is None or data.dtype.kind not in "iufb" or data.ndim != 2:
            continue
        names, units = _texts(record.get(f"{side}Name")), _texts(record.get(f"{side}Unit"))
        time = ((start[0] if len(start) else 0.0) + step[0] * np.arange(len(data))) * seconds
        for k, column in enumerate(data.T):
            name = names[k] if k < len(names) and names[k] else f"{side.lower()} {k + 1}"
            yield Signal(_titled(name, _unit(units[k] if k < len(units) else "")), column.astype(float), time)


def _block(path: Any) -> str:
    """Return the name of the block that a path ends at: what a signal without a name is called by."""
    if hasattr(path, "properties"):
        path = path.properties.get("path")
    return re.split("(?<!/)/(?!/)", _text(_cell(path)))[-1].replace("//", "/")  # a slash in a name is doubled


def _record(value: Any) -> dict[str, Any]:
    """Return a structure's first element, field → value."""
    value = _cell(value, structures=True)
    if isinstance(value, np.ndarray) and value.dtype.names and value.size:
        first = value.ravel()[0]
        return {name: first[name] for name in value.dtype.names}
    return {}


def _cell(value: Any, *, structures: bool = False) -> Any:
    """Return what lies in a cell in a cell: an array that is not one of objects."""
    for _ in range(DEPTH):
        if not (isinstance(value, np.ndarray) and value.dtype == object and value.size):
            break
        value = value.ravel()[0]
    fits = isinstance(value, np.ndarray) and (structures or not value.dtype.names)
    return value if fits else None


def _numbers(value: Any) -> FloatArray:
    value = _cell(value)
    if value is None or value.dtype.kind not in "iufb":
        return np.empty(0)
    return np.asarray(value, dtype=float).ravel()


def _text(value: Any) -> str:
    texts = _texts(value)
    return texts[0] if texts else ""


def _texts(value: Any) -> list[str]:
    if isinstance(value, str):
        return [value.strip()]
    if isinstance(value, np.ndarray) and value.dtype.kind in "US":
        return [str(text).strip() for text in value.ravel()]
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [_text(item) for item in value.ravel()]
    return []


def _unit(value: Any) -> str:
    return _text(value)


def _titled(name: str, unit: str) -> str:
    if not unit and "/" in name and (said := parse_unit(name)) is not None and said.quantity == "angular speed":
        return f"speed [{name}]"  # a signal that is called by its unit
    return f"{name} [{unit}]" if unit and parse_header(name).unit_text is None else name


def _seconds(unit: str) -> float:
    """Return the seconds of MATLAB's unit of a time; 1 for one that is not known."""
    known = parse_unit({"seconds": "s", "milliseconds": "ms", "microseconds": "us", "minutes": "min"}.get(unit, unit))
    return known.to_si(1.0) if known is not None and known.quantity == "time" else 1.0
