"""Whether one signal follows another as a first-order lag does. Knows samples only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.samples import filled

FloatArray = NDArray[np.float64]

THIN = 4000  # samples that are looked at


def lag_misfit(time: FloatArray, drive: FloatArray, y: FloatArray, *, enough: float = 0.0) -> float:
    """Return how badly y, (n,), is what dy/dt = a drive − b y − c makes of the drive: 1 for not at all.

    The misfit is relative to the deviation of y; a is positive, b is not negative; the equation is fitted integrated.
    One that is `enough` is told as it is, though it may be made smaller.
    """
    stride = max(1, len(time) // THIN)
    h = np.diff(time)
    drive, y = filled(drive), filled(y)
    moved = np.concatenate([[0.0], np.cumsum(h * (drive[1:] + drive[:-1]) / 2)])[::stride]
    fallen = -np.concatenate([[0.0], np.cumsum(h * (y[1:] + y[:-1]) / 2)])[::stride]
    t, y = (time - time[0])[::stride], y[::stride]
    spread = float(np.std(y))
    if spread == 0:
        return 1.0
    best = 1.0
    choices: list[list[FloatArray]] = [[moved, fallen, t], [moved, fallen], [moved, t], [moved]]
    for columns in choices:
        rows = np.column_stack([*columns, np.ones(len(t))])
        scale = np.linalg.norm(rows, axis=0)
        scale[scale == 0] = 1.0
        solution, *_ = np.linalg.lstsq(rows / scale, y, rcond=None)
        if solution[0] <= 0 or (len(columns) > 1 and columns[1] is fallen and solution[1] < 0):
            continue
        best = min(best, float(np.std(y - rows / scale @ solution)) / spread)
        if best <= enough:
            break
    return best
