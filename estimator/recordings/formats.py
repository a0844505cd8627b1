"""Files that are no rows of text below a header: how each is known, and what reads it. Imports a reader when needed.

docs/add-a-format.md says how to add one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from estimator.recordings.columns import Columns

HEAD = 1024  # bytes of a file's beginning


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    suffixes : usual ends of its names, in small letters
    knows : (path, the file's first `HEAD` bytes) → whether it is one; the name is a hint, the bytes decide
    read : (path, first bytes) → its columns; raises RecordingError where it is damaged
    """

    suffixes: tuple[str, ...]
    knows: Callable[[Path, bytes], bool]
    read: Callable[[Path, bytes], Columns]


def read_columns(path: Path) -> Columns | None:
    """Return what a file that is no text holds; None if it is one, or cannot be opened.

    Raises
    ------
    RecordingError
        It is damaged, or its reader is not installed.
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError:
        return None  # the reader of text says what is wrong
    found = next((kind for kind in FORMATS if kind.knows(path, head)), None)
    return None if found is None else found.read(path, head)


def begins(*heads: bytes) -> Callable[[Path, bytes], bool]:
    """Return what knows a format by its first bytes."""
    return lambda path, head: head.startswith(heads)


def _parquet(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_parquet import read_parquet

    return read_parquet(path)


def _mdf(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_mdf import read_mdf

    return read_mdf(path)


def _tdms(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_tdms import read_tdms

    return read_tdms(path)


def _lvm(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_lvm import read_lvm

    return read_lvm(path)


def _is_xlsx(path: Path, head: bytes) -> bool:
    if not head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        return False
    from estimator.recordings.recording_xlsx import is_xlsx

    return is_xlsx(path, head)


def _xlsx(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_xlsx import read_xlsx

    return read_xlsx(path, head)


def _is_mat(path: Path, head: bytes) -> bool:
    from estimator.recordings.recording_mat import is_mat

    return is_mat(path, head)


def _mat(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_mat import read_mat

    return read_mat(path, head)


def _json(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_json import read_json

    return read_json(path, head)


def _is_json(path: Path, head: bytes) -> bool:
    from estimator.recordings.recording_json import is_json

    return is_json(path, head)


def _npz(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_npz import read_npz

    return read_npz(path, head)


def _is_npz(path: Path, head: bytes) -> bool:
    from estimator.recordings.recording_npz import is_npz

    return is_npz(path, head)


def _messages(path: Path, head: bytes) -> Columns:
    from estimator.recordings.recording_messages import read_messages

    return read_messages(path, head)


def _are_messages(path: Path, head: bytes) -> bool:
    from estimator.recordings.recording_messages import are_messages

    return are_messages(path, head)


def _in_lines(path: Path, head: bytes) -> Columns:
    from estimator.recordings.signals_in_lines import read_signals_in_lines

    return read_signals_in_lines(path, head)


def _is_in_lines(path: Path, head: bytes) -> bool:
    from estimator.recordings.signals_in_lines import are_signals_in_lines

    return are_signals_in_lines(path, head)


FORMATS: tuple[Format, ...] = (
    Format((".parquet",), begins(b"PAR1"), _parquet),
    Format((".mf4", ".mdf", ".dat"), begins(b"MDF     ", b"UnFinMF "), _mdf),
    Format((".tdms",), begins(b"TDSm"), _tdms),
    Format((".lvm",), begins(b"LabVIEW Measurement"), _lvm),
    Format((".xlsx",), _is_xlsx, _xlsx),
    Format((), _is_npz, _npz),  # results are called .npz, too
    Format((), _is_json, _json),  # much else is called .json
    Format((".mat",), _is_mat, _mat),
    Format((), _are_messages, _messages),  # text, as the next
    Format((), _is_in_lines, _in_lines),
)
