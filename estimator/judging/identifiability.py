"""Before a search: which parameters the measured outputs could determine without noise. Knows no motor.

The outputs' derivatives by the scaled parameters are computed, if need be at a second point too. A direction that
changes nothing at either point cannot be determined by any recording of these outputs. Parameters that take part in it
are named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares import LeastSquares
from estimator.fitting.problem import Problem

FloatArray = NDArray[np.float64]

LEAST_SINGULAR_VALUE = 3e-6  # of the largest: smaller ones are rounding errors of differences
NAMED_PART = 0.01  # of a unit direction: parameters with a larger part are named
SECOND_POINT = 0.2  # of ln θ, to the second point


@dataclass(frozen=True)
class Identifiability:
    """Parameters that the outputs alone cannot determine, and why; empty if there are none."""

    untold: tuple[str, ...] = ()
    sentence: str = ""


def identifiability(problem: Problem, start: FloatArray) -> Identifiability:
    """Return which parameters the outputs of a plan cannot determine.

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
            return Identifiability()  # not simulated, or without influence: reported elsewhere
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
