"""Gaps of a recording's inputs: held over, or, where an input changes in one, what of the recording lies between."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.errors import RecordingError
from estimator.recordings.excitation import input_noise
from estimator.recordings.recording import MIN_SAMPLES, Recording

FloatArray = NDArray[np.float64]

SAME_LEVEL = 0.02  # of an input's range: levels on both sides of a gap that are nearer are one
SHORT_GAP = 3  # rows: an input that changes within so short a gap is held over it
SLOWER_CLOCK = 0.9  # of the gaps of an input that are equal: it was sampled at a lower rate


def known_range(recording: Recording, driven: Mapping[str, FloatArray]) -> tuple[int, int]:
    """Return the first row, and the one after the last, in which every input is known."""
    first, last = 0, len(recording.time)
    for name, signal in driven.items():
        known = np.flatnonzero(~np.isnan(signal))
        if not len(known):
            raise RecordingError(f"{recording.title}: the input {name!r} has no sample; an input must be complete")
        first, last = max(first, int(known[0])), min(last, int(known[-1]) + 1)
    if last - first < MIN_SAMPLES:
        raise RecordingError(f"{recording.title}: the inputs need at least {MIN_SAMPLES} samples in common")
    return first, last


def between_changes(
    recording: Recording, held: Mapping[str, FloatArray], columns: Mapping[str, str]
) -> tuple[slice, str]:
    """Return the rows between gaps in which an input changes, at an instant that nothing tells, and what to tell.

    The longest of these parts in which an input moves, or of all: of a motor that rests little can be told.

    Raises
    ------
    RecordingError
        It is too short.
    """
    cuts, at = {0, len(recording.time)}, dict[str, list[float]]()
    for name, signal in held.items():
        for last, following in _changes_in_gaps(signal):
            cuts |= {last + 1, following}
            at.setdefault(columns[name], []).append(float(recording.time[last + 1]))
    if not at:
        return slice(None), ""
    bounds = sorted(cuts)
    parts = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    known = [p for p in parts if not any(np.isnan(u[p]).all() for u in held.values())]
    moving = [p for p in known if any(_moves(u[p], u) for u in held.values())]
    best = max(moving or known, key=lambda p: p.stop - p.start)
    gaps = "; ".join(
        f"{column} has no sample at t = {', '.join(f'{t:g}' for t in times)} s and changes before the next one"
        for column, times in at.items()
    )
    rows = best.stop - best.start
    if rows < MIN_SAMPLES:
        raise RecordingError(
            f"{recording.title}: {gaps}; an input must be complete where it changes; leave the gap out with a window"
        )
    first, last = recording.time[best.start], recording.time[best.stop - 1]
    return best, f"{recording.title}: {gaps}: of it the {rows} rows from {first:g} to {last:g} s are used"


def _changes_in_gaps(signal: FloatArray) -> list[tuple[int, int]]:
    """Return the last row before each gap of an input, (n,), in which it changes, and the first one behind it."""
    known = np.flatnonzero(~np.isnan(signal))
    gaps = np.diff(known)
    if _is_slower(gaps):
        return []
    apart = np.abs(np.diff(signal[known])) > _one_level(signal[known])
    return [(int(k), int(k + gap)) for k, gap in zip(known[:-1][apart], gaps[apart], strict=True) if gap > SHORT_GAP]


def _is_slower(gaps: NDArray[np.int64]) -> bool:
    """Whether an input was sampled at a lower rate, by the rows from sample to sample."""
    usual = int(np.median(gaps)) if len(gaps) else 1
    return usual > 1 and bool(np.mean(gaps == usual) >= SLOWER_CLOCK)


def _one_level(known: FloatArray) -> float:
    """Return by how much samples of an input, (n,), differ that are of one level."""
    return max(SAME_LEVEL * float(np.ptp(known)), 6 * input_noise(known))


def _moves(part: FloatArray, signal: FloatArray) -> bool:
    """Whether an input leaves its level in a part of its samples; NaN: there is none."""
    return float(np.nanmax(part) - np.nanmin(part)) > _one_level(signal[~np.isnan(signal)])


def complete(recording: Recording, signal: FloatArray, name: str, *, linear: bool) -> tuple[FloatArray, list[str]]:
    """Return an input without gaps, and what to tell: held over them, as it is from row to row, or on a line."""
    missing = np.isnan(signal)
    if not missing.any():
        return signal, []
    known = np.flatnonzero(~missing)
    if linear:
        told = f"{recording.title}: {name} has {int(missing.sum())} missing samples, taken on a line between the others"
        return np.interp(recording.time, recording.time[known], signal[known]), [told]
    held = signal[known[np.searchsorted(known, np.arange(len(signal)), side="right") - 1]]
    gaps = np.diff(known)
    if _is_slower(gaps):
        return held, [f"{recording.title}: {name} was sampled at every {int(np.median(gaps))}th row and held between"]
    return held, [f"{recording.title}: {name} has {int(missing.sum())} missing samples, held from the one before"]
