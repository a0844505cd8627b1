"""What every search is: points of the unit cube, asked for and told what they cost. Knows no motor and no FMU."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Optimiser(ABC):
    """A minimiser over the unit cube, by ask and tell: it proposes points, and is told their costs.

    Parameters
    ----------
    first : (n, d) array
        Where it may begin, in the unit cube; the first row is the best guess.
    rng : numpy Generator
        The only source of randomness: same seed, same search.

    Attributes
    ----------
    points : (n, d) array
        The points that it holds now.
    costs : (n,) array
        What they cost; infinity where that is not known yet, or the simulation failed.
    asks : int
        How often it asks in one generation, after the first points.
    done : bool
        It has nothing more to ask for.
    """

    asks = 1
    done = False

    def __init__(self, first: FloatArray, *, rng: np.random.Generator) -> None:
        self.points = np.array(first, dtype=float)
        self.costs = np.full(len(self.points), np.inf)
        self.rng = rng

    @property
    def best(self) -> FloatArray:
        """The best point, (d,)."""
        return np.asarray(self.points[int(np.argmin(self.costs))])

    @property
    def best_cost(self) -> float:
        """Cost of the best point."""
        return float(np.min(self.costs))

    @abstractmethod
    def ask(self) -> tuple[FloatArray, FloatArray]:
        """Return the next points, (n, d) in the unit cube, and the bound of each, (n,).

        A simulation may stop once it costs more than its bound; its cost is infinity then. Give infinity as the bound
        where any cost matters.
        """

    @abstractmethod
    def tell(self, points: FloatArray, costs: FloatArray) -> None:
        """Take the points of the last `ask` with their costs, (n,); infinity where cut short or failed."""
