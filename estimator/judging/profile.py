"""How the cost rises around an optimum, parameter by parameter, simulated. Knows residuals only, no motor and no FMU.

For each parameter θ_j, at points within three standard errors of the optimum:

    held       the cost with all other parameters fixed
    followed   the cost with the others moved to the conditional optimum that the Jacobian predicts: along
               Σ_oj/Σ_jj, then one Gauss-Newton step; an upper limit of the profile that refits of the others would give

Costs are risen above the optimum's and in units in which a rise of 1 is one standard error, so that where the errors
are what they claim, `followed` is the parabola ((θ_j − θ̂_j)/σ_j)².
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.plans.parameters import Box
from estimator.results.result import CostProfile

FloatArray = NDArray[np.float64]
Residuals = Callable[[FloatArray], FloatArray]

REACH = 3.0  # standard errors to each side
POINTS = 2  # on each side; each costs three simulations
WIDEST = np.log(2.0)  # reach of the logarithm of a parameter that the data do not determine


def cost_profiles(
    residuals: Residuals, box: Box, polish: LeastSquaresFit, *, names: Sequence[str], output: NDArray[np.int16]
) -> dict[str, CostProfile]:
    """Return the cost profile of every parameter that has a standard error.

    Parameters
    ----------
    residuals : callable
        (c, p) candidates in the parameters' units → (c, m) residuals in the outputs' units; NaN where failed.
    polish : LeastSquaresFit
        The optimum.
    names : p names
    output : (m,) integer array
        Which output each residual belongs to.
    """
    around = _Surroundings(residuals, box, polish, 1 / polish.deviations[output])
    return {name: around.profile(j) for j, name in enumerate(names) if around.reach(j) > 0}


@dataclass(frozen=True)
class _Surroundings:
    residuals: Residuals
    box: Box
    polish: LeastSquaresFit
    weights: FloatArray

    def reach(self, j: int) -> float:
        """Return how far a profile goes on the parameter's scale, to each side; 0 for none."""
        if self.polish.at_bound[j] != 0:
            return 0.0
        sigma = float(np.sqrt(self.polish.covariance[j, j]))
        widest = WIDEST if self.box.log[j] else 0.5 * float(self.box.upper[j] - self.box.lower[j])
        return min(REACH * sigma, widest) if np.isfinite(sigma) else widest

    def profile(self, j: int) -> CostProfile:
        """Simulate the profile of one parameter."""
        values, jacobian = self.polish.values, self.polish.jacobian[:]
        x = self.box.scaled(values)
        steps = np.linspace(-self.reach(j), self.reach(j), 2 * POINTS + 1)
        steps = steps[steps != 0]
        low, high = self.box.low, self.box.high
        steps = steps[(x[j] + steps >= low[j]) & (x[j] + steps <= high[j])]
        inside = [k for k in range(len(values)) if k != j and self.polish.at_bound[k] == 0]
        others = jacobian[:, inside]
        alone = np.tile(x, (len(steps), 1))
        alone[:, j] += steps
        pseudo = np.linalg.pinv(others) if inside else np.zeros((0, len(jacobian)))
        along = alone.copy()
        along[:, inside] -= np.outer(steps, pseudo @ jacobian[:, j])
        along = np.clip(along, low, high)
        held, _ = self._costs(alone)
        followed, shown = self._costs(along)
        again = along.copy()
        again[:, inside] -= np.nan_to_num(shown) @ pseudo.T
        refined, _ = self._costs(np.clip(again, low, high))
        own = self.polish.residuals
        base = float(own @ own)
        free = jacobian[:, j] - others @ (pseudo @ jacobian[:, j])
        # Correlated residuals make the standard error larger than the cost alone gives.
        variance = float(self.polish.covariance[j, j])
        expected = variance * float(free @ free) if np.isfinite(variance) else 0.0
        scale = expected if expected > 0 else 1.0
        best = np.fmin(np.fmin(followed, refined), held)
        centre = int(np.searchsorted(steps, 0.0))

        def with_optimum(costs: FloatArray) -> FloatArray:
            return np.asarray(np.insert((costs - base) / scale, centre, 0.0))

        return CostProfile(
            values=np.insert(self.box.unscaled(alone)[:, j], centre, values[j]),
            held=with_optimum(held),
            followed=with_optimum(best),
        )

    def _costs(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return costs (c,), NaN where a simulation failed, and weighted residuals (c, m)."""
        weighted = self.residuals(self.box.unscaled(points)) * self.weights
        return np.asarray(np.sum(weighted**2, axis=1)), weighted
