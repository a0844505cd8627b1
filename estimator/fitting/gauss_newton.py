"""A fit's least cost, by Gauss-Newton steps with Levenberg's damping, from differences. Knows no effect and no test.

A step that falls about as far as its derivatives say leaves them nearly as they were: they are corrected by what it
showed (Broyden 1965) instead of simulated again, f simulations of f values. Near the minimum, where central ones are
asked for, they are kept as they are. A minimum is told by simulated ones only; those that a fit knows are not simulated
again. A step that falls short is corrected by what bends beside it, as in a valley that is curved (Transtrum and Sethna
2012).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit, cost_of, evaluated, linear_columns, misfit
from estimator.fitting.projection import Projection, triangle
from estimator.fitting.slopes import Point, Slopes

FloatArray = NDArray[np.float64]

ITERATIONS, MOST_STEPS = 25, 4  # derivatives that are simulated; steps for each, on average
ROUGH = 8  # derivatives that are simulated of a fit that is only compared
HOPE = 4.0  # times the whole fall that derivatives predict: a fit that needs more to be wanted ends
DAMPING = (1e-3, 1e8)  # first, last
BESIDE = 1.0  # of z'z, and standard errors: a fit that is led so near to a known least goes there
AS_PREDICTED = (0.7, 1.5)  # of the predicted fall: then derivatives are corrected, not simulated again
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
    descent = _Descent(fit, tolerance)

    def point(x: FloatArray, shown: FloatArray) -> Point:
        return Point(s, where, placed(fit, x), x, low, high, shown, s.between)

    simulated, fine, rest, own = True, tolerance < 1e-6, iterations, False
    x, shown, raw = _begun(fit, central=fine)
    if left:
        fit.forget()
    cost = descent.cost(shown)
    for _ in range(MOST_STEPS * iterations if len(where) and np.isfinite(cost) else 0):
        if raw is None:
            if not rest:
                break
            raw, simulated, rest, own = point(x, shown).slopes(central=fine), True, rest - 1, True
        a, g = descent.triangle(raw, misfit(fit, shown))
        if simulated and rest < iterations - 1 and cost - HOPE * float(g @ g) > limit:
            break
        if beside is not None and _leads_to(beside, x, cost, a, g):
            return beside
        better, predicted = descent.lower(x, shown, cost, raw, (a, g), simulated=simulated)
        if better is None:
            if simulated or not told:
                break
            raw = None  # what was corrected tells no minimum
            continue
        gained = cost - better[2]
        if gained >= tolerance and AS_PREDICTED[0] < gained / predicted < AS_PREDICTED[1]:
            step = better[0] - x, better[1] - shown
            if not fine:
                raw, own = _corrected(raw, *step, a, own=own), True
            simulated = False
        else:
            raw = None
        x, shown, cost = better
        if gained < tolerance and simulated:
            break
    end, known = point(x, shown), raw if fine and simulated else None
    return evaluated(fit, end.values, shown, Slopes(end, central=tolerance < 1e-2, known=known), descent.linear)


class _Descent:
    """Steps of a fit, damped as far as the last ones asked for; the linear part is at its best at every point."""

    def __init__(self, fit: Fit, tolerance: float) -> None:
        self.fit, self.tolerance = fit, tolerance
        self.linear = Projection(fit.whitener.flat(linear_columns(fit.linear, fit.shown.shape)))
        (self.low, self.high), self.longest, self.damping = fit.bounds, longest_steps(fit), DAMPING[0]

    def lower(
        self,
        x: FloatArray,
        shown: FloatArray,
        cost: float,
        raw: FloatArray,
        triangle: tuple[FloatArray, FloatArray],
        *,
        simulated: bool,
    ) -> tuple[tuple[FloatArray, FloatArray, float] | None, float]:
        """Return a point of less cost, what is shown there and its cost, and the predicted fall; None: there is none.

        Derivatives that are not `simulated` are tried once.
        """
        a, g = triangle
        while self.damping < DAMPING[1]:
            dx = _step(a, g, self.damping, x, self.low, self.high)
            dx *= min(1.0, float(np.min(self.longest / np.maximum(np.abs(dx), 1e-300))))
            tried = np.clip(x + dx, self.low, self.high)
            predicted = float(g @ g - np.sum((g - a @ (tried - x)) ** 2))
            if predicted < self.tolerance:
                break
            there = self.shown(tried)
            new = self.cost(there)
            if simulated and cost <= new < np.inf:
                off = np.where(self.fit.whitener.present, shown + raw @ (tried - x) - there, 0.0)
                bent = _step(*self.triangle(raw, off), self.damping, tried, self.low, self.high)
                tried = np.clip(tried + bent, self.low, self.high)
                there = self.shown(tried)
                new = self.cost(there)
            if new < cost:
                self.damping = max(self.damping / 10, 1e-9)
                return (tried, there, new), predicted
            if not simulated:
                break
            self.damping *= 10
        return None, 0.0

    def shown(self, x: FloatArray) -> FloatArray:
        """Return what the sensors show, (rows, q), at what is free, (f,), on its scale."""
        return np.asarray(self.fit.simulator.shown(placed(self.fit, x)[None, :])[0])

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


def _leads_to(known: Fit, x: FloatArray, cost: float, a: FloatArray, g: FloatArray) -> bool:
    """Whether derivatives at what is free, (f,), predict a least next to a known one, as low and not apart from it."""
    if abs(cost - float(g @ g) - known.cost) > BESIDE:
        return False
    s, free = known.simulator, known.at_bound[: len(x)] == 0
    ahead = x + np.linalg.lstsq(a, g, rcond=None)[0] - s.scaled(known.values)[known.where]
    return bool(free.all() and np.all(np.abs(ahead) < BESIDE * np.sqrt(np.diag(known.covariance_parts()[0])[: len(x)])))


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


def _corrected(raw: FloatArray, dx: FloatArray, change: FloatArray, a: FloatArray, *, own: bool) -> FloatArray:
    """Return derivatives, (rows, q, f), changed as little as gives the change, (rows, q), of a step, (f,).

    As little as the whitened signals weigh what is free, of which `a`, (f, f), is the triangle. `own`: in their place.
    """
    weights = np.sum(a**2, axis=0) * dx
    missed = (change - raw @ dx) / (weights @ dx)
    raw = raw if own else raw.copy(order="K")
    for k, weight in enumerate(weights.tolist()):
        raw[:, :, k] += weight * missed
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


def _step(a: FloatArray, g: FloatArray, damping: float, x: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the damped step that minimises |g - a dx|; zero for parameters at a bound that would leave it."""
    free = np.ones(len(x), dtype=bool)
    dx = np.zeros(len(x))
    for _ in range(len(x)):
        own = a[:, free]
        scale = np.sqrt(np.einsum("nk,nk->k", own, own))
        scale[scale == 0] = 1.0
        own = own / scale
        dx = np.zeros(len(x))
        dx[free] = np.linalg.solve(own.T @ own + damping * np.eye(len(scale)), own.T @ g) / scale
        out = free & (((x <= low) & (dx < 0)) | ((x >= high) & (dx > 0)))
        if not out.any():
            break
        free &= ~out
        if not free.any():
            return np.zeros(len(x))
    return dx
