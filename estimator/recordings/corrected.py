"""A signal with its sensor's error taken off: a factor, and what is added after it. Knows no file and no case."""

from __future__ import annotations

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.samples import LARGEST
from estimator.recordings.units import FloatArray


def corrected(signal: FloatArray, scale: float, offset: float, *, what: str) -> FloatArray:
    """Return scale · signal + offset, (n,); `what` names the signal and its recording.

    Raises
    ------
    RecordingError
        Nothing measures what comes out, or nothing is left of the signal.
    """
    if scale == offset == 0:
        raise RecordingError(f"the scale 0 leaves nothing of {what}; give its factor (-1 turns its sign)")
    if (scale, offset) == (1.0, 0.0):
        return signal
    with np.errstate(over="ignore"):
        result = scale * signal + offset
    if (largest := np.max(np.abs(result), initial=0.0, where=~np.isnan(result))) > LARGEST:
        raise RecordingError(
            f"the scale {scale:g} and the offset {offset:g} make {what} as large as {largest:g}, which nothing measures"
        )
    return result
