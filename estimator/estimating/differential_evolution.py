"""Differential evolution over the unit cube, by ask and tell. Knows numpy only: nothing of motors or FMUs.

Storn & Price 1997, best/1/bin, as scipy.optimize.differential_evolution does it with updating="deferred" and without
constraints or polish: random numbers are drawn in the same order, and points are rounded alike, so that a seed gives
the same bits. scipy's calls the cost function; this one is asked and told, as every search here.

    trial  = best + F (s_a − s_b), F uniform in 0.5 to 1, one a generation; entries outside the cube are drawn anew
    child  = trial where uniform < 0.7, and in one entry at least; else its parent → keep the better of both
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.estimating.optimiser import Optimiser

FloatArray = NDArray[np.float64]

FACTOR = (0.5, 1.0)  # of the difference: uniform between
CROSSOVER = 0.7  # chance of an entry to come from the trial
TOLERANCE = 1e-8  # of the costs' deviation over their mean, to end
FAILED = 1e300  # stands for infinity where a mean is taken
LEAST = 5  # points


class DifferentialEvolution(Optimiser):
    """The population and its next children; see `Optimiser`."""

    def __init__(self, first: FloatArray, *, rng: np.random.Generator) -> None:
        super().__init__(first if len(first) >= LEAST else rng.random((LEAST, np.shape(first)[1])), rng=rng)
        self.points = np.clip(_centred(self.points), 0.0, 1.0)
        self._order = np.arange(len(self.points))
        self._begun = False

    def ask(self) -> tuple[FloatArray, FloatArray]:
        """Return the next children, (n, d), and the costs of their parents, (n,)."""
        self._trial = self._children() if self._begun else self.points
        return _centred(self._trial), self.costs.copy()

    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Keep the children that cost no more than their parents; the best comes first."""
        better = costs <= self.costs
        self.points = np.where(better[:, None], self._trial, self.points)
        self.costs = np.where(better, costs, self.costs)
        best = int(np.argmin(self.costs))
        self.points[[0, best]] = self.points[[best, 0]]
        self.costs[[0, best]] = self.costs[[best, 0]]
        known = np.where(np.isfinite(self.costs), self.costs, FAILED)
        with np.errstate(over="ignore", invalid="ignore"):
            alike = bool(np.std(known) <= TOLERANCE * np.abs(np.mean(known)))
        self.done = self._begun and (alike or not np.isfinite(self.costs).any())
        self._begun = True

    @property
    def best(self) -> FloatArray:
        """The best point, (d,)."""
        return np.asarray(_centred(self.points[0]))

    def _children(self) -> FloatArray:
        n, d = self.points.shape
        factor = self.rng.uniform(*FACTOR)
        pairs = np.array([self._others(k) for k in range(n)])
        trial = self.points[0] + factor * (self.points[pairs[:, 0]] - self.points[pairs[:, 1]])
        kept = self.rng.integers(d, size=n)
        crossed = self.rng.uniform(size=(n, d)) < CROSSOVER
        crossed[np.arange(n), kept] = True
        trial = np.where(crossed, trial, self.points)
        outside = (trial > 1) | (trial < 0)
        trial[outside] = self.rng.uniform(size=np.count_nonzero(outside))
        return np.asarray(trial)

    def _others(self, k: int) -> NDArray[np.int64]:
        """Return two points at random, neither of them k."""
        self.rng.shuffle(self._order)
        drawn = self._order[:6]
        return np.asarray(drawn[drawn != k][:2]).copy()


def _centred(points: FloatArray) -> FloatArray:
    return 0.5 + (points - 0.5)
