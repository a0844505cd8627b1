"""What a coarse sensor leaves open of a level: an error that all its samples share. Estimates nothing.

A sample of a converter with steps of q is up to q / 2 off. Noise or motion of more than half a step makes these errors
as good as independent, and a level is known as well as their number tells (Widrow and Kollár, Quantization Noise,
2008). With less of it all samples of a level show the same one or two values, and no number of them tells where between
them it lies: two values tell how often each is shown, which is where the level lies in deviations of a noise that
nobody knows. The error of the samples' mean is that over all levels and all normal noises, each as likely as it shows
such values.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.distributions import normal_chance
from estimator.fitting.fit import Fit
from estimator.plans.part import LONG
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

DEVIATIONS = np.linspace(0.02, 0.6, 30)  # of a step: noises that are tried
PLACES, NARROWER = 41, 4  # levels that are tried of each, as often about those that were likely
POSSIBLE = 12.0  # of ln likelihood: a level that is less likely by more is not
MOST_VALUES = 5  # that a level shows: of more the noise is no smaller than a step
VISIBLE = 0.1  # deviations of a level's mean that are known by its samples: a smaller error of it adds 0.5 % to a bar
REPEATED = 0.5  # of neighbours: if fewer differ, the sensor holds them
STAYS = 0.25  # of a step: a signal that moves by less stays at a level
LEAST_ROWS = 4  # of a level; of fewer the converter's own noise holds it
MOST_LEVELS = 48  # of an output, the longest: of many levels errors average out


def held_by_sensor(fit: Fit) -> NDArray[np.bool_]:
    """Return, of each output, (q,), whether its sensor shows the same value again and again while the machine runs.

    An encoder's counts that are differenced are not held: what one lacks the next has.
    """
    s, moving = fit.simulator, fit.whitener.moving
    beside = moving[1:] & moving[:-1]
    counted = np.array([s.plan.sensors[y] == layout.MEAN for y in s.outputs]) | (fit.whitener.noise.differenced > 0)
    held = s.coarse & ~counted
    for j in np.flatnonzero(held):
        changes = np.diff(s.measured[:, j])[beside]
        changes = changes[~np.isnan(changes)]
        held[j] = len(changes) > 0 and np.count_nonzero(changes) < REPEATED * len(changes)
    return held


def coarse_levels(fit: Fit) -> FloatArray | None:
    """Return what errors of variance 1 add to the sensors, (rows, q, k), a level each; None: no sensor is so coarse.

    A signal that settles slowly stays at levels, too.
    """
    s, noise = fit.simulator, fit.whitener.noise
    if s.rows > LONG:
        return None
    columns = []
    for j in np.flatnonzero(held_by_sensor(fit)).tolist():
        step, levels = float(s.steps[j]), list[slice]()
        for clock in s.clocks:
            levels += [
                slice(clock.rows.start + first, clock.rows.start + last)
                for first, last in _levels(fit.explained[clock.rows, j], STAYS * step)
            ]
        for rows in sorted(levels, key=lambda rows: rows.start - rows.stop)[:MOST_LEVELS]:
            shown = s.measured[rows, j]
            shown = shown[~np.isnan(shown)]
            if len(shown) < LEAST_ROWS:
                continue
            error = level_error(shown, step)
            if error > VISIBLE * noise.white[j] / np.sqrt(len(shown)):
                columns.append(np.zeros((s.rows, len(s.outputs))))
                columns[-1][rows, j] = error
    return np.stack(columns, axis=2) if columns else None


def level_error(shown: FloatArray, step: float) -> float:
    """Return the deviation of what the mean of samples, (n,), is off by, in their unit, with a sensor of this step.

    Beside what it is off as a mean of independent samples.
    """
    codes = np.rint((shown - shown.min()) / step).astype(int)
    return 0.0 if codes.max() >= MOST_VALUES else step * _off(tuple(np.bincount(codes).tolist()))


@lru_cache(maxsize=1024)
def _off(counts: tuple[int, ...]) -> float:
    """Return it in steps, of how often each value is shown."""
    many, values = np.array(counts, dtype=float), np.arange(len(counts))
    n = float(many.sum())
    mean = float(many @ values) / n
    independent = float(many @ (values - mean) ** 2) / n**2
    edges = np.arange(len(counts) + 1) - 0.5
    low, high = np.full(len(DEVIATIONS), edges[0]), np.full(len(DEVIATIONS), edges[-1])
    for _ in range(NARROWER):
        places = np.linspace(low, high, PLACES)
        below = normal_chance((edges[:, None, None] - places) / DEVIATIONS)
        chances = np.log(np.maximum(np.diff(below, axis=0), 1e-300))
        likelihood = np.tensordot(many, chances, axes=1)
        possible = likelihood > likelihood.max(axis=0) - POSSIBLE
        apart = (high - low) / (PLACES - 1)
        low = np.maximum(np.where(possible, places, np.inf).min(axis=0) - apart, edges[0])
        high = np.minimum(np.where(possible, places, -np.inf).max(axis=0) + apart, edges[-1])
    weights = np.exp(likelihood - likelihood.max()) * apart
    square = float(np.sum(weights * (mean - places) ** 2) / weights.sum())
    return float(np.sqrt(max(square - independent, 0.0)))


def _levels(signal: FloatArray, within: float) -> list[tuple[int, int]]:
    """Return where a signal, (n,), stays within so much of its last value: the first row, and that after the last."""
    values, last = signal.tolist(), len(signal)
    found = []
    for k in range(len(values) - 1, -1, -1):
        if abs(values[k] - values[last - 1]) > within:
            found.append((k + 1, last))
            last = k + 1
    return [*found, (0, last)]
