"""Parameters to estimate: name, bounds, scale, and where each goes in the FMU. Knows no FMU."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class SensorPlace:
    """Where a free value of the measurement chain goes: "delay", "gain" or "offset"; which recording, which output."""

    kind: str
    recording: int | None = None  # None: all
    output: str = ""


@dataclass(frozen=True)
class Parameter:
    """One free parameter.

    Attributes
    ----------
    lower, upper : float
        Bounds, in `unit`.
    log : bool
        Searched and polished on a logarithmic scale; needs lower > 0.
    targets : tuple of str
        FMU variables that take its value.
    start, nominal : float or None
        Where to begin, and what to compare with.
    place : SensorPlace or None
        Set for a value of the measurement chain, which no FMU variable takes.
    recording : int or None
        Which recording's it is; None: of all.
    quantity : str
        What it is, where the name also says whose: "R" of "R run3".
    vanishes : bool
        It is 0 in some machines, and its lower bound, which nobody gave, stands for that: a friction, a brush drop.
    """

    name: str
    unit: str
    lower: float
    upper: float
    log: bool
    targets: tuple[str, ...]
    start: float | None = None
    nominal: float | None = None
    place: SensorPlace | None = None
    gains: tuple[float, ...] = ()  # of each target: its value over the parameter's; empty: 1
    recording: int | None = None
    quantity: str = ""
    vanishes: bool = False


def scaled(values: FloatArray, log: BoolArray) -> FloatArray:
    """Return values, (..., p), on their scales: logarithms where `log`, (p,)."""
    return np.where(log, np.log(np.where(log, values, 1.0)), values)


def unscaled(x: FloatArray, log: BoolArray) -> FloatArray:
    """Return the values, (..., p), of scaled ones."""
    return np.where(log, np.exp(np.where(log, x, 0.0)), x)


class Box:
    """A box of parameters seen as the unit cube.

    Parameters
    ----------
    lower, upper : (d,) array
        In the parameters' units.
    log : (d,) bool array
        Which are scaled logarithmically.

    Attributes
    ----------
    low, high : (d,) array
        The bounds on the parameters' scales.
    """

    def __init__(self, lower: FloatArray, upper: FloatArray, log: BoolArray) -> None:
        self.lower, self.upper, self.log = lower, upper, log
        self.low, self.high = scaled(lower, log), scaled(upper, log)
        self._width = self.high - self.low

    @classmethod
    def of(cls, parameters: tuple[Parameter, ...]) -> Box:
        """Return the box of these parameters."""
        return cls(
            np.array([p.lower for p in parameters]),
            np.array([p.upper for p in parameters]),
            np.array([p.log for p in parameters], dtype=bool),
        )

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return len(self.lower)

    def scaled(self, values: FloatArray) -> FloatArray:
        """Return values, (…, d), on the parameters' scales."""
        return scaled(values, self.log)

    def unscaled(self, x: FloatArray) -> FloatArray:
        """Return the values, (…, d), of scaled ones, inside the bounds."""
        return np.asarray(np.clip(unscaled(x, self.log), self.lower, self.upper))

    def from_cube(self, u: FloatArray) -> FloatArray:
        """Map (…, d) points of the unit cube to values in the parameters' units, inside the bounds."""
        return self.unscaled(self.low + u * self._width)

    def to_cube(self, values: FloatArray) -> FloatArray:
        """Map (…, d) values to the unit cube; values outside the bounds come to its faces."""
        inside = np.clip(values, self.lower, self.upper)
        width = np.where(self._width > 0, self._width, 1.0)
        return np.clip((self.scaled(inside) - self.low) / width, 0.0, 1.0)
