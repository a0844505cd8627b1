"""What a ripple may be in a transient beside what it is while the machine runs steadily. Estimates nothing.

A ripple's size and phase are told by settled rows, hundreds of turns. In the first turns after an edge it is another:
the resistance and the flux that change with the rotor's position act on other currents and speeds there, and the
winding, which smooths a fast ripple, passes a slow one. One half wave may last as long as the current's rise, and what
it adds is then taken for L, J or a limit of the drive.

Each transient therefore has an error of its own with the ripple's wave, that fades as the signals settle. Its form is
the effect's (ripple.py), its size such that settled rows would show as much as they show of the ripple. Cosine and sine
of it are normal with a mean of 0: an error that samples share (whitener.py).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.fitting.windows import FEW_EDGES, find_windows

FloatArray = NDArray[np.float64]


def with_unsteady(fit: Fit) -> Fit:
    """Return the fit with the errors of its ripple in transients among its noise; of a long recording as it is."""
    return dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener, shared=unsteady(fit)))


def unsteady(fit: Fit) -> FloatArray | None:
    """Return what errors of variance 1 add to the sensors, (rows, q, k): of each ripple in each transient two."""
    if not any(group.unsteady is not None for group in fit.linear):
        return None
    found, at, fades, steady = [], 0, _fading(fit), find_windows(fit).settled & fit.whitener.moving
    for group in fit.linear:
        own = slice(at, at + group.columns.shape[2])
        at = own.stop
        if group.unsteady is None:
            continue
        channels = group.columns.any(axis=(0, 2))
        for e, clock in enumerate(fit.simulator.clocks):
            two, known = slice(2 * e, 2 * e + 2), np.arange(clock.rows.start, clock.rows.stop)[steady[clock.rows]]
            there = np.ix_(known, channels, np.arange(two.start, two.stop))
            size, unit = _size(group.columns[there] @ fit.coefficients[own][two]), _size(group.unsteady[there])
            for fade in fades:
                wave = size / max(np.sqrt(2) * unit, 1e-300) * group.unsteady[:, :, two] * fade[:, None, None]
                if wave.any():  # cosine and sine share the size
                    found.append(wave)
    return np.concatenate(found, axis=2) if found else None


def _size(x: FloatArray) -> float:
    """Return the root mean square of numbers."""
    return float(np.sqrt(np.mean(x * x))) if x.size else 0.0


def _fading(fit: Fit) -> list[FloatArray]:
    """Return how far the signals are from settled, (rows,), 1 at most: in each transient, of many in all of them."""
    found = []
    for transients in find_windows(fit).transients:
        own = []
        for rows in transients:
            away = np.abs(fit.shown[rows] - fit.shown[rows[-1]])
            largest = np.max(away, axis=0)
            fade = np.zeros(fit.simulator.rows)
            fade[rows] = np.max(away / np.where(largest > 0, largest, 1.0), axis=1)
            own.append(fade)
        found += own if len(own) <= FEW_EDGES else [np.sum(own, axis=0)]
    return found
