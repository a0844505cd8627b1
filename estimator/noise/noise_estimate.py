"""Noise models estimated from residuals: the components that the data show, and their numbers. Knows no FMU.

The parameters of the model have the largest restricted likelihood over the settled rows: a misfit of a transient is not
taken for noise. A component is added as long as -2 log L falls enough.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL, STEP_DEVIATION
from estimator.noise.autoregression import autoregression, innovations
from estimator.noise.clock import Clock
from estimator.noise.noise_growth import Growth, grown_as, growths_of
from estimator.noise.noise_model import NoiseModel
from estimator.noise.repeating import repeat_themselves
from estimator.noise.restricted_likelihood import Component, RestrictedLikelihood
from estimator.noise.whitener import Whitener

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Short = tuple[FloatArray, float]  # coefficients of an autoregression, and its innovation's deviation
Colours = Sequence[Short]

ROWS = 4000  # settled rows that the noise is estimated from, at most
SETTLED_SAMPLES = 100  # settled samples of a channel; with fewer all rows are used
BLOCK_LENGTHS = (2, 8, 32, 128, 512)  # samples whose means show slow correlation
COLOURED = 5.0  # standard deviations of a block's mean square: of white noise less than once in 1e5
COUNTS_ALONE = 1.2  # times the deviation of an encoder's counts: a noise that is no larger is nothing else
SHOWN_AT_LEVELS = 0.3  # of a step: with a larger noise samples of a level are as far off as those in motion
COMPONENTS = 3  # that colour a noise, at most
NO_WHITE = 1e-3  # of the residuals: noise beside counts that are differenced, where none is told
BESIDE_COUNTS = 0.01  # of these: a white noise that is no less is told
MUCH_LESS = 0.1  # of the residuals: where the counts of an encoder begin beside white noise
SILENT = 1e-6  # of all residuals: smaller ones are of a sensor that shows zero at rest
STRETCH, MOST_STRETCHES = 20, 12  # rows of a stretch that has a level of its own; stretches, at most


def fit_noise(
    whitener: Whitener,
    residuals: FloatArray,
    columns: FloatArray,
    settled: BoolArray,
    sharp: BoolArray,
    *,
    steps: FloatArray,
    resolution: FloatArray,
    is_held: BoolArray,
    counts: FloatArray,
    colour: bool,
    again: bool,
    torque: tuple[float, float] | None = None,
    least: FloatArray | float = 0.0,
    behind: Sequence[Colours] = (),
) -> NoiseModel:
    """Return the noise model of the largest restricted likelihood.

    Parameters
    ----------
    whitener : Whitener
        Of an initial noise model; its machine is used.
    residuals : (rows, q) array
    columns : (rows, q, c) array
        Their derivatives by what is free, spectral lines among it: what the noise passes on of one it would keep.
    settled : (rows,) array
        Rows that the noise is estimated from.
    sharp : (rows,) array
        First parts of transients, where a misfit is most likely.
    steps : (q,) array
        By which the sensors resolve channels that stay at levels; 0: they are fine. Samples of a signal that moves are
        off by the noise and by what a step adds, of which those of a level show less where the noise is small.
    resolution : (q,) array
        Step of a sensor that is too coarse for its errors to be noise: they are up to half of it. 0: it is fine.
    is_held : (q,) array
        Of a sensor so coarse that neighbours show the same value while the machine runs: they tell no colour.
    counts : (q,) array
        Deviation of the counts that a channel differences: at a steady speed their errors repeat themselves, and seem
        to be less. 0: it shows no counts.
    colour : bool
        Look for slow parts, for a wandering torque, and for correlation over few samples.
    again : bool
        Keep the components of the whitener's noise, and estimate their parameters again.
    torque : deviation and correlation time, s, optional
        Of a wandering torque that all rows tell: the settled ones are not asked for it.
    least : (q,) array
        Deviation of white noise, which is no smaller.
    behind : sequence of Colours, optional
        Of each channel, what colours white noise may have behind the filters that are declared for it; none: no filter.
    """
    part, rows = _settled_part(whitener, settled, residuals)
    stacked = np.concatenate([residuals[rows, :, None], columns[rows], _levels(part)], axis=2)
    stacked = np.where(part.present[:, :, None], stacked, 0.0)
    coarse = np.maximum(np.maximum(steps, resolution), counts * STEP_DEVIATION)
    told, stands = growths_of(residuals, whitener, sharp, steps=coarse)
    told = [own if own.white * own.growth >= step else Growth() for own, step in zip(told, resolution, strict=True)]
    alike = part.as_of_one(stacked[:, :, 0])
    spread = np.array([_spread(own[here]) for own, here in zip(alike.T, part.present.T, strict=True)])
    if is_held.any() and not is_held.all():  # their errors are no noise, though a wandering torque might follow them
        part = dataclasses.replace(part, present=part.present & ~is_held)
        stacked[:, is_held] = 0.0
    likelihood = RestrictedLikelihood(part, stacked)
    choice = _Choice(
        likelihood,
        colour=colour,
        told=told,
        stands=stands,
        is_held=is_held,
        counts=counts,
        spread=spread,
        torque=torque,
        behind=behind,
    )
    found = choice.again() if again else choice.best()
    differenced = np.maximum(found.differenced, counts)
    hidden = np.hypot(np.minimum(found.white, SHOWN_AT_LEVELS * steps), steps / STEP_DEVIATION)
    white = np.maximum(np.maximum(found.white, least), np.maximum(hidden, resolution / STEP_DEVIATION))
    return dataclasses.replace(found, white=white, differenced=differenced)


def _settled_part(whitener: Whitener, settled: BoolArray, residuals: FloatArray) -> tuple[Whitener, NDArray[np.int64]]:
    """Return the whitener of the rows that the noise is estimated from, and these rows.

    A sensor that shows no noise at rest, and never settles elsewhere, tells its noise while the machine runs.
    """
    present = whitener.present & settled[:, None]
    for j in range(present.shape[1]):
        own, anywhere = residuals[present[:, j], j], residuals[whitener.present[:, j], j]
        few = len(own) < min(SETTLED_SAMPLES, len(anywhere))
        if few or float(own @ own) * len(anywhere) < SILENT**2 * float(anywhere @ anywhere) * len(own):
            present[:, j] = whitener.present[:, j]
    for own in present.T:  # each its own: one may tell its noise at rest alone, another while the machine runs
        many = int(np.count_nonzero(own))
        if many > ROWS:  # of every recording its part
            keep = np.zeros(len(own), dtype=bool)
            for clock in whitener.clocks:
                inside = clock.rows.start + np.flatnonzero(own[clock.rows])
                if len(inside):
                    keep[inside[-max(1, ROWS * len(inside) // many) :]] = True
            own &= keep
    used = np.flatnonzero(np.logical_or.reduce(list(present.T)))
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
        whitener.moving[rows], whitener.slope[rows], None if whitener.way is None else whitener.way[rows],
        None if whitener.opens is None else whitener.opens[rows],
        each=None if whitener.each is None else whitener.each[rows],
    )  # fmt: skip
    return narrowed, rows


def _spread(x: FloatArray) -> float:
    """Return the root mean square of residuals, (n,), above 0."""
    return max(float(np.sqrt(np.mean(x * x))), 1e-300) if len(x) else 1.0


def _levels(whitener: Whitener) -> FloatArray:
    """Return a constant for each channel and stretch, (rows, q, c): a misfit of a level is not taken for noise."""
    told = np.asarray(whitener.present.any(axis=1))
    breaks = set((np.flatnonzero(told[1:] != told[:-1]) + 1).tolist())
    starts = sorted({0, *breaks, *(c.rows.start for c in whitener.clocks)})
    q = whitener.present.shape[1]
    ends = zip(starts, [*starts[1:], len(told)], strict=True)
    stretches = [(first, last, j) for first, last in ends if told[first] and last - first >= STRETCH for j in range(q)]
    columns = np.zeros((len(told), q, min(len(stretches), MOST_STRETCHES)))
    for k, (first, last, j) in enumerate(stretches[:MOST_STRETCHES]):
        columns[first:last, j, k] = 1.0
    return columns


class _Choice:
    """The components of a noise model: those of before, or those that lower the restricted likelihood enough."""

    def __init__(
        self,
        likelihood: RestrictedLikelihood,
        *,
        colour: bool,
        told: Sequence[Growth],
        stands: float,
        is_held: BoolArray,
        counts: FloatArray,
        spread: FloatArray,
        torque: tuple[float, float] | None,
        behind: Sequence[Colours],
    ) -> None:
        self.likelihood, self.colour, self.is_held = likelihood, colour, is_held
        self.told, self.stands = told, stands
        self.counts, self.spread, self.torque = counts, spread, torque
        self.whitener, self.stacked = likelihood.whitener, likelihood.stacked
        self.q = self.stacked.shape[1]
        self.behind = behind or [()] * self.q
        self.known = self._kept()
        self.first = dataclasses.replace(self.whitener.noise, short=(), filtered=())

    def again(self) -> NoiseModel:
        """Estimate the parameters of the present components again; all afresh where they overflow.

        So it is where counts alone would have to be larger than they are: something is beside them now.
        """
        noise = self._grown(self.first)
        if self.known:  # by what is explained now
            self.known |= {j: own for j, own in self._of_filters(noise).items() if j in self.known}
            noise = self._alone(noise)
        active, beside = self._present(noise)
        found, misfit = self.likelihood.largest(noise, active, iterations=6)
        alone = (noise.differenced > 0) & (noise.differenced <= self.counts) & ~beside
        if not np.isfinite(misfit) or np.any(alone & (found.differenced > COUNTS_ALONE * self.counts)):
            return self.best()
        return self._with_short(found)

    def _present(self, noise: NoiseModel) -> tuple[list[Component], BoolArray]:
        """Return the components that a noise has, and where white noise is beside counts that are differenced."""
        active = [("differenced" if noise.differenced[j] > 0 else "white", j) for j in range(self.q)]
        beside = noise.white > BESIDE_COUNTS * noise.differenced
        active += [("white", j) for j in range(self.q) if noise.differenced[j] > 0 and beside[j]]
        active += [("slow", j) for j in range(self.q) if noise.slow[j, 0] > 0]
        active += [("torque", 0)] if noise.torque[0] > 0 and self.torque is None else []
        return active, beside

    def best(self) -> NoiseModel:
        """Add components as long as -2 log L falls enough, then the short autoregression.

        What was there before may be likelier than what is reached so, one after the other.
        """
        spread = self.spread
        differenced = self.first.differenced > 0
        noise = dataclasses.replace(
            self.first,
            white=np.where(differenced, NO_WHITE, 1.0) * spread,
            differenced=np.where(differenced, spread / np.sqrt(2), 0.0),
            growth=np.zeros(self.q),
            running=np.ones(self.q),
            bends=np.zeros(self.q, dtype=bool),
            slow=np.column_stack([np.zeros(self.q), np.ones(self.q)]),
            torque=self.torque or (0.0, 1.0),
        )
        active = [("differenced" if differenced[j] else "white", j) for j in range(self.q)]
        noise, value = self.likelihood.largest(noise, active)
        grows = self._grown(noise)
        if grows.grows:
            noise, value = self.likelihood.largest(grows, active)
        self.known = self._of_filters(noise)
        if self.known:
            noise, value = self.likelihood.largest(self._alone(noise), active)
        for _ in range((COMPONENTS if self.colour else 0) + int(differenced.sum())):
            options = self._options(noise, active)
            begun = [(*self.likelihood.largest(start, [c], iterations=5), c) for start, c in options]
            best = min(begun, key=lambda r: r[1], default=None)
            if best is None or best[1] > value:
                break
            more = [*active, best[2]]
            found, reached = self.likelihood.largest(best[0], more)
            if reached > value - LEAST_FALL:
                break
            noise, value, active = found, reached, more
        return self._with_short(self._likelier_of_before(noise, value, active))

    def _likelier_of_before(self, noise: NoiseModel, value: float, active: Sequence[Component]) -> NoiseModel:
        """Return the noise with the components of before where that is likelier than a noise of this misfit."""
        if not self.colour or not self.first.is_coloured:
            return noise
        start = self._grown(self.first)
        before, _ = self._present(start)
        found, misfit = self.likelihood.largest(self._alone(start) if self.known else start, before)
        return found if misfit + LEAST_FALL * (len(before) - len(active)) < value else noise

    def _grown(self, noise: NoiseModel) -> NoiseModel:
        """Return a noise that grows as is told, and is as large as before in the rows that it is estimated from."""
        grown = grown_as(noise, self.told, self.stands)
        level, moving, present = self.whitener.level, self.whitener.moving, self.whitener.present
        before, now = (np.sum(n.scale(level, moving) ** 2, axis=0, where=present) for n in (noise, grown))
        times = np.where(now > 0, np.sqrt(before / np.where(now > 0, now, 1.0)), 1.0)
        slow = np.column_stack([noise.slow[:, 0] * times, noise.slow[:, 1]])
        return dataclasses.replace(grown, white=noise.white * times, differenced=noise.differenced * times, slow=slow)

    def _options(self, noise: NoiseModel, active: Sequence[Component]) -> list[tuple[NoiseModel, Component]]:
        """Return starts with one more component, where the whitened residuals are not white.

        Beside counts that are differenced that is white noise, too: what counts alone leave of a slow motion is out of
        all proportion.
        """
        whitened, _ = self.whitener.of(noise)(self.stacked[:, :, :1])
        options = []
        for j in np.flatnonzero(~self.is_held).tolist():
            size = _colour_scale(whitened[:, j, 0], self.whitener.present[:, j], self.whitener.clocks)
            if size is None:
                continue
            block, share = size
            if noise.differenced[j] > 0 and ("white", j) not in active:
                white, differenced = noise.white.copy(), noise.differenced.copy()
                white[j], differenced[j] = self.spread[j], max(self.counts[j], MUCH_LESS * self.spread[j])
                options.append((dataclasses.replace(noise, white=white, differenced=differenced), ("white", j)))
            if not self.colour:
                continue
            tau = 0.5 * block * self.whitener.clocks[0].step
            deviation = np.sqrt(noise.white[j] ** 2 + noise.differenced[j] ** 2)
            if ("slow", j) not in active:
                slow = noise.slow.copy()
                slow[j] = np.sqrt(share) * deviation, tau
                options.append((dataclasses.replace(noise, slow=slow), ("slow", j)))
            if noise.machine is not None and noise.seat[j] >= 0 and self.torque is None and noise.torque[0] == 0:
                gain = abs(float(np.linalg.solve(*noise.machine)[noise.seat[j]]))
                torque = (np.sqrt(share) * deviation / gain, max(tau, 10 * self.whitener.clocks[0].step))
                options.append((dataclasses.replace(noise, torque=torque), ("torque", 0)))
        return options

    def _with_short(self, noise: NoiseModel) -> NoiseModel:
        """Return the noise with the remaining correlation over few samples."""
        if not self.colour:
            return noise
        left = self._left(noise)
        moving = self.whitener.moving
        of_each = [[np.where(there[c.rows], left[c.rows, j], 0.0) for c in self.whitener.clocks]
                   for j, there in enumerate((self.whitener.present & moving[:, None]).T)]  # fmt: skip
        # Of counts alone: a shaft that is nearly settled makes lines that are wide, which tell no more of its colour.
        of_counts = (self.counts > 0) & (np.hypot(noise.white, noise.differenced) < COUNTS_ALONE * self.counts)
        repeats = tuple(bool(alone) or repeat_themselves(own) for alone, own in zip(of_counts, of_each, strict=True))
        told = ~(np.array(repeats) | self.is_held)
        running = self._short(left, moving, told)
        counts = self.whitener.present[~moving].sum(axis=0)
        resting = self._short(left, ~moving, told)
        at_rest = tuple(a if n >= SETTLED_SAMPLES else b for n, a, b in zip(counts, resting, running, strict=True))
        return dataclasses.replace(noise, short=(at_rest, running), repeats=repeats)

    def _left(self, noise: NoiseModel) -> FloatArray:
        """Return the residuals whitened, (rows, q), without what the columns explain of them."""
        whitened, _ = self.whitener.of(noise)(self.stacked)
        flat = whitened.reshape(-1, whitened.shape[2])
        beta = np.linalg.lstsq(flat[:, 1:], flat[:, 0], rcond=1e-9)[0] if flat.shape[1] > 1 else np.zeros(0)
        return np.asarray(whitened[:, :, 0] - whitened[:, :, 1:] @ beta)

    def _of_filters(self, noise: NoiseModel) -> dict[int, Short]:
        """Return, of each channel whose noise is that of white noise behind its declared filters, its colour.

        So it is where these tell its colour at least as well as any autoregression does.
        """
        if not self.colour or not any(self.behind):
            return {}
        left, found = self._left(noise), {}
        for j in (j for j, colours in enumerate(self.behind) if colours and not self.is_held[j] and not self.counts[j]):
            there = self.whitener.present[:, j] & (self.whitener.inflate[:, j] == 1.0)
            series = [np.where(there[c.rows], left[c.rows, j], np.nan) for c in self.whitener.clocks]
            nothing = np.zeros_like(self.behind[j][0][0])
            alone = [innovations(series, a) for a in (nothing, *(a for a, _ in self.behind[j]))]
            n, (power, *sizes) = len(alone[0]), [float(np.mean(x * x)) if len(x) else 0.0 for x in alone]
            if not (power > 0 and n >= SETTLED_SAMPLES):
                continue
            best = int(np.argmin(sizes))
            coefficients, rest = autoregression([np.nan_to_num(x) for x in series], n)
            any_colour = n * np.log(rest**2 / power) + len(coefficients) * np.log(n) if len(coefficients) else 0.0
            if n * np.log(sizes[best] / power) + np.log(n) < min(any_colour, -LEAST_FALL):
                found[j] = self.behind[j][best]
        return found

    def _kept(self) -> dict[int, Short]:
        """Return those that the whitener's noise has."""
        running = self.whitener.noise.short[1] if self.whitener.noise.short else ()
        return {j: own for j, own in enumerate(running) if any(np.array_equal(own[0], a) for a, _ in self.behind[j])}

    def _alone(self, noise: NoiseModel) -> NoiseModel:
        """Return the noise with the short autoregressions of filters alone."""
        each = tuple(self.known.get(j, (np.zeros(0), 1.0)) for j in range(self.q))
        return dataclasses.replace(noise, short=(each, each), filtered=tuple(self.known))

    def _short(self, left: FloatArray, where: BoolArray, told: BoolArray) -> tuple[tuple[FloatArray, float], ...]:
        """Return the short autoregression of each channel, from these rows; none where they do not tell the colour."""
        result = []
        for j in range(self.q):
            if j in self.known:
                result.append(self.known[j])
                continue
            if not told[j]:
                result.append((np.zeros(0), 1.0))
                continue
            present = self.whitener.present[:, j] & where
            series = [np.where(present[c.rows], left[c.rows, j], 0.0) for c in self.whitener.clocks]
            n = int(present.sum())
            coefficients, deviation = autoregression(series, n)
            if not len(coefficients) and abs(deviation**2 - 1) < COLOURED * np.sqrt(2 / max(n, 1)):
                deviation = 1.0  # the size of the largest likelihood allows for the fitted columns
            result.append((coefficients, deviation))
        return tuple(result)


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
