"""Whether errors repeat themselves, as those of counts do at a steady speed. Knows series of numbers only.

They are lines of a spectrum, which an autoregression predicts; where the speed changes they are as noisy as any, and as
large. What lines tell is therefore the size of the noise and not its colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import STANDS_OUT

FloatArray = NDArray[np.float64]

FEWEST_CYCLES = 10  # in a series: what is slower is a drift; likewise of what alternates, beside half of the rate
NEARBY = 12  # places of a spectrum on either side, by whose median a line is told
BESIDE = 2  # of them on either side that a line fills
SHORTEST = 240  # samples: of fewer no autoregression is estimated


def repeat_themselves(series: Sequence[FloatArray]) -> bool:
    """Whether lines hold more than half of the power of series, (n,) each."""
    lines = total = 0.0
    for x in series:
        if len(x) >= SHORTEST:
            power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
            lines += float(power[_are_lines(power)].sum())
            total += float(power.sum())
    return total > 0 and lines > 0.5 * total


def _are_lines(power: FloatArray) -> NDArray[np.bool_]:
    """Return which places of a spectrum, (k,), are lines."""
    wide = np.pad(power, NEARBY, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(wide, 2 * NEARBY + 1)
    beside = np.abs(np.arange(-NEARBY, NEARBY + 1)) > BESIDE
    found = power > STANDS_OUT * np.median(around[:, beside], axis=1)
    found[:FEWEST_CYCLES] = found[-FEWEST_CYCLES:] = False
    return np.asarray(found)
