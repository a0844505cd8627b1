"""Whether a model's residuals have derivatives at a point: differences over two steps, and to both sides. Knows no FMU.

A central difference over h and one over h / RATIO agree to O(h²) where the residuals are smooth. Where a sample jumps
within the step (an event that a parameter moves past it) the difference grows as 1 / h, in few samples; where the
residuals carry noise (a solver that takes other steps for other values) it grows as 1 / h in all of them. A kink shows
in the one-sided differences: they keep their distance when the step shrinks. So few samples that jump can be told from
noise everywhere, and left out of a Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

RATIO = 4.0  # of the two steps
AGREE = 0.02  # of the derivative: two differences that are nearer agree
FEW = 0.1  # of the samples: jumps are in no more
MOST = 0.9  # of the squared disagreement: jumps hold that much of it
EVALUATIONS = 4  # a parameter

SMOOTH, JUMPS, NOISE, NOTHING = "smooth", "jumps", "noise", "no effect"


@dataclass(frozen=True)
class DifferenceCheck:
    """What the differences say.

    Attributes
    ----------
    derivatives : (n, p) array
        Central differences over the smaller step; zero where `reliable` is False.
    reliable : (n, p) bool array
        Whether a residual's derivative by a parameter was seen to exist.
    verdicts : (p,) "smooth", "jumps" (in few samples), "noise" (in many), "no effect"
    disagreement : (p,) array
        Distance of the two differences over the larger of them, all samples together.
    """

    derivatives: FloatArray
    reliable: BoolArray
    verdicts: tuple[str, ...]
    disagreement: FloatArray

    @property
    def exist(self) -> bool:
        """Whether a Jacobian by differences may be used as it is."""
        return all(v in (SMOOTH, NOTHING) for v in self.verdicts)


def check_differences(
    residuals: Callable[[FloatArray], FloatArray], at: FloatArray, steps: FloatArray
) -> DifferenceCheck:
    """Difference the residuals over two steps to both sides of a point.

    Parameters
    ----------
    residuals : (k, p) candidates → (k, n)
        Called once, with 4 p + 1 candidates.
    at : (p,) array
    steps : (p,) array
        Larger step of each parameter, positive, in its units.
    """
    p = len(at)
    candidates = np.repeat(at[None, :], EVALUATIONS * p + 1, axis=0)
    for j in range(p):
        for k, share in enumerate((1.0, -1.0, 1.0 / RATIO, -1.0 / RATIO)):
            candidates[EVALUATIONS * j + k, j] += share * steps[j]
    values = np.asarray(residuals(candidates), dtype=float)
    middle = values[-1]
    n = values.shape[1]
    derivatives, reliable = np.zeros((n, p)), np.ones((n, p), dtype=bool)
    verdicts, distances = [], np.zeros(p)
    for j in range(p):
        ahead, behind, near_ahead, near_behind = values[EVALUATIONS * j : EVALUATIONS * (j + 1)]
        wide = (ahead - behind) / (2 * steps[j])
        fine = (near_ahead - near_behind) * RATIO / (2 * steps[j])
        sides = (near_ahead + near_behind - 2 * middle) * RATIO / (2 * steps[j])  # half of right minus left
        bent = (ahead + behind - 2 * middle) / (2 * steps[j])
        apart = np.hypot(fine - wide, np.maximum(np.abs(sides) - np.abs(bent) / RATIO * 2, 0.0))
        verdict, distance, good = _judged(wide, fine, apart)
        verdicts.append(verdict)
        distances[j] = distance
        reliable[:, j] = good
        derivatives[:, j] = np.where(good, fine, 0.0)
    return DifferenceCheck(derivatives, reliable, tuple(verdicts), distances)


def _judged(wide: FloatArray, fine: FloatArray, apart: FloatArray) -> tuple[str, float, BoolArray]:
    """Return the verdict on one parameter, the distance of its differences, and in which samples they agree."""
    everywhere = np.ones(len(fine), dtype=bool)
    if not (np.isfinite(wide).all() and np.isfinite(fine).all() and np.isfinite(apart).all()):
        good = np.isfinite(wide) & np.isfinite(fine) & np.isfinite(apart)
        return (JUMPS if np.mean(~good) <= FEW else NOISE), np.inf, good
    size = max(float(np.linalg.norm(fine)), float(np.linalg.norm(wide)))
    if size == 0.0:
        return NOTHING, 0.0, everywhere
    distance = float(np.linalg.norm(apart)) / size
    if distance <= AGREE:
        return SMOOTH, distance, everywhere
    worst = np.argsort(apart)[::-1]
    few = worst[: max(1, int(FEW * len(apart)))]
    held = float(np.sum(apart[few] ** 2) / np.sum(apart**2))
    if held < MOST:
        return NOISE, distance, ~everywhere
    # Leave out the worst until the rest agrees.
    good = everywhere.copy()
    for k in few:
        good[k] = False
        rest = max(float(np.linalg.norm(fine[good])), float(np.linalg.norm(wide[good])))
        if rest > 0 and float(np.linalg.norm(apart[good])) <= AGREE * rest:
            return JUMPS, distance, good
    return NOISE, distance, ~everywhere
