"""What a coarse sensor leaves open of a level: an error that all its samples share. Estimates nothing.

A sample of a converter with steps of q is up to q / 2 off. Noise or motion of more than half a step makes these errors
as good as independent, and a level is known as well as their number tells (Widrow and Kollár, Quantization Noise,
2008). With less of it all samples of a level show the same one or two values, and no number of them tells where between
them it lies: two values tell how often each is shown, which is where the level lies in deviations of a noise that
nobody knows. The error of the samples' mean is that over all levels and all normal noises, each as likely as it shows
such values. Where the signal moves slowly, a noise shows as values that go back and forth: where none do there is none,
and a level that shows one value may lie anywhere within its step.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.distributions import normal_chance
from estimator.fitting.fit import Fit
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

DEVIATIONS = np.append(0.002, np.linspace(0.02, 0.6, 30))  # of a step: noises that are tried
PLACES, NARROWER = 41, 4  # levels that are tried of each, as often about those that were likely
POSSIBLE = 12.0  # of ln likelihood: a level that is less likely by more is not
MOST_VALUES = 5  # that a level shows: of more the noise is no smaller than a step
VISIBLE = 0.1  # deviations of a level's mean that are known by its samples: a smaller error of it adds 0.5 % to a bar
REPEATED = 0.5  # of neighbours: if fewer differ, the sensor holds them
STAYS = 0.25  # of a step: a signal that moves by less stays at a level
LEAST_CHANGE = 0.5  # of a step
KEPT = 8  # rows
LEAST_ROWS = 4  # of a level; of fewer the converter's own noise holds it
SLOW = 0.05  # of a step a row: so slowly a signal passes from one value to the next that noise would show there
STANDS = 0.005  # of a step a row: a slower signal may be moved by what is not explained
FEW_SLOW = 3  # passages: fewer do not tell that there is no noise
PASSES = 2.0  # deviations of the noise that a signal passes in a row, if values do not go back and forth
MOST_ROWS = 60_000  # of more a level is one of many
MOST_LEVELS = 48  # of an output, the longest: of many levels errors average out


def held_by_sensor(fit: Fit) -> NDArray[np.bool_]:
    """Return, of each output, (q,), whether its sensor shows the same value again and again while the machine runs.

    An encoder's counts that are differenced are not held: what one lacks the next has.
    """
    s, moving = fit.simulator, fit.whitener.moving
    counted = np.array([s.plan.sensors[y] == layout.MEAN for y in s.outputs]) | (fit.whitener.noise.differenced > 0)
    held = s.coarse & ~counted
    for j in np.flatnonzero(held):
        there = moving & np.isfinite(s.measured[:, j])
        changes = np.concatenate([np.diff(s.measured[clock.rows, j][there[clock.rows]]) for clock in s.clocks])
        held[j] = len(changes) > 0 and np.count_nonzero(changes) < REPEATED * len(changes)
    return held


def coarse_levels(fit: Fit) -> FloatArray | None:
    """Return what errors of variance 1 add to the sensors, (rows, q, k), a level each; None: no sensor is so coarse.

    A signal that settles slowly stays at levels, too.
    """
    s, noise = fit.simulator, fit.whitener.noise
    if s.rows > MOST_ROWS:
        return None
    columns = []
    for j in np.flatnonzero(held_by_sensor(fit)).tolist():
        step, levels, most = float(s.steps[j]), list[slice](), DEVIATIONS[-1]
        for clock in s.clocks:
            shown, signal = s.measured[clock.rows, j] / step, fit.explained[clock.rows, j] / step
            most, first_row = min(most, _most_noise(shown, signal)), clock.rows.start
            levels += [slice(first_row + a, first_row + b) for a, b in _levels(signal, _held_on(shown))]
        for rows in sorted(levels, key=lambda rows: rows.start - rows.stop)[:MOST_LEVELS]:
            shown = s.measured[rows, j]
            shown = shown[~np.isnan(shown)]
            if len(shown) < LEAST_ROWS:
                continue
            error = level_error(shown, step, most)
            if error > VISIBLE * noise.white[j] / np.sqrt(len(shown)):
                columns.append(np.zeros((s.rows, len(s.outputs))))
                columns[-1][rows, j] = error
    return np.stack(columns, axis=2) if columns else None


def level_error(shown: FloatArray, step: float, most: float = DEVIATIONS[-1]) -> float:
    """Return the deviation of what the mean of samples, (n,), is off by, in their unit, with a sensor of this step.

    Beside what it is off as a mean of independent samples.

    Parameters
    ----------
    most : float
        Deviation of the noise at most, in steps. Where several values are shown the level itself may move.
    """
    codes = np.rint((shown - shown.min()) / step).astype(int)
    counts = tuple(np.bincount(codes).tolist())
    if len(counts) > MOST_VALUES:
        return 0.0
    return step * _off(counts, int(np.count_nonzero(most >= DEVIATIONS)) if len(counts) == 1 else len(DEVIATIONS))


def _most_noise(shown: FloatArray, signal: FloatArray) -> float:
    """Return the largest deviation of a noise that its slow passages from value to value allow, in steps.

    Parameters
    ----------
    shown, signal : (n,) arrays
        What the sensor shows, and what is explained of it, in steps.
    """
    there = np.flatnonzero(np.isfinite(shown))
    changes, pace = np.diff(shown[there]), np.diff(signal[there]) / np.diff(there)
    slow = (np.abs(changes) > LEAST_CHANGE) & (np.abs(pace) > STANDS) & (np.abs(pace) < SLOW)
    if np.count_nonzero(slow) < FEW_SLOW or np.any(changes[slow] * pace[slow] < 0):
        return float(DEVIATIONS[-1])
    return max(PASSES * float(np.sort(np.abs(pace[slow]))[FEW_SLOW - 1]), float(DEVIATIONS[0]))


@lru_cache(maxsize=1024)
def _off(counts: tuple[int, ...], noises: int) -> float:
    """Return it in steps, of how often each value is shown, by so many of the noises."""
    deviations = DEVIATIONS[:noises]
    many, values = np.array(counts, dtype=float), np.arange(len(counts))
    n = float(many.sum())
    mean = float(many @ values) / n
    independent = float(many @ (values - mean) ** 2) / n**2
    edges = np.arange(len(counts) + 1) - 0.5
    low, high = np.full(noises, edges[0]), np.full(noises, edges[-1])
    for _ in range(NARROWER):
        places = np.linspace(low, high, PLACES)
        below = normal_chance((edges[:, None, None] - places) / deviations)
        chances = np.log(np.maximum(np.diff(below, axis=0), 1e-300))
        likelihood = np.tensordot(many, chances, axes=1)
        possible = likelihood > likelihood.max(axis=0) - POSSIBLE
        apart = (high - low) / (PLACES - 1)
        low = np.maximum(np.where(possible, places, np.inf).min(axis=0) - apart, edges[0])
        high = np.minimum(np.where(possible, places, -np.inf).max(axis=0) + apart, edges[-1])
    weights = np.exp(likelihood - likelihood.max()) * apart
    square = float(np.sum(weights * (mean - places) ** 2) / weights.sum())
    return float(np.sqrt(max(square - independent, 0.0)))


def _levels(signal: FloatArray, shown: FloatArray) -> list[tuple[int, int]]:
    """Return where a signal, (n,), stays, and does not pass to another value: the first row, and that after the last.

    Both in steps of the sensor.
    """
    values, last = signal.tolist(), len(signal)
    passes = _passages(shown).tolist()
    found = []
    for k in range(len(values) - 1, -1, -1):
        if abs(values[k] - values[last - 1]) > STAYS or passes[k]:
            found.append((k + 1, last))
            last = k + 1
    return [(first, last) for first, last in [*found, (0, last)] if first < last]


def _held_on(samples: FloatArray) -> FloatArray:
    """Return samples, (n,), each missing one as the one before: a logger may show one for many rows."""
    last = np.maximum.accumulate(np.where(np.isfinite(samples), np.arange(len(samples)), 0))
    return samples[last]


def _passages(shown: FloatArray) -> NDArray[np.bool_]:
    """Return behind which rows a sensor shows another value, (n,), which it keeps, as before the one it had."""
    changes = np.flatnonzero(np.abs(np.diff(shown)) > LEAST_CHANGE)
    apart = np.diff(np.concatenate([[-KEPT], changes, [len(shown) - 1 + KEPT]]))
    found = np.zeros(len(shown), dtype=bool)
    found[changes[(apart[:-1] >= KEPT) & (apart[1:] >= KEPT)]] = True
    return found
