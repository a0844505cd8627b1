"""How noise grows with its signal, and its size, from differences of neighbouring residuals. Knows no colour."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL, MEDIAN_SIZE, SECOND_DIFFERENCE, T_FREEDOM, T_MEDIAN
from estimator.noise.noise_model import NoiseModel, grown
from estimator.noise.whitener import Whitener
from estimator.recordings.samples import median, medians, sum_of_logs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TOGETHER = 1_000_000  # numbers that growths are tried on at once
DIFFERENCES = 8000  # second differences that tell the growth; of more than twice as many some are left out
FARTHEST = 1e37  # of a square, in deviations: a larger one counts as this
CHARGE = 2 * LEAST_FALL  # of -2 log L: twice, as the squares of neighbours correlate by 0.44
HOPELESS = 0.5  # of what a growth is charged: where a coarse one falls by no more, none is looked at closely
SILENT = 1e-3  # of the noise of a machine that runs: an encoder has none at rest, which tells of no growth
LOUD_SAMPLES = 25  # samples of a large signal, and as many below half of it: fewer do not show a growth


def noise_of_neighbours(whitener: Whitener, residuals: FloatArray, sharp: BoolArray) -> NoiseModel:
    """Return the white noise that samples beside each other show, and its growth; arguments as for `fit_noise`."""
    told = [growth_of(residuals[:, j], whitener, j, sharp) for j in range(residuals.shape[1])]
    white = [w if w > 0 else old for (_, w), old in zip(told, whitener.noise.white, strict=True)]
    return dataclasses.replace(whitener.noise, white=np.array(white), growth=np.array([c for c, _ in told]))


def growth_of(
    residuals: FloatArray, whitener: Whitener, j: int, sharp: BoolArray, *, step: float = 0.0
) -> tuple[float, float]:
    """Return how a channel's noise grows with its signal, c of `NoiseModel.growth`, from second differences.

    The second number is the deviation at rest of white noise of such differences, spread as they are; 0: too few
    samples.

    Second differences contain the noise and hardly any misfit, so that transients can be used, but for their first
    part. Their size is estimated by Student's t, on which outliers have little influence.

    Parameters
    ----------
    sharp : (rows,) array
        First parts of transients.
    step : float
        By which the sensor resolves the channel; 0: it is fine. Differences of a level are whole steps, and their
        median is up to half as large again, or as small, as that of a signal that moves with the same noise: all
        samples are spread over a step.
    """
    sizes, levels, moves = [], [], []
    for clock in whitener.clocks:
        x, known = residuals[clock.rows], whitener.present[clock.rows, j] & ~sharp[clock.rows]
        if len(x) < 3:
            continue
        told = known[2:] & known[1:-1] & known[:-2]
        sizes.append(_second_differences(x)[told])
        levels.append(whitener.level[clock.rows, j][1:-1][told])
        moves.append(whitener.moving[clock.rows][1:-1][told])
    if _is_silent(sizes, moves):  # all others are of a signal that moves
        sizes, levels = ([own[there] for own, there in zip(all_, moves, strict=True)] for all_ in (sizes, levels))
    elif step:
        rng = np.random.default_rng(0)
        sizes = [own + step * _second_differences(rng.random(len(own) + 2)) for own in sizes]
    d, level = np.concatenate([*sizes, np.zeros(0)]), np.concatenate([*levels, np.zeros(0)])
    if len(d) > 2 * DIFFERENCES:
        d, level = d[:: len(d) // DIFFERENCES], level[:: len(d) // DIFFERENCES]
    if len(level) < 2 * LOUD_SAMPLES or not np.any(d):
        return 0.0, 0.0
    floor, sizes = 1e-3 * median(np.abs(d[d != 0])), np.abs(d)

    def size(g: FloatArray) -> float:
        return max(median(sizes / g) / T_MEDIAN, floor)

    def white(g: FloatArray) -> float:
        return size(g) * T_MEDIAN / MEDIAN_SIZE / SECOND_DIFFERENCE

    loud = float(np.sort(level)[-LOUD_SAMPLES])
    if np.count_nonzero(level < loud / 2) < LOUD_SAMPLES:
        return 0.0, white(np.ones_like(level))

    squares, powers = sizes * sizes, level * level

    def misfits(c: FloatArray) -> FloatArray:
        together, found = max(1, TOGETHER // len(d)), []
        for some in (c[k : k + together] for k in range(0, len(c), together)):
            g = 1 + (some * some)[:, None] * powers
            ratio = squares / g
            unit = np.maximum(medians(ratio) / T_MEDIAN**2, floor**2)
            ratio /= (T_FREEDOM * unit)[:, None]
            far = np.minimum(ratio, FARTHEST, out=ratio)
            far += 1.0
            found.append(sum_of_logs(g) + len(d) * np.log(unit) + (T_FREEDOM + 1) * sum_of_logs(far))
        return np.concatenate(found)

    coarse, c = np.geomspace(0.3, 300.0, 16) / loud, 0.0
    none, *there = misfits(np.append(0.0, coarse)).tolist()
    if none - np.min(there) > HOPELESS * CHARGE:
        fine = coarse[np.argmin(there)] * np.geomspace(0.7, 1.43, 9)
        reached = misfits(fine)
        if none - np.min(reached) > CHARGE:
            c = float(fine[np.argmin(reached)])
    return c, white(grown(c * level))


def _second_differences(x: FloatArray) -> FloatArray:
    return x[2:] - 2 * x[1:-1] + x[:-2]


def _is_silent(differences: list[FloatArray], moves: list[BoolArray]) -> bool:
    """Whether a channel shows no noise while the machine is at rest."""
    sizes, running = (
        np.abs(np.concatenate([*differences, np.zeros(0)])),
        np.concatenate([*moves, np.zeros(0, dtype=bool)]),
    )
    if running.all() or not running.any():
        return False
    return median(sizes[~running]) <= SILENT * median(sizes[running])
