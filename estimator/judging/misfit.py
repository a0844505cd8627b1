"""Residuals that a model does not explain, in words. Knows what was tested, no other reason for doubt."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MISFIT, NUMERICAL
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.plans.plan import Plan

if TYPE_CHECKING:
    from estimator.explaining.adequacy import Adequacy, Failure
    from estimator.explaining.explained import Explained

FloatArray = NDArray[np.float64]

TOLD_FAILURES = 4  # sentences on failed tests, at most
UNEXPLAINED = 0.2  # of a signal's deviation: a noise that is larger is a misfit


def misfit(
    plan: Plan, polish: LeastSquaresFit, explained: Explained | None, noise: FloatArray, spread: FloatArray
) -> list[str]:
    """Say which residuals the model does not explain: larger than the recording's noise, or not like noise."""
    if explained is not None:
        doubts = sorted(explained.adequacy.doubts, key=lambda failure: not failure.is_doubt)
        reasons = unexplained(doubts[:TOLD_FAILURES])
        for j, name in enumerate(plan.outputs):
            shown = 0.0 if noise is None else MISFIT * noise[j]
            if explained.noise[j] > UNEXPLAINED * spread[j] and explained.at_rest[j] > shown:
                unit = plan.unit(name)
                reasons.append(
                    f"the model does not explain {name}: residuals of {explained.noise[j]:.3g} {unit} are left of a"
                    f" signal that spreads by {spread[j]:.3g} {unit}"
                )
        return reasons
    return above_noise(plan, polish.deviations, noise, spread)


def unexplained(failures: Sequence[Failure]) -> list[str]:
    """Return a sentence for each failure, but one for all windows in which an output's residuals are too large."""
    reasons = []
    for failure in failures:
        alike = [f for f in failures if f.what == failure.what == "size" and f.output == failure.output]
        if len(alike) < 2:
            reasons.append(failure.sentence)
        elif failure is alike[0]:
            others = [f"{f.excess:.1f} times in {f.window}" for f in alike[1:]]
            reasons.append(
                f"the model does not explain {failure.output}: the residuals, whitened, are {failure.excess:.1f} times"
                f" the noise found in {failure.window}, {', '.join(others)}"
            )
    return reasons


def above_noise(plan: Plan, deviations: FloatArray, noise: FloatArray, spread: FloatArray) -> list[str]:
    """Say which residuals are above the noise that the recording shows."""
    reasons = []
    for j, name in enumerate(plan.outputs):
        found = deviations[j]
        if found > MISFIT * noise[j] and found > NUMERICAL * spread[j]:
            unit = plan.unit(name)
            times = found / max(noise[j], 1e-300)
            size = f"{times:.1f} times" if times < 1000 else "far above"
            reasons.append(
                f"the model does not explain {name}: its residuals have a deviation of {found:.3g} {unit}, {size} the"
                f" noise of {noise[j]:.2g} {unit} that the recording shows"
            )
    return reasons


def louder(checked: Adequacy) -> list[str]:
    """Say where residuals are noise, but larger than the noise found: the bars hold it."""
    if checked.doubts:
        return []
    return [
        f"the residuals of {f.output} in {f.window} are noise, {f.excess:.1f} times that of the rest: the standard"
        " errors hold it"
        for f in checked.failures
    ]
