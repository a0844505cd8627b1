"""How far a cost lets each parameter go, where it is no parabola. Knows one fit, no effect.

A standard error is the curvature at the least cost. Where a limit or a friction begins to act between two samples, that
is of a kink, and the cost hardly rises beyond it. Where an inductance is settled within a sampling interval, the cost
hardly rises towards a smaller one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit, linear_projection
from estimator.fitting.gauss_newton import placed, solved_roughly
from estimator.fitting.simulator import CELLS

FloatArray = NDArray[np.float64]
_Line = tuple[int, float, FloatArray]  # a name's place, a side, and by what all names move for a standard error of it

FAR = 4.0  # standard errors, at which the cost should have risen by their square
FLAT = 0.5  # of that: a smaller rise is no parabola's
STEEP = 0.75  # of that: so large a rise, with nothing fitted again, is taken for a parabola's
DOUBLINGS = 5  # of the distance, until the cost has risen enough


def further_reach(fit: Fit, parameters: int, *, switches: bool) -> FloatArray:
    """Return what the covariance of all names, (f + m, f + m), lacks for the first of them to reach as far as they may.

    With it each goes as far as its cost, all else fitted again, rises by FAR squared, and takes the others along.
    `switches`: whether the model does; if not, only parameters whose cost is not steep with nothing fitted again are
    followed. What is not determined is told elsewhere.
    """
    covariance, untold = fit.covariance_parts()
    deviation = np.sqrt(np.diag(covariance))
    factors, told = np.ones(parameters), (deviation > 0) & (np.diag(untold) == 0) & (fit.at_bound == 0)
    moving = {k: covariance[:, k] / deviation[k] for k in range(parameters) if told[k]}
    lines = [(k, side, along) for k, along in moving.items() for side in (-1.0, 1.0)]
    for k, side, along in lines if switches else _flat(fit, lines):
        factors[k] = max(factors[k], _reach(fit, k, side, along))
    lacking = np.zeros_like(covariance)
    for k in np.argsort(-factors, kind="stable"):
        more = factors[k] ** 2 - 1.0 - lacking[k, k] / max(covariance[k, k], 1e-300)
        if factors[k] > 1.0 and more > 0:
            lacking += more * np.outer(covariance[:, k], covariance[:, k]) / covariance[k, k]
    return lacking


def _flat(fit: Fit, lines: Sequence[_Line]) -> list[_Line]:
    """Return those lines by which all names move on which the cost rises by less than a parabola's."""
    (low, high), s = fit.bounds, fit.simulator
    x = s.scaled(fit.values)[fit.where]
    linear = linear_projection(fit.linear, fit.whitener)
    flat, many = [], max(1, CELLS // s.rows)
    for some in (lines[k : k + many] for k in range(0, len(lines), many)):
        ends = [placed(fit, np.clip(x + side * FAR * along[: len(x)], low, high)) for _, side, along in some]
        away = linear.rest(fit.whitener.changes(s.shown(np.stack(ends)), s.measured)[:])
        costs = np.einsum("nk,nk->k", away, away).tolist()
        flat += [line for line, cost in zip(some, costs, strict=True) if cost - fit.cost < STEEP * FAR**2]
    return flat


def _reach(fit: Fit, k: int, side: float, along: FloatArray) -> float:
    """Return by how much a standard error is to be multiplied for one side; `along`: by one of them all names move.

    What is estimated by its logarithm ends at zero: how far it goes is told of itself. 1 where the cost stays as it is
    from one standard error to the end: then others make up for it, and its curvature is of what differences round.
    """
    low, high = fit.bounds
    x = fit.simulator.scaled(fit.values)[fit.where]
    free = tuple(name for name in fit.free if name != fit.free[k])
    one = np.clip(x + side * along[: len(x)], low, high)  # by one standard error
    here, reached = fit, 1.0
    for doubling in range(DOUBLINGS + 1):
        far = FAR * 2.0**doubling
        there = np.clip(x[k] + side * far * along[k], low[k], high[k])
        moved = fit.simulator.scaled(here.values)[fit.where]
        if doubling == 0:
            moved = np.clip(x + side * far * along[: len(x)], low, high)
        moved[k] = there
        values = placed(fit, moved)
        here = solved_roughly(dataclasses.replace(here, values=values, free=free))
        rise = max(here.cost - fit.cost, 0.0)
        away = there - x[k]
        away = abs(np.expm1(away) if fit.is_log[k] else away) / along[k]  # standard errors
        reached = max(reached, away / np.sqrt(max(rise, 1.0)))
        if rise >= FLAT * FAR**2 or not low[k] < there < high[k]:
            break
    else:
        if rise < 1.0:
            near = solved_roughly(dataclasses.replace(fit, values=placed(fit, one), free=free))
            if near.cost - fit.cost < FLAT:
                return 1.0
    return float(reached)
