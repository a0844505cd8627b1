"""How noise grows as the machine runs, and with its signal, from differences of neighbouring residuals. No colour."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL, MEDIAN_SIZE, SECOND_DIFFERENCE, T_FREEDOM, T_MEDIAN
from estimator.noise.noise_model import NoiseModel
from estimator.noise.whitener import Whitener
from estimator.recordings.samples import median, medians, sum_of_logs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TOGETHER = 1_000_000  # numbers that growths are tried on at once
DIFFERENCES = 8000  # second differences that tell the growth; of more than twice as many some are left out
FARTHEST = 1e37  # of a square, in deviations: a larger one counts as this
CHARGE = 2 * LEAST_FALL  # of -2 log L: twice, as the squares of neighbours correlate by 0.44
HOPELESS = 0.5  # of what a growth is charged: where a coarse one falls by no more, none is looked at closely
SILENT = 1e-3  # of the noise of a machine that runs: an encoder has none at rest, which tells of no growth
RUNS_LOUDER = 4.0  # standard errors of a ratio of medians: a noise that differs by less is not looked at closely
MEDIAN_ERROR = 1.4  # of the logarithm of a median of n sizes that correlate as second differences do, times sqrt n
FAINTEST = 0.05  # of the noise at rest: the least that is tried of a machine that runs
LOUD_SAMPLES = 25  # samples of a large signal, and as many below half of it: fewer do not show a growth


def noise_of_neighbours(whitener: Whitener, residuals: FloatArray, sharp: BoolArray) -> NoiseModel:
    """Return the white noise that samples beside each other show, and its growth; arguments as for `fit_noise`."""
    told = [growth_of(residuals[:, j], whitener, j, sharp) for j in range(residuals.shape[1])]
    white = [own.white if own.white > 0 else old for own, old in zip(told, whitener.noise.white, strict=True)]
    growth, running = np.array([own.growth for own in told]), np.array([own.running for own in told])
    return dataclasses.replace(whitener.noise, white=np.array(white), growth=growth, running=running)


@dataclass(frozen=True)
class Growth:
    """How the noise of a channel grows.

    Attributes
    ----------
    growth, running : of `NoiseModel`
    white : float
        Deviation at rest of white noise whose differences are as large, spread as they are; 0: too few samples.
    """

    growth: float = 0.0
    running: float = 1.0
    white: float = 0.0


def growth_of(residuals: FloatArray, whitener: Whitener, j: int, sharp: BoolArray, *, step: float = 0.0) -> Growth:
    """Return how a channel's noise grows, from second differences.

    Second differences contain the noise and hardly any misfit, so that transients can be used, but for their first
    part. Their size is estimated by Student's t, on which outliers have little influence.

    Parameters
    ----------
    sharp : (rows,) array
        First parts of transients.
    step : float
        By which the sensor resolves the channel; 0: it is fine. Differences of a level are whole steps, and their
        median is up to half as large again, or as small, as that of a signal that moves with the same noise: all
        samples are spread over a step.
    """
    sizes, levels, moves = [], [], []
    for clock in whitener.clocks:
        x, known = residuals[clock.rows], whitener.present[clock.rows, j] & ~sharp[clock.rows]
        if len(x) < 3:
            continue
        told = known[2:] & known[1:-1] & known[:-2]
        sizes.append(_second_differences(x)[told])
        levels.append(whitener.level[clock.rows, j][1:-1][told])
        moves.append(whitener.moving[clock.rows][1:-1][told])
    if silent := _is_silent(sizes, moves):  # all others are of a signal that moves
        sizes, levels = ([own[there] for own, there in zip(all_, moves, strict=True)] for all_ in (sizes, levels))
    elif step:
        rng = np.random.default_rng(0)
        sizes = [own + step * _second_differences(rng.random(len(own) + 2)) for own in sizes]
    d, level = np.concatenate([*sizes, np.zeros(0)]), np.concatenate([*levels, np.zeros(0)])
    runs = np.ones(len(d), dtype=bool) if silent else np.concatenate([*moves, np.zeros(0, dtype=bool)])
    if len(d) > 2 * DIFFERENCES:
        stride = len(d) // DIFFERENCES
        d, level, runs = d[::stride], level[::stride], runs[::stride]
    if len(level) < 2 * LOUD_SAMPLES or not np.any(d):
        return Growth()
    return _Differences(np.abs(d), level, runs).growth()


class _Differences:
    """Sizes of second differences, the levels of their signal, and whether the machine runs, all (n,)."""

    def __init__(self, sizes: FloatArray, level: FloatArray, runs: BoolArray) -> None:
        self.sizes, self.level, self.runs = sizes, level, runs
        self.squares, self.powers = sizes * sizes, level * level
        self.floor = 1e-3 * median(sizes[sizes != 0])

    def growth(self) -> Growth:
        """Return the growth of the largest likelihood, where that falls enough."""
        loud = float(np.sort(self.level)[-LOUD_SAMPLES])
        grows = np.count_nonzero(self.level < loud / 2) >= LOUD_SAMPLES
        louder, power = self._louder()
        if not grows and louder == 1.0:
            return self._of(0.0, 1.0)

        def beside(c: FloatArray) -> FloatArray:  # what is left of the ratio beside a growth
            return np.sqrt(np.maximum(louder**2 - c**2 * power, FAINTEST**2))

        coarse = np.geomspace(0.3, 300.0, 16) / loud if grows else np.zeros(0)
        ends = [(np.zeros(1), np.ones(1)), (coarse, np.ones_like(coarse))]
        if louder != 1.0:
            ends += [(np.zeros(1), np.array([louder])), (coarse, beside(coarse))]
        c, s = (np.concatenate([own[k] for own in ends]) for k in (0, 1))
        charge = CHARGE * ((c > 0) + (s != 1.0).astype(float))
        reached = self._misfits(c, s)
        if reached[0] - np.min(reached[1:] + HOPELESS * charge[1:]) <= 0:
            return self._of(0.0, 1.0)
        k = int(np.argmin(reached + charge))
        best, many = (float(reached[k]), float(c[k]), float(s[k])), float(charge[k]) or CHARGE
        for _ in range(2 if s[k] != 1.0 else 1):
            around = np.geomspace(0.7, 1.43, 9)
            tried = [(best[1] * around, np.full(9, best[2]))] if best[1] > 0 else []
            tried += [(np.full(9, best[1]), best[2] * around)] if s[k] != 1.0 else []
            for fine, own in tried:
                fell = self._misfits(fine, own)
                m = int(np.argmin(fell))
                best = min(best, (float(fell[m]), float(fine[m]), float(own[m])))
        return self._of(*best[1:]) if reached[0] - best[0] > many else self._of(0.0, 1.0)

    def _louder(self) -> tuple[float, float]:
        """Return how much larger differences are where the machine runs and its signal is small, and its power there.

        1 where that is chance, or rest is not shown.
        """
        at_rest = self.sizes[~self.runs]
        if len(at_rest) < LOUD_SAMPLES or np.count_nonzero(self.runs) < 2 * LOUD_SAMPLES:
            return 1.0, 0.0
        quiet = self.runs & (self.level <= median(self.level[self.runs]))
        running = self.sizes[quiet]
        ratio = max(median(running), self.floor) / max(median(at_rest), self.floor)
        error = MEDIAN_ERROR * np.sqrt(1 / len(at_rest) + 1 / len(running))
        return (ratio if abs(np.log(ratio)) > RUNS_LOUDER * error else 1.0), float(median(self.powers[quiet]))

    def _of(self, c: float, s: float) -> Growth:
        unit = max(median(self.sizes / np.sqrt(self._grown(c, s))) / T_MEDIAN, self.floor)
        return Growth(c, s, unit * T_MEDIAN / MEDIAN_SIZE / SECOND_DIFFERENCE)

    def _grown(self, c: float, s: float) -> FloatArray:
        return np.where(self.runs, s * s, 1.0) + c * c * self.powers

    def _misfits(self, c: FloatArray, s: FloatArray) -> FloatArray:
        """Return -2 log L of Student's t, up to a constant, of several growths."""
        together, found = max(1, TOGETHER // len(self.sizes)), []
        for k in range(0, len(c), together):
            some, own = c[k : k + together], s[k : k + together]
            g = np.where(self.runs, (own * own)[:, None], 1.0) + (some * some)[:, None] * self.powers
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
