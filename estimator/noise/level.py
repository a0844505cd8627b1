"""How large signals are beside their largest, made of them where it is asked for. Knows signals, no noise.

Most noises do not grow with the signals: of a long recording nobody asks for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Level:
    """Signals, (rows, q), over their largest, (q,); 0 where one is missing. Not held: of some rows when indexed.

    Parameters
    ----------
    signals : (rows, q) array
        Not to be changed.
    largest : (q,) array
    """

    def __init__(self, signals: FloatArray, largest: FloatArray) -> None:
        self._signals, self._largest = signals, largest
        self.shape = signals.shape

    @classmethod
    def of(cls, signals: FloatArray) -> Level:
        """Return that of signals over their largest; of one that is 0 it is 0."""
        # Of few columns one by one is ten times as quick as along the rows.
        largest = np.array([_sizes(own).max() for own in signals.T])
        return cls(signals, np.where(largest > 0, largest, 1.0))

    def __getitem__(self, at: Any) -> FloatArray:
        """Return some rows, `[rows]`, or these of one signal, `[rows, k]`."""
        largest = self._largest[at[1]] if isinstance(at, tuple) else self._largest
        level = _sizes(self._signals[at])
        level /= largest
        return level


def _sizes(signals: FloatArray) -> FloatArray:
    """Return the sizes of signals; 0 where one is missing."""
    sizes = np.abs(signals)
    if not (known := np.isfinite(sizes)).all():
        sizes[~known] = 0.0
    return sizes
