"""A copper winding: its resistance and its temperature, its time constant. Knows numbers only."""

from __future__ import annotations

COPPER, REFERENCE = 0.00393, 25.0  # 1/K, °C: as data sheets state a winding's resistance


def relative_resistance(temperature: float) -> float:
    """Return a winding's resistance at a temperature [°C], over that at 25 °C."""
    return 1 + COPPER * (temperature - REFERENCE)


def time_constant(R: float, L: float) -> float:
    """Return L / R, s, of Ohm and H."""
    return L / R
