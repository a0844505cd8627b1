"""CMA-ES as a search of fmu-estimator, from a package of its own."""

import cma
import numpy as np

from estimator.estimating.optimiser import Optimiser


class CmaEs(Optimiser):
    """Covariance matrix adaptation (Hansen & Ostermeier 2001) by the package cma."""

    def __init__(self, first, *, rng):
        super().__init__(first, rng=rng)
        options = {"bounds": [0, 1], "popsize": len(first), "verbose": -9, "verb_log": 0}
        options |= {"seed": np.nan, "randn": lambda n, d: rng.standard_normal((n, d))}  # of ours alone
        self._search = cma.CMAEvolutionStrategy(first[0], 0.25, options)
        self._best, self._best_cost = self.points[0], np.inf

    @property
    def best(self):
        return self._best

    @property
    def best_cost(self):
        return self._best_cost

    def ask(self):
        self.points = np.array(self._search.ask())
        return self.points, np.full(len(self.points), np.inf)  # all are ranked: none may be cut short

    def tell(self, points, costs):
        self.costs = costs
        self._search.tell(list(points), np.where(np.isfinite(costs), costs, 1e300).tolist())
        if costs.min() < self._best_cost:
            self._best, self._best_cost = points[costs.argmin()], float(costs.min())
        self.done = bool(self._search.stop())
