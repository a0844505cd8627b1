"""What a recording shows by itself: where the input steps, noise, what settled, what is lost. Knows no FMU.

Used before any simulation, to choose the start, the weights and the way of searching, and after it for the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, SECOND_DIFFERENCE, STEP_DEVIATION
from estimator.recordings.samples import filled, mean_of_known, median, told_once

FloatArray = NDArray[np.float64]

# Deviations of second, fourth, sixth and eighth differences of white noise of 1.
EVEN_DIFFERENCES = tuple(math.sqrt(math.comb(2 * order, order)) for order in (2, 4, 6, 8))
FEW_DIFFERENCES = 3  # fewer of a higher order tell nothing
LEAST_NOISE = 1e-6  # of the largest of an input: less is the rounding of a command

NORMAL_SPAN = 4.0  # standard deviations: normal noise spans more, a pseudo-random signal less
LEVEL = 0.02  # of the input's range: a smaller change is no new level
AT_REST = 0.02  # of the output's range: less is rest
TREND = 0.005  # of the response: a larger trend over the last tenth is not settled
TREND_SIGMAS = 4.0
TAIL = 0.1  # of the samples after the step, over which the trend is judged
BAND = 0.02  # of the response: the steady state of the paper
SETTLED_MARGIN = 2.5  # times the time to enter the band: an exponential is then within 6e-5
LOST_JUMP = 0.2  # of the response in one interval, alone: the transient lies between two samples
LOST_RATIO = 5.0
ONSET, ONSET_SWING = 5.0, 0.01  # deviations of the noise; of the response: more is a response
ONSET_BASE = 10  # samples before the step that tell the noise
WINDOWS, CUBIC = (5, 7, 11, 15, 21, 31, 43, 61, 87, 123, 175, 247, 351, 497), 3  # rows of a local polynomial
AGREED = 2.5  # deviations of what each number of them tells
CORNERS = 0.05  # of the rows
LIKE_THE_LAST = 0.5  # correlation of each change with the one before, at least, of an input that moves smoothly
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
    noise = _row_by_row(v)
    if _is_restless(v, noise):
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


@told_once
def noise_deviation(y: FloatArray) -> float:
    """Return the standard deviation of a signal's white noise, from its second differences.

    Robust against the transient and outliers (median absolute deviation); a resting encoder, whose samples repeat
    exactly, is left out unless nothing else is there. Quantisation counts as noise of step/√12.
    """
    y = y[~np.isnan(y)]
    if len(y) < 5:
        return 0.0
    second = y[2:] - 2 * y[1:-1] + y[:-2]
    resting = (y[2:] == y[1:-1]) & (y[1:-1] == y[:-2])
    moving = second[~resting]
    if len(moving) < max(10, 0.05 * len(second)):
        moving = second
    deviation = median(np.abs(moving)) / MEDIAN_SIZE / SECOND_DIFFERENCE
    return max(float(deviation), quantum(y) / STEP_DEVIATION)


def is_measured(v: FloatArray) -> bool:
    """Whether an input has noise, as what is measured has, and no command."""
    return input_noise(v) > LEAST_NOISE * float(np.max(np.abs(v), initial=0.0))


def input_noise(v: FloatArray) -> float:
    """Return the deviation of an input's noise; 0 for levels that repeat exactly, and where it moves in every row."""
    noise = _row_by_row(v)
    return 0.0 if _is_restless(v, noise) else noise


@told_once
def moves_smoothly(v: FloatArray) -> bool:
    """Whether an input, (n,), goes on as it went, beside its noise: no levels, whose edges are each a change alone."""
    change, noise = np.diff(v), _row_by_row(v) ** 2
    turn = np.diff(change)
    moved, turned = float(change @ change) - 2 * noise * len(change), float(turn @ turn) - 6 * noise * len(turn)
    return moved > 0 and turned < 2 * (1 - LIKE_THE_LAST) * moved


class Smoothed(NamedTuple):
    """An input without its noise, (n,), the deviation of that, and how many rows tell each row of it."""

    signal: FloatArray
    noise: float
    rows: float


@told_once
def smoothed(v: FloatArray) -> Smoothed:
    """Return an input that moves smoothly, (n,), without its noise: by local cubics (Savitzky and Golay 1964).

    Over as many rows as generalised cross-validation finds, corners left out (Craven and Wahba 1979); beside a corner
    over as many as agree with what fewer tell, within the noise (Goldenshluger and Nemirovski 1997).
    """
    from scipy.signal import savgol_coeffs, savgol_filter

    windows = [rows for rows in WINDOWS if rows < len(v)]
    smooth = [savgol_filter(v, rows, CUBIC, mode="interp") for rows in windows]
    own = [float(savgol_coeffs(rows, CUBIC)[rows // 2]) for rows in windows]  # a sample's part in what is told of it
    scores = [_without_largest((v - s) ** 2) / (1 - part) ** 2 for s, part in zip(smooth, own, strict=True)]
    quiet, noise = v.copy(), _row_by_row(v)
    low, high = v - AGREED * noise, v + AGREED * noise
    agreed = np.ones(len(v), dtype=bool)
    for k in range(int(np.argmin(scores)) + 1 if scores else 0):
        error = AGREED * noise * np.sqrt(own[k])
        low, high = np.maximum(low, smooth[k] - error), np.minimum(high, smooth[k] + error)
        agreed &= low <= high
        quiet[agreed] = smooth[k][agreed]
    return Smoothed(quiet, noise, 1 / own[int(np.argmin(scores))] if scores else 1.0)


def _without_largest(squares: FloatArray) -> float:
    """Return the mean of squares without the largest of them."""
    kept = len(squares) - int(CORNERS * len(squares))
    return float(np.mean(np.partition(squares, kept - 1)[:kept]))


def _row_by_row(v: FloatArray) -> float:
    """Return the deviation of what an input does from row to row, be it noise or not.

    Rows of exactly none show no noise: a converter's at rest, or those in which the voltage is the motor's own.
    """
    x = v[v != 0]
    sizes: list[float] = []
    for of_white in EVEN_DIFFERENCES:  # a wave of few rows has large second differences
        x = x[2:] - 2 * x[1:-1] + x[:-2]
        if len(x) < (FEW_DIFFERENCES if sizes else 1):
            break
        sizes.append(median(np.abs(x)) / MEDIAN_SIZE / of_white)
    return min(sizes, default=0.0)


def _is_restless(v: FloatArray, noise: float) -> bool:
    """Return whether an input moves in every row: no noise around a level spans so little of its own deviation."""
    return float(np.ptp(v)) < NORMAL_SPAN * noise


@told_once
def quantum(y: FloatArray) -> float:
    """Return the step of a quantised signal; 0 if it is not quantised.

    An angle in counts hardly repeats a value, but its differences do. So do those of values that are printed with few
    digits, which are then the steps of the digits.
    """
    y = y[~np.isnan(y)]
    if (step := _lattice(y)) > 0:
        return step
    fine = _lattice(np.diff(y))
    turns = len(np.unique(y)) > TURNS * len(y)
    return _lattice(y, printed=fine) or (_lattice(_without_digits(np.diff(y))) if turns else 0.0) or fine


def _without_digits(y: FloatArray) -> FloatArray:
    """Return values, (n,), each of which is the mean of a group of neighbours that differ by printed digits alone.

    A group is far from the next, as levels are from each other. Of small values more digits are printed.
    """
    order = np.argsort(y, kind="stable")
    gaps = np.diff(y[order])
    sizes = np.sort(gaps[gaps > 1e-9 * float(np.max(np.abs(y), initial=0.0))])
    if len(sizes) < LEAST_LEVELS:
        return y
    most = len(sizes) - LEAST_LEVELS // 2  # so many gaps at least are between levels, most of them a step apart
    ratios = np.where(sizes[1:] > BESIDE * sizes[most], sizes[1:] / sizes[:-1], 0.0)[:most]
    k = int(np.argmax(ratios))
    if ratios[k] < APART:
        return y
    group = np.concatenate([[0], np.cumsum(gaps > np.sqrt(sizes[k] * sizes[k + 1]))])
    means = np.bincount(group, y[order]) / np.bincount(group)
    return np.asarray(means[group])


OFF_LATTICE = 0.05  # of a step
TURNS = 0.5  # of the samples: values, of an angle that goes on
APART, BESIDE = 2.5, 0.3  # times the gaps between printed digits are those between steps; part of the usual one
PRINTED, LEAST_LEVELS = 0.2, 12  # of a step, that a digit may be; levels that tell the step then


def _lattice(y: FloatArray, *, printed: float = 0.0) -> float:
    """Return the distance of the levels that values lie on, which may be printed with few digits; 0: they do not.

    Parameters
    ----------
    printed : float
        Step of the digits that values are printed with, if it is known: a difference of two is off by as much.
    """
    peak = float(np.max(np.abs(y), initial=0.0))
    differences = np.diff(np.sort(y))
    differences = differences[differences > 1e-9 * peak]  # the rest is one level, or rounding
    if len(differences) < 2 or len(differences) > 0.5 * len(y):
        return 0.0
    step, reach = float(np.min(differences)), 1.5
    if printed > PRINTED * step or (printed > 0 and len(differences) < LEAST_LEVELS):
        return 0.0
    off = OFF_LATTICE + printed / step
    while True:  # few digits tell a step only roughly, and many of them are then no whole number
        near = differences[differences < reach * step]
        multiples = near / step
        whole = np.round(multiples)
        if float(np.max(np.abs(multiples - whole))) >= off:
            return 0.0
        step = float(np.sum(near) / np.sum(whole))
        if len(near) == len(differences):
            return step
        reach *= 4.0


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


@dataclass(frozen=True)
class Settling:
    """Whether a step response reached its final value.

    Attributes
    ----------
    settled : bool
    start : int
        First sample of the settled part (of the last tenth, if not settled).
    reason : str
        Why it counts as not settled.
    """

    settled: bool
    start: int
    reason: str = ""


def find_settling(step: Excitation, outputs: Mapping[str, FloatArray], *, interval: float) -> Settling:
    """Judge, on each output's trend against its own noise, whether the response to a step has settled.

    Parameters
    ----------
    step : Excitation
        Of kind "step".
    outputs : name → (n,) array
    interval : float
        s, sampling interval.
    """
    n = len(next(iter(outputs.values())))
    after = n - step.index
    tail = max(5, int(TAIL * after))
    start = step.index
    if after < 20:
        return Settling(False, n - min(tail, after), "fewer than 20 samples follow the step")
    for name, y in outputs.items():
        response = y[step.index :]
        final = mean_of_known(response[-tail:])
        if np.isnan(final):
            continue  # what was not recorded tells nothing
        swing = float(np.nanmax(response) - np.nanmin(response))
        if swing == 0:
            continue
        slope, error = _trend(response[-tail:])
        error = max(error, noise_deviation(response) / np.sqrt(tail**3 / 12))  # a few samples' own scatter may be small
        change = abs(slope) * tail
        if change > max(TREND * swing, TREND_SIGMAS * error * tail):
            return Settling(
                False,
                n - tail,
                f"{name} still changed by {100 * change / swing:.2g} % of its response"
                f" in the last {tail * interval:.3g} s",
            )
        outside = np.abs(_smoothed(response) - final) > max(BAND * swing, TREND_SIGMAS * noise_deviation(response))
        inside = int(np.flatnonzero(outside)[-1]) + 1 if outside.any() else 0
        start = max(start, step.index + int(SETTLED_MARGIN * inside))
    return Settling(True, min(start, n - tail))


def lost_transient(step: Excitation, y: FloatArray) -> tuple[int, float] | None:
    """Return sample and size (part of the response) of a jump that no neighbour shares, or None."""
    difference = np.abs(np.diff(filled(y)))
    response = float(np.nanmax(y) - np.nanmin(y))
    if response == 0 or len(difference) < 5:
        return None
    k = int(np.argmax(difference))
    neighbours = max(
        float(np.max(difference[max(0, k - 2) : k], initial=0.0)),
        float(np.max(difference[k + 1 : k + 3], initial=0.0)),
    )
    noise = noise_deviation(y)
    beyond = difference[k] > LOST_RATIO * neighbours + 6 * noise
    if difference[k] > LOST_JUMP * response and beyond and k >= step.index - 1:
        return k + 1, float(difference[k]) / response
    return None


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
    return float(np.ptp(_smoothed(finite))) > 8 * noise_deviation(finite) / np.sqrt(5) and float(np.ptp(finite)) > 0


def _trend(y: FloatArray) -> tuple[float, float]:
    """Return slope a sample, and its standard error, of a straight line through the samples."""
    k = np.flatnonzero(~np.isnan(y)).astype(float)
    values = y[~np.isnan(y)]
    if len(values) < 3:
        return 0.0, np.inf
    k -= k.mean()
    slope = float(k @ (values - values.mean()) / (k @ k))
    residual = values - values.mean() - slope * k
    power = float(residual @ residual)
    alike = float(np.clip(residual[1:] @ residual[:-1] / power, 0.0, 0.95)) if power > 0 else 0.0  # of a mean: much
    return slope, float(np.sqrt(power / (len(k) - 2) / (k @ k) * (1 + alike) / (1 - alike)))


def _smoothed(y: FloatArray, *, width: int = 5) -> FloatArray:
    """Return the running mean over `width` samples, same length."""
    padded = np.pad(filled(y), width // 2, mode="edge")
    return np.convolve(padded, np.ones(width) / width, mode="valid")
