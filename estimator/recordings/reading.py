"""Recordings read from files, or made from columns and arrays. Knows no format, no model and no FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy.typing as npt

from estimator.errors import RecordingError
from estimator.recordings.array_values import array_values
from estimator.recordings.columns import Columns
from estimator.recordings.from_raw import recording_of, timed
from estimator.recordings.raw_table import RawTable, raw_columns, raw_table
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.recording import Recording
from estimator.recordings.tests_in_file import labels_of, of_motor, tests_of
from estimator.recordings.units import FloatArray


def read_recording(path: Path, read_as: ReadAs = AS_WRITTEN) -> Recording:
    """Read a recording: text with a header, or any of `FORMATS`, known by its content.

    Parameters
    ----------
    path
        The file.
    read_as
        What wins over its headers.

    Raises
    ------
    RecordingError
        One sentence: what is wrong, in which line, and what would be right.

    Examples
    --------
    >>> run = read_recording(Path("examples/cml050_step.csv"))
    >>> sorted(run.signals), run.step
    (['current', 'speed', 'voltage'], 0.001)
    """
    return recording_of(timed(of_motor(raw_table(Path(path), read_as), read_as), read_as), read_as)


def read_recordings(path: Path, read_as: ReadAs = AS_WRITTEN) -> list[Recording]:
    """Read all tests that a file holds, each as a recording: mostly one.

    Parameters
    ----------
    path, read_as
        As `read_recording`; with `read_as.test` that test alone.

    Raises
    ------
    RecordingError
        As `read_recording`.
    """
    raw = timed(of_motor(raw_table(Path(path), read_as), read_as), read_as)
    if read_as.test is not None:
        return [recording_of(raw, read_as)]
    labels = labels_of(raw)
    try:
        whole = recording_of(raw, read_as)
    except RecordingError:
        tests = tests_of(raw, read_as, labels)
        if len(tests) < 2:
            raise
    else:
        tests = tests_of(raw, read_as, labels) if labels else []
    if len(tests) < 2:
        return [whole]
    return [recording_of(raw, replace(read_as, test=test.name)) for test in tests]


def recording_from_columns(
    name: str, columns: Columns, *, path: Path | None = None, read_as: ReadAs = AS_WRITTEN
) -> Recording:
    """Make a recording from columns, one of them the time.

    Raises
    ------
    RecordingError
        There is no time, or something in a column is no sample.
    """
    return recording_of(timed(raw_columns(name, columns, path), read_as), read_as)


def recording_from_arrays(
    name: str, time: npt.ArrayLike, signals: Mapping[str, npt.ArrayLike], *, path: Path | None = None
) -> Recording:
    """Make a recording from arrays.

    Parameters
    ----------
    name
        What messages call it.
    time
        (n,) s, increasing; or dates, which become seconds since the first.
    signals
        Header → (n,) samples in the header's unit, as ``{"voltage [V]": v, "speed [rpm]": n}``; NaN is a
        missing sample.
    path
        Where it came from, if it is a file.

    Raises
    ------
    RecordingError
        An array has another shape, or something in it is no sample.

    Examples
    --------
    >>> time = [0.001 * k for k in range(10)]
    >>> run = recording_from_arrays("run", time, {"voltage [mV]": [5000.0] * 10, "speed [rpm]": [3000.0] * 10})
    >>> float(run.signals["voltage"][0]), run.units["speed"], round(float(run.signals["speed"][0]), 3)
    (5.0, 'rad/s', 314.159)
    """
    texts = ["time [s]", *signals]
    columns: list[FloatArray] = []
    for text, values in zip(texts, (time, *signals.values()), strict=True):
        numbers, _ = array_values(values)
        if numbers is None:
            raise RecordingError(f"{name}: {text!r} is not an array of numbers; give one float per sample")
        columns.append(numbers)
    for text, column in zip(texts, columns, strict=True):
        if column.ndim != 1 or column.shape != columns[0].shape:
            raise RecordingError(
                f"{name}: {text!r} has shape {column.shape}; it should be one-dimensional and as long as time"
            )
    raw = RawTable(name, path, texts, columns, where=name, place=lambda k: f"{name} sample {k}")
    recording = recording_of(raw, AS_WRITTEN)
    if recording.unreadable:
        raise RecordingError(next(iter(recording.unreadable.values())))
    return recording
