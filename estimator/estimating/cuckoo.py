"""Cuckoo search over the unit cube, by ask and tell. Knows numpy only: nothing of motors or FMUs.

Yang & Deb, "Cuckoo search via Lévy flights", 2009, in the form of their published code, which is also the form that
reproduces the motor paper's tables: both phases touch every nest, and each egg competes with its own nest only.

    generation:  flight      s + α·L∘(s − best)∘n          L Lévy, n normal, per entry      → keep the better
                 discovery   s + r·(s_a − s_b)∘k            r uniform, one a generation;     → keep the better
                             k = 1 with probability 1 − Pa per entry; a, b random permutations

Typical values: 15 to 400 nests, Pa 0.25, α 0.01 (the published code) to 1, β 1.5.

An egg matters only if it costs no more than its nest, so `ask` also gives each egg's bound: a simulation may stop
once it costs more. The path of the search is the same with and without.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.estimating.optimiser import Optimiser

FloatArray = NDArray[np.float64]
Redraw = Callable[[FloatArray, np.random.Generator], FloatArray]


def levy_scale(beta: float) -> float:
    """Return the scale of the normal numerator that makes a Lévy step (Mantegna 1994, eq. 7)."""
    numerator = math.gamma(1 + beta) * math.sin(math.pi * beta / 2)
    denominator = math.gamma((1 + beta) / 2) * beta * 2 ** ((beta - 1) / 2)
    return float((numerator / denominator) ** (1 / beta))


class CuckooSearch(Optimiser):
    """The nests and their next eggs; see `Optimiser`. A generation asks twice: flight and discovery.

    Parameters
    ----------
    first : (n, d) array
        First nests, in the unit cube.
    rng : numpy Generator
        The only source of randomness.
    pa : float
        Probability that an entry of a nest is left alone by discovery.
    alpha, beta : float
        Scale and exponent of the Lévy flights.
    redraw : callable, optional
        Replaces eggs that are not allowed: (n, d) eggs, rng → (n, d) eggs.
    """

    asks = 2

    def __init__(
        self,
        first: FloatArray,
        *,
        rng: np.random.Generator,
        pa: float = 0.25,
        alpha: float = 0.01,
        beta: float = 1.5,
        redraw: Redraw | None = None,
    ) -> None:
        super().__init__(first, rng=rng)
        self._pa, self._alpha, self._beta = pa, alpha, beta
        self._sigma = levy_scale(beta)
        self._redraw = redraw
        self._phase = -1  # -1: the first nests; 0: flight; 1: discovery

    @property
    def nests(self) -> FloatArray:
        """The points, by the name that they have here."""
        return self.points

    def ask(self) -> tuple[FloatArray, FloatArray]:
        """Return the next eggs, (n, d) in the unit cube, and the bound of each, (n,)."""
        if self._phase < 0:
            return self.nests.copy(), self.costs.copy()
        eggs = np.clip(self._flight() if self._phase == 0 else self._discovery(), 0.0, 1.0)
        if self._redraw is not None:
            eggs = self._redraw(eggs, self.rng)
        return eggs, self.costs.copy()

    def tell(self, eggs: FloatArray, costs: FloatArray) -> None:
        """Take the eggs of the last `ask` with their costs, (n,); infinity where cut short or failed."""
        better = costs <= self.costs
        self.points[better] = eggs[better]
        self.costs[better] = costs[better]
        self._phase = 0 if self._phase < 0 else 1 - self._phase

    def _flight(self) -> FloatArray:
        shape = self.nests.shape
        u = self.rng.standard_normal(shape) * self._sigma
        v = self.rng.standard_normal(shape)
        step = u / np.abs(v) ** (1 / self._beta)
        return self.nests + self._alpha * step * (self.nests - self.best) * self.rng.standard_normal(shape)

    def _discovery(self) -> FloatArray:
        n = len(self.nests)
        moved = self.rng.random(self.nests.shape) > self._pa
        difference = self.nests[self.rng.permutation(n)] - self.nests[self.rng.permutation(n)]
        return np.asarray(self.nests + self.rng.random() * difference * moved)
