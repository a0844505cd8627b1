"""Whether the scales of speed and angle in one recording agree: one of the few gains that a recording determines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.plans.plan import Observed, Plan
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.samples import filled
from estimator.recordings.turns import starts_again

FloatArray = NDArray[np.float64]

BLOCKS = 50  # parts of the recording whose means are compared: within them the speed's noise is averaged
LEAST_BLOCK = 10  # samples
GAIN_AT_ODDS = 5.0  # standard deviations of a gain, with BLOCKS − 2 degrees of freedom
HARMLESS_GAIN = 0.002  # of a gain: a smaller error is negligible


def scales_at_odds(plan: Plan) -> list[str]:
    """Return where a speed that is compared is not the slope of the angle that was logged beside it.

    Over blocks of samples the angle's mean slope is fitted as gain × speed + offset. If the angle itself is
    compared, the gain is estimated in the fit instead.
    """
    reasons = []
    for o in plan.observed:
        found = _gain(o) if "w" in o.outputs and "angle" not in o.outputs else None
        if found is None:
            continue
        column, gain, error = found
        if abs(gain - 1) > max(HARMLESS_GAIN, GAIN_AT_ODDS * error):
            reasons.append(
                f"{o.recording.title}: held against {column!r} the speed is shown with a gain of {1 / gain:.4g}"
                f" ± {error / gain**2:.1g}; if it is the speed that is wrong, K, J and B are, too: check the scales"
            )
    return reasons


def _unwrapped(angle: FloatArray, w: FloatArray, time: FloatArray) -> FloatArray:
    """Return an angle, (n,) rad, that goes on where the logged one begins again after each turn, as the speed tells."""
    if not starts_again(angle):
        return angle
    expected = np.diff(time) * (filled(w)[1:] + filled(w)[:-1]) / 2
    moved = np.diff(filled(angle)) - expected
    moved = expected + moved - 2 * np.pi * np.round(moved / (2 * np.pi))
    return np.where(np.isnan(angle), np.nan, np.concatenate([[0.0], np.cumsum(moved)]))


def _gain(o: Observed) -> tuple[str, float, float] | None:
    """Return the angle's column, its slope over the speed, and the standard error of that; None without an angle."""
    recording = o.recording
    column = motor_columns(recording, required=[]).get("angle")
    if column is None or recording.fault(column, "angle") or len(recording.signals[column]) != len(o.outputs["w"]):
        return None
    w = o.outputs["w"]
    angle = _unwrapped(recording.signals[column], w, recording.time)
    size = max(LEAST_BLOCK, len(w) // BLOCKS)
    ends = np.arange(0, len(w) - size, size)
    whole = np.array(
        [not (np.isnan(angle[k : k + size + 1]).any() or np.isnan(w[k : k + size + 1]).any()) for k in ends]
    )
    ends = ends[whole] if len(ends) else ends
    if len(ends) < LEAST_BLOCK:
        return None
    slope = (angle[ends + size] - angle[ends]) / (recording.time[ends + size] - recording.time[ends])
    mean = np.array([np.mean((w[k : k + size] + w[k + 1 : k + size + 1]) / 2) for k in ends])
    if np.ptp(mean) == 0:
        return None
    rows = np.column_stack([mean, np.ones_like(mean)])
    (gain, offset), *_ = np.linalg.lstsq(rows, slope, rcond=None)
    left = slope - rows @ [gain, offset]
    variance = float(left @ left) / (len(mean) - 2)
    error = float(np.sqrt(variance / np.sum((mean - mean.mean()) ** 2)))
    return column, float(gain), error
