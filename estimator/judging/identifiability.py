"""Before a search: which parameters the measured outputs could tell at all, were there no noise. Knows no motor.

The outputs' derivatives by the scaled parameters are taken, at a second point too if need be; a direction in which
nothing moves at either is one that no recording of these outputs can tell. What has a part in it is named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares import LeastSquares
from estimator.fitting.problem import Problem

FloatArray = NDArray[np.float64]

LEAST_SINGULAR_VALUE = 3e-6  # of the largest: smaller ones are the rounding of differences
NAMED_PART = 0.01  # of a unit direction
SECOND_POINT = 0.2  # of ln θ, to the second point


@dataclass(frozen=True)
class Identifiability:
    """Parameters that the outputs alone cannot tell, and why; empty where all can be told."""

    untold: tuple[str, ...] = ()
    sentence: str = ""


def identifiability(problem: Problem, start: FloatArray) -> Identifiability:
    """Return what the outputs of a plan cannot tell.

    Parameters
    ----------
    start : (p,) array
        Where the search begins.
    """
    box, names = problem.box, problem.plan.names
    squares = LeastSquares(problem.residuals, box, output=problem.output_of_residual, spread=problem.spread)
    best: tuple[int, FloatArray] | None = None
    for away in (0.0, SECOND_POINT):
        tilt = away * np.cos(np.arange(len(start)))
        point = np.clip(np.where(box.log, start * np.exp(tilt), start), box.lower, box.upper)
        jacobian = squares.judge(point, problem.spread).jacobian
        norms = np.linalg.norm(jacobian, axis=0)
        if not np.isfinite(jacobian).all() or not norms.all():
            return Identifiability()  # where it cannot be simulated, or a parameter moves nothing: others say so
        _, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
        rank = int(np.sum(singular > LEAST_SINGULAR_VALUE * singular[0]))
        if rank == len(names):
            return Identifiability()
        if best is None or rank > best[0]:
            best = (rank, rows[rank:])
    assert best is not None
    rank, null = best
    part = np.sqrt(np.sum(null**2, axis=0))
    concerned = zip(names, part, problem.parameters, strict=True)
    untold = tuple(n for n, x, p in concerned if x > NAMED_PART and p.place is None)
    missing = len(names) - rank
    others = problem.plan.binding.unshown
    remedy = f", or record {' or '.join(others)}, too" if others else ", or record another experiment"
    sentence = (
        f"{' and '.join(problem.outputs)} alone cannot tell {', '.join(untold)} apart:"
        f" {len(untold) - missing} combinations of these {len(untold)} show, whatever the noise;"
        f" fix {missing} of them (--fix NAME=VALUE){remedy}"
    )
    return Identifiability(untold, sentence)
