"""How a recording's input moves, whether its motor runs already, and how late it answers. Knows no FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE
from estimator.recordings.samples import mean_of_known, median, running_mean
from estimator.recordings.signal_noise import is_restless, noise_deviation, row_by_row

FloatArray = NDArray[np.float64]

LEVEL = 0.02  # of the input's range: a smaller change is no new level
AT_REST = 0.02  # of the output's range: less is rest
TREND_SIGMAS = 4.0  # errors of a trend, or of a change: less is none
ONSET, ONSET_SWING = 5.0, 0.01  # deviations of the noise; of the response: more is a response
ONSET_BASE = 10  # samples before the step that tell the noise
STEADY = 15  # rows, and as many behind them, in which a motor that runs already shows the same
ON = 0.5  # of the largest input: more than that in the first rows moves what is not late


@dataclass(frozen=True)
class Excitation:
    """How the input moves.

    Attributes
    ----------
    kind : "none", "step" or "several"
        "several" is any input with more than one change: staircase, PRBS, ramp.
    index : int
        First sample k at which input[k] has the new level; 0 for a step at the first row.
    before, after : float
        Input levels, in its unit.
    running : bool
        The speed is not at rest in the first row; where it is not measured, any output.
    is_on : bool
        The input is large from the first row on, for as many rows as tell the noise of what rests.
    """

    kind: Literal["none", "step", "several"]
    index: int
    before: float
    after: float
    running: bool
    is_on: bool = False


def find_excitation(v: FloatArray, outputs: Mapping[str, FloatArray]) -> Excitation:
    """Find how the input moves.

    Parameters
    ----------
    v : (n,) array
        Input without missing samples.
    outputs : name → (n,) array
        Measured outputs, NaN where missing.
    """
    span = float(np.ptp(v))
    noise = row_by_row(v)
    if is_restless(v, noise):
        return Excitation("several", 0, float(v[0]), float(v[-1]), _runs_already(outputs))
    running = _runs_already(outputs)
    threshold = max(LEVEL * max(span, 0.5 * float(np.max(np.abs(v)))), 6 * noise)
    if span <= threshold:
        level = float(np.mean(v))
        moves = any(_moves(y) for y in outputs.values())
        if abs(level) > 6 * noise and level != 0 and moves and not running:
            return Excitation("step", 0, 0.0, level, running)
        return Excitation("none", 0, level, level, running)
    # Changes of level: where the input leaves the level it had, by more than its noise.
    changes = np.flatnonzero(np.abs(np.diff(v)) > threshold) + 1
    merged = [int(k) for j, k in enumerate(changes) if j == 0 or k - changes[j - 1] > 3]
    if merged and abs(float(np.mean(v[: merged[0]]))) > threshold and not running:  # on from row 0
        is_on = merged[0] >= ONSET_BASE and abs(float(v[0])) > ON * float(np.max(np.abs(v)))
        return Excitation("several", 0, 0.0, float(v[-1]), running, is_on)
    if len(merged) == 1 and len(changes) <= 3:
        k, last = merged[0], int(changes[-1])
        before, after = float(np.mean(v[:k])), float(np.mean(v[last:]))
        if float(np.ptp(v[last:])) <= 2 * threshold and float(np.ptp(v[:k])) <= 2 * threshold:
            return Excitation("step", k, before, after, running)
    return Excitation("several", merged[0] if merged else 0, float(v[0]), float(v[-1]), running)


def find_delay(excitation: Excitation, outputs: Mapping[str, FloatArray]) -> int:
    """Return by how many samples the response starts later than it could, at first sight; 0 if it starts in time.

    The first output to leave its noise counts: of a motor the current, which a step moves within one sample.
    """
    k = excitation.index
    if excitation.kind == "none" or excitation.running or (k < ONSET_BASE and not excitation.is_on):
        return 0
    onsets = []
    for y in outputs.values():
        base = y[: k or ONSET_BASE]
        base = base[~np.isnan(base)]
        if len(base) < ONSET_BASE:
            continue
        centre = median(base)
        swing = float(np.nanmax(np.abs(y - centre)))
        robust = median(np.abs(base - centre)) / MEDIAN_SIZE
        level = max(ONSET * max(robust, noise_deviation(y)), ONSET_SWING * swing)
        beyond = np.abs(y[k:] - centre) > level
        lasting = beyond[:-1] & beyond[1:]
        if lasting.any():
            onsets.append(int(np.argmax(lasting)))
    late = max(0, min(onsets, default=0) - 1)
    if excitation.is_on and (late < 2 * ONSET_BASE or not all(_rests(y[:late]) for y in outputs.values())):
        return 0
    return late


def _rests(y: FloatArray) -> bool:
    """Return whether a signal's samples, (n,), show noise around one value, and no trend."""
    y = y[~np.isnan(y)]
    error = 2 * float(np.std(np.diff(y))) / np.sqrt(2 * max(len(y), 1))
    apart = abs(mean_of_known(y[: len(y) // 2]) - mean_of_known(y[len(y) // 2 :]))
    return not apart > TREND_SIGMAS * error


def _runs_already(outputs: Mapping[str, FloatArray]) -> bool:
    """Return whether the first row is no rest: a current rises within a sample of a motor that stands."""
    if not all(map(_starts_at_rest, [outputs["w"]] if "w" in outputs else outputs.values())):
        return True
    return "w" in outputs and len(outputs) > 1 and _turns(outputs["w"]) and all(map(_is_steady, outputs.values()))


def _turns(w: FloatArray) -> bool:
    """Whether the first rows of a speed are none of a rest, though each may be: coarse counts."""
    first = w[:STEADY][~np.isnan(w[:STEADY])]
    error = noise_deviation(w) / np.sqrt(max(len(first), 1))
    return len(first) > 0 and bool(abs(float(np.mean(first))) > AT_REST * float(np.nanmax(np.abs(w))) + ONSET * error)


def _is_steady(y: FloatArray) -> bool:
    """Whether a signal stays where it is in its first rows: from a rest a current would jump."""
    first, then = y[:STEADY], y[STEADY : 2 * STEADY]
    error = max(noise_deviation(y), float(np.nanstd(first))) * np.sqrt(2 / STEADY)
    return len(then) == STEADY and abs(float(np.nanmean(then) - np.nanmean(first))) < TREND_SIGMAS * error


def _starts_at_rest(y: FloatArray) -> bool:
    finite = y[~np.isnan(y)]
    span = max(float(np.ptp(finite)), float(np.max(np.abs(finite))))
    return abs(float(finite[0])) <= AT_REST * span + 4 * noise_deviation(y)


def _moves(y: FloatArray) -> bool:
    finite = y[~np.isnan(y)]
    return float(np.ptp(running_mean(finite))) > 8 * noise_deviation(finite) / np.sqrt(5) and float(np.ptp(finite)) > 0
