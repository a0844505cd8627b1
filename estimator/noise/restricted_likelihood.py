"""The restricted likelihood of a noise model, and where it is largest. Knows which numbers are free, chooses none.

Restricted: it allows for the degrees of freedom of the fitted parameters (Patterson and Thompson 1971).
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.noise.noise_model import NoiseModel
from estimator.noise.quasi_newton import minimise
from estimator.noise.whitener import Whitener

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

FloatArray = NDArray[np.float64]
Component = tuple[str, int]  # "white", "differenced", "slow" or "torque", and the channel

SHORTEST_TORQUE = 0.02  # s, correlation time of a wandering torque: shorter ones are misfits of transients
# The same, s, and the deviation of its logarithm: a normal prior. Stretches shorter than it show a random walk, as
# likely by 0.02 s as by 1 s, but the friction is known four times better by the shorter.
USUAL_TORQUE, TORQUE_SPREAD = 0.3, 1.0
THREADS, LARGE = 2, 50_000  # noise models at once; numbers in all columns, of which threads gain more than they cost
LONGEST_SLOW = 0.25  # of the longest recording: a channel's longer correlation time is a drift, no noise


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    """Return threads that stay from one likelihood to the next; a process that is forked starts its own."""
    from concurrent.futures import ThreadPoolExecutor  # loaded where it pays

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_threads.cache_clear)
    return ThreadPoolExecutor(THREADS)


class RestrictedLikelihood:
    """The restricted likelihood of noise models.

    Parameters
    ----------
    whitener : Whitener
        Of any noise model.
    stacked : (rows, q, 1 + c) array
        Residuals, then their derivatives by what is free; these are scaled in place.
    """

    def __init__(self, whitener: Whitener, stacked: FloatArray) -> None:
        norms = np.linalg.norm(stacked[:, :, 1:].reshape(-1, stacked.shape[2] - 1), axis=0)
        stacked[:, :, 1:] /= np.where(norms > 0, norms, 1.0)
        self.whitener, self.stacked = whitener, stacked
        self._counts = whitener.present.sum(axis=0)
        self._of_unit_noise: dict[bytes, tuple[FloatArray, float]] = {}  # by growth: products of each channel, logs

    def misfit(self, noise: NoiseModel) -> float:
        """Return -2 log restricted likelihood, up to a constant; inf where the noise is out of all proportion."""
        return float(self.misfits([noise])[0])

    def misfits(self, noises: Sequence[NoiseModel]) -> FloatArray:
        """Return the same of several noise models, (k,)."""
        if len(noises) > 1 and self.stacked.size >= LARGE:
            found = list(_threads().map(self._products, noises))  # whitening gives up the interpreter's lock
        else:
            found = [self._products(noise) for noise in noises]
        with np.errstate(over="ignore", invalid="ignore"):  # as those of a recording without noise may be
            return self._of_products(np.array([own for own, _ in found]), np.array([total for _, total in found]))

    def _of_products(self, products: FloatArray, values: FloatArray) -> FloatArray:
        """Return the same of scalar products, (k, 1 + c, 1 + c), and sums of log variances, (k,)."""
        values = values + products[:, 0, 0]
        sound = np.asarray(np.isfinite(products).all(axis=(1, 2)))
        if products.shape[1] > 1 and sound.any():
            information, along = products[sound, 1:, 1:], products[sound, 1:, 0]
            scale = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
            eigen, vectors = np.linalg.eigh(information / (scale[:, :, None] * scale[:, None, :]))
            seen = eigen > 1e-9
            eigen, fall = np.where(seen, eigen, 1.0), ((along / scale)[:, None] @ vectors)[:, 0] ** 2
            values[sound] += (np.log(eigen) - np.where(seen, fall, 0.0) / eigen).sum(axis=1)
            values[sound] += 2 * np.log(scale).sum(axis=1)  # log det of their information less the fall of z'z
        return np.where(sound & np.isfinite(values), values, np.inf)

    def _products(self, noise: NoiseModel) -> tuple[FloatArray, float]:
        """Return the scalar products of the whitened columns, and the sum of log variances."""
        with np.errstate(over="ignore", invalid="ignore"):  # a thread's own
            if not self._is_scale(noise):
                whitened, total = self.whitener.of(noise)(self.stacked)
                flat = whitened.reshape(-1, whitened.shape[2])
                return flat.T @ flat, total
            products, totals = self._scaled(noise, noise.white[None])
            return products[0], float(totals[0])

    def _is_scale(self, noise: NoiseModel) -> bool:
        """Whether a noise model divides each sample by its own deviation, no more."""
        return not (noise.has_state or noise.jitter or self.whitener.shared is not None)

    def _scaled(self, noise: NoiseModel, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the same, (k, 1 + c, 1 + c) and (k,), of k deviations of each channel, (k, q), that grow alike."""
        told = (noise.growth, noise.running, noise.bends)
        key = b"".join(b"" if own is None else own.tobytes() for own in told) + str(noise.stands).encode()
        key += b"".join(a.tobytes() for of_channels in noise.short for a, _ in of_channels)
        if key not in self._of_unit_noise:
            unit = self.whitener.of(dataclasses.replace(noise, white=np.ones_like(noise.white)))
            whitened, total = unit(self.stacked)
            self._of_unit_noise[key] = np.array([own.T @ own for own in whitened.transpose(1, 0, 2)]), total
        own, total = self._of_unit_noise[key]
        variance = np.maximum(white**2, 1e-300)
        logs = np.array([self._counts @ of_channels for of_channels in np.log(variance)])
        return (own / variance[:, :, None, None]).sum(axis=1), total + logs

    def largest(
        self, noise: NoiseModel, active: Sequence[Component], *, iterations: int = 12
    ) -> tuple[NoiseModel, float]:
        """Return the noise model with its active components' numbers where they are likeliest, and its misfit.

        Likeliest by the restricted likelihood, and a prior of the time in which a torque wanders.
        """
        x0 = np.array([x for c in active for x in _get(noise, c)])
        low, high = x0 - 7.0, x0 + 7.0
        whole = max(float(c.time[-1] - c.time[0]) for c in self.whitener.clocks)
        taus = np.concatenate([[False, True] if kind in ("slow", "torque") else [False] for kind, _ in active])
        wanders = taus & np.concatenate([[k == "torque"] * (2 if k in ("slow", "torque") else 1) for k, _ in active])
        low[wanders] = np.maximum(low[wanders], np.log(SHORTEST_TORQUE))
        longest = np.log(np.where(wanders, whole, LONGEST_SLOW * whole))
        high[taus] = np.maximum(np.minimum(high, longest)[taus], low[taus] + 0.1)
        high = np.maximum(high, low + 0.1)
        x0 = np.clip(x0, low, high)
        plain, channels = self._is_scale(noise) and {kind for kind, _ in active} == {"white"}, [j for _, j in active]

        def values(points: FloatArray) -> FloatArray:
            if plain:
                white = np.repeat(noise.white[None], len(points), axis=0)
                white[:, channels] = np.exp(points)
                with np.errstate(over="ignore", invalid="ignore"):
                    return self._of_products(*self._scaled(noise, white))
            times = np.exp(points[:, wanders])
            return np.asarray(self.misfits([_set(noise, active, x) for x in points]) + np.sum(unusual(times), axis=1))

        x, found = minimise(values, x0, low, high, step=1e-3, iterations=iterations, ftol=1e-6)
        return _set(noise, active, x), found


def unusual(tau: FloatArray | float) -> FloatArray:
    """Return -2 log of the prior of times, s, in which a torque wanders, up to a constant."""
    return np.asarray(((np.log(tau) - np.log(USUAL_TORQUE)) / TORQUE_SPREAD) ** 2)


def _get(noise: NoiseModel, component: Component) -> list[float]:
    kind, j = component
    if kind == "torque":
        return [float(np.log(noise.torque[0])), float(np.log(noise.torque[1]))]
    if kind == "slow":
        return np.log(noise.slow[j]).tolist()  # type: ignore[no-any-return]
    return [float(np.log(getattr(noise, kind)[j]))]


def _set(noise: NoiseModel, active: Sequence[Component], x: FloatArray) -> NoiseModel:
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
