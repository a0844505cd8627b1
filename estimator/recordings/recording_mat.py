"""MAT files of MATLAB and Simulink → columns. Knows scipy.io (v4 to v7), h5py (v7.3; extra: mat), the order of trials.

What is found, in this order:

    structure with time         out.time and out.signals(k).values, .label or .blockName, as Simulink logs them
    dSPACE's recorder           X.Data, and Y(k).Name, Y(k).Data
    signals with own clocks     i.Time and i.Data (a time series as a structure; .values, .signal), or i = [time, value]
    vectors                     t, v, i, w of one length, or each beside a time of its own (tv, time_v, v_time)
    a matrix and its names      data (n × m) beside m names, and m units where they are given
    objects                     timeseries, Simulink's Dataset, timetable, iddata (matlab_objects.py)
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError, to_install
from estimator.recordings.columns import Columns, Signal, distinct, on_one_clock
from estimator.recordings.headers import parse_header, rank_in_role
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.units import FloatArray, parse_unit

HDF5 = b"\x89HDF\r\n\x1a\n"
TEXT = b"MATLAB 5.0 MAT-file"
REMEDY = "save the vectors time, voltage, current and speed, or a structure of them"
_PORT = re.compile(r"(Out|In|Value)?\d*")  # of a block, the last part of a path
_CLOCK_OF = re.compile(r"(?:time|t)_?(\w+)|(\w+)_(?:time|t)", re.I)  # the time of one signal
MIN_ROWS = 3
SIGNALS = ("v", "i", "w")
RESPONSE = ("i", "w", "angle")
MOVING = (("v",), ("i",), ("w", "angle"))  # what a motor's recording has, one or the other


def is_mat(path: Path, head: bytes) -> bool:
    """Whether a file, of which the first 1 024 bytes are given, is a MAT file or HDF5."""
    return path.suffix.lower() == ".mat" or head.startswith((TEXT, HDF5)) or head[512:520] == HDF5


def read_mat(path: Path, head: bytes) -> Columns:
    """Read a MAT file.

    Raises
    ------
    RecordingError
        It is damaged, or holds nothing with a clock; or h5py or mat-io is not installed.
    """
    content, objects = _hdf5(path) if HDF5 in (head[:8], head[512:520]) else _scipy(path)
    if found := _structure_with_time(content):
        return on_one_clock(path, found)
    groups = [group for _, group in _groups(content, ())]
    for reading in (_recorder, _own_clocks, partial(_vectors, path), partial(_matrix, path)):
        for group in groups:
            signals = reading(group)
            if signals:
                if objects and not _has_response(signals):  # logged beside its stimulus
                    signals = _with_objects(path, objects, signals)
                lengths = {len(signal.time) for signal in signals}
                return replace(on_one_clock(path, signals), not_read=_not_as_long(group, lengths))
    if objects:
        found = _objects(path, objects)
        if found:
            return on_one_clock(path, found)
    for group in groups:
        if columns := _without_clock(group):
            return replace(columns, not_read=_not_as_long(group, {len(columns.columns[0])}))
    if objects:
        raise RecordingError(f"{path.name} holds {objects}, and in it no signal with a clock; {REMEDY}")
    names = ", ".join(_with_length(name, value) for name, value in content.items()) or "nothing"
    raise RecordingError(f"{path.name} holds no time with signals of its length ({names}); {REMEDY}")


def _objects(path: Path, objects: str) -> list[Signal]:
    from estimator.recordings.matlab_objects import object_signals

    try:
        return object_signals(path)
    except ImportError:
        raise RecordingError(
            f"{path.name} holds {objects}, which needs mat-io; {to_install('mat')}, or {REMEDY}"
        ) from None


def _has_response(signals: list[Signal]) -> bool:
    """Whether one of the signals is what a motor answers with: a current, a speed, an angle."""
    names = [parse_header(signal.header).name for signal in signals]
    return any(rank_in_role(name, role) is not None for name in names for role in RESPONSE)


def _with_objects(path: Path, objects: str, signals: list[Signal]) -> list[Signal]:
    """Return signals with those of the file's objects, if these hold what a motor answers with."""
    found: list[Signal] = []
    with suppress(RecordingError):  # what the user calls a response may be among the signals
        found = _objects(path, objects)
    if not _has_response(found):
        return signals
    names = [signal.header for signal in signals]
    return [*signals, *(signal for signal in found if signal.header not in names)]


def _scipy(path: Path) -> tuple[dict[str, Any], str]:
    import warnings

    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = loadmat(path, simplify_cells=True)
    except Exception as error:  # scipy raises whatever it stumbles over
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise RecordingError(f"{path.name} is no MAT file, or a damaged one ({words}); {REMEDY}") from None
    opaque = "None" in content or "__function_workspace__" in content
    objects = "an object (timeseries, timetable, table or Dataset)" if opaque else ""
    if not opaque and any(
        isinstance(value, dict) and {"OutputData", "Ts"} <= value.keys() for value in content.values()
    ):
        objects = "an object (iddata)"
    return {name: value for name, value in content.items() if not name.startswith("__") and name != "None"}, objects


def _hdf5(path: Path) -> tuple[dict[str, Any], str]:
    try:
        import h5py
    except ImportError:
        raise RecordingError(
            f"{path.name} is a MAT file of version 7.3, which needs h5py; {to_install('mat')}, or save it with -v7"
        ) from None
    objects = ""

    def value(item: Any, file: Any) -> Any:
        nonlocal objects
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if "MATLAB_object_decode" in item.attrs or kind in ("timeseries", "table", "timetable"):
            objects = f"an object ({kind})"
            return None
        if isinstance(item, h5py.Group):
            return {name: value(item[name], file) for name in item}
        data = item[()]
        if item.attrs.get("MATLAB_empty", 0):
            return np.empty(0)
        if kind == "char":
            return "".join(chr(int(code)) for code in np.asarray(data).T.ravel())
        if item.dtype == h5py.ref_dtype:
            return [value(file[reference], file) for reference in np.asarray(data).T.ravel()]
        if item.dtype.kind in "OS":
            return [x.decode("utf-8", "replace") if isinstance(x, bytes) else str(x) for x in np.ravel(data)]
        return np.squeeze(np.asarray(data).T)

    try:
        with h5py.File(path, "r") as file:
            return {name: value(file[name], file) for name in file if not name.startswith("#")}, objects
    except Exception as error:  # h5py raises whatever it stumbles over
        words = " ".join(str(error).split())[:100]
        raise RecordingError(f"{path.name} is a damaged MAT file of version 7.3 ({words}); {REMEDY}") from None


def _groups(content: Any, way: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Yield the file's own variables, then every structure in it."""
    if isinstance(content, Mapping):
        yield way, content
        for name, value in content.items():
            yield from _groups(value, (*way, name))


def _structure_with_time(content: Any) -> list[Signal]:
    for _, group in _groups(content, ()):
        lower = {name.lower(): value for name, value in group.items()}
        time, signals = _vector(lower.get("time")), lower.get("signals")
        if time is None or signals is None:
            continue
        entries = _entries(signals)
        headers, values = [], []
        for k, entry in enumerate(entries):
            block = _array(entry.get("values"))
            if block is None or block.shape[:1] != time.shape:
                continue
            names = [_text(entry.get(key)) for key in ("label", "blockName", "title")]
            label = next(filter(None, names), "")
            label = label.split("/")[-1] or f"signal {k + 1}"
            labels = [part.strip() for part in label.split(",")]
            block = block.reshape(len(time), -1)
            if len(labels) != block.shape[1]:
                labels = [label] if block.shape[1] == 1 else [f"{label} {c + 1}" for c in range(block.shape[1])]
            headers += labels
            values += list(block.T)
        if headers:
            names = distinct(headers, headers)
            return [Signal(name, column, time) for name, column in zip(names, values, strict=True)]
    return []


def _entries(signals: Any) -> list[Mapping[str, Any]]:
    """Return the elements of a structure array: a list of structures, or a structure of lists."""
    if isinstance(signals, Mapping):
        columns = {name: value for name, value in signals.items() if isinstance(value, list)}
        if held := columns.get("values", columns.get("Data")):
            return [{name: v[k] for name, v in columns.items() if k < len(v)} for k in range(len(held))]
        return [signals]
    return [entry for entry in np.ravel(np.asarray(signals, dtype=object)).tolist() if isinstance(entry, Mapping)]


def _recorder(group: Mapping[str, Any]) -> list[Signal]:
    """Return the signals of dSPACE's recorder: ``Y(k).Data``, each on the clock ``X(j).Data`` of its length."""
    clocks = [time for entry in _entries(group.get("X")) if (time := _vector(entry.get("Data"))) is not None]
    found = [(entry, y) for entry in _entries(group.get("Y")) if (y := _vector(entry.get("Data"))) is not None]
    paths = [_text(entry.get("Name")) or f"Y({k + 1})" for k, (entry, _) in enumerate(found)]
    blocks = [[part.strip(' "{}') for part in re.split(r"[/\\]", path)] for path in paths]  # "Model Root/w/Out1"
    names = [
        next((part for part in reversed(b) if not _PORT.fullmatch(part)), p) for b, p in zip(blocks, paths, strict=True)
    ]
    return [
        Signal(_with_unit(name, _text(entry.get("Unit"))), y, time)
        for name, (entry, y) in zip(distinct(names, paths), found, strict=True)
        for time in [clock for clock in clocks if len(clock) == len(y)][:1]
    ]


def _own_clocks(group: Mapping[str, Any]) -> list[Signal]:
    """Return signals that bring their own clocks: structures of Time and Data, or two columns."""
    found = []
    for name, value in group.items():
        if isinstance(value, Mapping):
            lower = {key.lower(): item for key, item in value.items()}
            time, data = (
                _vector(lower.get("time")),
                next(
                    (
                        data
                        for key in ("data", "values", "signal", "value")
                        if (data := _vector(lower.get(key))) is not None
                    ),
                    None,
                ),
            )
            info = lower.get("datainfo")
            unit = _text(info.get("Units", info.get("units"))) if isinstance(info, Mapping) else ""
            unit = unit or _text(lower.get("unit", lower.get("units")))
            if time is not None and data is not None and len(time) == len(data):
                found.append(Signal(_with_unit(_text(lower.get("name")) or name, unit), data, time))
    if found:
        return found
    for name, value in group.items():
        block = _array(value)
        if block is not None and block.ndim == 2 and block.shape[1] == 2 and len(block) >= MIN_ROWS:
            increasing = bool(np.all(np.diff(block[:, 0]) > 0))
            if increasing and any(rank_in_role(parse_header(name).name, role) is not None for role in SIGNALS):
                found.append(Signal(name, block[:, 1], block[:, 0]))
    return found if len(found) > 1 else []


def _vectors(path: Path, group: Mapping[str, Any]) -> list[Signal]:
    """Return the vectors that are as long as a time; complain of a motor's signal that is as long as none."""
    vectors = {name: v for name, value in group.items() if (v := _vector(value)) is not None and len(v) >= MIN_ROWS}
    clock = _clock(list(vectors))
    if clock is None:
        return []
    clocks = {len(vectors[name]): name for name in (*_other_clocks(vectors), clock)}  # the last one goes before
    times = {}
    for length, name in clocks.items():
        unit = parse_header(name).unit
        times[length] = vectors[name] if unit is None or unit.quantity != "time" else unit.to_si(vectors[name])
    names = [name for name, vector in vectors.items() if name not in clocks.values() and len(vector) in times]
    for roles in MOVING:
        either = [n for n in vectors if any(rank_in_role(parse_header(n).name, role) is not None for role in roles)]
        others = [name for name in either if len(vectors[name]) >= MIN_SAMPLES]
        if others and not set(either) & set(names):
            raise RecordingError(
                f"{path.name}: {others[0]} has {len(vectors[others[0]])} samples and the time {clock} has"
                f" {len(vectors[clock])}; save vectors of one length, or its own time beside it, as time_{others[0]}"
            )
    units = group.get("units", group.get("unit"))
    given = units if isinstance(units, Mapping) else {}
    return [
        Signal(_with_unit(name, _text(given.get(name))), vectors[name], times[len(vectors[name])]) for name in names
    ]


def _other_clocks(vectors: Mapping[str, FloatArray]) -> list[str]:
    """Return the times of signals that are sampled at rates of their own: time_speed, speed_time, tv, t2."""
    found = []
    for name, vector in vectors.items():
        named = _CLOCK_OF.fullmatch(name)
        of = (named[1] or named[2] or "") if named else ""
        is_of_one = of.isdecimal() or of in vectors or any(rank_in_role(of, role) is not None for role in SIGNALS)
        if is_of_one and bool(np.all(np.diff(vector) > 0)):
            found.append(name)
    return found


def _not_as_long(group: Mapping[str, Any], lengths: Collection[int]) -> tuple[str, ...]:
    """Say which vectors of a motor's file are left out, as they are as long as none that is read."""
    vectors = {name: vector for name, value in group.items() if (vector := _vector(value)) is not None}
    others = [f"{name} ({len(v)})" for name, v in vectors.items() if len(v) >= MIN_SAMPLES and len(v) not in lengths]
    if not others:
        return ()
    return (
        f"left out, not as long as the others ({', '.join(map(str, sorted(lengths)))} samples): {', '.join(others)}",
    )


def _matrix(path: Path, group: Mapping[str, Any]) -> list[Signal]:
    """Return the columns of a matrix that stands beside as many names."""
    lists = {name: texts for name, value in group.items() if (texts := _texts(value))}
    for name, value in group.items():
        block = _array(value)
        if block is None or block.ndim != 2 or min(block.shape) < 2:
            continue
        fitting = {key: texts for key, texts in lists.items() if len(texts) in block.shape}
        titles = next((texts for texts in fitting.values() if _clock(texts) is not None), None)
        if titles is None:
            if max(block.shape) >= MIN_ROWS and not lists and "time" in {n.lower() for n in group} | {name.lower()}:
                raise RecordingError(
                    f"{path.name}: {name} has columns without names; give them in a cell array of texts, such as"
                    " names = {'time','voltage','current','speed'}"
                )
            continue
        columns = block.T if block.shape[1] == len(titles) else block
        units = next((t for t in fitting.values() if t is not titles and all(not u or parse_unit(u) for u in t)), None)
        headers = [_with_unit(title, units[j] if units else "") for j, title in enumerate(titles)]
        clock = titles.index(_clock(titles) or "")
        unit = parse_header(headers[clock]).unit
        time = columns[clock] if unit is None or unit.quantity != "time" else unit.to_si(columns[clock])
        return [Signal(header, columns[j], time) for j, header in enumerate(headers) if j != clock]
    return []


def _without_clock(group: Mapping[str, Any]) -> Columns | None:
    """Return vectors of one length, and columns of matrices as long, where nothing is the time; None where none are.

    The columns of a single matrix are called by their numbers, as those of a text without a header.
    """
    arrays = {name: a for name, value in group.items() if (a := _array(value)) is not None and a.ndim <= 2}
    arrays = {name: np.atleast_1d(np.squeeze(a)) for name, a in arrays.items() if max(a.shape, default=0) >= MIN_ROWS}
    length = max((len(a) if a.ndim == 1 else max(a.shape) for a in arrays.values()), default=0)
    headers: list[str] = []
    columns: list[FloatArray] = []
    for name, array in arrays.items():
        if array.ndim == 2 and array.shape[0] != length:
            array = array.T
        if len(array) == length:
            block = array.reshape(length, -1)
            alone = len(arrays) == 1
            titles = [f"column {k + 1}" if alone else f"{name} column {k + 1}" for k in range(block.shape[1])]
            headers += [name] if block.shape[1] == 1 else titles
            columns += list(block.T)
    return Columns(tuple(headers), tuple(columns)) if len(columns) > 1 else None


def _clock(names: list[str]) -> str | None:
    """Return the name that is likeliest the time's."""
    ranks = [(rank, name) for name in names if (rank := rank_in_role(parse_header(name).name, "time")) is not None]
    return min(ranks)[1] if ranks else None


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit.strip()}]" if unit.strip() and parse_header(name).unit_text is None else name


def _with_length(name: str, value: Any) -> str:
    vector = _vector(value)
    return name if vector is None or len(vector) < MIN_ROWS else f"{name} of {len(vector)}"


def _array(value: Any) -> FloatArray | None:
    """Return numbers as an array; None if it holds something else."""
    if isinstance(value, (np.ndarray, list, int, float)):
        try:
            array = np.asarray(value)
        except ValueError:
            return None
        if array.dtype.kind in "iufb" and array.size:
            return array.astype(np.float64)
    return None


def _vector(value: Any) -> FloatArray | None:
    array = _array(value)
    if array is None:
        return None
    array = np.squeeze(array)
    return array if array.ndim == 1 else None


def _text(value: Any) -> str:
    return value.strip() if isinstance(value, str) else ""


def _texts(value: Any) -> list[str]:
    """Return a cell array of texts, or the rows of a matrix of characters."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "UO":
        value = np.ravel(value).tolist()
    if isinstance(value, list) and len(value) > 1 and all(isinstance(text, str) for text in value):
        return [text.strip() for text in value]
    return []
