"""How noise grows as the machine runs, and with its signal, from differences of neighbouring residuals. No colour."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL, MEDIAN_SIZE, SECOND_DIFFERENCE, T_FREEDOM, T_MEDIAN
from estimator.noise.noise_model import LEAST_MOTION, NoiseModel
from estimator.noise.whitener import Whitener
from estimator.recordings.samples import median, medians, sum_of_logs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TOGETHER = 1_000_000  # numbers that growths are tried on at once
DIFFERENCES = 8000  # second differences that tell the growth; of twice as many some are left out
FARTHEST = 1e37  # of a square, in deviations: a larger one counts as this
CHARGE = 2 * LEAST_FALL  # of -2 log L: twice, as the squares of neighbours correlate by 0.44
HOPELESS = 0.5  # of what a growth is charged: where a coarse one falls by no more, none is looked at closely
SILENT = 1e-3  # of the noise of a machine that runs: an encoder has none at rest, which tells of no growth
RUNS_LOUDER = 4.0  # standard errors of a ratio of medians: a noise that differs by less is not looked at closely
MEDIAN_ERROR = 1.4  # of the logarithm of a median of n sizes that correlate as second differences do, times sqrt n
FINE = np.geomspace(0.7, 1.43, 9)  # times a growth, and a ratio
BENT = np.geomspace(0.7, 1.7, 9)  # times a growth, and a ratio, of the other form
STANDS = (5e-3, 0.02, 0.05)  # of the largest signals: with less of each a machine that hardly moves may be as quiet
RATIOS = 7  # of the noise of a machine that runs to that at rest that are tried, up to the largest
UNDECIDED = 4.0  # of -2 log L: what is likelier by less is not told
QUIET_SAMPLES = 10  # of a machine at rest
LOUD_SAMPLES = 25  # samples of a large signal, and as many below half of it: fewer do not show a growth


def noise_of_neighbours(whitener: Whitener, residuals: FloatArray, sharp: BoolArray) -> NoiseModel:
    """Return the white noise that samples beside each other show, and its growth; arguments as for `fit_noise`."""
    q = residuals.shape[1]
    told, stands = growths_of(residuals, whitener, sharp, steps=np.zeros(q))
    white = [own.white if own.white > 0 else old for own, old in zip(told, whitener.noise.white, strict=True)]
    return grown_as(dataclasses.replace(whitener.noise, white=np.array(white)), told, stands)


def growths_of(
    residuals: FloatArray, whitener: Whitener, sharp: BoolArray, *, steps: FloatArray
) -> tuple[list[Growth], float]:
    """Return how the noise of each channel grows, and `stands` of `NoiseModel`.

    Parameters
    ----------
    residuals : (rows, q) array
    sharp : (rows,) array
    steps : (q,) array
        As `growth_of`.
    """
    residuals = whitener.as_of_one(residuals)

    def told(stands: float) -> list[Growth]:
        own = whitener.of(dataclasses.replace(whitener.noise, stands=stands))
        return [growth_of(residuals[:, j], own, j, sharp, step=step) for j, step in enumerate(steps.tolist())]

    found, stands = told(LEAST_MOTION), LEAST_MOTION
    if not any(own.fall > 0 for own in found):
        return found, stands
    fall = sum(own.fall for own in found)
    for tried in STANDS:
        other = told(tried)
        if any(own.running != 1.0 for own in other) and sum(own.fall for own in other) > fall + LEAST_FALL:
            found, stands, fall = other, tried, sum(own.fall for own in other) - LEAST_FALL
    return found, stands


def grown_as(noise: NoiseModel, told: Sequence[Growth], stands: float) -> NoiseModel:
    """Return a noise that grows as is told of each channel, and of where the machine stands."""
    return dataclasses.replace(
        noise,
        stands=stands,
        growth=np.array([own.growth for own in told]),
        running=np.array([own.running for own in told]),
        bends=np.array([own.bends for own in told]),
    )


@dataclass(frozen=True)
class Growth:
    """How the noise of a channel grows.

    Attributes
    ----------
    growth, running, bends : of `NoiseModel`
    white : float
        Deviation at rest of white noise whose differences are as large, spread as they are; 0: too few samples.
    fall : float
        By how much -2 log L falls beyond what its numbers are charged.
    """

    growth: float = 0.0
    running: float = 1.0
    bends: bool = False
    white: float = 0.0
    fall: float = 0.0


def growth_of(residuals: FloatArray, whitener: Whitener, j: int, sharp: BoolArray, *, step: float = 0.0) -> Growth:
    """Return how a channel's noise grows, from second differences; arguments as for `differences_of`."""
    return pooled(differences_of(residuals, whitener, j, sharp, steps=[step] * len(whitener.clocks))).growth()


def differences_of(
    residuals: FloatArray, whitener: Whitener, j: int, sharp: BoolArray, *, steps: Sequence[float]
) -> list[Differences]:
    """Return the second differences of a channel's residuals, (rows,), in each recording.

    Second differences contain the noise and hardly any misfit, so that transients can be used, but for their first
    part. Their size is estimated by Student's t, on which outliers have little influence.

    Parameters
    ----------
    sharp : (rows,) array
        First parts of transients.
    steps : (recordings,) floats
        By which the sensor resolves the channel; 0: it is fine. Differences of a level are whole steps, and their
        median is up to half as large again, or as small, as that of a signal that moves with the same noise: all
        samples are spread over a step.
    """
    sizes, left, levels, moves = [], [], [], []
    for clock in whitener.clocks:
        x, known = residuals[clock.rows], whitener.present[clock.rows, j] & ~sharp[clock.rows]
        told = known[2:] & known[1:-1] & known[:-2]
        sizes.append(_second_differences(x)[told])
        left.append(x[1:-1][told])
        levels.append(whitener.level[clock.rows, j][1:-1][told])
        moves.append(whitener.moving[clock.rows][1:-1][told])
    if _is_silent(sizes, moves):  # all others are of a signal that moves
        of_all = (sizes, left, levels)
        sizes, left, levels = ([own[there] for own, there in zip(one, moves, strict=True)] for one in of_all)
        moves = [np.ones(len(own), dtype=bool) for own in sizes]
    rng = np.random.default_rng(0)
    sizes = [
        own + step * _second_differences(rng.random(len(own) + 2)) if step else own
        for own, step in zip(sizes, steps, strict=True)
    ]
    stride = max(1, sum(map(len, sizes)) // DIFFERENCES)
    each = zip(sizes, left, levels, moves, strict=True)
    return [Differences(*(np.asarray(x[::stride]) for x in (np.abs(d), np.abs(r), *rest))) for d, r, *rest in each]


def pooled(each: Sequence[Differences]) -> Differences:
    """Return the differences of all recordings as of one."""
    of_all = ([getattr(own, name) for own in each] for name in ("sizes", "left", "level", "runs"))
    return Differences(*map(np.concatenate, of_all))


class _Tried(NamedTuple):
    """A growth and a ratio that were tried, and -2 log L."""

    misfit: float
    growth: float
    running: float
    bends: bool

    @property
    def charge(self) -> float:
        """What its numbers are charged."""
        return CHARGE * ((self.growth > 0) + (self.running != 1.0))

    @property
    def usual(self) -> float:
        """By how much of -2 log L it may be behind one that is charged as much: a machine is as loud at any speed.

        Rest and one level do not tell what is between them, where a noise that grows would be the smaller, and more so
        the larger of two.
        """
        return UNDECIDED * ((self.growth == 0) + (self.running != 1.0 or not self.bends))


class Differences:
    """Sizes of second differences and of what is left, levels of the signal, and whether the machine runs, all (n,)."""

    def __init__(self, sizes: FloatArray, left: FloatArray, level: FloatArray, runs: BoolArray) -> None:
        self.sizes, self.left, self.level, self.runs = sizes, left, level, runs
        self.squares, self.powers = sizes * sizes, level * level
        self.floor = 1e-3 * median(sizes[sizes != 0]) if sizes.any() else 0.0

    @property
    def tell(self) -> bool:
        """Whether they are enough to tell a size, and any is not 0."""
        return len(self.sizes) >= 2 * LOUD_SAMPLES and bool(np.any(self.sizes))

    def growth(self) -> Growth:
        """Return the growth of the largest likelihood, where that falls enough."""
        if not self.tell:
            return Growth()
        none = self.misfit()
        coarse = [tried for tried in self._coarsely() if none - tried.misfit > HOPELESS * CHARGE]
        if not coarse:
            return self._of(0.0, 1.0)
        tried = [*map(self._fine, coarse), *(self._fine(self._bent(own)) for own in coarse if own.growth > 0)]
        best = min(tried, key=lambda own: own.misfit + own.charge - own.usual)
        fall = none - best.misfit - best.charge
        return self._of(best.growth, best.running, bends=best.bends, fall=fall) if fall > 0 else self._of(0.0, 1.0)

    def misfit(self) -> float:
        """Return -2 log L of Student's t, up to a constant, of a noise that does not grow."""
        return float(self._misfits(np.zeros(1), np.ones(1))[0])

    def over(self, growth: Growth, share: float = 1.0) -> Differences:
        """Return them as of a noise that does not grow so, and is no such share."""
        c, s = np.array([growth.growth]), np.array([growth.running])
        scale = share * np.sqrt(self._grown(c, s, bends=growth.bends)[0])
        return Differences(self.sizes / scale, self.left / scale, self.level, self.runs)

    def _bent(self, best: _Tried) -> _Tried:
        """Return the likeliest of the other form, which has as many numbers, near one that was tried."""
        ratios = best.running * BENT if best.running != 1.0 else np.ones(1)
        return self._best(best.growth * BENT, ratios, bends=True)

    def _fine(self, best: _Tried) -> _Tried:
        """Return the likeliest near one that was tried."""
        for _ in range(2 if best.running != 1.0 else 1):
            if best.growth > 0:
                best = min(best, self._best(best.growth * FINE, np.array([best.running]), bends=best.bends))
            if best.running != 1.0:
                best = min(best, self._best(np.array([best.growth]), best.running * FINE, bends=best.bends))
        return best

    def _coarsely(self) -> list[_Tried]:
        """Return the best of few growths, and of few ratios beside it where the machine runs with another noise."""
        loud = float(np.sort(self.level)[-LOUD_SAMPLES])
        grows = np.count_nonzero(self.level < loud / 2) >= LOUD_SAMPLES
        coarse = np.append(0.0, np.geomspace(0.3, 300.0, 16) / loud) if grows else np.zeros(1)
        best = self._best(coarse, np.ones(1))
        if (louder := self._louder()) == 1.0:
            return [best]
        near = best.growth * np.geomspace(0.63, 2.5, 4) if best.growth > 0 else np.zeros(0)
        ratios = np.geomspace(min(louder, 1.0), max(louder, 1.0), RATIOS)
        others = [self._best(growths, ratios[ratios != 1.0]) for growths in (np.zeros(1), near) if len(growths)]
        return [best, *others]

    def _best(self, growths: FloatArray, ratios: FloatArray, *, bends: bool = False) -> _Tried:
        """Return the likeliest of all these growths with all these ratios."""
        c, s = (own.ravel() for own in np.meshgrid(growths, ratios))
        reached = self._misfits(c, s, bends=bends)
        k = int(np.argmin(reached))
        return _Tried(float(reached[k]), float(c[k]), float(s[k]), bends)

    def _louder(self) -> float:
        """Return how much larger differences are where the machine runs and its signal is small; 1: that is chance."""
        at_rest = self.sizes[~self.runs]
        if len(at_rest) < QUIET_SAMPLES or np.count_nonzero(self.runs) < 2 * LOUD_SAMPLES:
            return 1.0
        quiet = self.runs & (self.level <= median(self.level[self.runs]))
        running = self.sizes[quiet]
        ratio = max(median(running), self.floor) / max(median(at_rest), self.floor)
        error = MEDIAN_ERROR * np.sqrt(1 / len(at_rest) + 1 / len(running))
        return ratio if abs(np.log(ratio)) > RUNS_LOUDER * error else 1.0

    def _of(self, c: float, s: float, *, bends: bool = False, fall: float = 0.0) -> Growth:
        g = self._grown(np.array([c]), np.array([s]), bends=bends)[0]
        unit = max(median(self.sizes / np.sqrt(g)) / T_MEDIAN, self.floor)
        return Growth(c, s, bends, unit * T_MEDIAN / MEDIAN_SIZE / SECOND_DIFFERENCE, fall)

    def _grown(self, c: FloatArray, s: FloatArray, *, bends: bool) -> FloatArray:
        """Return g^2 of several growths, (k, n)."""
        least = np.where(self.runs, (s * s)[:, None], 1.0)
        more = (c * c)[:, None] * self.powers
        return np.asarray(np.maximum(least, more, out=more) if bends else np.add(least, more, out=more))

    def _misfits(self, c: FloatArray, s: FloatArray, *, bends: bool = False) -> FloatArray:
        """Return -2 log L of Student's t, up to a constant, of several growths."""
        together, found = max(1, TOGETHER // len(self.sizes)), []
        for k in range(0, len(c), together):
            some, own = c[k : k + together], s[k : k + together]
            g = self._grown(some, own, bends=bends)
            ratio = self.squares / g
            unit = np.maximum(medians(ratio) / T_MEDIAN**2, self.floor**2)
            ratio /= (T_FREEDOM * unit)[:, None]
            far = np.minimum(ratio, FARTHEST, out=ratio)
            far += 1.0
            found.append(sum_of_logs(g) + len(self.sizes) * np.log(unit) + (T_FREEDOM + 1) * sum_of_logs(far))
        return np.concatenate(found)


def _second_differences(x: FloatArray) -> FloatArray:
    return x[2:] - 2 * x[1:-1] + x[:-2]


def _is_silent(differences: list[FloatArray], moves: list[BoolArray]) -> bool:
    """Whether a channel shows no noise while the machine is at rest."""
    sizes, running = (
        np.abs(np.concatenate([*differences, np.zeros(0)])),
        np.concatenate([*moves, np.zeros(0, dtype=bool)]),
    )
    if running.all() or not running.any():
        return False
    return median(sizes[~running]) <= SILENT * median(sizes[running])
