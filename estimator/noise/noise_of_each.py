"""The noise of each recording over that of the noisiest, from differences of neighbouring residuals. No colour.

A sensor is switched to another range, another one is taken. Where recordings go through other levels a noise that grows
with its signal makes them differ, too: what is likelier counts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.noise.noise_growth import CHARGE, Differences, Growth, differences_of, pooled
from estimator.noise.whitener import Whitener
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TOLD = 4.0  # standard errors by which noises differ; of n second differences' logarithm one is 1 / sqrt n
ALIKE = 0.2  # of a logarithm: noises that differ by less are one
FAR = 6.7  # times the median of sizes: 4.5 deviations, normal noise is hardly ever as far
LEAST_SHARE = 1e-3  # no range of a sensor is so much finer than another: what is left of less is no noise
ROUNDS = 2  # in which shares and growth are told, each by the other


def with_noise_of_each(whitener: Whitener, residuals: FloatArray, sharp: BoolArray, steps: FloatArray) -> Whitener:
    """Return a whitener by which recordings differ in their noise, where they do; of one recording the same.

    Parameters
    ----------
    residuals : (rows, q) array
    sharp : (rows,) array
        First parts of transients.
    steps : (n, q) array
        By which the sensors resolve the channels of each recording; 0: they are fine.
    """
    if len(whitener.clocks) == 1:
        return whitener
    told = [
        _shares(differences_of(residuals[:, j], whitener, j, sharp, steps=steps[:, j].tolist()))
        for j in range(residuals.shape[1])
    ]
    shares = np.array(told).T
    each = (
        None if np.all(shares == 1.0) else np.repeat(shares, [c.rows.stop - c.rows.start for c in whitener.clocks], 0)
    )
    return dataclasses.replace(whitener, each=each)


def _shares(each: Sequence[Differences]) -> FloatArray:
    """Return the noise of each recording over that of the noisiest, (n,), from its second differences of a channel."""
    best = np.ones(len(each))
    if sum(own.tell for own in each) < 2:
        return best
    grown = pooled(each).growth()
    least = pooled(each).misfit() - grown.fall
    for growth in (grown, Growth()):
        for _ in range(ROUNDS):
            shares = _given(each, growth)
            if np.all(shares == 1.0):
                break
            alike = pooled([own.over(Growth(), share) for own, share in zip(each, shares, strict=True)])
            growth = alike.growth()
            logs = sum(2 * len(own.sizes) * np.log(share) for own, share in zip(each, shares, strict=True))
            misfit = alike.misfit() - growth.fall + logs + CHARGE * np.count_nonzero(shares != 1.0)
            if misfit < least:
                best, least = shares, misfit
    return best


def _given(each: Sequence[Differences], growth: Growth) -> FloatArray:
    """Return the same of a noise that grows so: 1 where the recording does not tell, or the difference may be chance.

    What is left tells it more closely than its differences do, where both agree: else that is no noise alone.
    """
    told = np.array([own.tell for own in each])
    alike = [own.over(growth) for own in each]
    sizes = np.array([_typical(own.sizes) if there else 0.0 for own, there in zip(alike, told, strict=True)])
    left = np.array([_typical(own.left) if there else 0.0 for own, there in zip(alike, told, strict=True)])
    noisiest = int(np.argmax(sizes))
    counts = np.maximum([len(own.sizes) for own in each], 1)
    by_chance = TOLD * np.sqrt(1 / counts + 1 / counts[noisiest])
    share = np.where(sizes > 0, sizes, sizes[noisiest]) / sizes[noisiest]
    differs = np.log(share) < -np.maximum(by_chance, ALIKE)
    with np.errstate(divide="ignore", invalid="ignore"):  # of what is left nowhere
        closely = left / left[noisiest]
        agrees = np.abs(np.log(closely / share)) < by_chance
    return np.maximum(np.where(differs, np.where(agrees, np.minimum(closely, 1.0), share), 1.0), LEAST_SHARE)


def _typical(sizes: FloatArray) -> float:
    """Return the root mean square of sizes, (n,), of which few are far."""
    return float(np.sqrt(np.mean(np.minimum(sizes, FAR * median(sizes)) ** 2)))
