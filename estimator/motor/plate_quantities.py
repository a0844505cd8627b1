"""What a motor's nameplate states, from its values. Knows numbers only, no FMU.

At the voltage V, with R, K (= Kt = Ke) and the viscous friction B:

    no-load speed     K V / (R B + K²)        no-load current    B V / (R B + K²)
    stall torque      K V / R                 stall current      V / R
"""

from __future__ import annotations

from collections.abc import Mapping

Values = Mapping[str, float]


def plate_quantities(R: float, K: float, B: float | None, V: float | None) -> dict[str, tuple[float, Values]]:
    """Return what a nameplate states: name → value and its derivatives by R, K, B; what needs B or V only with it.

    Parameters
    ----------
    R, K, B, V : float
        Ohm, V.s/rad, N.m.s/rad, V.
    """
    found: dict[str, tuple[float, Values]] = {"Kt": (K, {"K": 1.0}), "R": (R, {"R": 1.0})}
    if V is None or R <= 0:
        return found
    if B is not None:
        d = R * B + K * K
        slopes = {"R": -K * V * B / d**2, "K": V * (R * B - K * K) / d**2, "B": -K * V * R / d**2}
        found["no_load_speed"] = (K * V / d, slopes)
        slopes = {"R": -B * V * B / d**2, "K": -2 * B * V * K / d**2, "B": V * K * K / d**2}
        found["no_load_current"] = (B * V / d, slopes)
    found["stall_current"] = (V / R, {"R": -V / R**2})
    found["stall_torque"] = (K * V / R, {"R": -K * V / R**2, "K": V / R})
    return found
