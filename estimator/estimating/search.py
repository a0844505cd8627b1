"""One search: points to costs, generation by generation. Knows an optimiser and costs, no motor and no FMU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.estimating.optimiser import Optimiser

FloatArray = NDArray[np.float64]
Costs = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass
class SearchRecord:
    """How a search went, one entry a generation: simulations so far, best, median and quartile costs."""

    simulations: list[float] = field(default_factory=list)
    best: list[float] = field(default_factory=list)
    median: list[float] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)


def run_search(
    search: Optimiser,
    costs: Costs,
    *,
    generations: int,
    record: SearchRecord,
    stop: Callable[[Optimiser, int], bool] | None = None,
    bounded: bool = True,
    on_generation: Callable[[Optimiser, int], None] | None = None,
) -> None:
    """Run a search to its end.

    Parameters
    ----------
    costs : callable
        ((n, d) points in the unit cube, (n,) bounds) → (n,) costs; infinity where cut short or failed.
    generations : int
        At most: an optimiser may be done before.
    stop : callable, optional
        Asked after every generation whether to stop.
    bounded : bool
        Give the bounds on; the path of the search is the same without.
    """
    simulations = record.simulations[-1] if record.simulations else 0.0
    for generation in range(generations + 1):
        for _ in range(1 if generation == 0 else search.asks):
            points, bounds = search.ask()
            search.tell(points, costs(points, bounds if bounded else np.full(len(points), np.inf)))
            simulations += len(points)
        record.simulations.append(simulations)
        record.best.append(search.best_cost)
        ordered = np.sort(search.costs)  # np.percentile would make NaN of infinities
        record.median.append(float(0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2])))
        record.lower.append(float(ordered[len(ordered) // 4]))
        record.upper.append(float(ordered[min(3 * len(ordered) // 4, len(ordered) - 1)]))
        if on_generation is not None:
            on_generation(search, generation)
        if search.done or (stop is not None and stop(search, generation)):
            break
