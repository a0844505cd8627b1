"""A least-squares optimum: values, covariance, standard errors, bounds that hold it. Knows not how it is found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.noise.in_parts import Columns
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LeastSquaresFit:
    """A least-squares optimum.

    Attributes
    ----------
    values : (p,) array
        Parameters, in their units.
    cost : float
        Σ of squared weighted residuals.
    deviations : (q,) array
        σ of each output, in its unit.
    covariance : (p, p) array
        Of the scaled parameters (ln θ where log); rows of parameters at a bound are zero.
    standard_errors : (p,) array
        In the parameters' units; infinity where not determined, 0 at a bound.
    at_bound : (p,) array
        −1 lower, 1 upper, 0 free.
    jacobian : (m, p) columns
        Of the weighted residuals by the scaled parameters.
    residuals : (m,) array
        Weighted.
    scores : (p, p) array
        Jᵀ Γ J, with Γ the autocovariance of the weighted residuals; JᵀJ where they are white. The covariance between
        its inverses (JᵀJ)⁻¹.
    """

    values: FloatArray
    cost: float
    deviations: FloatArray
    covariance: FloatArray
    standard_errors: FloatArray
    at_bound: NDArray[np.int64]
    jacobian: Columns
    residuals: FloatArray
    scores: FloatArray

    def at_given_bound(self, plan: Plan) -> tuple[str, ...]:
        """Return the parameters that lie at a bound which the case gives them."""
        held = []
        for parameter, side in zip(plan.parameters, self.at_bound.tolist(), strict=False):
            spec = plan.case.parameters.get(parameter.quantity or parameter.name)
            if spec is not None and (spec.minimum if side < 0 else spec.maximum if side > 0 else None) is not None:
                held.append(parameter.name)
        return tuple(held)
