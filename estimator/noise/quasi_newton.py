"""Minimum of a smooth function of a few variables within bounds. Knows numbers and one function only.

A quadratic model with BFGS's Hessian is minimised within the bounds: first along the projected gradient, which tells
what stays at a bound, then over the other variables (Byrd, Lu, Nocedal and Zhu 1995; Morales and Nocedal 2011). A line
search to that point follows (Moré and Thuente 1994). With the Hessian of the last ten steps it is SciPy's L-BFGS-B, and
takes the same steps (tests/test_quasi_newton.py), in a package whose import takes as long as a clean estimate.
Derivatives are one-sided differences.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Values = Callable[[FloatArray], FloatArray]
Objective = Callable[[FloatArray], tuple[float, FloatArray]]  # value and slopes

FLAT = 1e-5  # slope of a minimum
KEPT = 10  # steps that the Hessian is made of
SEARCHES = 20  # values that a line search asks for, at most
ENOUGH, FLATTER, NARROW = 1e-3, 0.9, 0.1  # of the first slope: fall, slope that is left; of a bracket: its width
FARTHER, LEAST_FARTHER, SHRINKS = 4.0, 1.1, 0.66  # times the last stride; of a bracket in two strides
ROUNDING = float(np.finfo(float).eps)


def minimise(
    values: Values,
    x: FloatArray,
    low: FloatArray,
    high: FloatArray,
    *,
    step: float,
    iterations: int,
    ftol: float,
) -> tuple[FloatArray, float]:
    """Return the minimum that is reached from x, (n,), and its value.

    Parameters
    ----------
    values : callable
        (k, n) points -> (k,) values.
    low, high : (n,) arrays
        Bounds, further apart than two steps.
    step : float
        Of the differences.
    iterations : int
        At most.
    ftol : float
        It ends when a step lowers the value by less of it, or no variable has a larger slope than FLAT.
    """

    def told(x: FloatArray) -> tuple[float, FloatArray]:
        points = np.repeat(x[None, :], len(x) + 1, axis=0)
        points[range(1, len(points)), range(len(x))] += np.where(x + step <= high, step, -step)
        at = values(points)
        with np.errstate(invalid="ignore"):
            return float(at[0]), (at[1:] - at[0]) / (points[1:].diagonal() - x)

    x = np.clip(x, low, high)
    f, g = told(x)
    pairs: list[tuple[FloatArray, FloatArray]] = []
    done = 0
    while done < iterations and np.isfinite(g).all() and float(np.max(np.abs(x - np.clip(x - g, low, high)))) > FLAT:
        hessian = _hessian(pairs, len(x))
        way = _model_minimum(x, g, hessian, low, high, newton=bool(pairs)) - x
        longest = _longest(x, way, low, high) if done else 1.0
        found = _line_search(told, x, f, g, way, longest) if g @ way < 0 else None
        if found is None:
            if not pairs:
                break
            pairs = []
            continue
        stride, new, there, g_there = found
        done += 1
        fell = f - there
        s, y, curvature = stride * way, g_there - g, float(g_there @ way - g @ way) * stride
        steep = -float(g @ way) * stride
        enough = fell > ftol * max(abs(f), abs(there), 1.0)
        x, f, g = new, there, g_there
        if not enough:
            break
        if curvature > ROUNDING * steep:
            pairs = [*pairs[max(0, len(pairs) + 1 - KEPT) :], (s, y)]
    return x, f


def _hessian(pairs: list[tuple[FloatArray, FloatArray]], n: int) -> FloatArray:
    """Return BFGS's Hessian, (n, n), of steps and changes of the slope, from a multiple of one."""
    if not pairs:
        return np.eye(n)
    s, y = pairs[-1]
    b = float(y @ y) / float(s @ y) * np.eye(n)
    for s, y in pairs:
        along = b @ s
        b = b - np.outer(along, along) / float(s @ along) + np.outer(y, y) / float(s @ y)
    return b


def _model_minimum(
    x: FloatArray, g: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, *, newton: bool
) -> FloatArray:
    """Return the minimum of g'd + d'b d / 2 within the bounds, approximately; without `newton` along the gradient."""
    at = _cauchy_point(x, g, b, low, high)
    free = (at > low) & (at < high)
    if not newton or not free.any():
        return at
    left = (g + b @ (at - x))[free]
    whole = at.copy()
    whole[free] -= np.linalg.solve(b[np.ix_(free, free)], left)
    clipped = np.clip(whole, low, high)
    if np.array_equal(clipped, whole) or float(g @ (clipped - x)) <= 0:
        return clipped
    way = whole - at
    return np.asarray(at + min(1.0, _longest(at, way, low, high)) * way)


def _cauchy_point(x: FloatArray, g: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the first minimum of the model along the projected gradient."""
    reaches = np.full(len(x), np.inf)
    reaches[g < 0], reaches[g > 0] = ((x - high)[g < 0] / g[g < 0]), ((x - low)[g > 0] / g[g > 0])
    way, at, gone = np.where(reaches > 0, -g, 0.0), x.copy(), 0.0
    for k in np.argsort(reaches, kind="stable"):
        if not way.any():
            break
        if way[k] == 0:
            continue
        curvature = float(way @ b @ way)
        stride = -float(g @ way + way @ b @ (at - x)) / curvature if curvature > 0 else np.inf
        if stride < reaches[k] - gone:
            return np.asarray(at + max(stride, 0.0) * way)
        at = at + (reaches[k] - gone) * way
        at[k] = high[k] if g[k] < 0 else low[k]
        gone, way[k] = float(reaches[k]), 0.0
    return at


def _longest(x: FloatArray, way: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Return how far along a way the bounds are reached."""
    up, down = way > 0, way < 0
    reaches = [*((high - x)[up] / way[up]).tolist(), *((low - x)[down] / way[down]).tolist()]
    return max(0.0, min(reaches, default=1e10))


def _line_search(
    told: Objective,
    x: FloatArray,
    f: float,
    g: FloatArray,
    way: FloatArray,
    longest: float,
) -> tuple[float, FloatArray, float, FloatArray] | None:
    """Return stride, point, value and gradient that lower the value enough and are flat enough; None if none is found.

    An interval that holds such a point, once there is one, shrinks; before, the strides grow.
    """
    first = float(g @ way)
    least = ENOUGH * first
    best = other = (0.0, f, first)  # ends of the interval: stride, value, slope; the best first
    bracketed, falls = False, True  # falls: no point yet with a fall that is enough and a slope that rises
    width, before = longest, 2 * longest
    lower, upper = 0.0, (1 + FARTHER) * min(1.0, longest)
    stride = min(1.0, longest)
    for _ in range(SEARCHES):
        point = x + stride * way
        there, g_there = told(point)
        if not np.isfinite(g_there).all():
            stride = best[0] + 0.5 * (stride - best[0])
            continue
        now = (stride, there, float(g_there @ way))
        test = f + stride * least
        if falls and there <= test and now[2] >= 0:
            falls = False
        stuck = bracketed and (stride <= lower or stride >= upper or upper - lower <= NARROW * upper)
        if stuck or (stride == longest and there <= test and now[2] <= least):
            return stride, point, there, g_there
        if there <= test and abs(now[2]) <= -FLATTER * first:
            return stride, point, there, g_there
        # Before a fall is enough, the value less what is enough is what is minimised.
        tilt = least if falls and there <= best[1] and there > test else 0.0
        ends = (_tilted(e, -tilt) for e in (best, other, now))
        try:
            with np.errstate(all="ignore"):
                best, other, stride, bracketed = _next_stride(*ends, bracketed=bracketed, lower=lower, upper=upper)
        except ZeroDivisionError:  # flat to the last digit
            return None
        if not np.isfinite(stride):
            return None
        best, other = _tilted(best, tilt), _tilted(other, tilt)
        if bracketed:
            if abs(other[0] - best[0]) >= SHRINKS * before:
                stride = best[0] + 0.5 * (other[0] - best[0])
            before, width = width, abs(other[0] - best[0])
            lower, upper = sorted((best[0], other[0]))
        else:
            lower, upper = (stride + k * (stride - best[0]) for k in (LEAST_FARTHER, FARTHER))
        stride = min(max(stride, 0.0), longest)
        if bracketed and (stride <= lower or stride >= upper or upper - lower <= NARROW * upper):
            stride = best[0]
    return None


End = tuple[float, float, float]


def _tilted(end: End, tilt: float) -> End:
    """Return stride, value and slope with a line of a slope added."""
    return end[0], end[1] + tilt * end[0], end[2] + tilt


def _next_stride(best: End, other: End, now: End, *, bracketed: bool, lower: float, upper: float
                 ) -> tuple[End, End, float, bool]:  # fmt: skip
    """Return the interval with the stride tried last, the next stride, and whether there is a bracket."""
    (x0, f0, d0), (x1, f1, d1) = best, now
    same_way = d1 * np.sign(d0)
    theta = 3 * (f0 - f1) / (x1 - x0) + d0 + d1
    size = max(abs(theta), abs(d0), abs(d1))
    if f1 > f0:  # higher: the minimum lies between
        gamma = size * np.sqrt((theta / size) ** 2 - (d0 / size) * (d1 / size)) * (1 if x1 > x0 else -1)
        cubic = x0 + (gamma - d0 + theta) / (gamma - d0 + gamma + d1) * (x1 - x0)
        quadratic = x0 + d0 / ((f0 - f1) / (x1 - x0) + d0) / 2 * (x1 - x0)
        stride = cubic if abs(cubic - x0) < abs(quadratic - x0) else cubic + (quadratic - cubic) / 2
        bracketed = True
    elif same_way < 0:  # lower, and rising
        gamma = size * np.sqrt((theta / size) ** 2 - (d0 / size) * (d1 / size)) * (-1 if x1 > x0 else 1)
        cubic = x1 + (gamma - d1 + theta) / (gamma - d1 + gamma + d0) * (x0 - x1)
        secant = x1 + d1 / (d1 - d0) * (x0 - x1)
        stride = cubic if abs(cubic - x1) > abs(secant - x1) else secant
        bracketed = True
    elif abs(d1) < abs(d0):  # lower, and flatter
        gamma = size * np.sqrt(max(0.0, (theta / size) ** 2 - (d0 / size) * (d1 / size))) * (-1 if x1 > x0 else 1)
        part = (gamma - d1 + theta) / (gamma + (d0 - d1) + gamma)
        cubic = x1 + part * (x0 - x1) if part < 0 and gamma != 0 else (upper if x1 > x0 else lower)
        secant = x1 + d1 / (d1 - d0) * (x0 - x1)
        if bracketed:
            stride = cubic if abs(cubic - x1) < abs(secant - x1) else secant
            end = x1 + SHRINKS * (other[0] - x1)
            stride = min(end, stride) if x1 > x0 else max(end, stride)
        else:
            stride = cubic if abs(cubic - x1) > abs(secant - x1) else secant
            stride = min(max(stride, lower), upper)
    elif bracketed:  # lower, and no flatter: towards the other end
        x2, f2, d2 = other
        theta = 3 * (f1 - f2) / (x2 - x1) + d2 + d1
        size = max(abs(theta), abs(d2), abs(d1))
        gamma = size * np.sqrt((theta / size) ** 2 - (d2 / size) * (d1 / size)) * (-1 if x1 > x2 else 1)
        stride = x1 + (gamma - d1 + theta) / (gamma - d1 + gamma + d2) * (x2 - x1)
    else:
        stride = upper if x1 > x0 else lower
    if f1 > f0:
        other = now
    else:
        other = best if same_way < 0 else other
        best = now
    return best, other, float(stride), bracketed
