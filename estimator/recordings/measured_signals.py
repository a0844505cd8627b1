"""A motor's signals as they were read, and the samples that show something of them. Judges nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.finding import Evidence
from estimator.recordings.samples import filled
from estimator.recordings.units import parse_unit

FloatArray = NDArray[np.float64]

JUMP, LEAD = 0.3, 3  # of the voltage's range, samples before it: a jump
DRIVEN = 0.05  # of the largest voltage: less is none
SETTLED = 0.1  # of a response: less is its end


@dataclass(frozen=True)
class MeasuredSignals:
    """The signals of one recording of a motor, and what is known of how they were read.

    Attributes
    ----------
    title : str
        What sentences call the recording.
    time : (n,) array, s
    signals : "v", "i", "w", "angle" → (n,) array, SI, NaN where a sample is missing
    guessed : those of them, and "time", whose unit nobody said
    columns : signal → header of its column, for the options that are named
    units : signal → unit that its samples were in
    turned : those of them whose sign the user has turned
    """

    title: str
    time: FloatArray
    signals: Mapping[str, FloatArray]
    guessed: frozenset[str] = frozenset()
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    turned: frozenset[str] = frozenset()

    @property
    def small_units(self) -> set[str]:
        """Signals that were read in a part of their unit, such as milliamperes."""
        return {n for n, text in self.units.items() if (unit := parse_unit(text)) and unit.denominator > 1}

    def beyond(self, signal: str, y: FloatArray, limit: float) -> Evidence:
        """Return the samples from the first to the last that are no less than a limit."""
        there = np.flatnonzero(np.nan_to_num(y, nan=-np.inf) >= limit)
        return self.evidence(signal, int(there[0]), int(there[-1])) if len(there) else self.evidence(signal)

    def evidence(self, signal: str, first: int = 0, last: int = -1) -> Evidence:
        """Return the samples of a signal from one row to another."""
        return Evidence(signal, float(self.time[first]), float(self.time[last]))

    def response(self, *names: str) -> tuple[Evidence, ...]:
        """Return the samples between the first jump of the voltage and where the last of the signals stays."""
        v = filled(self.signals["v"])
        jumps = np.flatnonzero(np.abs(np.diff(v)) > JUMP * np.ptp(v)) + 1
        if not len(jumps):
            return tuple(self.evidence(name) for name in names)
        first = int(jumps[0])
        beyond = int(next((k for k in jumps if k > first + LEAD), len(v)))
        last = first + LEAD
        for name in names:
            y = filled(self.signals[name])[first:beyond]
            off = np.abs(y - np.median(y[-max(3, len(y) // 10) :]))
            last = max(last, first + int(np.max(np.flatnonzero(off > SETTLED * np.max(off)), initial=0)))
        return tuple(self.evidence(name, first - 1, min(last, len(v) - 1)) for name in names)
