"""Which files are recordings, by their names. Reads no samples.

JSON is used for much else, so of a file of that kind the beginning is looked at too.
"""

from __future__ import annotations

from pathlib import Path

from estimator.recordings.formats import FORMATS

TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")
SUFFIXES = (*TEXT, *(s for kind in FORMATS for s in kind.suffixes if s not in TEXT))
JSON = ".json"
TESTS = (b'"slow-forward"', b'"slow-backward"', b'"fast-forward"', b'"fast-backward"')  # as in sysid_json.py
BEGINNING = 1 << 16  # bytes; the first test's name stands before the first test


def is_recording(path: Path) -> bool:
    """Return whether a file is a recording by its name, or JSON with the tests of WPILib's SysId."""
    suffix = path.suffix.lower()
    if suffix != JSON:
        return suffix in SUFFIXES
    try:
        with path.open("rb") as file:
            beginning = file.read(BEGINNING)
    except OSError:
        return False
    return any(test in beginning for test in TESTS)
