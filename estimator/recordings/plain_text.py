"""Delimited text that holds nothing but numbers below its header, read at once. Knows no dialect and tells no mistake.

Whatever is not as plain as that (quotes, comments, empty cells, a decimal comma, a row of another width) is left to
the reader line by line, which gives the same bits where both can read a file.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from estimator.recordings.units import FloatArray

_NOT_PLAIN = '"#%'


def plain_columns(
    path: Path, text: str, *, encoding: str, skipped: int, offset: int, delimiter: str, width: int
) -> FloatArray | None:
    """Read what stands below the header, if it is plain.

    Parameters
    ----------
    path, encoding
        The file, and how its text is written.
    text
        All of it, its lines ended by line feeds.
    skipped, offset
        Lines and characters above the first row.
    width
        Cells a row.

    Returns
    -------
    (width, n) array, or None
        A row for every line; None: the text is not plain.
    """
    if any(text.find(character, offset) >= 0 for character in _NOT_PLAIN):
        return None
    rows = text.count("\n", offset) + (not text.endswith("\n"))
    try:
        block = np.loadtxt(
            os.path.abspath(path),
            dtype=np.float64,
            delimiter=delimiter,
            comments=None,
            skiprows=skipped,
            ndmin=2,
            encoding=encoding,
        )
    except (ValueError, OSError):
        return None
    if block.shape != (rows, width) or np.isinf(block).any():
        return None
    return np.ascontiguousarray(block.T)
