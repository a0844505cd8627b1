"""One explanation of the recordings: what is free, the noise, and their values. Minimises nothing, names no effect.

    |W (m - s(x) - C b)|^2   of x, what is free on its scale, and b, the linear coefficients

s is simulated through the FMU, C are known columns, W whitens (whitener.py). b is eliminated at every point (variable
projection, Golub and Pereyra 1973): the triangular factor of the whitened [C J r] holds all that a step, a covariance
or a test needs. gauss_newton.py finds the least.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.information import information_parts
from estimator.fitting.lateness import recording_delay, soon_shown
from estimator.fitting.projection import Projection, triangle
from estimator.fitting.score_test import ScoreTest
from estimator.fitting.simulator import Simulator
from estimator.fitting.slopes import Slopes
from estimator.noise.in_parts import Columns, Made, Scaled
from estimator.noise.kalman import give_back
from estimator.noise.level import Level
from estimator.noise.noise_model import WAYS, NoiseModel
from estimator.noise.whitener import Whitener, moving

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
T = TypeVar("T")

BOUND_MARGIN, NEAR_BOUND = 1e-4, 1e-8  # of the width of bounds on a logarithmic scale, and on a linear one, where a
# value may be a small part of the width and told


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
    form : int
        Which of the forms that its effect knows the columns have.
    transient : (rows, q, k) array, optional
        What it may be in a transient beside what settled rows show of it (`transient_ripple.py`).
    most_transient : float
        Bound of the coefficients of that.
    beyond : (rows, q, k) array, optional
        What it may be besides where settled rows show more than that bound allows.
    uncertain : (rows, q, k) array, optional
        Deviation of the columns: what a coefficient of 1 adds is known as well as that.
    moves : bool
        They move the machine by much, and are no error of a sensor: noise follows the signals with them.
    foretold : bool
        The recordings show the coefficient elsewhere too, as a voltage at rest does that of its offset.
    untold : bool
        No such recording tells it: it is never found, only told among what is not visible.
    """

    name: str
    columns: FloatArray
    units: tuple[str, ...]
    least: float = -np.inf
    most: float = np.inf
    size: float = 0.0
    told_from: float = 0.0
    one_of: int = 1
    form: int = 0
    transient: FloatArray | None = None
    most_transient: float = np.inf
    beyond: FloatArray | None = None
    uncertain: FloatArray | None = None
    moves: bool = False
    foretold: bool = False
    untold: bool = False


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
    slopes : Slopes
        Derivatives of what is shown by what is free, on its scale.
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
    slopes: Slopes
    cost: float

    def missed_by_output(self) -> FloatArray:
        """Return z'z of each output beyond that of as much noise, (q,); 0 where it is less."""
        present = self.whitener.present
        return np.asarray(np.maximum(np.sum(self.z.reshape(present.shape) ** 2, axis=0) - np.sum(present, axis=0), 0.0))

    @property
    def raw(self) -> FloatArray:
        """Derivatives, (rows, q, f + m), of what is explained by what is free, then by the coefficients."""
        columns = [g.columns for g in self.linear]
        return np.concatenate([self.slopes.raw, *columns], axis=2) if columns else self.slopes.raw

    @cached_property
    def whitened(self) -> Columns:
        """The same whitened, (rows q, f + m); of a long recording not held."""
        return self.whitener.whitened(self.slopes.raw, *(g.columns for g in self.linear))

    @property
    def jacobian(self) -> FloatArray:
        """The same, held by who asks."""
        return self.whitened[:]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is estimated: the free values, then the linear coefficients."""
        linear = (f"{g.name}{f'#{k}' if k else ''}" for g in self.linear for k in range(g.columns.shape[2]))
        return (*self.free, *linear)

    @cached_property
    def where(self) -> NDArray[np.int_]:
        """Places of what is free among the names of the simulator, (f,)."""
        return np.array([self.simulator.index[n] for n in self.free], dtype=int)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of what is free, (f,) each, on its scale."""
        s = self.simulator
        return s.scaled(s.lower)[self.where], s.scaled(s.upper)[self.where]

    @property
    def at_bound(self) -> NDArray[np.int64]:
        """-1, 1 or 0 of each name: at its lower or upper bound, or neither."""
        x, (low, high) = self.simulator.scaled(self.values)[self.where], self.bounds
        part = np.where(self.simulator.log[self.where], BOUND_MARGIN, NEAR_BOUND)
        margin = part * np.where(high > low, high - low, 1.0)
        own = np.where(x - low <= margin, -1, np.where(high - x <= margin, 1, 0))
        return np.concatenate([own, np.zeros(len(self.coefficients), dtype=np.int64)])

    @property
    def estimates(self) -> FloatArray:
        """The values of the names, (f + m,)."""
        return np.concatenate([self.values[self.where], self.coefficients])

    @property
    def is_log(self) -> BoolArray:
        """Which of the names are on a logarithmic scale."""
        return np.concatenate([self.simulator.log[self.where], np.zeros(len(self.coefficients), dtype=bool)])

    def value(self, name: str) -> float:
        """Return the value of a name of the simulator, free or not."""
        return float(self.values[self.simulator.index[name]])

    @property
    def linear_names(self) -> tuple[str, ...]:
        """Names of the linear coefficients, (m,)."""
        return self.names[len(self.free) :]

    def estimates_of(self, addition: str) -> list[float]:
        """Return what is estimated of one addition, by its name: of a group of columns each coefficient."""
        named = zip(self.names, self.estimates.tolist(), strict=True)
        return [x for name, x in named if name.partition("#")[0] == addition]

    @property
    def linear_parts(self) -> list[tuple[Linear, FloatArray]]:
        """Each group of columns with its own coefficients, (k,)."""
        ends = np.cumsum([g.columns.shape[2] for g in self.linear])
        return list(zip(self.linear, np.split(self.coefficients, ends[:-1]), strict=True)) if self.linear else []

    @property
    def explained(self) -> FloatArray:
        """What the sensors show, (rows, q), the linear part included; not to be changed."""
        if not self.linear:
            return self.shown
        return self.shown + linear_columns(self.linear, self.shown.shape) @ self.coefficients

    @property
    def moved(self) -> FloatArray:
        """What is shown, (rows, q), with what moves the machine beside the simulation; not to be changed."""
        return sum((g.columns @ own for g, own in self.linear_parts if g.moves and len(own)), self.shown)

    def delay(self, recording: int) -> float:
        """Return by how much a recording's outputs come after its inputs, s."""
        return recording_delay(self.simulator, self.value, recording)

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
            parts = information_parts(triangle(chosen(self.whitened, open_ones)))
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
        inside = self.at_bound == 0
        known = Projection(chosen(self.whitened, inside))
        return ScoreTest(self.whitener, known, known.rest(self.z), inside)

    def once(self, told: Callable[[Fit], T]) -> T:
        """Return what a function tells of this fit, asked once; it is not to be changed."""
        known: dict[Callable[[Fit], object], T] = self._told
        if told not in known:
            known[told] = told(self)
        return known[told]

    @cached_property
    def _told(self) -> dict[Callable[[Fit], object], Any]:
        return {}

    def chosen(self) -> dict[str, float]:
        """Return the whole numbers that were chosen, off neutral: nuisance parameter → number."""
        values = {n.name: (self.value(n.name), n.neutral) for n in self.simulator.nuisances if n.whole}
        return {name: value for name, (value, neutral) in values.items() if value != neutral}

    def forget(self) -> None:
        """Give up the memory of what is told again when it is asked for, its derivatives among it."""
        for name in ("whitened", "_covariance_parts", "_test", "_told"):
            self.__dict__.pop(name, None)
        self.slopes.forget()
        self.whitener.forget()
        give_back(len(self.shown))


def chosen(columns: Columns, which: BoolArray) -> Columns:
    """Return some of columns; of all no copy."""
    if which.all():
        return columns
    if isinstance(columns, Scaled):
        return columns.chosen(which)
    return Made(lambda at: columns[at][:, which], len(columns)) if isinstance(columns, Made) else columns[:, which]


def new_fit(simulator: Simulator, values: FloatArray, free: Sequence[str], noise: NoiseModel) -> Fit:
    """Return a fit that has not been solved: a start."""
    shown = simulator.shown(values[None, :])[0]
    nothing, one = (np.broadcast_to(x, shown.shape) for x in (0.0, 1.0))
    present, runs = ~np.isnan(simulator.measured), np.ones(len(shown), dtype=bool)
    whitener = Whitener(noise, simulator.clocks, present, nothing, one, runs, nothing)
    none = Slopes(None, known=np.zeros((*shown.shape, 0)))
    start = Fit(simulator, values, tuple(free), (), whitener, shown, np.zeros(0), np.zeros(shown.size), none, np.inf)
    return with_level(start)


def with_level(fit: Fit) -> Fit:
    """Return the fit whose noise follows the signals as they are simulated now.

    A sensor that is late has the noise of what the machine does already, and of what it shows still: the larger counts.
    """
    level = Level.of(soon_shown(fit.simulator, fit.value, fit.moved))
    runs = moving(level, fit.whitener.noise.stands)
    slope = slopes_in_time(fit) if fit.whitener.noise.jitter else np.broadcast_to(0.0, level.shape)
    whitener = dataclasses.replace(fit.whitener, level=level, moving=runs, slope=slope, way=_way(fit))
    return dataclasses.replace(fit, whitener=whitener)


def _way(fit: Fit) -> NDArray[np.int8] | None:
    """Return `way` of the whitener, (rows,), as the machine is simulated; None: no sensor shows its speed."""
    s = fit.simulator
    if "w" not in s.outputs:
        return None
    values = {**s.plan.fixed, **dict(zip(s.names, fit.values.tolist(), strict=True))}
    w = fit.moved[:, s.outputs.index("w")]
    torque = np.abs(w)  # changed in its place: a long recording has many rows
    torque *= values.get("B", 0.0)
    torque += values.get("friction", 0.0)
    largest = float(np.max(torque))
    way = np.full(len(w), WAYS, dtype=np.int8)
    if 0 < largest < np.inf:
        torque *= WAYS / largest
        way = np.maximum(np.ceil(torque, out=torque), 1.0, out=torque).astype(np.int8)
    np.negative(way, out=way, where=w < 0)
    return way


def slopes_in_time(fit: Fit) -> FloatArray:
    """Return the slopes of the signals as they are simulated now, (rows, q), in their units a second."""
    slope = np.zeros_like(fit.shown)
    for clock, k in itertools.product(fit.simulator.clocks, range(slope.shape[1])):
        if len(clock.time) > 2:
            own = fit.shown[clock.rows, k]
            slope[clock.rows, k] = np.gradient(np.where(np.isfinite(own), own, 0.0), clock.time)
    return slope


def evaluated(fit: Fit, values: FloatArray, shown: FloatArray, slopes: Slopes, linear: Projection) -> Fit:
    """Return the fit at a point, with its whitened residuals; `linear`: on its columns, whitened."""
    own = whitened_misfit(fit, shown)[:][:, 0]
    b = linear.coefficients(own)
    z = own - linear.columns[:] @ b if len(b) else own
    cost = float(z @ z) if np.isfinite(z).all() else np.inf
    return dataclasses.replace(fit, values=values, shown=shown, coefficients=b, z=z, slopes=slopes, cost=cost)


def refreshed(fit: Fit, whitener: Whitener) -> Fit:
    """Return the fit with another whitener, its values unchanged."""
    linear = linear_projection(fit.linear, whitener)
    return evaluated(dataclasses.replace(fit, whitener=whitener), fit.values, fit.shown, fit.slopes, linear)


def set_aside(fit: Fit) -> Callable[[], Fit]:
    """Return what makes a fit again, as it is, by one simulation: until then none of its long arrays is held."""
    nothing = np.broadcast_to(0.0, fit.shown.shape)
    whitener = fit.whitener if fit.whitener.noise.grows else dataclasses.replace(fit.whitener, level=nothing)
    bare = dataclasses.replace(fit, whitener=whitener, shown=nothing, z=nothing, slopes=fit.slopes.of(nothing))

    def again() -> Fit:
        shown = bare.simulator.shown(bare.values[None, :])[0]
        return refreshed(dataclasses.replace(bare, shown=shown, slopes=bare.slopes.of(shown)), bare.whitener)

    return again


def cost_of(fit: Fit, shown: FloatArray, linear: Projection) -> float:
    """Return z'z at what is shown, (rows, q), of which nothing failed; `linear`: as of `evaluated`, at its best."""
    own = whitened_misfit(fit, shown)
    if isinstance(own, Scaled) and not linear.columns.shape[1]:
        return float(own.squares()[0])
    r = linear.rest(own[:][:, 0])
    return float(r @ r)


def whitened_misfit(fit: Fit, shown: FloatArray) -> Columns:
    """Return measured less shown signals whitened, (rows q, 1)."""
    return fit.whitener.changes(fit.simulator.measured[None], shown)


def misfit(fit: Fit, shown: FloatArray) -> FloatArray:
    """Return measured less shown signals, (rows, q); 0 where a sample is missing."""
    off = fit.simulator.measured - shown
    if not fit.whitener.present.all():
        off[~fit.whitener.present] = 0.0
    return np.asarray(off)


def linear_columns(linear: Sequence[Linear], shape: tuple[int, ...]) -> FloatArray:
    """Return the columns of all, (rows, q, m); `shape` is that of what is shown."""
    return np.concatenate([np.zeros((*shape, 0)), *(g.columns for g in linear)], axis=2)


def linear_projection(linear: Sequence[Linear], whitener: Whitener) -> Projection:
    """Return the projection on the columns of all, whitened, (rows q, m)."""
    shape = whitener.present.shape
    return Projection(whitener.flat(linear_columns(linear, shape)) if linear else np.zeros((shape[0] * shape[1], 0)))
