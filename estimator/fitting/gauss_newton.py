"""A fit's least cost, by Gauss-Newton steps with Levenberg's damping, from differences. Knows no effect and no test.

The steps are ``stepping/gauss_newton.h``'s: that says when derivatives are simulated, corrected or kept. Derivatives
that a fit knows are not simulated again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit, cost_of, evaluated, linear_projection, misfit
from estimator.fitting.least_squares import SOON
from estimator.fitting.projection import triangle
from estimator.fitting.slopes import Point, Slopes, difference_steps
from estimator.noise.in_parts import blocks
from estimator.noise.kalman import filters
from estimator.stepping.layout import ASKS_BENT, ASKS_CORRECTED, ASKS_COST, ASKS_NEW, DONE, DONE_BESIDE

FloatArray = NDArray[np.float64]

ITERATIONS, MOST_STEPS = 25, 4  # derivatives that are simulated; steps for each, on average
ROUGH = 8  # derivatives that are simulated of a fit that is only compared
AS_PREDICTED = (0.7, 1.5)  # of the predicted fall: then derivatives are corrected, not simulated again
FINE = 1e-6  # of a tolerance: with less derivatives are central
LONGEST_LOG_STEP, LONGEST_STEP = 1.0, 5.0  # longest step: of a logarithm; of a nuisance's typical sizes


def solved_roughly(fit: Fit, *, limit: float = np.inf) -> Fit:
    """Return the fit near the least cost that is reached from where it stands: to be compared, not to be told."""
    return solved(fit, iterations=ROUGH, limit=limit)


def solved(
    fit: Fit,
    *,
    iterations: int = ITERATIONS,
    tolerance: float = 1e-3,
    limit: float = np.inf,
    told: bool = True,
    beside: Fit | None = None,
    left: bool = False,
) -> Fit:
    """Return the fit at the least cost that is reached from where it stands.

    Parameters
    ----------
    iterations : int
        How often derivatives are simulated, at most.
    tolerance : float
        Of z'z: the iteration ends when the predicted fall is smaller. 1 is one standard error.
    limit : float
        Of z'z: the iteration ends where it has no hope of less.
    told : bool
        Whether derivatives are simulated where it ends; if not, a fit by another noise is to begin there.
    beside : Fit, optional
        A least cost by the same noise, with the same free: returned where derivatives lead next to it.
    left : bool
        The fit that it begins at is asked nothing more: its memory is given up.
    """
    s, where, (low, high) = fit.simulator, fit.where, fit.bounds
    fine = tolerance < FINE
    misfits = _Misfits(fit)

    def point(x: FloatArray, shown: FloatArray) -> Point:
        return Point(s, where, placed(fit, x), x, low, high, shown, s.between)

    def end_at(x: FloatArray, shown: FloatArray, known: FloatArray | None) -> Fit:
        end = point(x, shown)
        return evaluated(fit, end.values, shown, Slopes(end, central=tolerance < 1e-2, known=known), misfits.linear)

    limits: dict[str, Any] = {
        "iterations": iterations,
        "fine": fine,
        "told": told,
        "tolerance": tolerance,
        "limit": limit,
    }
    if (found := _told_whole(fit, beside, limits)) is not None:
        x, at_known, shown, known = found
        return beside if at_known and beside is not None else end_at(x, shown, known)
    x, shown, raw = _begun(fit, central=fine)
    if left:
        fit.forget()
    steps = _Steps(fit, beside=beside, **limits)
    is_fits, there = raw is not None, shown
    asked = steps.begin(x, misfits.cost(shown), is_fits)
    while asked not in (DONE, DONE_BESIDE):
        if steps.has_moved:
            change, shown = there - shown, there
        if asked == ASKS_COST:
            there = np.asarray(s.shown(placed(fit, steps.tried)[None, :])[0])
            asked = steps.take_cost(misfits.cost(there))
            continue
        if asked == ASKS_NEW:
            raw = None  # before others are simulated
            raw, is_fits = point(steps.x, shown).slopes(central=fine), False
        assert raw is not None
        if asked == ASKS_CORRECTED and steps.corrects:
            raw, is_fits = _corrected(raw, steps.step, change, steps.correction, own=not is_fits), False
        off = misfit(fit, shown)
        if asked == ASKS_BENT:
            off = np.where(fit.whitener.present, shown + raw @ (steps.tried - steps.x) - there, 0.0)
        asked = steps.take_triangle(*misfits.triangle(raw, off), bends=asked == ASKS_BENT)
    if asked == DONE_BESIDE:
        assert beside is not None
        return beside
    if steps.has_moved:
        shown = there
    return end_at(steps.x, shown, raw if fine and steps.knows_derivatives else None)


def _told_whole(
    fit: Fit, beside: Fit | None, limits: Mapping[str, Any]
) -> tuple[FloatArray, bool, FloatArray, FloatArray | None] | None:
    """Return the end of a descent that a worker process does in one go, as `Simulator.descend`; None where it does not.

    It does where few samples, of noise without a memory, are compared with signals as the stepper shows them.
    """
    s, w, where = fit.simulator, fit.whitener, fit.where
    if fit.linear or w.remembers or w.shared is not None or not 0 < fit.shown.size * len(where) <= SOON:
        return None
    x = np.clip(s.scaled(fit.values)[where], *fit.bounds)
    h = difference_steps(s, where, np.zeros(len(where)))
    known = None if beside is None else [tuple(part.tolist()) for part in _least(beside, len(where))]
    least_part, most_part = AS_PREDICTED
    return s.descend(
        placed(fit, x),
        where,
        w.scale,
        x=tuple(x.tolist()),
        rounds=MOST_STEPS * limits["iterations"],
        least_part=least_part,
        most_part=most_part,
        longest=tuple(longest_steps(fit).tolist()),
        steps=tuple(h.tolist()),
        known=known and known[0],
        bars=known and known[1],
        known_cost=0.0 if beside is None else beside.cost,
        **limits,
    )


class _Steps:
    """The steps of a descent as they are asked.

    Attributes
    ----------
    tried, x, step : (f,) arrays
        What is tried; where it stands; the last step.
    correction : (f,) array
        How much of what that missed goes into each derivative.
    has_moved, corrects, knows_derivatives : bool
        It stands where it has just tried; derivatives are corrected by the last step; they were simulated there.
    """

    tried: FloatArray
    x: FloatArray
    step: FloatArray
    correction: FloatArray

    def __init__(
        self,
        fit: Fit,
        *,
        iterations: int,
        fine: bool,
        told: bool,
        tolerance: float,
        limit: float,
        beside: Fit | None,
    ) -> None:
        f, self._filters = len(fit.where), filters()
        self._f = f
        self._own = np.empty(self._filters.descent_bytes(f) // 8 + 1)
        self._point = np.zeros(4 * f + 4)
        given = [*fit.bounds, longest_steps(fit), *(() if beside is None else _least(beside, f))]
        self._kept = [np.ascontiguousarray(array, dtype=np.float64) for array in given]  # while they are pointed to
        places = [*(array.ctypes.data for array in self._kept), None, None][:5]
        cost = 0.0 if beside is None else beside.cost
        whole = f, iterations, MOST_STEPS * iterations, int(fine), int(told)
        self._limits = (*whole, tolerance, limit, *AS_PREDICTED, *places, cost)
        self._places = self._own.ctypes.data, self._point.ctypes.data

    def begin(self, x: FloatArray, cost: float, known: bool) -> int:
        """Begin at x, (f,), of a cost; `known`: derivatives are, too. Return what is asked."""
        own, point = self._places
        self._point[self._f : 2 * self._f] = x
        return self._at(self._filters.descent_begin(own, *self._limits, cost, int(known), point))

    def take_triangle(self, a: FloatArray, g: FloatArray, *, bends: bool) -> int:
        """Take a, (f, f), and g, (f,), as gauss_newton.h says."""
        own, point = self._places
        a, g = np.ascontiguousarray(a), np.ascontiguousarray(g)
        return self._at(self._filters.descent_take_triangle(own, a.ctypes.data, g.ctypes.data, int(bends), point))

    def take_cost(self, cost: float) -> int:
        """Take the cost at the tried point."""
        own, point = self._places
        return self._at(self._filters.descent_take_cost(own, cost, point))

    def _at(self, asked: int) -> int:
        """Read where it stands; return what is asked."""
        f = self._f
        self.tried, self.x, self.step, self.correction = self._point[: 4 * f].reshape(4, f).copy()
        self.has_moved, self.corrects, self.knows_derivatives = map(bool, self._point[-3:])
        return asked


class _Misfits:
    """The misfit of a fit at any signals, whitened; the linear part is at its best at every point."""

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        self.linear = linear_projection(fit.linear, fit.whitener)

    def cost(self, shown: FloatArray) -> float:
        """Return z'z at simulated signals; infinity where the FMU failed."""
        if not np.isfinite(shown).all():
            return float(np.inf)
        return cost_of(self.fit, shown, self.linear)

    def triangle(self, raw: FloatArray, off: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a, (f, f), and g, (f,): |g - a dx| is what a step leaves of a misfit, (rows, q)."""
        r = triangle(self.linear.rest(self.fit.whitener.whitened(raw, off[:, :, None])))
        f = raw.shape[2]
        square = np.zeros((f, f + 1))
        square[: len(r)] = r[:f]
        return square[:, :f], square[:, f]


def _least(known: Fit, f: int) -> tuple[FloatArray, FloatArray]:
    """Return where a known fit's f free values are, on their scales, and their bars: none at a bound."""
    free = known.at_bound[:f] == 0
    bars = np.sqrt(np.diag(known.covariance_parts()[0])[:f])
    return known.simulator.scaled(known.values)[known.where], bars if free.all() else np.zeros(f)


def _begun(fit: Fit, *, central: bool) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return what is free, (f,), on its scale, what is shown there, and the derivatives, if the fit knows central ones.

    One-sided ones are simulated again: where a delay stands before a filter, they are others a little further on.
    """
    s, (low, high) = fit.simulator, fit.bounds
    begun = fit.slopes.begun(s, fit.where, fit.values)
    if begun is not None and np.all((begun.x >= low) & (begun.x <= high)):
        return begun.x, begun.shown, fit.slopes.known(central=True) if central else None
    x = np.clip(s.scaled(fit.values)[fit.where], low, high)
    return x, s.shown(placed(fit, x)[None, :])[0], None


def _corrected(raw: FloatArray, dx: FloatArray, change: FloatArray, weights: FloatArray, *, own: bool) -> FloatArray:
    """Return derivatives, (rows, q, f), corrected so that they give the change, (rows, q), of a step, (f,).

    Parameters
    ----------
    weights : (f,) array
        How much of what is missed goes into each: weights @ dx is 1.
    own : bool
        In their place.
    """
    raw = raw if own else raw.copy(order="K")
    for at in blocks(len(raw)):  # which stay in a processor's cache
        missed = change[at] - raw[at] @ dx
        for k, weight in enumerate(weights.tolist()):
            raw[at, :, k] += weight * missed
    return raw


def longest_steps(fit: Fit) -> FloatArray:
    """Return the longest step of what is free, (f,), on its scale."""
    s, where = fit.simulator, fit.where
    own = where < len(s.plan.names)
    return np.where(s.log[where], LONGEST_LOG_STEP, np.where(own, 100.0, LONGEST_STEP) * s.size[where])


def placed(fit: Fit, x: FloatArray) -> FloatArray:
    """Return the fit's values with what is free at x, (f,), on its scale, within the bounds."""
    s, values = fit.simulator, fit.values.copy()
    values[fit.where] = s.unscaled(x, fit.where)
    return np.clip(values, s.lower, s.upper)
