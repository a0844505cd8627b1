"""One explanation of the recordings: what is free, the noise, and their most likely values. Knows no effect by name.

    minimise  |W (m - s(x) - C b)|^2   over x, what is free on its scale, and b, the linear coefficients

by Gauss-Newton steps with Levenberg's damping; s is simulated through the FMU, C are known columns, W whitens
(noise_model). b is eliminated at every point (variable projection, Golub and Pereyra 1973): the triangular factor of
the whitened [C J r] holds all that a step, a covariance or a test needs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, T_FREEDOM
from estimator.fitting.least_squares import DIFFERENCE_STEP, information_parts
from estimator.fitting.noise_model import NoiseModel, Whitener
from estimator.fitting.simulator import CELLS, Simulator
from estimator.plans.parameters import SensorPlace
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
T = TypeVar("T")

ITERATIONS = 25
DAMPING = (1e-3, 1e8)  # first, last
LONGEST_LOG_STEP, LONGEST_STEP = 1.0, 5.0  # longest step: of a logarithm; of a nuisance's typical sizes
OUTLIER, OUTLIER_BESIDE = 4.5, 3.0  # standard deviations of an outlier, 1 of 147 000 normal values; of those beside one
SECANTS, KINKED = 6, 0.7  # times that errors grow by secants; of a derivative: a smaller secant is taken
WENT_ON = 0.01  # of z'z: a continued descent that ends this much lower is an improvement
WELL_CONDITIONED, AT_ONCE = 1e-6, 1e-3  # least eigenvalue of a Gram matrix, its diagonal 1: by two steps, by one
DEPENDENT = 1e-12  # of a column's norm: a smaller remainder is rounding
BOUND_MARGIN = 1e-4  # of the width of the bounds


@dataclass(frozen=True)
class Linear:
    """Columns that explain residuals with free coefficients: what the sensors show more for a unit of each.

    Attributes
    ----------
    columns : (rows, q, k) array
    units : of the coefficients
    least, most : float
        Bounds of a coefficient that is physically possible.
    size : float
        A usual size of a coefficient; 0: none is known.
    one_of : int
        Of how many columns that exclude each other it is the likeliest.
    told_from : float
        What a coefficient of 0 is reported as: for a gain, 1.
    """

    name: str
    columns: FloatArray
    units: tuple[str, ...]
    least: float = -np.inf
    most: float = np.inf
    size: float = 0.0
    told_from: float = 0.0
    one_of: int = 1


@dataclass(frozen=True)
class Fit:
    """An explanation at its most likely values.

    Attributes
    ----------
    values : (p,) array
        Over all names of the simulator.
    free : names of those that are free
    linear : columns that explain a part of the residuals
    shown : (rows, q) array
        What the simulated sensors show, without the linear part.
    coefficients : (m,) array
        Of the linear part.
    z : (rows q,) array
        Whitened residuals, measured less explained; zero where a sample is missing.
    jacobian : (rows q, f + m) array
        Whitened derivatives of what is explained by what is free, on its scale, then by the coefficients.
    raw : (rows, q, f + m) array
        The same before whitening.
    cost : float
        z'z.
    """

    simulator: Simulator
    values: FloatArray
    free: tuple[str, ...]
    linear: tuple[Linear, ...]
    whitener: Whitener
    shown: FloatArray
    coefficients: FloatArray
    z: FloatArray
    jacobian: FloatArray
    raw: FloatArray
    cost: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is estimated: the free values, then the linear coefficients."""
        linear = (f"{g.name}{f'#{k}' if k else ''}" for g in self.linear for k in range(g.columns.shape[2]))
        return (*self.free, *linear)

    @property
    def at_bound(self) -> NDArray[np.int64]:
        """-1, 1 or 0 of each name: at its lower or upper bound, or neither."""
        return np.concatenate([_at_bound(self.simulator, self.values, self.free), np.zeros(len(self.coefficients))]
                              ).astype(np.int64)  # fmt: skip

    @property
    def estimates(self) -> FloatArray:
        """The values of the names, (f + m,)."""
        return np.concatenate([self.values[[self.simulator.index[n] for n in self.free]], self.coefficients])

    @property
    def is_log(self) -> BoolArray:
        """Which of the names are on a logarithmic scale."""
        log = self.simulator.log[[self.simulator.index[n] for n in self.free]]
        return np.concatenate([log, np.zeros(len(self.coefficients), dtype=bool)])

    @property
    def explained(self) -> FloatArray:
        """What the sensors show, (rows, q), the linear part included."""
        return self.shown + _linear_columns(self.linear, self.shown.shape) @ self.coefficients

    def delay(self, recording: int) -> float:
        """Return by how much a recording's outputs come after its inputs, s."""
        s = self.simulator
        own = [n.name for n in s.nuisances if n.place == SensorPlace("delay", recording)]
        return float(self.values[s.index[own[0]]]) if own else s.observed[recording].delay

    def covariance(self) -> FloatArray:
        """Return the covariance of the names on their scales, (f + m, f + m): 0 at a bound, inf if not determined."""
        told, untold = self.covariance_parts()
        return told + untold

    def covariance_parts(self) -> tuple[FloatArray, FloatArray]:
        """Return the covariance's parts, (f + m, f + m) each: of the directions that are determined, and of the others.

        A parameter that vanishes, at the lower bound of its logarithm, may also be as large as is not yet visible: the
        standard errors of the others include that.
        """
        told, untold = self._covariance_parts
        return told.copy(), untold.copy()

    @cached_property
    def _covariance_parts(self) -> tuple[FloatArray, FloatArray]:
        at_bound = self.at_bound
        open_ones = (at_bound == 0) | (at_bound == -1) & self.is_log
        told, untold = np.zeros((2, len(at_bound), len(at_bound)))
        if open_ones.any():
            parts = information_parts(np.asarray(np.linalg.qr(self.jacobian[:, open_ones], mode="r")))
            told[np.ix_(open_ones, open_ones)], untold[np.ix_(open_ones, open_ones)] = parts
        for part in (told, untold):
            part[at_bound != 0] = part[:, at_bound != 0] = 0.0
        return told, untold

    def residuals(self) -> FloatArray:
        """Return measured less explained, (rows, q); NaN where a sample is missing."""
        return self.simulator.measured - self.explained

    def test(self) -> ScoreTest:
        """Return the score test of further columns."""
        return self._test

    @cached_property
    def _test(self) -> ScoreTest:
        known = _Projection(self.jacobian[:, self.at_bound == 0])
        return ScoreTest(self.whitener, known.basis, known.rest(self.z))

    def once(self, told: Callable[[Fit], T]) -> T:
        """Return what a function tells of this fit, asked once; it is not to be changed."""
        known: dict[Callable[[Fit], object], T] = self._told
        if told not in known:
            known[told] = told(self)
        return known[told]

    @cached_property
    def _told(self) -> dict[Callable[[Fit], object], Any]:
        return {}


@dataclass(frozen=True)
class ScoreTest:
    """Score test: how far z'z falls with further columns, to first order, all else fitted again (Rao 1948)."""

    whitener: Whitener
    basis: FloatArray
    left: FloatArray

    def across(self, columns: FloatArray) -> FloatArray:
        """Return (rows, q, c) columns whitened, without their part that the fit explains, (rows q, c)."""
        whitened = self.whitener(columns)[0].reshape(len(self.left), -1)
        whitened -= self.basis @ (self.basis.T @ whitened)
        return whitened

    def scores(self, columns: FloatArray, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Return the scores and the information, (c,) each, of (n, q, c) columns that are zero beside their rows."""
        rows, whitened = self.whitener.of_rows(columns, rows)
        q = columns.shape[1]
        at = slice(rows.start * q, rows.stop * q)
        known = self.basis[at].T @ whitened
        whole = np.einsum("nk,nk->k", whitened, whitened)
        power = whole - np.einsum("nk,nk->k", known, known)
        return whitened.T @ self.left[at], np.where(power > DEPENDENT * whole, power, 0.0)

    def scores_of(self, made: Callable[[FloatArray], FloatArray], values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return scores and information, (c,) each, of columns, (rows, q, c), made of c values, some at once."""
        many = max(1, CELLS // len(self.whitener.present))
        found = [self.scores(made(values[k : k + many])) for k in range(0, len(values), many)]
        along, power = (np.concatenate(part) for part in zip(*found, strict=True))
        return along, power

    def gain(self, across: FloatArray) -> tuple[float, FloatArray]:
        """Return the fall of z'z, and the coefficients, of a group of columns, (rows q, k), as `across` gives them."""
        q, r = _orthonormal(across)
        size, norms = np.abs(np.diag(r)), np.linalg.norm(r, axis=0)
        if not np.all(size > 1e-6 * np.maximum(norms, 1e-300)) or not np.all(norms > 1e-9):
            return 0.0, np.zeros(across.shape[1])
        along = q.T @ self.left
        return float(along @ along), np.asarray(np.linalg.solve(r, along))


def likeliest(along: FloatArray, power: FloatArray) -> int:
    """Return which column lowers z'z most with a coefficient above 0, by `ScoreTest.scores`; 0 if none does."""
    return int(np.argmax(np.where((power > 1e-9) & (along > 0), along**2 / np.maximum(power, 1e-9), 0.0)))


def new_fit(simulator: Simulator, values: FloatArray, free: Sequence[str], noise: NoiseModel) -> Fit:
    """Return a fit that has not been solved: a start."""
    shown = simulator.shown(values[None, :])[0]
    whitener = Whitener(
        noise, simulator.clocks, ~np.isnan(simulator.measured), np.zeros_like(shown),
        np.ones_like(shown), np.ones(len(shown), dtype=bool), np.zeros_like(shown),
    )  # fmt: skip
    none = np.zeros((shown.size, 0))
    start = Fit(simulator, values, tuple(free), (), whitener, shown, np.zeros(0), np.zeros(shown.size), none,
                np.zeros((*shown.shape, 0)), np.inf)  # fmt: skip
    return with_level(start)


def with_level(fit: Fit) -> Fit:
    """Return the fit whose noise follows the signals as they are simulated now."""
    shown = np.where(np.isfinite(fit.shown), fit.shown, 0.0)
    largest = np.max(np.abs(shown), axis=0)
    level = np.abs(shown) / np.where(largest > 0, largest, 1.0)
    moving = level.max(axis=1) > 1e-3
    slope = np.zeros_like(shown)
    for clock in fit.simulator.clocks:
        if len(clock.time) > 2:
            slope[clock.rows] = np.abs(np.gradient(shown[clock.rows], clock.time, axis=0))
    whitener = dataclasses.replace(fit.whitener, level=level, moving=moving, slope=slope)
    return dataclasses.replace(fit, whitener=whitener)


def solved(fit: Fit, *, iterations: int = ITERATIONS, tolerance: float = 1e-3) -> Fit:
    """Return the fit at the least cost that is reached from where it stands.

    Parameters
    ----------
    tolerance : float
        Of z'z: the iteration ends when the predicted fall is smaller. 1 is one standard error.
    """
    s = fit.simulator
    where = np.array([s.index[n] for n in fit.free], dtype=int)
    low, high = s.scaled(s.lower)[where], s.scaled(s.upper)[where]
    x = np.clip(s.scaled(fit.values)[where], low, high)
    columns = _linear_columns(fit.linear, fit.shown.shape)
    linear = _Projection(_flat(fit.whitener, columns))
    damping = DAMPING[0]
    values = _placed(fit, where, x)
    shown = s.shown(values[None, :])[0]
    cost = _cost(fit, shown, linear)
    raw = None
    for _ in range(iterations if len(where) and np.isfinite(cost) else 0):
        raw = _differences(fit, where, x, shown, low, high, central=tolerance < 1e-6)
        a, g = _triangle(fit, linear, raw, shown)
        better = None
        while better is None and damping < DAMPING[1]:
            dx = _step(a, g, damping, x, low, high)
            dx *= min(1.0, float(np.min(_reach(s, where) / np.maximum(np.abs(dx), 1e-300))))
            tried = np.clip(x + dx, low, high)
            predicted = float(g @ g - np.sum((g - a @ (tried - x)) ** 2))
            if predicted < tolerance:
                break
            there = s.shown(_placed(fit, where, tried)[None, :])[0]
            new = _cost(fit, there, linear)
            if new < cost:
                better = tried, there, new
                damping = max(damping / 10, 1e-9)
            else:
                damping *= 10
        if better is None:
            break
        gained = cost - better[2]
        x, shown, cost = better
        raw = None
        if gained < tolerance:
            break
    if raw is None or tolerance >= 1e-6:
        raw = _differences(fit, where, x, shown, low, high, central=tolerance < 1e-2)
    return _evaluated(fit, _placed(fit, where, x), shown, raw, columns, linear)


def _evaluated(
    fit: Fit, values: FloatArray, shown: FloatArray, raw: FloatArray, columns: FloatArray, linear: _Projection
) -> Fit:
    """Return the fit at a point, with its whitened residuals and derivatives; `linear`: of the columns, whitened."""
    own = _flat(fit.whitener, np.concatenate([_misfit(fit, shown)[:, :, None], raw], axis=2))
    b = linear.coefficients(own[:, 0])
    z = own[:, 0] - linear.columns @ b
    return dataclasses.replace(
        fit, values=values, shown=shown, coefficients=b, z=z, jacobian=np.hstack([own[:, 1:], linear.columns]),
        raw=np.concatenate([raw, columns], axis=2), cost=float(z @ z) if np.isfinite(z).all() else np.inf,
    )  # fmt: skip


def refreshed(fit: Fit, whitener: Whitener) -> Fit:
    """Return the fit with another whitener, its values unchanged."""
    f = len(fit.free)
    columns = fit.raw[:, :, f:]
    judged = dataclasses.replace(fit, whitener=whitener)
    return _evaluated(judged, fit.values, fit.shown, fit.raw[:, :, :f], columns, _Projection(_flat(whitener, columns)))


def held_down(fit: Fit, onsets: BoolArray) -> Fit:
    """Return the fit with outliers, which stand alone or two together, weighted by Student's t.

    Parameters
    ----------
    onsets : (rows,) array
        Rows after edges: residuals there are a misfit of the response, and no outliers.
    """
    # As if no outlier had a lower weight yet.
    z = np.abs(fit.z.reshape(fit.shown.shape)) * np.sqrt(fit.whitener.inflate)
    present = fit.whitener.present
    usual = [median(own[here]) / MEDIAN_SIZE if here.any() else 1.0 for own, here in zip(z.T, present.T, strict=True)]
    least = np.where(fit.simulator.coarse, 1.0, 1e-3)  # the median of a few steps of a converter tells no size
    z = z / np.clip(usual, least, 1.0)  # the noise is too large if outliers were in it
    n = len(z)
    far = np.vstack([np.zeros((2, z.shape[1])), z, np.zeros((2, z.shape[1]))])
    one, *two = (np.maximum(far[2 + a : 2 + a + n], far[2 + b : 2 + b + n]) for a, b in ((-1, 1), (-2, 1), (-1, 2)))
    steady = np.abs(np.gradient(fit.shown, axis=0)) < fit.whitener.noise.deviation(fit.whitener.level)
    beside = np.where(steady, np.minimum(one, np.minimum(*two)), one)  # two neighbours in a transient may be a misfit
    alone = (z > OUTLIER) & ((beside < OUTLIER_BESIDE) | (z > 4 * beside))
    alone &= ~onsets[:, None]
    alone &= np.abs(np.nan_to_num(fit.residuals())) > fit.simulator.steps  # a sensor's resolution is no outlier
    inflate = np.where(alone, (T_FREEDOM + z * z) / (T_FREEDOM + 1), 1.0)
    return dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener, inflate=inflate))


def with_secants(fit: Fit) -> Fit:
    """Return the fit with secants over one standard error in place of derivatives that are much larger.

    Where an FMU switches, its signals have kinks. A derivative there may be large on one side only, and the descent
    stops. With the secant of the flatter side it goes on, as long as the cost falls.
    """
    s = fit.simulator
    where = np.array([s.index[n] for n in fit.free], dtype=int)
    f = len(where)
    low, high = s.scaled(s.lower)[where], s.scaled(s.upper)[where]
    for _ in range(SECANTS):
        x = s.scaled(fit.values)[where]
        deviation = np.sqrt(np.maximum(np.diag(fit.covariance())[:f], 0.0))
        reach = np.where(np.isfinite(deviation) & (deviation > 0), deviation, 0.0)
        reach = np.minimum(reach, np.where(s.log[where], 0.5, _reach(s, where)))
        points = np.concatenate([np.minimum(x + reach, high), np.maximum(x - reach, low)])
        wide = np.repeat(fit.values[None, :], 2 * f, axis=0)
        for k, j in enumerate([*where, *where]):
            wide[k, j] = s.unscaled(_spread(s, j, points[k]))[j]
        shown = s.shown(wide)
        width = points - np.tile(x, 2)
        usable = (width != 0) & np.isfinite(shown).all(axis=(1, 2))
        change = np.where(usable[:, None, None], np.nan_to_num(shown) - fit.shown, 0.0).transpose(1, 2, 0)
        secants = change / np.where(width != 0, width, 1.0)
        norms = np.where(usable, np.linalg.norm(_flat(fit.whitener, secants), axis=0), np.inf).reshape(2, f)
        side = np.argmin(norms, axis=0)
        kinked = np.flatnonzero(norms.min(axis=0) < KINKED * np.linalg.norm(fit.jacobian[:, :f], axis=0))
        if not len(kinked):
            break
        raw = fit.raw[:, :, :f].copy()
        raw[:, :, kinked] = secants[:, :, side[kinked] * f + kinked]
        fit = _evaluated(fit, fit.values, fit.shown, raw, fit.raw[:, :, f:], _Projection(fit.jacobian[:, f:]))
        for k in kinked.tolist():
            moved = x.copy()
            moved[k] = points[side[k] * f + k]
            tried = solved(dataclasses.replace(fit, values=_placed(fit, where, moved)), tolerance=1e-6)
            if tried.cost < fit.cost - WENT_ON:
                fit = tried
                break
    return fit


def _misfit(fit: Fit, shown: FloatArray) -> FloatArray:
    return np.where(fit.whitener.present, fit.simulator.measured - shown, 0.0)


class _Projection:
    """Projection on columns, (n, m), by an orthonormal basis; columns that depend on earlier ones are left out."""

    def __init__(self, columns: FloatArray) -> None:
        self.columns = columns
        self.basis, self.factor = _orthonormal(columns)
        own = np.abs(np.diag(self.factor)) > DEPENDENT * np.linalg.norm(self.factor, axis=0)
        self.independent = np.flatnonzero(own)
        if not own.all():
            self.basis, self.factor = self.basis[:, own], self.factor[np.ix_(own, own)]

    def rest(self, others: FloatArray) -> FloatArray:
        """Return the remainder of others, (n, c) or (n,), after projection on the columns."""
        return others - self.basis @ (self.basis.T @ others) if self.basis.shape[1] else others

    def coefficients(self, r: FloatArray) -> FloatArray:
        """Return how much of each column, (m,), explains (n,) residuals best; 0 of dependent ones."""
        result = np.zeros(self.columns.shape[1])
        if len(self.independent):
            result[self.independent] = np.linalg.solve(self.factor, self.basis.T @ r)
        return result


def _orthonormal(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return q, (n, m), and triangular r, (m, m), of columns = q r; by the Cholesky factor where that loses no digits.

    For many columns it costs a quarter of Householder's method (Yamamoto et al. 2015).
    """
    n, m = columns.shape
    norms = np.linalg.norm(columns, axis=0)
    if m == 1 and np.isfinite(norms[0]) and norms[0]:
        return columns / norms, norms[None, :]
    if 1 < m < n and norms.all() and np.isfinite(norms).all():
        scaled = columns / norms
        gram = scaled.T @ scaled
        least = float(np.linalg.eigvalsh(gram)[0])
        if least > WELL_CONDITIONED:
            r = np.linalg.cholesky(gram).T
            q = scaled @ np.linalg.inv(r)
            if least < AT_ONCE:
                again = np.linalg.cholesky(q.T @ q).T
                q, r = q @ np.linalg.inv(again), again @ r
            return np.asarray(q), np.asarray(r * norms)
    q, r = np.linalg.qr(columns)
    return np.asarray(q), np.asarray(r)


def _cost(fit: Fit, shown: FloatArray, linear: _Projection) -> float:
    """Return z'z at simulated signals, the linear part at its best; infinity where the FMU failed."""
    if not np.isfinite(shown).all():
        return float(np.inf)
    r = linear.rest(_flat(fit.whitener, _misfit(fit, shown)[:, :, None])[:, 0])
    return float(r @ r)


def _triangle(fit: Fit, linear: _Projection, raw: FloatArray, shown: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a, (f, f), and g, (f,): |g - a dx| are the whitened residuals after a step, the linear part free."""
    own = _flat(fit.whitener, np.concatenate([raw, _misfit(fit, shown)[:, :, None]], axis=2))
    r = np.asarray(np.linalg.qr(linear.rest(own), mode="r"))
    f = raw.shape[2]
    square = np.zeros((f, f + 1))
    square[: len(r)] = r[:f]
    return square[:, :f], square[:, f]


def _step(a: FloatArray, g: FloatArray, damping: float, x: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the damped step that minimises |g - a dx|; zero for parameters at a bound that would leave it."""
    free = np.ones(len(x), dtype=bool)
    dx = np.zeros(len(x))
    for _ in range(len(x)):
        scale = np.linalg.norm(a[:, free], axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        lhs = np.vstack([a[:, free], np.sqrt(damping) * np.diag(scale)])
        dx = np.zeros(len(x))
        dx[free] = np.linalg.lstsq(lhs, np.concatenate([g, np.zeros(int(free.sum()))]), rcond=None)[0]
        out = free & (((x <= low) & (dx < 0)) | ((x >= high) & (dx > 0)))
        if not out.any():
            break
        free &= ~out
        if not free.any():
            return np.zeros(len(x))
    return dx


def _reach(s: Simulator, where: NDArray[np.int_]) -> FloatArray:
    own = where < len(s.plan.names)
    return np.where(s.log[where], LONGEST_LOG_STEP, np.where(own, 100.0, LONGEST_STEP) * s.size[where])


def _differences(
    fit: Fit,
    where: NDArray[np.int_],
    x: FloatArray,
    shown: FloatArray,
    low: FloatArray,
    high: FloatArray,
    *,
    central: bool,
) -> FloatArray:
    """Return derivatives of what is shown by what is free, (rows, q, f), by one-sided or central differences."""
    s = fit.simulator
    f = len(where)
    if not f:
        return np.zeros((*shown.shape, 0))
    h = np.where(s.log[where], DIFFERENCE_STEP, 10 * DIFFERENCE_STEP * s.size[where])
    h = np.maximum(h, s.spacing(fit.values)[where] / (2 if central else 1))
    ahead = np.where(x + h <= high, x + h, x - h)
    behind = np.where((x - h >= low) & (ahead > x), x - h, x) if central else x
    points = np.repeat(_placed(fit, where, x)[None, :], 2 * f if central else f, axis=0)
    for k, j in enumerate(where):
        points[k, j] = s.unscaled(_spread(s, j, ahead[k]))[j]
        if central:
            points[f + k, j] = s.unscaled(_spread(s, j, behind[k]))[j]
    all_shown = s.shown(points)
    result = np.zeros((*shown.shape, f))
    for k in range(f):
        there, back, width = all_shown[k], all_shown[f + k] if central else shown, ahead[k] - behind[k]
        if not np.isfinite(back).all():
            back, width = shown, ahead[k] - x[k]
        if np.isfinite(there).all():
            np.subtract(there, back, out=result[:, :, k])
            result[:, :, k] /= width
    return result


def _spread(s: Simulator, j: int, x: float) -> FloatArray:
    whole = np.ones(len(s.names))
    whole[j] = x
    return whole


def _placed(fit: Fit, where: NDArray[np.int_], x: FloatArray) -> FloatArray:
    s = fit.simulator
    values = fit.values.copy()
    values[where] = np.where(s.log[where], np.exp(np.where(s.log[where], x, 0.0)), x)
    return np.clip(values, s.lower, s.upper)


def _at_bound(s: Simulator, values: FloatArray, free: Sequence[str]) -> FloatArray:
    where = [s.index[n] for n in free]
    x, low, high = s.scaled(values)[where], s.scaled(s.lower)[where], s.scaled(s.upper)[where]
    width = np.where(high > low, high - low, 1.0)
    return np.where(x - low <= BOUND_MARGIN * width, -1, np.where(high - x <= BOUND_MARGIN * width, 1, 0))


def _linear_columns(linear: Sequence[Linear], shape: tuple[int, ...]) -> FloatArray:
    return np.concatenate([np.zeros((*shape, 0)), *(g.columns for g in linear)], axis=2)


def _flat(whitener: Whitener, columns: FloatArray) -> FloatArray:
    return whitener(columns)[0].reshape(columns.shape[0] * columns.shape[1], -1)
