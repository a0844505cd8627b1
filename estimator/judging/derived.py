"""Quantities that follow from a motor's parameters, and their standard errors: gains, time constants. Knows no FMU.

A recording may determine these though it does not determine the parameters: the speed alone gives the speed per volt
and the slow time constant, whatever R, K, J and B are. A quantity q(θ) is determined if its gradient g lies in the span
of the directions that the weighted Jacobian J = U S Vᵀ determines; then, with a = V S⁻² Vᵀ g over those directions,

    var q = aᵀ (Jᵀ Γ J) a

where Γ is the autocovariance of the weighted residuals, and the unit matrix for white ones (`LeastSquaresFit.scores`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.budget import Budget
from estimator.fitting.information import OUTSIDE, RANK_TOLERANCE, information_parts, scaled_svd
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.projection import triangle
from estimator.judging.scaling import written
from estimator.motor.derived_quantities import derived_quantities
from estimator.motor.names import is_motor
from estimator.results.result import DerivedQuantity

FloatArray = NDArray[np.float64]
Values = Mapping[str, float]

USEFUL = 1.0  # of the value: a quantity with a larger standard error is not determined
GRADIENT_STEP = 1e-6  # of a parameter, for the gradient
NEGLIGIBLE = 1e-6  # of the largest: a smaller change by a parameter is none, and asks for none of its errors


def told_quantities(
    values: Values, names: Sequence[str], log: NDArray[np.bool_], polish: LeastSquaresFit, budget: Budget | None = None
) -> dict[str, DerivedQuantity]:
    """Return the quantities of a DC motor that the data determine; empty for another model.

    Parameters
    ----------
    values : name → float
        R, K, L, J, B in SI units, the fixed ones included.
    names : (p,) names
        The polished parameters, in the order of `polish`.
    log : (p,) array
        Which of them were polished on a logarithmic scale.
    budget : Budget, optional
        Systematic errors that no recording shows, of the same names.
    """
    if not is_motor(values) or values["R"] <= 0 or values["K"] == 0:
        return {}
    told = "L" in names and polish.at_bound[list(names).index("L")] == 0
    result, told_by = {}, _ToldBy(polish)
    for name, (unit, quantity) in derived_quantities(values, with_winding=bool(told)).items():
        value = quantity(values)
        gradient = _gradient(quantity, values, names, log)
        error = told_by.standard_error(gradient)
        if error is not None and np.isfinite(value) and error < USEFUL * abs(value):
            result[name] = DerivedQuantity(float(value), error, unit, budget.of(gradient) if budget else {})
    return result


def products(
    determined: Sequence[Mapping[str, int]],
    values: Values,
    names: Sequence[str],
    units: Mapping[str, str],
    log: NDArray[np.bool_],
    polish: LeastSquaresFit,
) -> dict[str, DerivedQuantity]:
    """Return products of powers (name → exponent) that the data determine where they do not tell the factors.

    The other arguments are those of `told_quantities`; `units` is of each parameter.
    """
    if not determined:
        return {}
    result, told_by = {}, _ToldBy(polish)
    for powers in determined:

        def product(of: Values, powers: Mapping[str, int] = powers) -> float:
            return float(np.prod([of[n] ** e for n, e in powers.items()]))

        error = told_by.standard_error(_gradient(product, values, names, log))
        if error is not None:
            unit = written({f"({units[n]})": e for n, e in powers.items()}) if all(units[n] for n in powers) else ""
            result[written(powers)] = DerivedQuantity(product(values), error, unit)
    return result


class _ToldBy:
    """What a fit tells of quantities; its Jacobian's triangular factor has the same scalar products, and is small."""

    def __init__(self, polish: LeastSquaresFit) -> None:
        self.inside = polish.at_bound == 0
        if not self.inside.any():
            return
        jacobian = triangle(polish.jacobian)[:, self.inside]
        self.scale, singular, rows = scaled_svd(jacobian)
        self.rows = rows[singular > RANK_TOLERANCE * singular[0]]
        self.known = information_parts(jacobian)[0]
        self.scores = polish.scores[np.ix_(self.inside, self.inside)]

    def standard_error(self, gradient: FloatArray) -> float | None:
        """Return the standard error of a quantity with this (p,) gradient; None if it is not determined."""
        if np.any(gradient[~self.inside] != 0) or not self.inside.any():
            return None
        g = gradient[self.inside]
        scaled = g / self.scale
        if np.linalg.norm(scaled - (self.rows @ scaled) @ self.rows) > OUTSIDE * np.linalg.norm(scaled):
            return None
        a = self.known @ g
        variance = float(a @ self.scores @ a)
        return float(np.sqrt(variance)) if variance > 0 else None  # below 0 by rounding: not determined


def _gradient(
    quantity: Callable[[Values], float], values: Values, names: Sequence[str], log: NDArray[np.bool_]
) -> FloatArray:
    """Return the (p,) derivatives by the scaled parameters (ln θ where log)."""
    gradient, whole = np.zeros(len(names)), np.zeros(len(names))
    for j, name in enumerate(names):
        if values.get(name, 0.0) != 0:
            step = GRADIENT_STEP * abs(values[name])
            above, below = ({**values, name: values[name] + sign * step} for sign in (1, -1))
            whole[j] = (quantity(above) - quantity(below)) / (2 * step) * values[name]
            gradient[j] = whole[j] if log[j] else whole[j] / values[name]
    return np.where(np.abs(whole) > NEGLIGIBLE * np.max(np.abs(whole), initial=0.0), gradient, 0.0)
