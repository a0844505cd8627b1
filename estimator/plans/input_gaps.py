"""Gaps of a recording's inputs: held over, or, where an input changes in one, what of the recording lies between."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.errors import RecordingError
from estimator.recordings.recording import MIN_SAMPLES, Recording
from estimator.recordings.signal_noise import input_noise
from estimator.recordings.smooth_inputs import moves_smoothly

FloatArray = NDArray[np.float64]

SAME_LEVEL = 0.02  # of an input's range: levels on both sides of a gap that are nearer are one
SHORT_GAP = 3  # rows: an input that changes within so short a gap is held over it
ON_A_CURVE, APART = 2e-3, 4  # of an input's range; parts as long as its longest gap, of which one is left out
SLOWER_CLOCK = 0.9  # of the gaps of an input that are equal: it was sampled at a lower rate


def on_a_curve(time: FloatArray, signal: FloatArray) -> FloatArray:
    """Return an input, (n,), with its gaps on a cubic spline where it moves smoothly; else it keeps them.

    There a spline tells the samples around a gap, too: parts of them, each as long as the longest gap, by the others.
    It goes by the time, or by the rows: a loop may find its command for each turn, whenever that comes.
    """
    known = np.flatnonzero(~np.isnan(signal))
    gaps = np.diff(known)
    longest = int(np.max(gaps, initial=1))
    if longest == 1 or 2 * APART * longest > len(known) or _is_slower(gaps) or not moves_smoothly(signal[known]):
        return signal
    from scipy.interpolate import CubicSpline  # which takes long to load

    def errors(at: FloatArray) -> FloatArray:
        """Return by how much a spline misses each sample that is left out."""
        found = np.zeros(len(known))
        for left_out in range(APART):
            kept = known[np.arange(len(known)) // longest % APART != left_out]
            found = np.maximum(found, np.abs(CubicSpline(at[kept], signal[kept])(at[known]) - signal[known]))
        return found

    missed, at = min(((errors(x), x) for x in (time, np.arange(0.0, len(time)))), key=lambda e: float(np.sum(e[0])))
    most = max(ON_A_CURVE * float(np.ptp(signal[known])), 6 * input_noise(signal[known]))
    curve, told = CubicSpline(at[known], signal[known]), signal.copy()
    for k in np.flatnonzero(gaps > 1).tolist():
        if np.max(missed[max(0, k - APART * longest) : k + 1 + APART * longest]) <= most:
            rows = np.arange(known[k] + 1, known[k + 1])
            told[rows] = curve(at[rows])
    return told


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
    recording: Recording, driven: Mapping[str, FloatArray], columns: Mapping[str, str], rows: slice
) -> tuple[slice, str, float]:
    """Return the rows between gaps in which an input changes, at an instant that nothing tells; a sentence; `early`.

    The longest of these parts in which an input moves, or of all: of a motor that rests little can be told. `early` is
    for how many s before the first row the inputs are not known, though they have changed.

    Parameters
    ----------
    driven : (n,) arrays
        Inputs that are held from row to row, of all rows of the recording.
    rows : those in which every input is known

    Raises
    ------
    RecordingError
        A part is too short, or an input has no sample in these rows.
    """
    held = {name: _held(u) if _is_slower(np.diff(np.flatnonzero(~np.isnan(u)))) else u for name, u in driven.items()}
    for name, signal in held.items():
        if np.isnan(signal[rows]).all():
            raise RecordingError(f"{recording.title}: the input {name!r} has no sample while the others are known")
    cuts, at, gaps_before = {rows.start, rows.stop}, dict[str, list[float]](), dict[int, float]()
    for name, signal in held.items():
        for ends in _changes_in_gaps(signal[rows]):
            last, following = (rows.start + row for row in ends)
            cuts |= {last + 1, following}
            gap = float(recording.time[following] - recording.time[last])
            gaps_before[following] = max(gap, gaps_before.get(following, 0.0))
            at.setdefault(columns[name], []).append(float(recording.time[last + 1]))
    if not at:
        return rows, "", 0.0
    bounds = sorted(cuts)
    parts = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    known = [p for p in parts if not any(np.isnan(u[p]).all() for u in held.values())]
    moving = [p for p in known if any(_moves(u[p], u) for u in held.values())]
    best = max(moving or known, key=lambda p: p.stop - p.start)
    gaps = "; ".join(
        f"{column} has no sample at t = {', '.join(f'{t:g}' for t in times)} s and changes before the next one"
        for column, times in at.items()
    )
    many = best.stop - best.start
    if many < MIN_SAMPLES:
        raise RecordingError(
            f"{recording.title}: {gaps}; an input must be complete where it changes; leave the gap out with a window"
        )
    first, last = recording.time[best.start], recording.time[best.stop - 1]
    told = f"{recording.title}: {gaps}: of it the {many} rows from {first:g} to {last:g} s are used"
    return best, told, gaps_before.get(best.start, 0.0)


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


def complete(
    recording: Recording, signal: FloatArray, name: str, rows: slice, *, linear: bool
) -> tuple[FloatArray, list[str]]:
    """Return some rows of an input without gaps, and what to tell: held over them, as between rows, or on a line."""
    missing = np.isnan(signal)
    many = int(missing[rows].sum())
    if not many:
        return signal[rows], []
    known = np.flatnonzero(~missing)
    if linear:
        told = f"{recording.title}: {name} has {many} missing samples, taken on a line between the others"
        return np.interp(recording.time, recording.time[known], signal[known])[rows], [told]
    gaps = np.diff(known)
    if _is_slower(gaps):
        told = f"{recording.title}: {name} was sampled at every {int(np.median(gaps))}th row and held between"
    else:
        told = f"{recording.title}: {name} has {many} missing samples, held from the one before"
    return _held(signal)[rows], [told]


def _held(signal: FloatArray) -> FloatArray:
    """Return a signal, (n,), held over its gaps; before its first sample as that."""
    known = np.flatnonzero(~np.isnan(signal))
    before = np.searchsorted(known, np.arange(len(signal)), side="right") - 1
    return np.asarray(signal[known[np.maximum(before, 0)]])
