"""Bounded nonlinear least squares by the trust-region reflective method. Knows arrays only.

    minimise  |r(x)|^2 / 2   over   low < x < high

(Branch, Coleman and Li 1999). Every step minimises the linearised sum of squares, in variables that are scaled by the
lengths of the Jacobian's columns and by the root of their distance to the bound that the gradient points at, within a
radius (Moré 1978); a step that would leave the bounds is cut there, or reflected, or taken along the gradient, whatever
lowers the model most. All iterates lie inside. It is the method of SciPy's ``least_squares``, and takes the same steps
(tests/test_trust_region.py), in a package whose import takes as long as a clean estimate.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.projection import triangle

FloatArray = NDArray[np.float64]
Steps = Generator[tuple[FloatArray, bool], FloatArray, tuple[FloatArray, float]]

INSIDE = 0.995  # of the way to a bound, at most
POOR, GOOD = 0.25, 0.75  # of the predicted fall: with less the radius shrinks, with more it grows
ON_RADIUS, CUT = 0.01, 0.95  # of the radius: how near to it a step's length is brought; a longer step is cut by it
LEAST_GRADIENT = 1e-15


def steps(x: FloatArray, *, low: FloatArray, high: FloatArray, evaluations: int, ftol: float, xtol: float) -> Steps:
    """Yield points at which residuals, or their derivatives, are asked; return the optimum and its sum of squares.

    So that whoever solves several problems can answer them all at once. Derivatives are asked at the point at which the
    residuals, (m,), were accepted last, as `triangle_of` them and these residuals.

    Parameters
    ----------
    x : (p,) array
        The start, inside the bounds.
    evaluations : int
        Of the residuals, at most.
    ftol, xtol : float
        The iteration ends when the sum of squares falls by less than ftol of itself, or x moves by less than xtol of
        itself.
    """
    r = yield x, False
    cost, left, damping, radius = 0.5 * float(r @ r), evaluations - 1, 0.0, -1.0
    triangle = yield x, True
    lengths = _lengths(triangle)
    lengths[lengths == 0] = 1.0
    while True:
        model = _Model.at(x, triangle, low, high, 1 / lengths, len(r))
        if radius < 0:
            radius = _length(x * lengths / np.sqrt(model.distance)) or 1.0
        if model.steepness < LEAST_GRADIENT or left <= 0:
            break
        fell, ended = -1.0, False
        while fell <= 0 and left > 0:
            scaled, damping = model.within(radius, damping)
            step, predicted = model.chosen(scaled, radius)
            tried = _inside(x + model.scale * step, low, high)
            there, left = (yield tried, False), left - 1
            length = _length(step)
            if not np.isfinite(there).all():
                radius = POOR * length
                continue
            new = 0.5 * float(there @ there)
            fell = cost - new
            ratio = fell / predicted if predicted > 0 else float(predicted == fell == 0)
            before = radius
            if ratio < POOR:
                radius = POOR * length
            elif ratio > GOOD and length > CUT * radius:
                radius *= 2
            moved = _length(model.scale * step)
            ended = (fell < ftol * cost and ratio > POOR) or moved < xtol * (xtol + _length(x))
            if ended:
                break
            damping *= before / radius
        if fell > 0:
            x, r, cost = tried, there, new
            if not ended:
                triangle = yield x, True
                lengths = np.maximum(lengths, _lengths(triangle))
        if fell <= 0 or ended:
            break
    return x, 2 * cost


@dataclass
class _Model:
    """The sum of squares about a point, quadratic in scaled steps: g's + s'(A'A + D)s / 2.

    Attributes
    ----------
    x, low, high : (p,) arrays
    distance : (p,) array
        To the bound that the descent goes to, in the sizes; 1 where there is none.
    scale : (p,) array
        A step is scale times its scaled one.
    a, g, d : (p, p), (p,) and (p,) arrays
    singular, rows, along : of [A; sqrt(D)] = U S V': S, V' and U'[r; 0]
    count : residuals
    """

    x: FloatArray
    low: FloatArray
    high: FloatArray
    distance: FloatArray
    scale: FloatArray
    a: FloatArray
    g: FloatArray
    d: FloatArray
    steepness: float
    singular: FloatArray
    rows: FloatArray
    along: FloatArray
    count: int

    @classmethod
    def at(
        cls, x: FloatArray, triangle: FloatArray, low: FloatArray, high: FloatArray, size: FloatArray, count: int
    ) -> _Model:
        """Return the model at x of a triangle, (p + 1, p + 1), of so many rows, and the sizes of parameters, (p,)."""
        p = len(x)
        gradient = triangle[:, :p].T @ triangle[:, p]
        up, down = (gradient < 0) & (high < np.inf), (gradient > 0) & (low > -np.inf)
        distance = np.where(up, high - x, np.where(down, x - low, 1.0))
        bounded = up | down
        steepness = float(np.abs(gradient * distance).max())
        distance = np.where(bounded, distance / size, 1.0)
        scale = np.sqrt(distance) * size
        d = np.where(bounded, np.abs(gradient), 0.0) * size
        k = len(triangle)
        stacked = np.zeros((k + p, p))
        a = stacked[:k]
        np.multiply(triangle[:, :p], scale, out=a)
        stacked[k:].ravel()[:: p + 1] = np.sqrt(d)
        u, singular, rows = np.linalg.svd(stacked, full_matrices=False)
        along = u[:k].T @ triangle[:, p]
        return cls(x, low, high, distance, scale, a, scale * gradient, d, steepness, singular, rows, along, count)

    def within(self, radius: float, damping: float) -> tuple[FloatArray, float]:
        """Return the scaled step that minimises the model within a radius, and its damping; the last one is a guess."""
        s, weighted = self.singular, self.singular * self.along
        full = bool(s[-1] > np.finfo(float).eps * self.count * s[0])
        if full:
            step = -self.rows.T @ (self.along / s)
            if _length(step) <= radius:
                return step, 0.0

        squares = s**2

        def beyond(damping: float) -> tuple[float, float]:
            damped = squares + damping
            parts = weighted / damped
            length = _length(parts)
            return length - radius, -float((parts**2 / damped).sum()) / length

        most, least = _length(weighted) / radius, 0.0
        if full:
            excess, slope = beyond(0.0)
            least = -excess / slope
        if not full and damping == 0.0:
            damping = max(0.001 * most, math.sqrt(max(least * most, 0.0)))
        for _ in range(10):
            if not least <= damping <= most:
                damping = max(0.001 * most, math.sqrt(max(least * most, 0.0)))
            excess, slope = beyond(damping)
            most = damping if excess < 0 else most
            least = max(least, damping - excess / slope)
            damping -= (excess + radius) / radius * excess / slope
            if abs(excess) < ON_RADIUS * radius:
                break
        step = -self.rows.T @ (weighted / (squares + damping))
        return np.asarray(step * (radius / _length(step))), float(damping)

    def chosen(self, step: FloatArray, radius: float) -> tuple[FloatArray, float]:
        """Return the scaled step that stays inside and lowers the model most, and by how much it does."""
        whole = self.x + self.scale * step
        if ((whole >= self.low) & (whole <= self.high)).all():
            return step, -self._value(step)
        part = max(INSIDE, 1 - self.steepness)
        reached, hit = self._to_bound(self.x, self.scale * step)
        back = np.where(hit, -step, step)
        step = reached * step
        found = [part * step]
        # Reflected where the step meets the bound, as far as the next bound or the radius.
        to_radius = _to_radius(step, back, radius)
        to_bound, _ = self._to_bound(self.x + self.scale * step, self.scale * back)
        longest = min(to_bound, to_radius)
        if longest > 0:
            first = (1 - part) * reached / longest
            last = part * to_bound if longest == to_bound else to_radius
            if first <= last:
                found.append(step + self._best_along(back, first, last, begin=step) * back)
        down = -self.g
        to_radius, (to_bound, _) = radius / _length(down), self._to_bound(self.x, self.scale * down)
        found.append(self._best_along(down, 0.0, part * to_bound if to_bound < to_radius else to_radius) * down)
        values = [self._value(f) for f in found]
        k = int(np.argmin(values))
        return found[k], -values[k]

    def _value(self, step: FloatArray) -> float:
        moved = self.a @ step
        return float(0.5 * (moved @ moved + step @ (self.d * step)) + self.g @ step)

    def _best_along(self, way: FloatArray, first: float, last: float, *, begin: FloatArray | None = None) -> float:
        """Return how far along a way, from `first` to `last`, the model is least."""
        moved = self.a @ way
        curvature = float(moved @ moved + way @ (self.d * way))
        slope = float(self.g @ way)
        if begin is not None:
            slope += float((self.a @ begin) @ moved + begin @ (self.d * way))
        ends = [first, last]
        if curvature != 0 and first < -slope / curvature < last:
            ends.append(-slope / curvature)
        return min(ends, key=lambda t: t * (slope + 0.5 * curvature * t))

    def _to_bound(self, x: FloatArray, step: FloatArray) -> tuple[float, NDArray[np.bool_]]:
        """Return by how much of a step the first bound is reached, and which."""
        moves = step != 0
        ways = np.full(len(x), np.inf)
        ways[moves] = np.maximum((self.low - x)[moves] / step[moves], (self.high - x)[moves] / step[moves])
        nearest = float(np.min(ways))
        return nearest, moves & (ways == nearest)


def _to_radius(begin: FloatArray, way: FloatArray, radius: float) -> float:
    """Return how far along a way from `begin`, which lies inside, the radius is reached."""
    a, b, c = float(way @ way), float(begin @ way), float(begin @ begin) - radius**2
    if a == 0:
        return 0.0
    q = -(b + math.copysign(math.sqrt(max(b * b - a * c, 0.0)), b))
    return float(max(q / a, c / q if q != 0 else 0.0))


def triangle_of(jacobian: FloatArray, r: FloatArray) -> FloatArray:
    """Return R of [J r] = Q R, (k, p + 1), J (m, p): it has all scalar products of the columns and the residuals."""
    both = np.empty((len(r), jacobian.shape[1] + 1))
    both[:, :-1], both[:, -1] = jacobian, r
    return triangle(both)


def _lengths(triangle: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((triangle[:, :-1] ** 2).sum(axis=0)))


def _length(x: FloatArray) -> float:
    return math.sqrt(float(x @ x))


def _inside(x: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return a point that lies strictly between the bounds."""
    if ((x > low) & (x < high)).all():
        return x
    x = np.where(x <= low, np.nextafter(low, high), np.where(x >= high, np.nextafter(high, low), x))
    return np.asarray(np.where((x < low) | (x > high), 0.5 * (low + high), x))
