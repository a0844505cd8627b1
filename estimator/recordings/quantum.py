"""The step of a quantised signal, told by its values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.samples import told_once

FloatArray = NDArray[np.float64]

OFF_LATTICE = 0.05  # of a step
REPEATS = 0.5  # of the samples: levels of a signal that repeats them
BY_CHANCE = 12  # gaps of two steps or more: that all are whole is chance once in 2 OFF_LATTICE to that power
FIRST_REACH, FURTHER = 1.5, 4.0  # times the least gap: those are looked at first; and times as far then
MOST_TOGETHER = 200_000  # gaps times the steps that they are held against at once
MOST_STEPS = 64  # between the two nearest levels
TURNS = 0.5  # of the samples: values, of an angle that goes on
APART, BESIDE = 2.5, 0.3  # times the gaps between printed digits are those between steps; part of the usual one
PRINTED, LEAST_LEVELS = 0.2, 12  # of a step, that a digit may be; levels that tell the step then


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
    known = _lattice(y, printed=fine) if fine > 0 else 0.0  # of no digits it is told above
    return known or (_lattice(_without_digits(np.diff(y))) if turns else 0.0) or fine


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


def _lattice(y: FloatArray, *, printed: float = 0.0) -> float:
    """Return the distance of the levels that values lie on, which may be printed with few digits; 0: they do not.

    Parameters
    ----------
    printed : float
        Step of the digits that values are printed with, if it is known: a difference of two is off by as much.
    """
    peak = float(np.max(np.abs(y), initial=0.0))
    differences = np.diff(np.sort(y))
    differences = np.sort(differences[differences > 1e-9 * peak])  # the rest is one level, or rounding
    if len(differences) < 2:
        return 0.0
    repeats, least = len(differences) <= REPEATS * len(y), float(differences[0])
    if printed > PRINTED * least or (printed > 0 and len(differences) < LEAST_LEVELS):
        return 0.0
    if repeats:
        return _step(differences, np.ones(1), printed, repeats=True)
    if len(differences) < BY_CHANCE:
        return 0.0
    return _step(differences, np.arange(1.0, 1 + MOST_STEPS), printed, repeats=False)


def _step(differences: FloatArray, parts: FloatArray, printed: float, *, repeats: bool) -> float:
    """Return the first step of which all differences are whole multiples; 0: there is none.

    Few digits tell a step only roughly, and many of them are then no whole number: it is told by the least ones first.

    Parameters
    ----------
    differences : (n,), sorted
    parts : (m,)
        A step is this part of the least difference: of an angle the nearest samples may be some steps apart.
    repeats : bool
        Whether the levels repeat: else it may be chance, or a line, whose differences are one, as often as it likes.
    """
    steps, reach = differences[0] / parts, FIRST_REACH * differences[0]
    off = OFF_LATTICE + printed / steps
    while len(steps):
        near = differences[: np.searchsorted(differences, reach)]
        if len(parts) > 1 and len(near) * len(parts) > MOST_TOGETHER:
            return next(
                (s for n in parts if (s := _step(differences, np.array([n]), printed, repeats=repeats)) > 0), 0.0
            )
        multiples = near / steps[:, None]
        whole = np.round(multiples)
        fits = np.max(np.abs(multiples - whole), axis=1) < off
        whole, off, parts = whole[fits], off[fits], parts[fits]
        steps = np.sum(near) / np.sum(whole, axis=1)
        if len(near) == len(differences):
            return next((float(s) for s, n in zip(steps, whole, strict=True) if repeats or _is_told(n)), 0.0)
        reach *= FURTHER
    return 0.0


def _is_told(multiples: FloatArray) -> bool:
    """Whether whole multiples, (n,), of a step tell it: many are of two or more, and none is in all of them."""
    return int(np.count_nonzero(multiples > 1)) >= BY_CHANCE and int(np.gcd.reduce(multiples.astype(np.int64))) == 1
