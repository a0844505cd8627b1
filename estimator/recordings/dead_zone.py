"""Where a speed is shown as none though the machine turns: below what its sensor can tell. Knows two signals, no motor.

A tacho's brushes, a Hall sensor or a timer of pulses shows nothing of slow speeds. A speed that is there at once, or
gone at once, jumps by many times what it changes by in the rows beside, though its voltage has been there for as long
as what is missing takes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.excitation import LEVEL
from estimator.recordings.quantum import quantum
from estimator.recordings.samples import filled
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

MOST = 0.2  # of the largest speed: more is no dead zone
NOISES, STEPS = 6.0, 3.0  # deviations of the noise, steps of the sensor: a smaller gap is none
JUMPS, BESIDE = 3.0, 4  # times the largest change in so many rows beside
HALF = 0.5  # of the rows that what is missing takes at least, the voltage has been there
ALIKE = 0.8  # of the places where the speed comes and goes


def least_speed(w: FloatArray, v: FloatArray) -> float:
    """Return the least speed that a sensor shows where it shows none of slower ones; 0 where no such limit is told.

    Parameters
    ----------
    w, v : (n,) arrays
        Speed, NaN where a sample is missing, and voltage.
    """
    shown = filled(w)
    size = np.abs(shown)
    levels = np.unique(size)
    low = levels[: int(np.searchsorted(levels, MOST * levels[-1]))]
    edges = _edges(v)
    if len(low) < 2 or not len(edges):
        return 0.0
    gaps = np.diff(low)
    k = int(np.argmax(gaps))
    if gaps[k] < max(NOISES * noise_deviation(w), STEPS * quantum(w)):
        return 0.0
    stands = size <= low[k]
    crossings = np.flatnonzero(stands[1:] != stands[:-1]) + 1
    told = 0
    for at in crossings.tolist():
        comes = bool(stands[at - 1])
        beside = shown[at : at + BESIDE + 1] if comes else shown[max(0, at - BESIDE - 1) : at]
        change = float(np.max(np.abs(np.diff(beside)), initial=0.0))
        jump = float(abs(shown[at] - shown[at - 1]))
        before = edges[edges <= at]
        late = at - int(before[-1]) if len(before) else 0
        told += len(beside) > BESIDE and jump > JUMPS * change and (not comes or late * change > HALF * jump)
    return float(low[k + 1]) if told >= ALIKE * len(crossings) else 0.0


def hidden_speeds(w: FloatArray, v: FloatArray, least: float) -> NDArray[np.bool_]:
    """Return the rows, (n,), that show none of a speed that may be there, by the least that is shown.

    Before its first voltage a machine that stands shows so.
    """
    hidden = np.abs(w) < HALF * least
    edges = _edges(v)
    first = int(edges[0]) if len(edges) else len(v)
    known = np.flatnonzero(~np.isnan(w[:first]))
    hidden[:first] &= len(known) > 0 and not hidden[known[0]]
    return np.asarray(hidden)


def _edges(v: FloatArray) -> NDArray[np.int64]:
    """Return the rows at which a voltage, (n,), has another level: the first row, too, of one that is on there."""
    least = LEVEL * float(np.max(np.abs(v), initial=0.0))
    return np.asarray(np.flatnonzero(np.abs(np.diff(v, prepend=0.0)) > least))
