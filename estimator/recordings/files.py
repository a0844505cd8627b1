"""A file → its recordings as the user wants them read: all its tests, one motor of several, volts, angles."""

from __future__ import annotations

from pathlib import Path

from estimator.errors import InputError, SeveralMotorsError
from estimator.recordings.headers import motors_named, parse_header
from estimator.recordings.made_columns import with_made_columns
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.parts import names_motors
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.reading import read_recordings
from estimator.recordings.recording import Recording
from estimator.recordings.sysid_json import is_sysid, read_sysid

HEAD, HEADER_LINES = 1 << 14, 60  # of a file of text: bytes and lines within which its header stands


def recordings_in(path: Path, read_as: ReadAs = AS_WRITTEN) -> list[Recording]:
    """Return the recordings that a file holds, mostly one.

    Parameters
    ----------
    path
        Text, any of `FORMATS`, or the JSON of WPILib's SysId.
    read_as
        What the user says of it.

    Raises
    ------
    RecordingError
        One sentence: what is wrong, in which line, and what would be right.
    """
    found = read_sysid(path, read_as) if is_sysid(path) else read_recordings(path, read_as)
    return [with_made_columns(recording, read_as) for recording in found]


def motors_in(path: Path) -> tuple[str, ...]:
    """Return which motors a file holds, ("left", "right"); empty for one, or for what cannot be read.

    Only a file whose first lines name several, or one of WPILib's SysId, is read whole.
    """
    if not is_sysid(path) and not _names_several(path):
        return ()
    try:
        for recording in recordings_in(path)[:1]:
            motor_columns(recording, required=("v",), either=("i", "w"))
    except SeveralMotorsError as error:
        return error.motors
    except InputError:
        return ()  # its own case says why
    return ()


def _names_several(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            lines = file.read(HEAD).decode("latin-1").splitlines()[:HEADER_LINES]
    except OSError:
        return False
    # A line without letters names nothing.
    rows = [line.split(mark) for line in lines if line.lower() != line.upper() for mark in ",;\t"]
    names = [[parse_header(cell.strip(' "#%')).name for cell in row] for row in rows if len(row) > 2]
    return any(motors_named(row) or any(map(names_motors, row)) for row in names)
