"""The noise of a fit's residuals: its size, its colour, its covariance between channels. Knows arrays, no FMU.

Residuals of channel j at row k are r = g z: g grows with the signal if the data show it (noise of
commutation and contacts), and

    z = white + slow(tau) + differenced + H torque

is a sum of a white part, an exponentially correlated one (Ornstein-Uhlenbeck), the difference of white errors (an
encoder's counts, differenced) and the response of the machine to a torque that wanders, which colours current and speed
together. Such sums are linear state spaces, so that whitening and likelihood are exact at O(rows), with gaps and any
clock (kalman.py). Remaining correlation over few samples, such as a sensor's filter makes, is removed by a short
autoregression. The parameters of the model have the largest restricted likelihood (Patterson and Thompson 1971) over
the settled rows. Restricted: it allows for the degrees of freedom of the fitted parameters. Settled rows: a misfit of a
transient is not taken for noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, SECOND_DIFFERENCE, T_FREEDOM, T_MEDIAN
from estimator.fitting.kalman import shorten, whiten
from estimator.fitting.quasi_newton import minimise
from estimator.motor.exponential import exponential
from estimator.plans.part import LONG
from estimator.recordings.samples import median, medians

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

ROWS = 4000  # settled rows that the noise is estimated from, at most
SETTLED_SAMPLES = 100  # settled samples of a channel; with fewer all rows are used
BLOCK_LENGTHS = (2, 8, 32, 128, 512)  # samples whose means show slow correlation
COLOURED = 5.0  # standard deviations of a block's mean square: of white noise less than once in 1e5
LEAST_FALL = 10.0  # of -2 log L, by which a component must lower it: two numbers, and a margin
AR_ORDERS = (1, 2, 3, 4, 6, 8, 12, 16, 24)  # of the short autoregression
LOUD_SAMPLES = 25  # samples of a large signal, and as many below half of it: fewer do not show a growth
STRETCH, MOST_STRETCHES = 20, 12  # rows of a stretch that has a level of its own; stretches, at most
SHORTEST_TORQUE = 0.02  # s, correlation time of a wandering torque: shorter ones are misfits of transients
LONGEST_SLOW = 0.25  # of the longest recording: a longer correlation time is a drift, no noise
STEEP = 12  # samples, where the signals are steep, that tell a jitter
NEIGHBOURS_ALIKE = 3.0  # standard deviations of their correlation: more is a misfit, no jitter
CAPPED = 25.0  # square of a residual: a larger one counts as this
TOGETHER = 1_000_000  # numbers that factors are tried on at once
MEMORY = 1000  # rows over which a noise with a state remembers, in a long recording
NOISE_FACTORS = np.geomspace(0.35, 1.2, 16)  # tried factors on a noise that was estimated with a jitter in it
RESTS, STARTS, RUNS = range(3)
LEAST_WHITE = 1e-9  # of the residuals' variance: the least white part


@dataclass(frozen=True)
class Clock:
    """The times, s, of one recording's rows, and its place among the rows of all."""

    time: FloatArray
    rows: slice

    @cached_property
    def step(self) -> float:
        """The usual sampling interval, s."""
        return median(np.diff(self.time)) if len(self.time) > 1 else 1.0

    @cached_property
    def steps(self) -> tuple[FloatArray, NDArray[np.int64] | None]:
        """The different steps, s, and which leads to each row; None: all are alike."""
        dt = np.diff(self.time)
        if not len(dt) or np.ptp(dt) < 1e-3 * self.step:
            return np.array([self.step]), None
        ticks = np.round(dt / (0.02 * self.step)) * (0.02 * self.step)  # to 2 % of a step
        steps, index = np.unique(np.maximum(ticks, 0.02 * self.step), return_inverse=True)
        return steps, np.concatenate([[0], index]).astype(np.int64)


@dataclass(frozen=True)
class NoiseModel:
    """The noise of q channels.

    Attributes
    ----------
    white, differenced : (q,) arrays
        Deviations at rest, in the channels' units.
    growth : (q, 2) array
        c and p of g = (1 + (c |y| / max |y|)^p)^(1/p): 2 adds powers, 8 hardly grows before c |y| / max |y| = 1.
    slow : (q, 2) array
        Deviation and correlation time, s, of the slow part; 0: none.
    torque : deviation and correlation time, s, of the torque; in the unit of `machine`'s input; 0: none
    machine : (2, 2) and (2,) arrays, or None
        A and b of d[i, w]/dt = A [i, w] + b torque.
    seat : (q,) array
        Which state of the machine a channel shows: 0 current, 1 speed, -1 none.
    jitter : float
        Deviation of the instants at which the samples were taken, s: noise in proportion to the slope.
    short : of the machine at rest and running, of each channel: coefficients of the short autoregression,
        and its innovation's deviation
    """

    white: FloatArray
    differenced: FloatArray
    growth: FloatArray
    slow: FloatArray
    torque: tuple[float, float] = (0.0, 1.0)
    machine: tuple[FloatArray, FloatArray] | None = None
    seat: tuple[int, ...] = ()
    jitter: float = 0.0
    short: tuple[tuple[tuple[FloatArray, float], ...], ...] = ()

    @classmethod
    def plain(cls, white: FloatArray, seat: Sequence[int]) -> NoiseModel:
        """Return white noise of these deviations, (q,)."""
        q = len(white)
        none = np.column_stack([np.zeros(q), np.full(q, 2.0)])
        return cls(white, np.zeros(q), none, np.column_stack([np.zeros(q), np.ones(q)]), seat=tuple(seat))

    @property
    def has_state(self) -> bool:
        """Whether a sample's noise depends on all before it."""
        return bool(self.slow[:, 0].any() or self.differenced.any() or self.torque[0] > 0)

    def scale(self, level: FloatArray) -> FloatArray:
        """Return g, (rows, q), at signals over their largest, (rows, q)."""
        c, p = self.growth.T
        return np.asarray((1 + (c * level) ** p) ** (1 / p)) if c.any() else np.ones_like(level)

    def deviation(self, level: FloatArray) -> FloatArray:
        """Return the deviation of each sample, (rows, q), all parts together."""
        power = self.white**2 + 2 * self.differenced**2 + self.slow[:, 0] ** 2
        if self.torque[0] > 0 and self.machine is not None:
            gain = np.abs(np.linalg.solve(self.machine[0], self.machine[1]))
            power = power + np.array([(gain[s] * self.torque[0]) ** 2 if s >= 0 else 0.0 for s in self.seat])
        return np.asarray(self.scale(level) * np.sqrt(power))

    def states(self, dt: float, running: FloatArray, phase: int = RUNS) -> dict[str, FloatArray]:
        """Return the state space at a step in s: transition (d, d), process (d, d), start (d, d), readout (q, d).

        Parameters
        ----------
        running : (q,) array
            g while the machine runs.
        phase : RESTS, STARTS or RUNS
            A machine at rest has no wandering torque.
        """
        q = len(self.white)
        blocks: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        for j in range(q):
            unit = np.eye(q)[:, j : j + 1]
            if self.slow[j, 0] > 0:
                f = np.exp(-dt / self.slow[j, 1])
                v = self.slow[j, 0] ** 2
                blocks.append((np.array([[f]]), np.array([[v * (1 - f * f)]]), np.array([[v]]), unit))
            if self.differenced[j] > 0:
                v = self.differenced[j] ** 2
                shift = np.array([[0.0, 0.0], [1.0, 0.0]])
                blocks.append((shift, np.diag([v, 0.0]), np.diag([v, v]), np.hstack([unit, -unit])))
        if self.torque[0] > 0 and self.machine is not None:
            blocks.append(self._machine_block(dt, running, phase))
        d = sum(len(b[0]) for b in blocks)
        result = {name: np.zeros((d, d)) for name in ("transition", "process", "initial")}
        result["readout"] = np.zeros((q, d))
        at = 0
        for f, noise, start, readout in blocks:
            part = slice(at, at + len(f))
            result["transition"][part, part], result["process"][part, part] = f, noise
            result["initial"][part, part], result["readout"][:, part] = start, readout
            at += len(f)
        return result

    def _machine_block(
        self, dt: float, running: FloatArray, phase: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return transition and process covariance of the machine with the wandering torque held over a step."""
        assert self.machine is not None
        a, b = self.machine
        f = np.exp(-dt / self.torque[1])
        transition = held(a.tobytes(), b.tobytes(), dt).copy()
        transition[2, 2] = f
        v = self.torque[0] ** 2
        process = np.diag([0.0, 0.0, {RESTS: 0.0, STARTS: v, RUNS: v * (1 - f * f)}[phase]])
        start, step = process.copy(), transition.copy()
        for _ in range(60 if phase == RUNS else 0):  # P = F P F' + Q by doubling
            more = step @ start @ step.T
            start = start + more
            if np.trace(more) <= 1e-12 * np.trace(start):
                break
            step = step @ step
        readout = np.zeros((len(self.white), 3))
        for j, seat in enumerate(self.seat):
            if seat >= 0:
                readout[j, seat] = 1 / running[j]
        return transition, process, start, readout


@dataclass(frozen=True)
class Whitener:
    """Whitens columns by a noise model, over all recordings.

    Attributes
    ----------
    present : (rows, q) array
        Which samples are there.
    level : (rows, q) array
        The signals over their largest.
    inflate : (rows, q) array
        Factor on the white variance of single samples: outliers.
    moving : (rows,) array
        Whether the machine runs.
    slope : (rows, q) array
        Of the signals, in their units a second.
    """

    noise: NoiseModel
    clocks: tuple[Clock, ...]
    present: BoolArray
    level: FloatArray
    inflate: FloatArray
    moving: BoolArray
    slope: FloatArray

    def __call__(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """Return (rows, q, c) columns whitened, zero where a sample is missing, and the sum of log variances."""
        g, variance, spaces = self._state_spaces
        scaled = columns / g[:, :, None] if self._grows else columns
        parts = []
        total = self._log_size
        for clock, (steps, arrays) in zip(self.clocks, spaces, strict=True):
            part = clock.rows
            white, log = whiten(scaled[part], variance[part], steps=steps, **arrays)
            total += log
            if self.noise.short:
                shorten(white, self.present[part], self.moving[part], self.noise.short)
            parts.append(white)
        result = parts[0] if len(parts) == 1 else np.concatenate(parts)
        alike = all(s == 1.0 for short in self.noise.short for _, s in short)  # their logarithms are 0
        for short, counts in () if alike else zip(self.noise.short, self._counts, strict=False):
            total += float(sum(2 * n * np.log(s) for n, (_, s) in zip(counts, short, strict=True)))
        return result, total

    def of_rows(self, columns: FloatArray, rows: slice) -> tuple[slice, FloatArray]:
        """Return columns, (n, q, c), whitened that are zero beside the given rows of one recording, as (m, c).

        Noise without a state leaves them zero beyond some rows: these alone, the slice, are whitened. In a long
        recording noise with a state is taken to forget within MEMORY rows.
        """
        last = len(self.present)
        first, end = rows.start or 0, last if rows.stop is None else rows.stop
        clock = next((c for c in self.clocks if c.rows.start <= first and end <= c.rows.stop), None)
        if clock is None or (self.noise.has_state and last <= LONG):
            whole = np.zeros((last, *columns.shape[1:]))
            whole[rows] = columns
            return slice(0, last), self(whole)[0].reshape(-1, columns.shape[2])
        before, behind = (MEMORY, MEMORY) if self.noise.has_state else (0, max(AR_ORDERS))
        wide = slice(max(clock.rows.start, first - before), min(clock.rows.stop, end + behind))
        padded = np.zeros((wide.stop - wide.start, *columns.shape[1:]))
        padded[first - wide.start : end - wide.start] = columns
        return wide, self._part(padded, wide, clock).reshape(-1, columns.shape[2])

    def _part(self, columns: FloatArray, rows: slice, clock: Clock) -> FloatArray:
        """Return columns, (n, q, c), of n rows of a clock, whitened as if the noise had its usual state before."""
        g, variance, spaces = self._state_spaces
        steps, arrays = next(space for own, space in zip(self.clocks, spaces, strict=True) if own is clock)
        own = None if steps is None else steps[rows.start - clock.rows.start : rows.stop - clock.rows.start]
        scaled = columns / g[rows][:, :, None] if self._grows else columns
        white, _ = whiten(scaled, variance[rows], steps=own, **arrays)
        if self.noise.short:
            shorten(white, self.present[rows], self.moving[rows], self.noise.short)
        return white

    @cached_property
    def _log_size(self) -> float:
        """The sum of log g^2 of all samples."""
        return float(2 * np.sum(np.log(self._state_spaces[0])[self.present])) if self._grows else 0.0

    @property
    def _grows(self) -> bool:
        """Whether the noise grows with the signals, anywhere: else g is 1."""
        return bool(self.noise.growth[:, 0].any())

    @cached_property
    def _counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Samples of each channel while the machine rests, and while it runs."""
        return self.present[~self.moving].sum(axis=0), self.present[self.moving].sum(axis=0)

    @cached_property
    def _state_spaces(
        self,
    ) -> tuple[FloatArray, FloatArray, list[tuple[NDArray[np.int64] | None, dict[str, FloatArray]]]]:
        """The scale and white variance of each sample, (rows, q); of each clock the step to each row, and `states`."""
        noise = self.noise
        g, running = noise.scale(self.level), np.ones(len(noise.white))
        if self._grows:
            running = np.array([median(x[p]) if p.any() else 1.0 for x, p in zip(g.T, self.present.T, strict=True)])
        power = noise.white**2 + noise.differenced**2 + noise.slow[:, 0] ** 2
        floor = np.maximum(LEAST_WHITE * power, 1e-300)
        white = np.maximum(noise.white**2, floor) * self.inflate
        if noise.jitter:
            white += (noise.jitter * self.slope / g) ** 2
        variance = np.where(self.present, white, np.inf)
        found = []
        for clock in self.clocks:
            steps, index = clock.steps
            phases: tuple[int, ...] = (RUNS,)
            moving = self.moving[clock.rows]
            if noise.torque[0] > 0 and not moving.all():
                phase = np.where(moving, np.where(np.concatenate([[True], moving[:-1]]), RUNS, STARTS), RESTS)
                index = (np.zeros(len(moving), dtype=np.int64) if index is None else index) * 3 + phase
                phases = (RESTS, STARTS, RUNS)
            spaces = [noise.states(dt, running, phase) for dt in steps for phase in phases]
            arrays = {name: np.array([s[name] for s in spaces]) for name in ("transition", "process")}
            arrays["initial"] = spaces[0 if index is None else int(index[0])]["initial"]
            found.append((index, {**arrays, "readout": spaces[0]["readout"]}))
        return g, variance, found

    def of(self, noise: NoiseModel) -> Whitener:
        """Return the whitener of another noise model."""
        return dataclasses.replace(self, noise=noise)


@lru_cache(maxsize=256)
def held(a: bytes, b: bytes, dt: float) -> FloatArray:
    """Return exp([[A, b], [0, 0]] dt), (3, 3): state and held input of a machine over a step."""
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = np.frombuffer(a).reshape(2, 2), np.frombuffer(b)
    return exponential(whole * dt)


def fit_noise(
    whitener: Whitener,
    residuals: FloatArray,
    columns: FloatArray,
    settled: BoolArray,
    sharp: BoolArray,
    *,
    resolution: FloatArray | None = None,
    colour: bool = True,
    again: bool = False,
) -> NoiseModel:
    """Return the noise model of the largest restricted likelihood.

    Parameters
    ----------
    whitener : Whitener
        Of an initial noise model; its machine is used.
    residuals : (rows, q) array
    columns : (rows, q, c) array
        Their derivatives by what is free.
    settled : (rows,) array
        Rows that the noise is estimated from.
    sharp : (rows,) array
        First parts of transients, where a misfit is most likely.
    resolution : (q,) array, optional
        Step of a sensor that is too coarse for its errors to be noise: they are up to half of it. 0: it is fine.
    colour : bool
        Look for slow parts, for a wandering torque, and for correlation over few samples.
    again : bool
        Keep the components of the whitener's noise, and estimate their parameters again.
    """
    present = whitener.present & settled[:, None]
    for j in range(present.shape[1]):
        if present[:, j].sum() < min(SETTLED_SAMPLES, whitener.present[:, j].sum()):
            present[:, j] = whitener.present[:, j]
    told = np.flatnonzero(present.any(axis=1))
    if len(told) > ROWS:  # of every recording its part
        keep = np.zeros(len(present), dtype=bool)
        for clock in whitener.clocks:
            inside = told[(told >= clock.rows.start) & (told < clock.rows.stop)]
            keep[inside[-max(1, ROWS * len(inside) // len(told)) :]] = True
        present &= keep[:, None]
    used = np.flatnonzero(present.any(axis=1))
    cut, clocks, at = [], [], 0
    for clock in whitener.clocks:
        inside = used[(used >= clock.rows.start) & (used < clock.rows.stop)]
        if len(inside):
            part = np.arange(inside[0], inside[-1] + 1)
            cut.append(part)
            clocks.append(Clock(clock.time[part - clock.rows.start], slice(at, at + len(part))))
            at += len(part)
    rows = np.concatenate(cut)
    narrowed = Whitener(
        whitener.noise, tuple(clocks), present[rows], whitener.level[rows], whitener.inflate[rows],
        whitener.moving[rows], whitener.slope[rows],
    )  # fmt: skip
    levels = _levels(narrowed)
    stacked = np.concatenate([residuals[rows, :, None], columns[rows], levels], axis=2)
    stacked = np.where(narrowed.present[:, :, None], stacked, 0.0)
    growth = np.array([_growth(residuals[:, j], whitener, j, sharp)[:2] for j in range(residuals.shape[1])])
    resolution = np.zeros(len(growth)) if resolution is None else resolution
    growth[resolution > 0] = 0.0, 2.0
    search = _Search(narrowed, stacked, colour=colour, growth=growth)
    found = search.again() if again else search.best()
    return dataclasses.replace(found, white=np.maximum(found.white, resolution / np.sqrt(12)))


def find_jitter(z: FloatArray, slope: FloatArray, step: float) -> tuple[float, FloatArray, float]:
    """Return the deviation of the samples' instants, s, factors on the rest of the noise, and the fall of -2 log L.

    A jitter makes residuals larger where the signals are steep, and leaves them independent: correlated neighbours are
    a misfit. 0 s where the instants are known.

    Parameters
    ----------
    z : (rows, q) array
        Whitened residuals without any jitter.
    slope : (rows, q) array
        Of the signals, in deviations of their noise a second; 0 where a sample is missing.
    step : float
        The sampling interval, s.
    """
    tried = step * np.geomspace(3e-3, 0.5, 24)
    squares = z * z
    # Rows whose slope is too small to change a sum of doubles cost the same at every jitter.
    steep_rows = np.any((tried[-1] * slope) ** 2 > 1e-17 * NOISE_FACTORS[0] ** 2, axis=1)
    flat = squares[~steep_rows]
    level = np.array(
        [len(flat) * np.log(f**2) + np.sum(np.minimum(flat / f**2, CAPPED), axis=0) for f in NOISE_FACTORS]
    )
    moved, hit = slope[steep_rows], squares[steep_rows]
    many = max(1, TOGETHER // max(hit.size, 1))

    def misfits(jitter: float) -> FloatArray:
        steep, costs = (jitter * moved) ** 2, []
        for factors in (NOISE_FACTORS[k : k + many] for k in range(0, len(NOISE_FACTORS), many)):
            variance = factors[:, None, None] ** 2 + steep
            costs.append(np.sum(np.log(variance) + np.minimum(hit / variance, CAPPED), axis=1))
        return np.asarray(np.concatenate(costs) + level)  # (sizes, q)

    costs = [misfits(t) for t in tried]
    k = int(np.argmin([c.min(axis=0).sum() for c in costs]))
    best, sizes = float(tried[k]), NOISE_FACTORS[costs[k].argmin(axis=0)]
    gain = float(misfits(0.0).min(axis=0).sum() - costs[k].min(axis=0).sum())
    steep = best * slope > sizes
    both = steep[1:] & steep[:-1]
    scaled = np.clip(z / np.sqrt(sizes**2 + (best * slope) ** 2), -3, 3)
    alike = float(np.sum((scaled[1:] * scaled[:-1])[both])) / float(np.sqrt(max(1, int(np.sum(both)))))
    if np.count_nonzero(steep) < STEEP or gain < 2 * LEAST_FALL or abs(alike) > NEIGHBOURS_ALIKE:
        return 0.0, np.ones(z.shape[1]), 0.0
    return best, np.where(steep.any(axis=0), sizes, 1.0), gain


def noise_of_neighbours(whitener: Whitener, residuals: FloatArray, sharp: BoolArray) -> NoiseModel:
    """Return the white noise that samples beside each other show, and its growth; arguments as for `fit_noise`."""
    told = [_growth(residuals[:, j], whitener, j, sharp) for j in range(residuals.shape[1])]
    white = [w if w > 0 else old for (_, _, w), old in zip(told, whitener.noise.white, strict=True)]
    return dataclasses.replace(whitener.noise, white=np.array(white), growth=np.array([(c, p) for c, p, _ in told]))


def _growth(residuals: FloatArray, whitener: Whitener, j: int, sharp: BoolArray) -> tuple[float, float, float]:
    """Return how a channel's noise grows with its signal, c and p of `NoiseModel.growth`, from second differences.

    The third number is the deviation at rest of white noise of such differences; 0: too few samples.

    Second differences contain the noise and hardly any misfit, so that transients can be used, but for their first
    part. Their size is estimated by Student's t, on which outliers have little influence.

    Parameters
    ----------
    sharp : (rows,) array
        First parts of transients.
    """
    sizes, levels = [], []
    for clock in whitener.clocks:
        x, known = residuals[clock.rows], whitener.present[clock.rows, j] & ~sharp[clock.rows]
        if len(x) < 3:
            continue
        told = known[2:] & known[1:-1] & known[:-2]
        sizes.append((x[2:] - 2 * x[1:-1] + x[:-2])[told])
        levels.append(whitener.level[clock.rows, j][1:-1][told])
    d, level = np.concatenate([*sizes, np.zeros(0)]), np.concatenate([*levels, np.zeros(0)])
    if len(d) > 4 * ROWS:
        d, level = d[:: len(d) // (2 * ROWS)], level[:: len(d) // (2 * ROWS)]
    if len(level) < 2 * LOUD_SAMPLES or not np.any(d):
        return 0.0, 2.0, 0.0
    floor = 1e-3 * median(np.abs(d[d != 0]))

    sizes = np.abs(d)

    def size(g: FloatArray) -> float:
        return max(median(sizes / g) / T_MEDIAN, floor)

    loud = float(np.sort(level)[-LOUD_SAMPLES])
    if np.count_nonzero(level < loud / 2) < LOUD_SAMPLES:
        return 0.0, 2.0, size(np.ones_like(level)) * T_MEDIAN / MEDIAN_SIZE / SECOND_DIFFERENCE

    def misfits(c: FloatArray, p: float) -> FloatArray:
        together, found = max(1, TOGETHER // len(d)), []
        for some in (c[k : k + together] for k in range(0, len(c), together)):
            g = grown(some[:, None] * level, p)
            ratio = sizes / g
            unit = np.maximum(medians(ratio) / T_MEDIAN, floor)
            far = np.log1p(ratio * ratio / (T_FREEDOM * unit**2)[:, None])
            logs = np.sum(np.log(g), axis=1) + len(d) * np.log(unit)
            found.append(2 * logs + (T_FREEDOM + 1) * np.sum(far, axis=1))
        return np.concatenate(found)

    found = []
    for p, charge in (
        (2.0, 2 * LEAST_FALL),
        (8.0, 4 * LEAST_FALL),
    ):  # twice: the squares of neighbours correlate by 0.44
        coarse = np.geomspace(0.3, 300.0, 16) / loud
        fine = coarse[np.argmin(misfits(coarse, p))] * np.geomspace(0.7, 1.43, 9)
        reached = misfits(fine, p)
        found.append((float(np.min(reached)) + charge, float(fine[np.argmin(reached)]), p))
    best = min(found)
    c, p = (best[1], best[2]) if best[0] < misfits(np.zeros(1), 2.0)[0] else (0.0, 2.0)
    return c, p, size(grown(c * level, p)) * T_MEDIAN / MEDIAN_SIZE / SECOND_DIFFERENCE


def grown(x: FloatArray, p: float) -> FloatArray:
    """Return (1 + x^p)^(1/p) of numbers from 0; for 2 and 8 by products and roots, which are quicker."""
    if p == 2:
        return np.asarray(np.sqrt(1 + x * x))
    if p == 8:
        x = x * x
        x = x * x
        return np.asarray(np.sqrt(np.sqrt(np.sqrt(1 + x * x))))
    return np.asarray((1 + x**p) ** (1 / p))


def _levels(whitener: Whitener) -> FloatArray:
    """Return a constant for each channel and stretch, (rows, q, c): a misfit of a level is not taken for noise."""
    told = np.asarray(whitener.present.any(axis=1))
    breaks = set((np.flatnonzero(told[1:] != told[:-1]) + 1).tolist())
    starts = sorted({0, *breaks, *(c.rows.start for c in whitener.clocks)})
    q = whitener.present.shape[1]
    columns: list[FloatArray] = []
    for first, last in zip(starts, [*starts[1:], len(told)], strict=True):
        for j in range(q):
            if told[first] and last - first >= STRETCH and len(columns) < MOST_STRETCHES:
                column = np.zeros((len(told), q))
                column[first:last, j] = 1.0
                columns.append(column)
    return np.stack(columns, axis=2) if columns else np.zeros((len(told), q, 0))


class _Search:
    """The restricted likelihood of noise models, and the components that lower it enough."""

    def __init__(self, whitener: Whitener, stacked: FloatArray, *, colour: bool, growth: FloatArray) -> None:
        self.whitener, self.stacked = whitener, stacked
        self.first = dataclasses.replace(whitener.noise, short=())
        self.q = stacked.shape[1]
        self.colour, self.growth = colour, growth
        self.machine = self.first.machine is not None and any(s >= 0 for s in self.first.seat)
        self._of_unit_noise: dict[bytes, tuple[FloatArray, float]] = {}  # by growth: products of each channel, logs
        norms = np.linalg.norm(stacked[:, :, 1:].reshape(-1, stacked.shape[2] - 1), axis=0)
        self.stacked[:, :, 1:] /= np.where(norms > 0, norms, 1.0)

    def misfit(self, noise: NoiseModel) -> float:
        """Return -2 log restricted likelihood, up to a constant."""
        products, total = self._products(noise)
        value = total + float(products[0, 0])
        if len(products) > 1:
            information, along = products[1:, 1:], products[1:, 0]
            scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
            eigen, vectors = np.linalg.eigh(information / np.outer(scale, scale))
            seen = eigen > 1e-9
            along = (vectors.T @ (along / scale))[seen]
            value += float(-np.sum(along**2 / eigen[seen]) + np.sum(np.log(eigen[seen])) + 2 * np.sum(np.log(scale)))
        return value if np.isfinite(value) else np.inf

    def _products(self, noise: NoiseModel) -> tuple[FloatArray, float]:
        """Return the scalar products of the whitened columns, and the sum of log variances."""
        if noise.has_state or noise.jitter:
            whitened, total = self.whitener.of(noise)(self.stacked)
            flat = whitened.reshape(-1, whitened.shape[2])
            return flat.T @ flat, total
        key = noise.growth.tobytes()
        if key not in self._of_unit_noise:
            unit = self.whitener.of(dataclasses.replace(noise, white=np.ones(self.q)))
            whitened, total = unit(self.stacked)
            self._of_unit_noise[key] = np.array([own.T @ own for own in whitened.transpose(1, 0, 2)]), total
        own, total = self._of_unit_noise[key]
        variance = np.maximum(noise.white**2, 1e-300)
        counts = self.whitener.present.sum(axis=0)
        return np.asarray((own / variance[:, None, None]).sum(axis=0)), total + float(counts @ np.log(variance))

    def again(self) -> NoiseModel:
        """Estimate the parameters of the present components again."""
        noise = dataclasses.replace(self.first, growth=self.growth)
        active = [("differenced" if noise.differenced[j] > 0 else "white", j) for j in range(self.q)]
        active += [("slow", j) for j in range(self.q) if noise.slow[j, 0] > 0]
        active += [("torque", 0)] if noise.torque[0] > 0 else []
        return self._with_short(self._optimised(noise, active, iterations=6)[0])

    def best(self) -> NoiseModel:
        """Add components as long as -2 log L falls enough, then the short autoregression."""
        known = [self.stacked[:, j, 0][self.whitener.present[:, j]] for j in range(self.q)]
        spread = np.array([max(float(np.sqrt(np.mean(x * x))), 1e-300) if len(x) else 1.0 for x in known])
        differenced = self.first.differenced > 0
        noise = dataclasses.replace(
            self.first,
            white=np.where(differenced, 1e-3, 1.0) * spread,
            differenced=np.where(differenced, spread / np.sqrt(2), 0.0),
            growth=np.column_stack([np.zeros(self.q), np.full(self.q, 2.0)]),
            slow=np.column_stack([np.zeros(self.q), np.ones(self.q)]),
            torque=(0.0, 1.0),
        )
        active = [("differenced" if differenced[j] else "white", j) for j in range(self.q)]
        noise, value = self._optimised(noise, active)
        if np.any(self.growth[:, 0] > 0):
            noise, value = self._optimised(dataclasses.replace(noise, growth=self.growth), active)
        for _ in range(3 if self.colour else 0):
            options = self._slow_options(noise, active)
            begun = [(*self._optimised(start, [c], iterations=5), c) for start, c in options]
            best = min(begun, key=lambda r: r[1], default=None)
            if best is None or best[1] > value:
                break
            more = [*active, best[2]]
            found, reached = self._optimised(best[0], more)
            if reached > value - LEAST_FALL:
                break
            noise, value, active = found, reached, more
        return self._with_short(noise)

    def _slow_options(
        self, noise: NoiseModel, active: Sequence[tuple[str, int]]
    ) -> list[tuple[NoiseModel, tuple[str, int]]]:
        """Return starts with one more slow component, where the whitened residuals are not white."""
        whitened, _ = self.whitener.of(noise)(self.stacked[:, :, :1])
        options = []
        for j in range(self.q):
            size = _colour_scale(whitened[:, j, 0], self.whitener.present[:, j], self.whitener.clocks)
            if size is None:
                continue
            block, share = size
            tau = 0.5 * block * self.whitener.clocks[0].step
            deviation = np.sqrt(noise.white[j] ** 2 + noise.differenced[j] ** 2)
            if ("slow", j) not in active:
                slow = noise.slow.copy()
                slow[j] = np.sqrt(share) * deviation, tau
                options.append((dataclasses.replace(noise, slow=slow), ("slow", j)))
            if self.machine and ("torque", 0) not in active and noise.seat[j] >= 0 and noise.machine is not None:
                gain = abs(float(np.linalg.solve(*noise.machine)[noise.seat[j]]))
                torque = (np.sqrt(share) * deviation / gain, max(tau, 10 * self.whitener.clocks[0].step))
                options.append((dataclasses.replace(noise, torque=torque), ("torque", 0)))
        return options

    def _optimised(
        self, noise: NoiseModel, active: Sequence[tuple[str, int]], *, iterations: int = 12
    ) -> tuple[NoiseModel, float]:
        """Return the noise model with its active components' numbers at the largest likelihood, and its misfit."""
        x0 = np.array([x for c in active for x in _get(noise, c)])
        low, high = x0 - 7.0, x0 + 7.0
        longest = np.log(LONGEST_SLOW * max(float(c.time[-1] - c.time[0]) for c in self.whitener.clocks))
        taus = np.concatenate([[False, True] if kind in ("slow", "torque") else [False] for kind, _ in active])
        wanders = taus & np.concatenate([[k == "torque"] * (2 if k in ("slow", "torque") else 1) for k, _ in active])
        low[wanders] = np.maximum(low[wanders], np.log(SHORTEST_TORQUE))
        high[taus] = np.maximum(np.minimum(high[taus], longest), low[taus] + 0.1)
        high = np.maximum(high, low + 0.1)
        x0 = np.clip(x0, low, high)

        def value(x: FloatArray) -> float:
            return self.misfit(_set(noise, active, x))

        x, found = minimise(value, x0, low, high, step=1e-3, iterations=iterations, ftol=1e-6)
        return _set(noise, active, x), found

    def _with_short(self, noise: NoiseModel) -> NoiseModel:
        """Return the noise with the remaining correlation over few samples."""
        if not self.colour:
            return noise
        whitened, _ = self.whitener.of(noise)(self.stacked)
        flat = whitened.reshape(-1, whitened.shape[2])
        beta = np.linalg.lstsq(flat[:, 1:], flat[:, 0], rcond=1e-9)[0] if flat.shape[1] > 1 else np.zeros(0)
        left = whitened[:, :, 0] - whitened[:, :, 1:] @ beta
        moving = self.whitener.moving
        running = self._short(left, moving)
        counts = self.whitener.present[~moving].sum(axis=0)
        resting = self._short(left, ~moving)
        at_rest = tuple(a if n >= SETTLED_SAMPLES else b for n, a, b in zip(counts, resting, running, strict=True))
        return dataclasses.replace(noise, short=(at_rest, running))

    def _short(self, left: FloatArray, where: BoolArray) -> tuple[tuple[FloatArray, float], ...]:
        """Return the short autoregression of each channel, from these rows."""
        result = []
        for j in range(self.q):
            present = self.whitener.present[:, j] & where
            series = [np.where(present[c.rows], left[c.rows, j], 0.0) for c in self.whitener.clocks]
            n = int(present.sum())
            coefficients, deviation = autoregression(series, n)
            if not len(coefficients) and abs(deviation**2 - 1) < COLOURED * np.sqrt(2 / max(n, 1)):
                deviation = 1.0  # the size of the largest likelihood allows for the fitted columns
            result.append((coefficients, deviation))
        return tuple(result)


def autoregression(series: Sequence[FloatArray], count: int) -> tuple[FloatArray, float]:
    """Return coefficients and innovation deviation of `count` samples, zeros between, by Burg's method (1975) and BIC.

    It resolves a spectrum over many decades, as of filtered noise, where the Yule-Walker equations are biased.
    """
    most = max(AR_ORDERS)
    power = sum(float(x @ x) for x in series) / max(count, 1)
    if count < 10 * most or power <= 0:
        return np.zeros(0), float(np.sqrt(power)) if power > 0 else 1.0
    best: tuple[float, FloatArray, float] = (0.0, np.zeros(0), power)
    a, error = np.zeros(0), power
    ahead, behind = list(series), list(series)
    for order in range(1, most + 1):
        pairs = [(f[1:], b[:-1]) for f, b in zip(ahead, behind, strict=True) if len(f) > 1]
        size = sum(float(f @ f + b @ b) for f, b in pairs)
        reflection = 2 * sum(float(f @ b) for f, b in pairs) / size if size > 0 else 0.0
        if not 0 < abs(reflection) < 1:
            break
        ahead, behind = [f - reflection * b for f, b in pairs], [b - reflection * f for f, b in pairs]
        a = np.concatenate([a - reflection * a[::-1], [reflection]])
        error *= 1 - reflection**2
        score = count * np.log(error / power) + order * np.log(count)
        if order in AR_ORDERS and score < best[0] - LEAST_FALL:
            best = (float(score), a.copy(), error)
    return best[1], float(np.sqrt(best[2]))


def _colour_scale(z: FloatArray, present: BoolArray, clocks: Sequence[Clock]) -> tuple[int, float] | None:
    """Return the block, in samples, whose means are most too large, and their share of the variance; None if none."""
    best, found = COLOURED, None
    power = float(np.mean(z[present] ** 2)) if present.any() else 0.0
    for block in BLOCK_LENGTHS:
        means = []
        for clock in clocks:
            x, p = z[clock.rows], present[clock.rows]
            n = len(x) // block
            counts = p[: n * block].reshape(n, block).sum(axis=1)
            sums = np.where(p, x, 0.0)[: n * block].reshape(n, block).sum(axis=1)
            means.append((sums / np.sqrt(np.maximum(counts, 1)))[counts > block // 2])
        squares = np.concatenate(means) ** 2
        if len(squares) < 4 or power == 0:
            continue
        ratio = float(np.mean(squares)) / power
        excess = (ratio - 1) * np.sqrt(len(squares) / 2)
        if excess > best:
            best, found = excess, (block, min((ratio - 1) / block, 1.0))
    return found


def _with(values: FloatArray, j: int, value: float) -> FloatArray:
    changed = values.copy()
    changed[j] = value
    return changed


def _get(noise: NoiseModel, component: tuple[str, int]) -> list[float]:
    kind, j = component
    if kind == "torque":
        return [float(np.log(noise.torque[0])), float(np.log(noise.torque[1]))]
    if kind == "slow":
        return np.log(noise.slow[j]).tolist()  # type: ignore[no-any-return]
    return [float(np.log(getattr(noise, kind)[j]))]


def _set(noise: NoiseModel, active: Sequence[tuple[str, int]], x: FloatArray) -> NoiseModel:
    values = iter(np.exp(x).tolist())
    changed = {name: getattr(noise, name).copy() for name in ("white", "differenced", "slow")}
    torque = noise.torque
    for kind, j in active:
        if kind == "torque":
            torque = (next(values), next(values))
        elif kind == "slow":
            changed["slow"][j] = next(values), next(values)
        else:
            changed[kind][j] = next(values)
    return dataclasses.replace(noise, **changed, torque=torque)
