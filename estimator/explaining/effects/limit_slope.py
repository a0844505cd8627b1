"""A drive whose current limit gives way: the more voltage it takes away, the further the current is beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimator.explaining.effects.drive import TRIED, CurrentLimit, Drive
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import Plan

USUAL_SLOPE, STEEPEST = 0.1, 1.0  # of the current per volt of the motor at standstill


@dataclass(frozen=True)
class LimitSlope(Drive):
    """By how many amperes a volt that is taken away lets the current exceed its limit, as foldback does."""

    name: str = "slope of the current limit"
    target: str = "limit_slope"
    unit: str = "A/V"
    needs: str = CurrentLimit.target
    sentence: str = "the current exceeds the limit by {value:.3g} {unit} of the voltage that the drive takes away"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the slope, of a motor whose resistance is known roughly."""
        R = plan.guess.get("R", 0.0)
        if R <= 0:
            return ()
        return [
            Nuisance(
                self.target, self.unit, 0.0, STEEPEST / R, 0.0, 0.1 * USUAL_SLOPE / R,
                target=self.target, tries=(TRIED * USUAL_SLOPE / R,), needs=self.needs, usual=USUAL_SLOPE / R,
            )
        ]  # fmt: skip
