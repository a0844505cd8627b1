"""What follows from a motor's values: gains, rates of decay, a feedforward. Knows numbers only, no FMU.

λ² + (R/L + B/J) λ + (R B + K²)/(L J) = 0
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

Values = Mapping[str, float]
Quantity = tuple[str, Callable[[Values], float]]  # unit, value


def derived_quantities(values: Values, *, with_winding: bool) -> dict[str, Quantity]:
    """Return what a recording may tell of a motor as a whole: name → unit, and the value that other values give.

    Parameters
    ----------
    values : name → float
        R, K, L, J, B; they decide whether the motor has two time constants or oscillates.
    with_winding : bool
        Whether kA has the inductance's part in it, L B / K beside R J / K.
    """
    found: dict[str, Quantity] = {
        "speed_per_volt": ("rad/(s.V)", lambda v: v["K"] / _braking(v)),
        "current_per_volt": ("A/V", lambda v: v["B"] / _braking(v)),
    }
    if _discriminant(values) > 0:
        found["slow_time_constant"] = "s", lambda v: 1 / _slow_rate(v)
        found["fast_time_constant"] = "s", lambda v: _slow_rate(v) * v["L"] * v["J"] / _braking(v)
    else:
        found["natural_frequency"] = "rad/s", _natural_frequency
        found["damping_ratio"] = "", lambda v: _damping(v) / _natural_frequency(v)
    if values.get("friction", 0.0) > 0:  # v = kS sign(w) + kV w + kA dw/dt, as robots are tuned (WPILib's SysId)
        found["kS"] = "V", lambda v: v["R"] * v["friction"] / v["K"] + v.get("brush", 0.0)
    found["kV"] = "V.s/rad", lambda v: _braking(v) / v["K"]
    found["kA"] = "V.s2/rad", lambda v: (v["R"] * v["J"] + (v["L"] * v["B"] if with_winding else 0.0)) / v["K"]
    return found


def largest_acceleration(values: Values, voltage: float) -> float:
    """Return the acceleration [rad/s²] of a motor at rest by a voltage [V] as if its current rose at once."""
    return values["K"] * voltage / values["R"] / values["J"]


def _braking(v: Values) -> float:
    return v["R"] * v["B"] + v["K"] ** 2


def _damping(v: Values) -> float:
    return (v["R"] / v["L"] + v["B"] / v["J"]) / 2


def _natural_frequency(v: Values) -> float:
    return float(np.sqrt(_braking(v) / (v["L"] * v["J"])))


def _discriminant(v: Values) -> float:
    return _damping(v) ** 2 - _natural_frequency(v) ** 2


def _slow_rate(v: Values) -> float:
    """Return the smaller of the two rates of decay, without cancellation."""
    return float(_natural_frequency(v) ** 2 / (_damping(v) + np.sqrt(max(_discriminant(v), 0.0))))
