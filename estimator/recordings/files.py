"""A file → its recordings as the user wants them read: all its tests, one motor of several, volts, angles."""

from __future__ import annotations

from pathlib import Path

from estimator.recordings.made_columns import with_made_columns
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.recording import Recording, read_recordings
from estimator.recordings.sysid_json import is_json, read_sysid


def recordings_in(path: Path, read_as: ReadAs = AS_WRITTEN) -> list[Recording]:
    """Return the recordings that a file holds, mostly one.

    Parameters
    ----------
    path
        Text, MAT, Parquet, MDF, or the JSON of WPILib's SysId.
    read_as
        What the user says of it.

    Raises
    ------
    RecordingError
        One sentence: what is wrong, in which line, and what would be right.
    """
    found = read_sysid(path, read_as) if is_json(path) else read_recordings(path, read_as)
    return [with_made_columns(recording, read_as) for recording in found]
