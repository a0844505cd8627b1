"""Parameters that scale together: products of powers of them are all that the outputs show. Knows no motor, no search.

The outputs' derivatives by ln θ give candidates: directions along which nothing changes to first order, rounded to
simple exponents, such as R1¹ R2¹ C⁻¹. A candidate counts only if the outputs stay, to within the simulation's own
numerical noise, when its parameters are really moved along it, far, from several points. An FMU with its own solver
has such noise, which differences over small steps take for information.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.problem import Problem

FloatArray = NDArray[np.float64]

STEP, TINY = 1e-2, 1e-8  # of ln θ: of the derivatives, and at which only the simulation's numerical noise is seen
FLAT = 2e-2  # of the largest singular value: a candidate; moving along it decides
FAR = np.log(2.0)  # of ln θ, how far a candidate is moved
LEAST = 0.05  # of ln θ: bounds that are nearer show nothing
STAYS = 0.1  # of what its parameters change one by one: at most, however large the numerical noise
NOISE_TIMES, ROUNDING = 5.0, 1e-8  # of the numerical noise, of the signals' deviations: no change
EXPONENTS = (-2, -1, 0, 1, 2)
ROUNDED, LARGEST_PART = 0.08, 3  # how far an exponent may lie from the fraction that it is taken for; its denominator
MOST = 6  # parameters of a group for which products are looked for


@dataclass(frozen=True)
class Scaling:
    """Parameters that scale together, and what of them is determined.

    Attributes
    ----------
    names : tuple of str
        That take part, in the order of the problem.
    missing : int
        How many of them must be known for the others to be told.
    determined : tuple of (name → exponent)
        Products of powers that do not change; empty where there are none, or too many parameters.
    """

    names: tuple[str, ...]
    missing: int
    determined: tuple[dict[str, int], ...] = ()

    @property
    def products(self) -> tuple[str, ...]:
        """Return what is determined as text, such as R1*C."""
        return tuple(written(powers) for powers in self.determined)


def exact_scaling(problem: Problem, points: Sequence[FloatArray]) -> Scaling | None:
    """Return which of the FMU's parameters scale together; None if none do.

    Parameters
    ----------
    points : of (p,) arrays
        From which the parameters are moved; the first gives the candidates.
    """
    movable = [j for j, p in enumerate(problem.parameters) if p.place is None and points[0][j] != 0]
    if len(movable) < 2:
        return None
    jacobian = _derivatives(problem, points[0], movable)
    norms = np.linalg.norm(jacobian, axis=0)
    if not np.isfinite(norms).all() or not norms.all():
        return None
    _, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
    flat = int(np.sum(singular < FLAT * singular[0]))
    noises = [_noise(problem, x, movable) for x in points] if flat else []
    best: FloatArray = np.zeros((0, len(movable)))
    for k in range(flat, 0, -1):
        candidates = _rounded(rows[len(rows) - k :] / norms)
        held = [
            d for d in candidates if all(_stays(problem, x, movable, d, e) for x, e in zip(points, noises, strict=True))
        ]
        if len(held) > len(best):
            best = np.array(held)
        if len(best) >= k:
            break
    if not len(best):
        return None
    part = [m for m in range(len(movable)) if best[:, m].any()]
    names = tuple(problem.parameters[movable[m]].name for m in part)
    return Scaling(names, len(best), _invariants(best[:, part], names))


def written(powers: Mapping[str, int]) -> str:
    """Return a product of powers as text: R1*C, K/J, R*J/K^2."""

    def factors(sign: int) -> str:
        return "*".join(n if e * sign == 1 else f"{n}^{e * sign}" for n, e in powers.items() if e * sign > 0)

    below = factors(-1)
    below = f"({below})" if "*" in below else below
    return (factors(1) or "1") + (f"/{below}" if below else "")


def _derivatives(problem: Problem, point: FloatArray, movable: list[int]) -> FloatArray:
    """Return the derivatives by ln θ, (m, movable), in the signals' deviations; NaN where a simulation fails."""
    shown = _shown(problem, [_moved(point, {j: sign * STEP}) for j in movable for sign in (1, -1)])
    return (shown[0::2] - shown[1::2]).T / (2 * STEP)


def _noise(problem: Problem, point: FloatArray, movable: list[int]) -> float:
    """Return the numerical noise of a simulation at a point, in the signals' deviations: what hardly a move changes."""
    moves = [{j: sign * k * TINY for j in movable[m::2]} for m in (0, 1) for k in (1, 2, 3) for sign in (1, -1)]
    shown = _shown(problem, [point, *(_moved(point, move) for move in moves if move)])
    noise = float(np.sqrt(np.mean((shown[1:] - shown[0]) ** 2, axis=1).max()))
    return noise if np.isfinite(noise) else 0.0


def _shown(problem: Problem, points: list[FloatArray]) -> FloatArray:
    """Return residuals in the signals' deviations, (c, m); NaN where a simulation fails."""
    return np.asarray(problem.residuals(np.array(points)) / problem.spread[problem.output_of_residual])


def _moved(point: FloatArray, by: dict[int, float]) -> FloatArray:
    result = point.copy()
    for j, much in by.items():
        result[j] *= np.exp(much)
    return result


def _stays(problem: Problem, point: FloatArray, movable: list[int], direction: FloatArray, noise: float) -> bool:
    """Whether the outputs stay when the parameters are moved along a direction of exponents, far, on both sides."""
    along = {j: float(e) for j, e in zip(movable, direction, strict=True) if e}
    sides = [s for sign in (1.0, -1.0) if (s := sign * _room(problem, point, along, sign)) and abs(s) >= LEAST]
    if not sides:
        return False
    moved = [_moved(point, {j: s * e for j, e in along.items()}) for s in sides]
    alone = [_moved(point, {j: sides[0] * e}) for j, e in along.items()]
    shown = _shown(problem, [point, *moved, *alone])
    if not np.isfinite(shown).all():
        return False
    change = np.sqrt(np.mean((shown[1:] - shown[0]) ** 2, axis=1))
    together, least = change[: len(moved)].max(), change[len(moved) :].min()
    return bool(together < min(max(NOISE_TIMES * noise, ROUNDING), STAYS * least))


def _room(problem: Problem, point: FloatArray, along: dict[int, float], sign: float) -> float:
    """Return how far the parameters can be moved along a direction, at most FAR, within their bounds."""
    room = FAR
    for j, exponent in along.items():
        bounds = (problem.box.lower[j], problem.box.upper[j])
        grows = sign * exponent > 0
        limit = max(bounds, key=abs) if grows else min(bounds, key=abs)
        if not grows and bounds[0] <= 0 <= bounds[1]:
            continue
        if limit * point[j] > 0:
            room = min(room, max(0.0, np.log(limit / point[j]) / (sign * exponent)))
    return float(room)


def _rounded(directions: FloatArray) -> FloatArray:
    """Return directions, (k, q), of simple exponents that span nearly the same space."""
    rows = directions / np.abs(directions).max(axis=1, keepdims=True)
    for r in range(len(rows)):  # Gauss-Jordan, by the largest element that is left
        _, pivot = max((abs(rows[r, c]), -c) for c in range(rows.shape[1]))
        if rows[r, -pivot] == 0:
            continue
        rows[r] /= rows[r, -pivot]
        for other in range(len(rows)):
            if other != r:
                rows[other] -= rows[other, -pivot] * rows[r]
    found = []
    for row in rows:
        if not row.any():
            continue
        simple = [Fraction(float(x / np.abs(row).max())).limit_denominator(LARGEST_PART) for x in row]
        near = all(abs(float(s) - x / np.abs(row).max()) < ROUNDED for s, x in zip(simple, row, strict=True))
        if near and sum(s != 0 for s in simple) > 1:
            found.append([float(s) for s in simple])
    return np.array(found).reshape(-1, directions.shape[1])


def _invariants(directions: FloatArray, names: tuple[str, ...]) -> tuple[dict[str, int], ...]:
    """Return the simplest independent products of powers that no direction, (k, q), changes."""
    q, wanted = len(names), len(names) - len(directions)
    if not wanted or q > MOST:
        return ()
    tried = [e for e in itertools.product(EXPONENTS, repeat=q) if any(e) and next(x for x in e if x) > 0]
    # few factors first, then products before quotients, then the order of the parameters
    tried.sort(key=lambda e: (sum(map(abs, e)), sum(x < 0 for x in e), [-abs(x) for x in e]))
    chosen: list[tuple[int, ...]] = []
    for e in tried:
        if np.abs(directions @ np.array(e)).max() < 1e-9:
            independent = np.linalg.matrix_rank(np.array([*chosen, e])) > len(chosen)
            if independent:
                chosen.append(e)
                if len(chosen) == wanted:
                    return tuple({n: x for n, x in zip(names, c, strict=True) if x} for c in chosen)
    return ()
