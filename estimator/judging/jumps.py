"""Whether what an FMU shows jumps as its parameters move: differences across a jump are no derivatives.

A bounce that falls into another step, a switch, a stop: the outputs are then piecewise smooth in the parameters. Along
each parameter some points are simulated; between the two neighbours that are furthest apart the interval is halved
until it is tiny. What changes smoothly has then as good as no change left; a jump has all of its own.

Standard errors are then those of the likelihood itself, without derivatives: points are drawn around the optimum from a
normal distribution, each counts by its likelihood over its density, and the distribution is widened until it covers
the likelihood. Knows no search.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.problem import Problem
from estimator.plans.parameters import Box, unscaled

FloatArray = NDArray[np.float64]

REACH, POINTS = 0.1, 9  # of ln θ, or of the range, to each side; simulated along each parameter
HALVINGS = 14
JUMP = 3.0  # in the noise's deviations, over all samples: smaller ones do not matter
BESIDE, ALONE = 6, 0.3  # points on each side of a jump; of its size, up to which it stands alone
DRAWN, ROUNDS = 600, 20  # points a round; rounds at most
WIDER, COVERED = 1.5, 1.3  # the distribution's deviations over the likelihood's; at which growth it covers it
EFFECTIVE = 30.0  # points that count, at least
STEEP, NARROWER = 20.0, 3.0  # rise of the cost from which the deviations shrink, and by how much
LEVEL, FURTHER = 0.3, 5.0  # rise of the cost up to which they grow, and by how much
BETTER = 2.0  # of the cost: a point so far below the optimum says that it is none
SEEN = 1e-3  # of a signal's deviation, in one sample: less is a solver's numerical noise


def jumping(problem: Problem, point: FloatArray) -> tuple[str, ...]:
    """Return the FMU's parameters that make the outputs jump near a point, (p,), by more than the data's noise."""
    sigma = np.array([problem.sigma[y] for y in problem.outputs])[problem.output_of_residual]
    box = problem.box
    home = box.to_cube(point)
    ratio = np.where(box.log, box.upper / np.where(box.log, box.lower, 1.0), 1.0)
    width = np.where(box.log, np.log(ratio), 1.0)
    reach = REACH / np.maximum(width, REACH)
    free = [j for j, p in enumerate(problem.parameters) if p.place is None and box.upper[j] > box.lower[j]]
    if not free:
        return ()

    def shown(points: list[FloatArray]) -> FloatArray:
        return np.asarray(problem.residuals(box.from_cube(np.array(points))) / sigma)

    def beside(j: int, at: float) -> FloatArray:
        moved = home.copy()
        moved[j] = at
        return moved

    grids = {j: np.linspace(max(0.0, home[j] - reach[j]), min(1.0, home[j] + reach[j]), POINTS) for j in free}
    first = shown([beside(j, at) for j in free for at in grids[j]]).reshape(len(free), POINTS, -1)
    intervals = {}
    for j, rows in zip(free, first, strict=True):
        change = np.linalg.norm(np.diff(rows, axis=0), axis=1)
        if np.isfinite(change).all():
            k = int(np.argmax(change))
            intervals[j] = (grids[j][k], grids[j][k + 1], rows[k], rows[k + 1])
    for _ in range(HALVINGS):
        intervals = {j: i for j, i in intervals.items() if np.linalg.norm(i[3] - i[2]) > JUMP}
        if not intervals:
            return ()
        between = shown([beside(j, (a + b) / 2) for j, (a, b, _, _) in intervals.items()])
        for (j, (a, b, at_a, at_b)), middle in zip(list(intervals.items()), between, strict=True):
            if not np.isfinite(middle).all():
                del intervals[j]
            elif np.linalg.norm(middle - at_a) > np.linalg.norm(at_b - middle):
                intervals[j] = (a, (a + b) / 2, at_a, middle)
            else:
                intervals[j] = ((a + b) / 2, b, middle, at_b)
    seen = SEEN * problem.spread[problem.output_of_residual] / sigma
    found = []
    for j, (a, b, at_a, at_b) in intervals.items():
        size = float(np.linalg.norm(at_b - at_a))
        if size <= JUMP or not np.any(np.abs(at_b - at_a) > seen):
            continue
        around = shown([beside(j, x + sign * k * (b - a)) for x, sign in ((a, -1), (b, 1)) for k in range(BESIDE)])
        steps = np.linalg.norm(np.diff(around.reshape(2, BESIDE, -1), axis=1), axis=2)
        if not np.nanmax(steps) > ALONE * size:  # a solver's noise changes as much wherever one looks
            found.append(problem.parameters[j].name)
    return tuple(found)


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A fit whose covariance is the likelihood's own.

    Attributes
    ----------
    polish : LeastSquaresFit
        With infinite standard errors where none could be had.
    simulations : int
    holds : bool
        Whether the likelihood was covered, and no better point was met.
    """

    polish: LeastSquaresFit
    simulations: int
    holds: bool


def drawn_errors(
    residuals: Callable[[FloatArray], FloatArray],
    box: Box,
    polish: LeastSquaresFit,
    rng: np.random.Generator,
) -> Drawn:
    """Return a fit with standard errors that need no derivatives.

    Parameters
    ----------
    residuals : callable
        (c, p) candidates in the parameters' units → (c, m) weighted residuals; NaN where a simulation fails.
    polish : LeastSquaresFit
        The optimum, and covariance and standard errors by differences.
    """
    inside = np.flatnonzero((polish.at_bound == 0) & np.isfinite(polish.standard_errors))
    none = dataclasses.replace(polish, standard_errors=np.full(len(polish.values), np.inf))
    covariance = polish.covariance[np.ix_(inside, inside)]
    if not len(inside) or not np.isfinite(covariance).all():
        return Drawn(none, 0, holds=False)
    centre = box.scaled(polish.values)

    def costs(moves: FloatArray) -> FloatArray:
        points = np.tile(centre, (len(moves), 1))
        points[:, inside] += moves
        within = ((points >= box.low) & (points <= box.high)).all(axis=1)
        result = np.full(len(moves), np.inf)
        if within.any():
            values = unscaled(points[within], box.log)
            result[within] = np.nan_to_num(np.sum(residuals(values) ** 2, axis=1), nan=np.inf)
        return result

    base = float(costs(np.zeros((1, len(inside))))[0])
    simulations = 1
    for _ in range(ROUNDS):
        root = WIDER * _root(covariance)
        normal = rng.standard_normal((DRAWN, len(inside)))
        risen = costs(normal @ root.T) - base
        simulations += DRAWN
        if risen.min() < -BETTER:
            return Drawn(none, simulations, holds=False)
        weights = np.exp(-0.5 * (risen - np.sum(normal**2, axis=1)))
        weights /= weights.sum()
        moved = normal @ root.T
        found = (weights[:, None] * moved).T @ moved
        effective = 1 / np.sum(weights**2)
        if effective < EFFECTIVE and np.median(risen) > STEEP:  # the likelihood is far narrower
            covariance = covariance / NARROWER**2
            continue
        if np.median(risen) < LEVEL:  # the distribution sees nothing of it yet
            covariance = covariance * FURTHER**2
            continue
        grown = np.sqrt(np.diag(found) / np.diag(covariance))
        covariance = found
        if effective >= EFFECTIVE and grown.max() < COVERED and grown.min() > 1 / COVERED:
            whole = polish.covariance.copy()
            whole[np.ix_(inside, inside)] = covariance
            errors = polish.standard_errors.copy()
            errors[inside] = np.sqrt(np.diag(covariance)) * np.where(box.log, polish.values, 1.0)[inside]
            return Drawn(dataclasses.replace(polish, covariance=whole, standard_errors=errors), simulations, holds=True)
    return Drawn(none, simulations, holds=False)


def _root(covariance: FloatArray) -> FloatArray:
    """Return A with A Aᵀ a covariance, (p, p), whatever its rank."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 1e-12 * values.max())))
