"""Weighted least squares through the emulated bench itself, told which effects it has and how its noise is made.

What is not told are the sizes: each effect's are free. Its standard errors are what an estimator can hope for. An
effect that a recording cannot tell, one that the noise-free response of another motor without it fits within
`TELLING`, is left out, and that other motor's parameters are right as well: the recording tells nothing better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from emulated_bench import MODES, MOTOR, Array, Bench, Story, current_noise, measure, physics, shown
from numpy.typing import NDArray
from scipy.optimize import least_squares

TELLING = 16.0  # chi-square by which an effect has to show
GAINS = {  # of a sensor that is left out: what the motor's parameters are multiplied by
    "gain_i": {"R": -1, "L": -1, "J": 1, "B": 1},
    "gain_v": {"R": -1, "K": -1, "L": -1, "J": -1, "B": -1},
}
PRIOR = {"B_run": 0.05, "K_run": 0.003}  # how much runs of a motor differ, relative
Key = tuple[str, int]


@dataclass(frozen=True)
class Told:
    """What a recording tells: by the truth, by the motor that it cannot be told from, by a fit and its bars."""

    truth: dict[str, float]
    alike: dict[str, float]  # without the effects that cannot be told
    lower: dict[str, float]  # a parameter that changes while it is recorded is right anywhere between its ends
    upper: dict[str, float]
    value: dict[str, float]
    bar: dict[str, float]
    untold: tuple[str, ...]
    chi_square: float  # of the fit's whitened residuals, over their number


class ExactEffects:
    """One bench, its measured rows, and the residuals of any story of it."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.measured = [measure(bench, k) for k in range(len(bench.recordings))]
        self.calm = np.zeros(MODES)
        self.noisy = [(m.i, m.w) for m in self.measured]
        self.clean = [shown(bench, bench.story, k, wander=self.calm)[:2] for k in range(len(self.measured))]
        self.wander = self._wander()

    def _wander(self) -> tuple[Array, Array] | None:
        """Return what whitens the response to a wandering friction: U and 1 - 1 / sqrt(1 + s^2)."""
        blocks = []
        for k, rec in enumerate(self.bench.recordings):
            if not rec.noise.wander:
                continue
            columns = []
            for m in range(MODES):
                one = np.where(np.arange(MODES) == m, 0.1, 0.0)
                i, w, _ = shown(self.bench, self.bench.story, k, wander=one)
                di, dw = (i - self.clean[k][0]) / 0.1, (w - self.clean[k][1]) / 0.1
                columns.append(
                    np.concatenate(
                        [
                            self._white(j, di, dw) if j == k else self._white(j, 0.0, 0.0)
                            for j in range(len(self.measured))
                        ]
                    )  # fmt: skip
                )
            blocks += columns
        if not blocks:
            return None
        u, s, _ = np.linalg.svd(np.stack(blocks, axis=1), full_matrices=False)
        return u, 1.0 - 1.0 / np.sqrt(1.0 + s * s)

    def _white(self, k: int, di: Array | float, dw: Array | float) -> Array:
        """Return residuals of current and speed of one recording, white and of unit variance if the story is true."""
        rec, m = self.bench.recordings[k], self.measured[k]
        noise, rows = rec.noise, rec.rows
        di, dw = np.broadcast_to(di, rows), np.broadcast_to(dw, rows)
        sigma_i = np.sqrt(current_noise(self.bench, noise, m.true_i) ** 2 + noise.quantum**2 / 12.0 + m.moved_i**2)
        counts = self.bench.story.get(("counts", -1))
        zi = _uncoloured(di / sigma_i, noise.colour_i)[_whole(m.plain_i, noise.colour_i)]
        if not counts:
            sigma_w = np.sqrt(noise.w**2 + m.moved_w**2)
            return np.concatenate([zi, _uncoloured(dw / sigma_w, noise.colour_w)[_whole(m.plain_w, noise.colour_w)]])
        quantum = 2.0 * np.pi / counts
        turning = np.abs(m.true_w) * rec.h > 0.3 * quantum  # a count that stands still says nothing
        zw = (np.cumsum(dw) * rec.h / (quantum / np.sqrt(12.0)))[turning]
        return np.concatenate([zi, zw - (zw.mean() if len(zw) else 0.0)])

    def residual(self, story: Story, *, clean: bool, priors: tuple[Key, ...] = ()) -> Array:
        """Return whitened residuals of all recordings, measured or noise-free, then those of the priors."""
        parts = []
        for k, (i, w) in enumerate(self.clean if clean else self.noisy):
            i0, w0, _ = shown(self.bench, story, k, wander=self.calm)
            parts.append(self._white(k, i - i0, w - w0))
        z = np.concatenate(parts)
        if self.wander is not None:
            u, shrink = self.wander
            z = z - u @ (shrink * (u.T @ z))
        aims = [(story.get(key, 0.0) - (self.bench.story[key] if clean else 0.0)) / PRIOR[key[0]] for key in priors]
        return np.concatenate([z, np.array(aims)])

    def keys(self, without: tuple[str, ...]) -> tuple[tuple[Key, ...], tuple[Key, ...]]:
        """Return what is free when some effects are left out, and which of it has a prior."""
        gone = {key for name in without for key in self.bench.effects[name]}
        free = tuple((name, -1) for name in MOTOR) + tuple(key for key in self.bench.free if key not in gone)
        return free, tuple(key for key in free if key[0] in PRIOR)

    def fit(self, start: Story, without: tuple[str, ...], *, clean: bool) -> tuple[Story, Array, float]:
        """Return the story that fits best, the covariance of the motor's parameters, and chi-square."""
        free, priors = self.keys(without)
        scale = np.array([abs(start[key]) or 1.0 for key in free])

        def told(x: Array) -> Story:
            return start | {key: start[key] + float(s * dx) for key, s, dx in zip(free, scale, x, strict=True)}

        def residual(x: Array) -> Array:
            return self.residual(told(x), clean=clean, priors=priors)

        def jacobian(x: Array) -> Array:
            here = residual(x)
            steps = 1e-4 * np.eye(len(x))
            return np.stack([(residual(x + step) - here) / 1e-4 for step in steps], axis=1)

        limits = np.where([key[0] in MOTOR[:4] for key in free], -0.95, -np.inf)
        done = least_squares(residual, np.zeros(len(free)), jac=jacobian, bounds=(limits, np.inf), x_scale="jac",
                             max_nfev=25, xtol=1e-7, ftol=1e-9)  # fmt: skip
        jac = np.asarray(done.jac)
        covariance = np.linalg.pinv(jac.T @ jac, rcond=1e-14) * np.outer(scale, scale)
        return told(done.x), covariance[:5, :5], 2.0 * float(done.cost)

    def without(self, names: tuple[str, ...]) -> Story:
        """Return the true story without some effects, where a fit begins: the motor that stands for gains exactly."""
        gone = {key for name in names for key in self.bench.effects[name] if key[0] not in MOTOR}
        left = {key: value for key, value in self.bench.story.items() if key not in gone}
        left["R", -1] += sum(self.bench.story[key] for key in gone if key[0] == "Rs")
        for gain, power in GAINS.items():
            size = 1.0 + sum(self.bench.story[key] for key in gone if key == (gain, -1))
            for name, exponent in power.items():
                left[name, -1] *= size**exponent
        return left

    def shows(self, names: tuple[str, ...]) -> float:
        """Return chi-square, to first order, that the motor without some effects leaves of the noise-free response."""
        free, priors = self.keys(names)
        start = self.without(names)
        z = self.residual(start, clean=True, priors=priors)
        columns = []
        for key in free:
            step = 1e-4 * (abs(start[key]) or 1.0)
            moved = self.residual(start | {key: start[key] + step}, clean=True, priors=priors)
            columns.append((moved - z) / step * (abs(start[key]) or 1.0))
        jacobian = np.stack(columns, axis=1)
        best = np.linalg.lstsq(jacobian, -z, rcond=1e-10)[0]
        return float(np.sum((z + jacobian @ best) ** 2))

    def untold(self) -> tuple[tuple[str, ...], Story]:
        """Return the effects that the recordings cannot tell, and the story without them that fits as well."""
        shaping = [n for n, keys in self.bench.effects.items() if any(key[0] not in MOTOR for key in keys)]
        weak = sorted((chi, name) for name in shaping if (chi := self.shows((name,))) < 25.0 * TELLING)
        left: tuple[str, ...] = ()
        story = self.bench.story
        for _, name in weak:
            trial, _, chi = self.fit(self.without((*left, name)), (*left, name), clean=True)
            if chi < TELLING:
                left, story = (*left, name), trial
        return left, story

    def tell(self) -> Told:
        """Return what the recordings tell."""
        truth = {name: self.bench.story[name, -1] for name in MOTOR}
        left, alike = self.untold()
        found, covariance, chi = self.fit(alike, left, clean=False)
        rows = len(self.residual(alike, clean=False))
        lower, upper = _ends(self.bench, truth)
        bars = dict(zip(MOTOR, map(float, np.sqrt(np.diag(covariance))), strict=True))
        alike_values, values = ({name: story[name, -1] for name in MOTOR} for story in (alike, found))
        return Told(truth, alike_values, lower, upper, values, bars, left, chi / rows)


def _uncoloured(z: Array, colour: float) -> Array:
    if not colour:
        return z
    white: Array = np.r_[z[:1], (z[1:] - colour * z[:-1]) / np.sqrt(1.0 - colour**2)]
    return white


def _whole(plain: NDArray[np.bool_], colour: float) -> NDArray[np.bool_]:
    """Return the rows whose white residual is of plain rows alone."""
    return plain & np.r_[True, plain[:-1]] if colour else plain


def _ends(bench: Bench, truth: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the least and the greatest value that each parameter has while it is recorded."""
    lower, upper = dict(truth), dict(truth)
    runs = range(len(bench.recordings))
    of = bench.story.get
    heat = max((of(("heat", -1), 0.0) * float(physics(bench, bench.story, k)[0][-1, 4]) for k in runs), default=0.0)
    upper["R"] *= 1.0 + heat
    ratios = [((1.0 + of(("B_run", k), 0.0)), 1.0 - of(("drift", k), 0.0)) for k in runs]
    lower["B"] *= min(run * lost for run, lost in ratios)
    upper["B"] *= max(run for run, _ in ratios)
    lower["K"] *= 1.0 + min(of(("K_run", k), 0.0) for k in runs)
    upper["K"] *= 1.0 + max(of(("K_run", k), 0.0) for k in runs)
    return lower, upper
