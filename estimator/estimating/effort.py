"""How much a method searches: nests, generations, simulations. Knows the plan only."""

from __future__ import annotations

from estimator.estimating.baselines import DIRECT, POPULATION
from estimator.plans.plan import Plan

PAPER_NESTS, PAPER_GENERATIONS = 400, 100
NESTS, GENERATIONS = 10, 8  # of the default
POLISHING = 130  # simulations that usually follow the default's search: polish, nuisances, checks
EVOLVED = 200  # generations that differential evolution usually takes


def nests_and_generations(plan: Plan) -> tuple[int, int]:
    """Return the size of a cuckoo search: the case's, or the method's own."""
    search = plan.case.search
    if search.method == "cuckoo":
        return search.nests or NESTS, search.iterations or GENERATIONS
    return search.nests or PAPER_NESTS, search.iterations or PAPER_GENERATIONS


def usual_simulations(plan: Plan) -> int:
    """Return how many simulations the method takes where the model fits."""
    search = plan.case.search
    if search.method in DIRECT:
        return len(DIRECT)
    if search.method == "differential-evolution":
        return (search.nests or POPULATION * len(plan.names)) * (1 + (search.iterations or EVOLVED))
    nests, generations = nests_and_generations(plan)
    return nests * (1 + 2 * generations) + (POLISHING if search.method == "cuckoo" else 2)
