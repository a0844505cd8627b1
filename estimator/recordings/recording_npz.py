"""NumPy's .npz and .npy → columns. Knows no unit and no motor; objects that would run code are not loaded."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.columns import Columns
from estimator.recordings.named_columns import named_columns

MAGIC_NPY, MAGIC_NPZ = b"\x93NUMPY", b"PK\x03\x04"
DAMAGED = (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile)


def is_npz(path: Path, head: bytes) -> bool:
    """Whether a file is an array of NumPy's, or an archive of such, from its first bytes and its table of contents."""
    if head.startswith(MAGIC_NPY):
        return True
    if not head.startswith(MAGIC_NPZ):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError):  # the second: a version of ZIP that no program writes
        return path.suffix.lower() == ".npz"
    return bool(names) and all(name.endswith(".npy") for name in names)


def read_npz(path: Path, head: bytes) -> Columns:
    """Read the vectors of an archive, the fields of an array, or the columns of a matrix, called by their numbers.

    Raises
    ------
    RecordingError
        The file is damaged, or holds objects, or no vectors of one length.
    """
    try:
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            arrays = {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except DAMAGED as error:
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise RecordingError(f"{path.name} cannot be read ({words}); save plain arrays of numbers") from None
    found = {name: array for name, array in arrays.items() if array.ndim == 1 and array.dtype.names is None}
    length = max(map(len, found.values()), default=0)
    found = {name: array for name, array in found.items() if len(array) == length}
    if not found and len(arrays) == 1:
        (array,) = arrays.values()
        if array.dtype.names is not None:
            found = {name: array[name] for name in array.dtype.names}
        elif array.ndim == 2:
            columns = array if array.shape[0] >= array.shape[1] else array.T
            found = {f"column {j + 1}": column for j, column in enumerate(columns.T)}
    if not found:
        raise RecordingError(f"{path.name} holds no vectors; save one a signal, called time, voltage, current, speed")
    return named_columns(path.name, found, {})
