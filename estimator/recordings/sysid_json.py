"""The JSON of WPILib's SysId and of frc-characterization before it → recordings, one a test. Knows no FMU.

A test is "slow-forward", "slow-backward" (the voltage rises slowly), "fast-forward" or "fast-backward" (a step). It has
rows of

    4 numbers   SysId, one motor       time s, V, position, speed, in turns and turns/s
    9           SysId, drive train     time, V left, V right, positions left and right, speeds, heading, its rate
    10          frc-characterization   time, battery V, ratio, V left, V right, positions, speeds, heading
    9           the same, early        time, battery V, ratio, V left, V right, positions, speeds

The voltage is logged without its sign by some of those programs; it takes that of the speed, as in their own analysis.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import MIN_SAMPLES, Recording
from estimator.recordings.recording_json import TESTS, is_json, json_content
from estimator.recordings.suffixes import BEGINNING
from estimator.recordings.units import FloatArray

ONE = ("time", "voltage [V]", "position [rev]", "speed [rev/s]")
SIDES = ("voltage_left [V]", "voltage_right [V]", "position_left [rev]", "position_right [rev]")
SPEEDS = ("speed_left [rev/s]", "speed_right [rev/s]")
TRAIN = ("time", *SIDES, *SPEEDS, "", "")
CHARACTERIZATION = ("time", "", "", *SIDES, *SPEEDS, "")


def is_sysid(path: Path) -> bool:
    """Return whether a file begins as JSON with a test of this kind."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(BEGINNING)
    except OSError:
        return False  # the reader of text says what is wrong
    return is_json(path, head) and any(f'"{test}"'.encode() in head for test in TESTS)


def read_sysid(path: Path, read_as: ReadAs) -> list[Recording]:
    """Return the tests of such a file, or the one that is asked for.

    Raises
    ------
    RecordingError
        It is no JSON, or not of this kind, or a row is none.
    """
    path = Path(path)
    content, _ = json_content(path)
    tests = [test for test in TESTS if isinstance(content, dict) and content.get(test)]
    if not tests:
        raise RecordingError(f"{path.name}: its tests of WPILib's SysId hold nothing; record them again")
    if read_as.test is not None:
        if read_as.test not in tests:
            raise RecordingError(f"{path.name} has no test {read_as.test!r}; it holds {', '.join(tests)}")
        tests = [read_as.test]
    is_sysid = "sysid" in content or "test" in content
    found = [_recording(path, test, content[test], is_sysid=is_sysid) for test in tests]
    return [recording for recording in found if recording is not None]


def _recording(path: Path, test: str, rows: Any, *, is_sysid: bool) -> Recording | None:
    """Return one test; None of too few rows that are of any use."""
    try:
        table = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        table = np.empty(0)
    if table.ndim != 2 or not np.isfinite(table).all() or table.shape[1] not in (4, 9, 10):
        raise RecordingError(
            f"{path.name}: {test!r} should hold rows of 4, 9 or 10 numbers; export the recording as CSV"
        )
    names = _names(table.shape[1], is_sysid=is_sysid)
    later = np.concatenate([[True], np.diff(np.maximum.accumulate(table[:, 0])) > 0])
    table = table[later]  # a stamp that is there twice is one sample
    if len(table) < MIN_SAMPLES:
        return None
    columns = {name: table[:, j] for j, name in enumerate(names) if name and name != "time"}
    for name in [name for name in columns if name.startswith("voltage")]:
        speed = columns[name.replace("voltage", "speed").replace("[V]", "[rev/s]")]
        columns[name] = _signed(columns[name], speed)
    return recording_from_arrays(f"{path.stem} {test}", table[:, 0] - table[0, 0], columns, path=path)


def _names(width: int, *, is_sysid: bool) -> tuple[str, ...]:
    if width == 4:
        return ONE
    if width == 9 and is_sysid:
        return TRAIN
    return CHARACTERIZATION[:width]


def _signed(voltage: FloatArray, speed: FloatArray) -> FloatArray:
    """Return a voltage that was logged without its sign with that of the speed."""
    one_sign = float(np.min(voltage)) >= 0 or float(np.max(voltage)) <= 0
    return -voltage if one_sign and float(voltage @ speed) < 0 else voltage
