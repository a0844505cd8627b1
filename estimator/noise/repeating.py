"""Whether errors repeat themselves, as those of counts do at a steady speed. Knows series of numbers only.

They are lines of a spectrum, which an autoregression predicts; where the speed changes they are as noisy as any, and as
large. What lines tell is therefore the size of the noise and not its colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import STANDS_OUT
from estimator.recordings.samples import medians

FloatArray = NDArray[np.float64]

FEWEST_CYCLES = 10  # in a series: what is slower is a drift; likewise of what alternates, beside half of the rate
NEARBY = 12  # places of a spectrum on either side, by whose median a line is told
BESIDE = 2  # of them on either side that a line fills
LARGEST = 0.6  # of the power: its largest values, of which few places of a spectrum hold so much
SHORTEST = 240  # samples: of fewer no autoregression is estimated


def repeat_themselves(series: Sequence[FloatArray]) -> bool:
    """Whether lines hold more than half of the power of series, (n,) each."""
    spectra = [np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2 for x in series if len(x) >= SHORTEST]
    half = 0.5 * sum(float(power.sum()) for power in spectra)
    if half == 0 or sum(_most_in_lines(power) for power in spectra) <= half:
        return False
    return sum(float(power[_are_lines(power)].sum()) for power in spectra) > half


def _most_in_lines(power: FloatArray) -> float:
    """Return what lines hold at most of a spectrum, (k,): what does of its largest values, and all others."""
    order = np.argsort(power)[::-1]
    largest = order[: 1 + int(np.searchsorted(np.cumsum(power[order]), LARGEST * power.sum()))]
    return float(power.sum() - power[largest[~_are_lines(power, largest)]].sum())


def _are_lines(power: FloatArray, places: NDArray[np.int_] | None = None) -> NDArray[np.bool_]:
    """Return which places of a spectrum, (k,), are lines; by default all are asked."""
    asked = np.arange(len(power)) if places is None else places
    away = np.arange(BESIDE + 1, NEARBY + 1)
    beside = np.abs(asked[:, None] + np.concatenate([-away, away]))
    beside = np.minimum(beside, 2 * (len(power) - 1) - beside)  # reflected at both ends
    found = power[asked] > STANDS_OUT * medians(power[beside])
    return np.asarray(found & (asked >= FEWEST_CYCLES) & (asked < len(power) - FEWEST_CYCLES))
