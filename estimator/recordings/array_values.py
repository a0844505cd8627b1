"""An array of numbers, dates, durations or texts of these → numbers: times are seconds since the first."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np

from estimator.recordings.clock_text import seconds_since_first
from estimator.recordings.units import FloatArray


def array_values(column: Any) -> tuple[FloatArray | None, bool]:
    """Return an array as numbers, None if it holds none, and whether they are seconds; what is masked is NaN."""
    array = np.asarray(column)
    if array.dtype.kind in "mM":
        ticks = array.astype(f"{'timedelta64' if array.dtype.kind == 'm' else 'datetime64'}[ns]")
        since = (ticks - ticks[:1]).astype(np.float64) / 1e9
        return np.where(np.isnat(ticks), np.nan, since), True
    if array.dtype.kind in "biuf":
        values = array.astype(np.float64)
        return np.where(np.ma.getmaskarray(column), np.nan, values) if np.ma.isMaskedArray(column) else values, False
    if array.ndim != 1:
        return None, False
    cells = array.tolist()
    try:
        return np.array([np.nan if cell is None else float(cell) for cell in cells], dtype=np.float64), False
    except (TypeError, ValueError):
        pass
    if all(isinstance(cell, datetime) for cell in cells) or all(isinstance(cell, timedelta) for cell in cells):
        try:
            return np.array([(cell - cells[0]).total_seconds() for cell in cells]), True
        except TypeError:  # of some the time zone is known, of others not
            return None, False
    seconds = seconds_since_first(cells) if all(isinstance(cell, str) for cell in cells) else None
    return (None, False) if seconds is None else (seconds[0], True)
