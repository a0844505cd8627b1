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

from estimator.fitting.fit import Fit, evaluated, linear_columns, misfit
from estimator.fitting.projection import Projection, triangle
from estimator.fitting.slopes import Point, Slopes

FloatArray = NDArray[np.float64]

ITERATIONS, MOST_STEPS = 25, 4  # derivatives that are simulated; steps for each, on average
ROUGH = 8  # derivatives that are simulated of a fit that is only compared
HOPE = 4.0  # times the whole fall that derivatives predict: a fit that needs more to be wanted ends
DAMPING = (1e-3, 1e8)  # first, last
AS_PREDICTED = (0.7, 1.5)  # of the predicted fall: then derivatives are corrected, not simulated again
LONGEST_LOG_STEP, LONGEST_STEP = 1.0, 5.0  # longest step: of a logarithm; of a nuisance's typical sizes


def solved_roughly(fit: Fit, *, limit: float = np.inf) -> Fit:
    """Return the fit near the least cost that is reached from where it stands: to be compared, not to be told."""
    return solved(fit, iterations=ROUGH, limit=limit)


def solved(
    fit: Fit, *, iterations: int = ITERATIONS, tolerance: float = 1e-3, limit: float = np.inf, told: bool = True
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
    """
    s, where, (low, high) = fit.simulator, fit.where, fit.bounds
    linear = Projection(fit.whitener.flat(linear_columns(fit.linear, fit.shown.shape)))
    longest, damping = longest_steps(fit), DAMPING[0]

    def point(x: FloatArray, shown: FloatArray) -> Point:
        return Point(s, where, placed(fit, x), x, low, high, shown, s.between)

    simulated, fine, left = True, tolerance < 1e-6, iterations
    x, shown, known = _begun(fit, central=fine)
    cost, raw = _cost(fit, shown, linear), known
    for _ in range(MOST_STEPS * iterations if len(where) and np.isfinite(cost) else 0):
        if raw is None:
            if not left:
                break
            raw, simulated, left = point(x, shown).slopes(central=fine), True, left - 1
        a, g = _triangle(fit, linear, raw, misfit(fit, shown))
        if simulated and left < iterations - 1 and cost - HOPE * float(g @ g) > limit:
            break
        better, predicted = None, 0.0
        while better is None and damping < DAMPING[1]:
            dx = _step(a, g, damping, x, low, high)
            dx *= min(1.0, float(np.min(longest / np.maximum(np.abs(dx), 1e-300))))
            tried = np.clip(x + dx, low, high)
            predicted = float(g @ g - np.sum((g - a @ (tried - x)) ** 2))
            if predicted < tolerance:
                break
            there = s.shown(placed(fit, tried)[None, :])[0]
            new = _cost(fit, there, linear)
            if simulated and cost <= new < np.inf:
                bent = _triangle(
                    fit, linear, raw, np.where(fit.whitener.present, shown + raw @ (tried - x) - there, 0.0)
                )
                tried = np.clip(tried + _step(*bent, damping, tried, low, high), low, high)
                there = s.shown(placed(fit, tried)[None, :])[0]
                new = _cost(fit, there, linear)
            if new < cost:
                better = tried, there, new
                damping = max(damping / 10, 1e-9)
            elif simulated:
                damping *= 10
            else:
                break
        if better is None:
            if simulated or not told:
                break
            raw = None  # what was corrected tells no minimum
            continue
        gained = cost - better[2]
        if gained >= tolerance and AS_PREDICTED[0] < gained / predicted < AS_PREDICTED[1]:
            step = better[0] - x, better[1] - shown
            raw, simulated = raw if fine else _corrected(raw, *step, a, own=raw is not known), False
        else:
            raw = None
        x, shown, cost = better
        if gained < tolerance and simulated:
            break
    end, known = point(x, shown), raw if fine and simulated else None
    return evaluated(fit, end.values, shown, Slopes(end, central=tolerance < 1e-2, known=known), linear)


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


def _cost(fit: Fit, shown: FloatArray, linear: Projection) -> float:
    """Return z'z at simulated signals, the linear part at its best; infinity where the FMU failed."""
    if not np.isfinite(shown).all():
        return float(np.inf)
    r = linear.rest(fit.whitener.flat(misfit(fit, shown)[:, :, None])[:, 0])
    return float(r @ r)


def _triangle(fit: Fit, linear: Projection, raw: FloatArray, off: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a, (f, f), and g, (f,): |g - a dx| is what a step leaves of a misfit, (rows, q), the linear part free."""
    r = triangle(linear.rest(fit.whitener.whitened(raw, off[:, :, None])))
    f = raw.shape[2]
    square = np.zeros((f, f + 1))
    square[: len(r)] = r[:f]
    return square[:, :f], square[:, f]


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
