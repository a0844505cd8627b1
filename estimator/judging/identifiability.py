"""Before a search: which parameters the measured outputs could determine without noise. Knows no motor.

Parameters that scale together are found first (scaling.py), with the products that are determined. The outputs'
derivatives by the scaled parameters are computed too, if need be at a second point. A direction that changes nothing at
either point cannot be determined by any recording of these outputs. Parameters that take part in it are named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares import LeastSquares
from estimator.fitting.problem import Problem
from estimator.judging.scaling import exact_scaling

FloatArray = NDArray[np.float64]

LEAST_SINGULAR_VALUE = 3e-6  # of the largest: smaller ones are rounding errors of differences
NAMED_PART = 1e-3  # of how far what is least told moves, in logarithms: parameters that move further with it are named
SECOND_POINT = 0.2  # of ln θ, to the second point


@dataclass(frozen=True)
class Identifiability:
    """Parameters that the outputs alone cannot determine, and why; empty if there are none."""

    untold: tuple[str, ...] = ()
    sentence: str = ""
    determined: tuple[dict[str, int], ...] = ()  # products of powers, name → exponent, that are told all the same


def identifiability(problem: Problem, start: FloatArray) -> Identifiability:
    """Return which parameters the outputs of a plan cannot determine.

    Parameters
    ----------
    start : (p,) array
        Where the search begins.
    """
    points = [_tilted(problem, start, away) for away in (0.0, SECOND_POINT, -SECOND_POINT)]
    scaling = exact_scaling(problem, points)
    unmoving = _unmoving(problem, start)
    outputs, others = " and ".join(problem.outputs), problem.plan.binding.unshown
    beside = f"or record {' or '.join(others)}, too" if others else "or measure another quantity, too"
    if scaling is not None and len(unmoving) <= scaling.missing:
        names, missing = scaling.names, scaling.missing
        only = f"only {_listed(scaling.products)} {'is' if len(scaling.products) == 1 else 'are'} determined"
        if not scaling.products:
            only = f"{len(names) - missing} combinations of these {len(names)} show"
        sentence = f"{outputs} alone cannot tell {', '.join(names)} apart: {only}, whatever the noise"
        remedy = f"fix {missing} of them (--fix NAME=VALUE), {beside}"  # no other experiment helps
        return Identifiability(names, f"{sentence}; {remedy}", scaling.determined)
    if not len(unmoving):
        return Identifiability()
    part = np.max(np.abs(unmoving), axis=0)
    concerned = zip(problem.plan.names, part, problem.parameters, strict=True)
    untold = tuple(n for n, x, p in concerned if x > NAMED_PART and p.place is None)
    missing = len(unmoving)
    sentence = (
        f"{outputs} alone cannot tell {', '.join(untold)} apart:"
        f" {len(untold) - missing} combinations of these {len(untold)} show, whatever the noise;"
        f" fix {missing} of them (--fix NAME=VALUE), {beside if others else 'or record another experiment'}"
    )
    return Identifiability(untold, sentence)


def _unmoving(problem: Problem, start: FloatArray) -> FloatArray:
    """Return directions, (k, p), that change nothing at the start nor beside it, the longest move of each 1.

    Of logarithms; of what has none parts of its bounds' width.
    """
    squares = LeastSquares(problem.residuals, problem.box, output=problem.output_of_residual, spread=problem.spread)
    names, none = problem.plan.names, np.zeros((0, len(start)))
    best: FloatArray | None = None
    for away in (0.0, SECOND_POINT):
        jacobian = squares.judge(_tilted(problem, start, away), problem.spread).jacobian[:]
        norms = np.linalg.norm(jacobian, axis=0)
        if not np.isfinite(jacobian).all() or not norms.all():
            return none  # not simulated, or without influence: reported elsewhere
        _, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
        rank = int(np.sum(singular > LEAST_SINGULAR_VALUE * singular[0]))
        if rank == len(names):
            return none
        if best is None or len(rows) - rank < len(best):
            moves = rows[rank:] / norms / np.where(problem.box.log, 1.0, problem.box.upper - problem.box.lower)
            best = moves / np.max(np.abs(moves), axis=1, keepdims=True)
    assert best is not None
    return best


def _tilted(problem: Problem, start: FloatArray, away: float) -> FloatArray:
    """Return a point beside the start, (p,), each parameter of a logarithmic scale moved by a part of its own."""
    box, tilt = problem.box, away * np.cos(np.arange(len(start)))
    return np.clip(np.where(box.log, start * np.exp(tilt), start), box.lower, box.upper)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""
