"""The steady-state relations of the DC motor: what follows from K, or from R. Knows the motor, no FMU.

With the rotor at constant speed and no load (the paper's eqs. 7 and 8):

    R = (v − K w) / i        B = K i / w

Near no load a small error in K throws R far off (d ln R / d ln K is about −42 at the paper's CML-050), so the default
search draws R and computes K = (v − R i) / w from the same relation; the method `paper` draws K, as printed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.samples import mean_of_known

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_R = 1e-4  # of the largest R that the steady state allows


@dataclass(frozen=True)
class SteadyState:
    """Means of the settled part: voltage v [V], current i [A], speed w [rad/s]."""

    v: float
    i: float
    w: float

    def resistance(self, K: FloatArray) -> FloatArray:
        """R [Ω] that follows from K [V·s/rad] (eq. 7)."""
        return np.asarray((self.v - K * self.w) / self.i)

    def constant(self, R: FloatArray) -> FloatArray:
        """K [V·s/rad] that follows from R [Ω] (eq. 7, turned round)."""
        return np.asarray((self.v - R * self.i) / self.w)

    def friction(self, K: FloatArray) -> FloatArray:
        """B [N·m·s/rad] that follows from K [V·s/rad] (eq. 8)."""
        return np.asarray(K * self.i / self.w)

    @property
    def is_usable(self) -> bool:
        """Whether the relations mean anything: the motor turns, with the voltage, and draws current."""
        values = (self.v, self.i, self.w)
        return all(np.isfinite(values)) and self.i * self.v > 0 and self.w * self.v > 0

    def feasible_constant(
        self, *, R: tuple[float, float], K: tuple[float, float], B: tuple[float, float]
    ) -> tuple[float, float] | None:
        """Return the interval of K for which K, R and B lie in their bounds; None if there is none."""
        from_R = sorted(float(self.constant(np.asarray(r))) for r in R)
        from_B = sorted(b * self.w / self.i for b in B)
        low, high = max(K[0], from_R[0], from_B[0]), min(K[1], from_R[1], from_B[1])
        return (low, high) if low < high else None

    def drawn(
        self, count: int, rng: np.random.Generator, *, step: float, intervals: tuple[float, float]
    ) -> dict[str, FloatArray]:
        """Return R, K, L, J, B, (count,) each, that keep this state, up to its signs.

        Parameters
        ----------
        step : float
            s, sampling interval.
        intervals : (float, float)
            Smallest and largest of the time constants L / R and R J / K², in sampling intervals.
        """

        def spread(low: float, high: float) -> FloatArray:
            return np.exp(rng.uniform(np.log(low), np.log(high), count))

        v, i, w = abs(self.v), max(abs(self.i), 1e-9), abs(self.w)
        R = spread(LEAST_R, 0.999) * min(v / i, 1e6)
        K = (v - np.minimum(R * i, 0.999 * v)) / max(w, 1e-9)
        drawn = {"R": R, "K": K, "L": R * step * spread(*intervals), "B": K * i / max(w, 1e-9)}
        drawn["J"] = K * K / R * step * spread(*intervals)
        return drawn


def last_samples(v: FloatArray, i: FloatArray, w: FloatArray, *, count: int = 5) -> SteadyState:
    """Return the mean of the last `count` samples, as the paper takes its steady state; NaN where none is there."""
    return SteadyState(*(mean_of_known(x[-count:]) for x in (v, i, w)))
