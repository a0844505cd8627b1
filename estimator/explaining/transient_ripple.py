"""What a ripple may be in a transient beside what it is while the machine runs steadily. Estimates nothing.

A ripple's size and phase are told by settled rows, hundreds of turns. In the first turns after an edge it is another:
the resistance and the flux that change with the rotor's position act on other currents and speeds there, and the
winding, which smooths a fast ripple, passes a slow one. One half wave may last as long as the current's rise, and what
it adds is then taken for L, J or a limit of the drive.

Each transient therefore has an error of its own with the ripple's wave, that fades as the signals settle. Its form is
the effect's (ripple.py), its size such that settled rows would show as much as they show of the ripple. Cosine and sine
of it are normal with a mean of 0: an error that samples share (shared_errors.py). Where that form would have to be
larger than is possible, it is as large as is possible, and another is there beside it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.fitting.windows import FEW_EDGES, find_windows

FloatArray = NDArray[np.float64]


def transient_ripple(fit: Fit) -> FloatArray | None:
    """Return what errors of variance 1 add to the sensors, (rows, q, k): of each ripple in each transient two or four.

    None: there is no ripple, or the recording is a long one.
    """
    found = list[FloatArray]()
    fades = _fading(fit) if any(group.transient is not None for group in fit.linear) else []
    for _, pairs in _of_ripples(fit):
        waves = [size * pair * fade[:, None, None] for size, pair in pairs for fade in fades]
        found += [wave for wave in waves if wave.any()]
    return np.concatenate(found, axis=2) if found else None


def transient_ripple_sizes(fit: Fit) -> dict[str, list[float]]:
    """Return the deviation of the coefficients of each ripple's change in a transient, by its name, of each recording.

    By such a coefficient settled rows would show as much as they show of the ripple, if no bound is below it.
    """
    found = dict[str, list[float]]()
    for name, pairs in _of_ripples(fit):
        found.setdefault(name, []).append(pairs[0][0])
    return found


def _of_ripples(fit: Fit) -> Iterator[tuple[str, list[tuple[float, FloatArray]]]]:
    """Yield, of each ripple and recording, its name and its forms in transients: their deviations, cosine and sine."""
    steady = find_windows(fit).settled & fit.whitener.moving
    for group, own in fit.linear_parts:
        if group.transient is None:
            continue
        channels = group.columns.any(axis=(0, 2))
        for e, clock in enumerate(fit.simulator.clocks):
            there = np.zeros_like(steady)
            there[clock.rows] = steady[clock.rows]
            rows = np.ix_(there, channels)
            shown = _size((_of_recording(group.columns, e) @ _of_recording(own, e))[rows])
            forms = [_of_recording(form, e) for form in (group.transient, group.beyond) if form is not None]
            there_is = [2**0.5 * _size(form[rows]) for form in forms]  # cosine and sine share it
            sizes = [shown / size if size > 0 else np.inf for size in there_is]
            enough = sizes[0] <= group.most_transient
            sizes[0] = min(sizes[0], group.most_transient)
            sizes = [size if size < np.inf else 0.0 for size in sizes]  # a form that settled rows lack tells none
            yield group.name, list(zip(sizes, forms, strict=True))[: 1 if enough else 2]


def _of_recording(pairs: FloatArray, e: int) -> FloatArray:
    """Return those of pairs along the last axis that are of a recording."""
    return pairs[..., 2 * e : 2 * e + 2]


def _size(x: FloatArray) -> float:
    """Return the root mean square of numbers."""
    return float(np.sqrt(np.mean(x * x))) if x.size else 0.0


def _fading(fit: Fit) -> list[FloatArray]:
    """Return how far the signals are from settled, (rows,), 1 at most: in each transient, of many in all of them."""
    found = list[FloatArray]()
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
