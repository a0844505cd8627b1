"""A copper winding: its resistance and its temperature, its time constant, its inductance. Knows numbers only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

NO_TRACE = 1e-4  # of a sampling interval: a winding whose time constant is less leaves no trace in any sample
STEEPER = 10.0  # than its samples show a current may rise: between them, behind a filter
COPPER, REFERENCE = 0.00393, 25.0  # 1/K, °C: as data sheets state a winding's resistance
COLDEST, HOTTEST = -200.0, 500.0  # °C: beyond, no winding is on that line, which goes through zero at -229 °C


def relative_resistance(temperature: float) -> float:
    """Return a winding's resistance at a temperature [°C], over that at 25 °C."""
    return 1 + COPPER * (temperature - REFERENCE)


def possible_inductance(R: float, v: FloatArray, i: FloatArray, *, step: float) -> tuple[float, float] | None:
    """Return the least and the largest L, H, of a winding of R, Ohm; None where the current stays.

    Voltage, (n,) V, less what R and the motion take, is L di/dt: the steepest rise of the current, (n,) A, at samples
    `step` s apart, says how large L can be, and the samples, what of it could show at all.
    """
    steepest = float(np.nanmax(np.abs(np.diff(i)), initial=0.0)) / step
    if not steepest > 0:
        return None
    low = NO_TRACE * step * R
    return low, max(STEEPER * float(np.ptp(v)) / steepest, STEEPER * low)


def time_constant(R: float, L: float) -> float:
    """Return L / R, s, of Ohm and H."""
    return L / R


def resistance_of(tau: float, K: float, J: float, B: float) -> float:
    """Return the resistance, Ohm, of a motor without inductance whose time constant is tau, s; infinite: of none."""
    return tau * K**2 / (J - tau * B) if tau * B < J else float("inf")
