"""What follows from a motor's parameters: gains, time constants, each with its standard error. Knows no FMU.

A recording may tell these where it does not tell the parameters: speed alone gives the speed per volt and the slow time
constant, whatever R, K, J and B are. A quantity q(θ) is told if its gradient g lies in the span of the directions that
the weighted Jacobian J = U S Vᵀ sees; then, with a = V S⁻² Vᵀ g over those directions,

    var q = aᵀ (Jᵀ Γ J) a

where Γ is the autocovariance of the residuals (noise.py), and the unit matrix for white ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.budget import Budget
from estimator.fitting.polish import OUTSIDE, SEEN, Polish, information_parts, scaled_svd
from estimator.results.linear import is_motor
from estimator.results.result import DerivedQuantity

FloatArray = NDArray[np.float64]
Values = Mapping[str, float]

USEFUL = 1.0  # of the value: a larger standard error tells nothing
STEP = 1e-6  # of a parameter, for the gradient


def derived_quantities(
    values: Values, names: Sequence[str], log: NDArray[np.bool_], polish: Polish, budget: Budget | None = None
) -> dict[str, DerivedQuantity]:
    """Return what the data tell of a DC motor as a whole; empty for another model.

    Parameters
    ----------
    values : name → float
        R, K, L, J, B in SI units, the fixed ones included.
    names : (p,) names
        The polished parameters, in the order of `polish`.
    log : (p,) array
        Which of them were polished on a logarithmic scale.
    budget : Budget, optional
        What no recording tells, of the same names.
    """
    if not is_motor(values) or values["R"] <= 0 or values["K"] == 0:
        return {}
    quantities: list[tuple[str, str, Callable[[Values], float]]] = [
        ("speed_per_volt", "rad/(s.V)", lambda v: v["K"] / (v["R"] * v["B"] + v["K"] ** 2)),
        ("current_per_volt", "A/V", lambda v: v["B"] / (v["R"] * v["B"] + v["K"] ** 2)),
    ]
    if _discriminant(values) > 0:
        quantities += [
            ("slow_time_constant", "s", lambda v: 1 / _slow_rate(v)),
            ("fast_time_constant", "s", lambda v: _slow_rate(v) * v["L"] * v["J"] / (v["R"] * v["B"] + v["K"] ** 2)),
        ]
    else:
        quantities += [
            ("natural_frequency", "rad/s", _natural_frequency),
            ("damping_ratio", "", lambda v: _damping(v) / _natural_frequency(v)),
        ]
    result = {}
    quantities += _feedforward(values, "L" not in names or bool(polish.at_bound[list(names).index("L")] != 0))
    for name, unit, quantity in quantities:
        value = quantity(values)
        gradient = _gradient(quantity, values, names, log)
        error = _standard_error(gradient, polish)
        if error is not None and np.isfinite(value) and error < USEFUL * abs(value):
            result[name] = DerivedQuantity(float(value), error, unit, budget.of(gradient) if budget else {})
    return result


def _feedforward(values: Values, without_winding: bool) -> list[tuple[str, str, Callable[[Values], float]]]:
    """Return what a feedforward needs, v = kS sign(w) + kV w + kA dw/dt, as robots are tuned (WPILib's SysId).

    Where the inductance is not told, kA is without its part in it, L B / K of R J / K.
    """
    found: list[tuple[str, str, Callable[[Values], float]]] = [
        ("kV", "V.s/rad", lambda v: (v["R"] * v["B"] + v["K"] ** 2) / v["K"]),
        ("kA", "V.s2/rad", lambda v: (v["R"] * v["J"] + (0.0 if without_winding else v["L"] * v["B"])) / v["K"]),
    ]
    if values.get("friction", 0.0) > 0:
        found.insert(0, ("kS", "V", lambda v: v["R"] * v["friction"] / v["K"] + v.get("brush", 0.0)))
    return found


def _standard_error(gradient: FloatArray, polish: Polish) -> float | None:
    """Return the standard error of a quantity with this (p,) gradient; None where the data do not tell it."""
    inside = polish.at_bound == 0
    if np.any(gradient[~inside] != 0) or not inside.any():
        return None
    jacobian, g = polish.jacobian[:, inside], gradient[inside]
    scale, singular, rows = scaled_svd(jacobian)
    rows, g_scaled = rows[singular > SEEN * singular[0]], g / scale
    if np.linalg.norm(g_scaled - (rows @ g_scaled) @ rows) > OUTSIDE * np.linalg.norm(g_scaled):
        return None
    a = information_parts(jacobian)[0] @ g
    variance = float(a @ polish.scores[np.ix_(inside, inside)] @ a)
    return float(np.sqrt(variance)) if variance > 0 else None  # below: what the arithmetic leaves of nothing told


def _gradient(
    quantity: Callable[[Values], float], values: Values, names: Sequence[str], log: NDArray[np.bool_]
) -> FloatArray:
    """Return the (p,) derivatives by the scaled parameters (ln θ where log)."""
    gradient = np.zeros(len(names))
    for j, name in enumerate(names):
        if values.get(name, 0.0) != 0:
            step = STEP * abs(values[name])
            above, below = ({**values, name: values[name] + sign * step} for sign in (1, -1))
            gradient[j] = (quantity(above) - quantity(below)) / (2 * step) * (values[name] if log[j] else 1.0)
    return gradient


# λ² + (R/L + B/J) λ + (R B + K²)/(L J) = 0


def _damping(v: Values) -> float:
    return (v["R"] / v["L"] + v["B"] / v["J"]) / 2


def _natural_frequency(v: Values) -> float:
    return float(np.sqrt((v["R"] * v["B"] + v["K"] ** 2) / (v["L"] * v["J"])))


def _discriminant(v: Values) -> float:
    return _damping(v) ** 2 - _natural_frequency(v) ** 2


def _slow_rate(v: Values) -> float:
    """Return the smaller of the two rates of decay, without cancellation."""
    fast = _damping(v) + np.sqrt(max(_discriminant(v), 0.0))
    return float(_natural_frequency(v) ** 2 / fast)
