"""Columns of all recordings whitened by a noise model, whole or some rows of them. Estimates nothing."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.noise.autoregression import ORDERS
from estimator.noise.clock import Clock
from estimator.noise.in_parts import Columns, Made, Scaled
from estimator.noise.kalman import Gains, gains, rows_behind, shorten
from estimator.noise.level import Level
from estimator.noise.noise_model import COASTS, RESTS, RUNS, STARTS, WAYS, NoiseModel
from estimator.plans.part import LONG
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MEMORY = 1000  # rows over which a noise with a state remembers, in a long recording
LEAST_WHITE = 1e-9  # of the residuals' variance: the least white part
ALL = slice(None)
BY_CHANCE = 2e-5  # of the samples: no more outliers come of white noise, three times as many as are expected


@dataclass(frozen=True)
class Whitener:
    """Whitens columns by a noise model, over all recordings.

    Attributes
    ----------
    present : (rows, q) array
        Which samples are there.
    level : (rows, q) array, or Level
        The signals over their largest.
    inflate : (rows, q) array
        Factor on the white variance of single samples: outliers.
    moving : (rows,) array
        Whether the machine runs.
    slope : (rows, q) array
        Of the signals, in their units a second, where the noise has a jitter.
    way : (rows,) array, optional
        The friction over its largest, in parts of WAYS, with the sign of the speed: friction that wanders is against
        it, and changes by a share of it. None: it is not known.
    opens : (rows,) array, optional
        Behind which rows the machine's circuit is open. None: it is not.
    shared : (rows, q, k) array, optional
        What errors that samples share, of variance 1 each, add to them beside their noise (shared_errors.py).
    each : (rows, q) array, optional
        The noise of each sample's recording over that of the noisiest. None: they are alike.
    """

    noise: NoiseModel
    clocks: tuple[Clock, ...]
    present: BoolArray
    level: FloatArray | Level
    inflate: FloatArray
    moving: BoolArray
    slope: FloatArray
    way: NDArray[np.int8] | None = None
    opens: BoolArray | None = None
    shared: FloatArray | None = None
    each: FloatArray | None = None

    def __call__(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """Return (rows, q, c) columns whitened, zero where a sample is missing, and the sum of log variances."""
        white, total = self._by_noise(columns)
        if self._shared is None:
            return white, total
        along, shortened, log = self._shared
        flat = white.reshape(len(along), -1)
        flat -= along @ (shortened @ (along.T @ flat))
        return white, total + log

    @cached_property
    def _shared(self) -> tuple[FloatArray, FloatArray, float] | None:
        """The shared errors whitened, F, and M with (I + F F')^-1/2 = I - F M F'; log det (I + F F')."""
        if self.shared is None:
            return None
        with np.errstate(over="ignore", invalid="ignore"):
            f = self._by_noise(self.shared)[0].reshape(-1, self.shared.shape[2])
            products = f.T @ f
        if not np.isfinite(products).all():  # beyond all numbers, of parameters or a noise out of all proportion
            return None
        sizes, axes = np.linalg.eigh(products)
        root = np.sqrt(1 + np.maximum(sizes, 0.0))
        return f, (axes / (root * (1 + root))) @ axes.T, float(2 * np.sum(np.log(root)))

    @property
    def log_shared(self) -> float:
        """By how much shared errors raise the logarithm of the covariance's determinant, 1."""
        return 0.0 if self._shared is None else self._shared[2]

    def by_noise_alone(self, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened columns, (rows q, c), as if no errors were shared, and these as columns, (rows q, k).

        Those have coefficients of variance 1. So each row is of its own sample alone, and may be told from others.
        """
        if self._shared is None:
            return white, np.zeros((len(white), 0))
        f = self._shared[0]
        sizes, axes = np.linalg.eigh(f.T @ f)
        longer = (axes / (1 + np.sqrt(1 + np.maximum(sizes, 0.0)))) @ axes.T  # N of (I + F F')^1/2 = I + F N F'
        return white + f @ (longer @ (f.T @ white)), f

    def _by_noise(self, columns: FloatArray) -> tuple[FloatArray, float]:
        """Return the same without shared errors."""
        if not self.remembers:
            return self._scaled(columns, slice(None)), self._log_variances
        parts = []
        total = self._log_size
        for k, clock in enumerate(self.clocks):
            white, log = self._part(columns[clock.rows], clock.rows, k)
            total += log
            parts.append(white)
        result = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return result, total

    def flat(self, columns: FloatArray) -> FloatArray:
        """Return (rows, q, c) columns whitened, (rows q, c)."""
        if self.in_parts:
            return self.whitened(columns)[:]
        return self(columns)[0].reshape(columns.shape[0] * columns.shape[1], -1)

    def whitened(self, *columns: FloatArray) -> Columns:
        """Return (rows, q, c) columns whitened, (rows q, all c); of a long recording, without a memory, not held."""
        if self.in_parts:
            wide = [c.reshape(self.scale.size, c.shape[2]) for c in columns]
            return Scaled([column for own in wide for column in own.T], self.scale.ravel())
        return self.flat(columns[0] if len(columns) == 1 else np.concatenate(columns, axis=2))

    def changes(self, signals: FloatArray, before: FloatArray) -> Columns:
        """Return by how much c signals, (c, rows, q), differ from another, (rows, q), whitened likewise."""
        if self.in_parts:
            return Scaled([np.ravel(own) for own in signals], self.scale.ravel(), np.ravel(before))
        return self.flat(np.ascontiguousarray(np.moveaxis(signals - before, 0, 2)))

    def of_made(self, made: Callable[[slice], FloatArray]) -> Columns:
        """Return columns whitened, likewise, that are made: of a slice of rows (n, q, c) ones."""
        rows, q = self.present.shape
        if not self.in_parts:
            return self.flat(made(slice(0, rows)))
        factors = self.scale

        def whitened(at: slice) -> FloatArray:  # which may begin and end amid a row
            there = slice(at.start // q, -(-at.stop // q))
            own = made(there)
            for k in range(own.shape[2]):
                own[:, :, k] *= factors[there]
            return own.reshape(own.shape[0] * q, own.shape[2])[at.start - there.start * q :][: at.stop - at.start]

        return Made(whitened, rows * q)

    @cached_property
    def remembers(self) -> bool:
        """Whether the noise of a sample depends on those before it: else whitening divides by its deviation."""
        short = any(len(a) for of_channels in self.noise.short for a, _ in of_channels)
        return self.noise.has_state or short

    @property
    def in_parts(self) -> bool:
        """Whether columns are whitened some rows at a time: the recording is long, and its noise has no memory."""
        return len(self.present) > LONG and not self.remembers and self.shared is None

    def _scaled(self, columns: FloatArray, rows: slice) -> FloatArray:
        """Return columns, (n, q, c), of some rows over the deviation of noise without a memory."""
        white = columns * self.scale[rows, :, None]
        if not self._complete:
            white[~self.present[rows]] = 0.0
        return white

    @cached_property
    def _complete(self) -> bool:
        """Whether no sample is missing."""
        return bool(self.present.all())

    @cached_property
    def _log_variances(self) -> float:
        """The sum of the logarithms of the variances of noise without a memory."""
        return float(-2 * np.sum(np.log(self.scale if self._complete else self.scale[self.present])))

    @cached_property
    def scale(self) -> FloatArray:
        """One over the deviation of each sample, (rows, q), of noise without a memory; 0 where it is missing."""
        g, white = self._sizes()
        deviation = np.sqrt(white, out=white)
        if self.grows:
            deviation *= g
        scale = np.divide(1.0, deviation, out=deviation)
        if not self._alike:
            at_rest, moving = ([own for _, own in short] for short in self.noise.short)
            scale /= np.where(self.moving[:, None], moving, at_rest)
        if not self._complete:
            scale[~self.present] = 0.0
        return scale

    def of_rows(self, columns: FloatArray, rows: slice) -> tuple[slice, FloatArray]:
        """Return columns, (n, q, c), whitened that are zero beside the given rows of one recording, as (m, c).

        Noise without a state leaves them zero beyond some rows: these alone, the slice, are whitened. In a long
        recording noise with a state is taken to forget within MEMORY rows.
        """
        last = len(self.present)
        first, end = rows.start or 0, last if rows.stop is None else rows.stop
        holding = [k for k, c in enumerate(self.clocks) if c.rows.start <= first and end <= c.rows.stop]
        if not holding or ((self.noise.has_state or self.shared is not None) and last <= LONG):
            whole = np.zeros((last, *columns.shape[1:]))
            whole[rows] = columns
            return slice(0, last), self(whole)[0].reshape(-1, columns.shape[2])
        if not self.remembers:
            return slice(first, end), self._scaled(columns, slice(first, end)).reshape(-1, columns.shape[2])
        before, behind = (MEMORY, MEMORY) if self.noise.has_state else (0, max(ORDERS))
        clock = self.clocks[holding[0]]
        wide = slice(max(clock.rows.start, first - before), min(clock.rows.stop, end + behind))
        padded = np.zeros((wide.stop - wide.start, *columns.shape[1:]))
        padded[first - wide.start : end - wide.start] = columns
        return wide, self._part(padded, wide, holding[0])[0].reshape(-1, columns.shape[2])

    def _part(self, columns: FloatArray, rows: slice, k: int) -> tuple[FloatArray, float]:
        """Return columns, (n, q, c), of n rows of clock k, whitened as if the noise had its usual state before.

        The second is the sum of the logarithms of the innovations' variances.
        """
        clock = self.clocks[k]
        whole = rows == clock.rows and len(self.present) <= LONG  # else they are not held
        own = self._gains[k] if whole else self._gains_of(rows, k)
        white = own.whiten(columns, self._state_spaces[0][rows] if self.grows else None)
        log = own.log_determinant
        if self.noise.short:
            log += shorten(white, self.present[rows], self.moving[rows], self.noise.short, self._behind[rows])
        return white, log

    @cached_property
    def _behind(self) -> NDArray[np.int64]:
        """How many rows each sample has behind it for a short autoregression, (rows, q); all, but behind filters."""
        outlying, most = self.inflate != 1.0, max(ORDERS)
        found = np.full(self.present.shape, most)
        for j in self.noise.filtered:
            for rows in (c.rows for c in self.clocks):
                found[rows, j] = rows_behind(self.present[rows, j], outlying[rows, j], most)
        return found

    @cached_property
    def _gains(self) -> list[Gains]:
        """The gains of all rows of each clock: many columns are whitened by one noise."""
        return [self._gains_of(clock.rows, k) for k, clock in enumerate(self.clocks)]

    def _gains_of(self, rows: slice, k: int) -> Gains:
        """Return the gains of some rows of clock k, as if the noise had its usual state before."""
        _, variance, spaces = self._state_spaces
        steps, arrays = spaces[k]
        start = self.clocks[k].rows.start
        own = None if steps is None else steps[rows.start - start : rows.stop - start]
        return gains(variance[rows], steps=own, **arrays)

    @cached_property
    def _log_size(self) -> float:
        """The sum of log g^2 of all samples."""
        return float(2 * np.sum(np.log(self._state_spaces[0])[self.present])) if self.grows else 0.0

    @property
    def is_white(self) -> bool:
        """Whether the noise is alike and independent in all samples of a channel, but for a few outliers by chance."""
        plain = not (self.grows or self.remembers or self.noise.jitter or self.shared is not None)
        return plain and bool(np.count_nonzero(self.inflate != 1.0) <= BY_CHANCE * self.inflate.size)

    @property
    def _alike(self) -> bool:
        """Whether the noise is as large while the machine rests as while it runs, beside what grows."""
        return all(s == 1.0 for short in self.noise.short for _, s in short)

    @cached_property
    def _state_spaces(
        self,
    ) -> tuple[FloatArray, FloatArray, list[tuple[NDArray[np.int64] | None, dict[str, FloatArray]]]]:
        """The scale and white variance of each sample, (rows, q); of each clock the step to each row, and `states`."""
        noise, (g, white) = self.noise, self._sizes()
        running = self._running(g, ALL)
        variance = np.where(self.present, white, np.inf)
        found = []
        for clock in self.clocks:
            steps, index = clock.steps
            phases: tuple[int, ...] = (RUNS,)
            moving = self.moving[clock.rows]
            before_row = np.maximum(np.arange(len(moving)) - 1, 0)  # at which a step begins
            opens = None if self.opens is None else self.opens[clock.rows][before_row]
            if noise.torque[0] > 0 and not (moving.all() and opens is None):
                runs = RUNS if opens is None else np.where(opens, COASTS, RUNS)
                phase = np.where(moving, np.where(np.concatenate([[True], moving[:-1]]), runs, STARTS), RESTS)
                phases = (RESTS, STARTS, RUNS, COASTS)
                index = (np.zeros(len(moving), dtype=np.int64) if index is None else index) * len(phases) + phase
            ways: tuple[int, ...] = (WAYS,)
            if noise.torque[0] > 0 and self.way is not None:
                before = self.way[clock.rows][before_row]
                ways = tuple(range(-WAYS, WAYS + 1))
                index = (np.zeros(len(moving), dtype=np.int64) if index is None else index) * len(ways) + before + WAYS
            kinds = list(itertools.product(steps, phases, ways))
            if index is not None:  # most of many kinds do not occur
                used = np.bincount(index, minlength=len(kinds)) > 0
                kinds = list(itertools.compress(kinds, used.tolist()))
                index = (np.cumsum(used) - 1)[index]
            first = 0 if index is None else int(index[0])
            if self.each is not None:
                running = self._running(g, clock.rows)
            lengths, phase_of_each, way_of_each = (np.array(own) for own in zip(*kinds, strict=True))
            found.append((index, noise.states(lengths, running, phase_of_each, way_of_each, first=first)))
        return g, variance, found

    def _running(self, g: FloatArray, rows: slice) -> FloatArray:
        """Return the scale, (q,), in most of some rows."""
        if not self.grows:
            return np.ones(g.shape[1])
        of_channels = zip(g[rows].T, self.present[rows].T, strict=True)
        return np.array([median(x[p]) if p.any() else 1.0 for x, p in of_channels])

    @property
    def grows(self) -> bool:
        """Whether the noise is not of one size everywhere: with the signals, or from recording to recording."""
        return self.noise.grows or self.each is not None

    def growth(self, rows: slice | NDArray[np.intp] = ALL) -> FloatArray:
        """Return the scale of some rows, (n, q); not to be changed."""
        g = self.noise.scale(self.level[rows], self.moving[rows])
        return g if self.each is None else g * self.each[rows]

    def as_of_one(self, residuals: FloatArray) -> FloatArray:
        """Return residuals, (rows, q), as if all recordings were as noisy as the noisiest."""
        return residuals if self.each is None else residuals / self.each

    def deviation(self, rows: slice | NDArray[np.intp] = ALL) -> FloatArray:
        """Return the deviation of each sample of some rows, (n, q), all parts of the noise together."""
        deviation = self.noise.deviation(self.level[rows], self.moving[rows])
        return deviation if self.each is None else deviation * self.each[rows]

    def _sizes(self) -> tuple[FloatArray, FloatArray]:
        """Return the scale and white variance of each sample, (rows, q), as if none were missing."""
        noise = self.noise
        g = self.growth()
        power = noise.white**2 + noise.differenced**2 + noise.slow[:, 0] ** 2
        floor = np.maximum(LEAST_WHITE * power, 1e-300)
        white = np.maximum(noise.white**2, floor) * self.inflate
        if noise.jitter:
            white += (noise.jitter * self.slope / g) ** 2
        return g, white

    def forget(self) -> None:
        """Give up the memory of what is made of the noise again when it is asked for."""
        for name in ("scale", "_state_spaces", "_gains", "_shared"):
            self.__dict__.pop(name, None)

    def of(self, noise: NoiseModel) -> Whitener:
        """Return the whitener of another noise model."""
        same = noise.stands == self.noise.stands
        return dataclasses.replace(self, noise=noise, moving=self.moving if same else moving(self.level, noise.stands))


def moving(level: FloatArray | Level, stands: float) -> BoolArray:
    """Return where the machine runs, (rows,): a signal is larger than so much of its largest."""
    return np.asarray(np.logical_or.reduce([level[:, k] > stands for k in range(level.shape[1])]))
