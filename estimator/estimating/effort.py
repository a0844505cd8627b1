"""How much a method searches: nests, generations, simulations. Knows the plan only."""

from __future__ import annotations

from estimator.estimating.baselines import DIRECT
from estimator.method_names import WITHOUT_POLISH
from estimator.plans.plan import Plan

PAPER_NESTS, PAPER_GENERATIONS = 400, 100
NESTS, GENERATIONS = 10, 8  # of the default
POLISHING = 130  # simulations that usually follow the default's search: polish, nuisances, checks
POPULATION, EVOLUTIONS = 15, 1000  # of differential evolution: points a parameter, generations at most
EVOLVED = 200  # generations that differential evolution usually takes


def nests_and_generations(plan: Plan) -> tuple[int, int]:
    """Return the size of a cuckoo search: the case's, or the method's own."""
    search = plan.case.search
    if search.method in WITHOUT_POLISH:
        return search.nests or PAPER_NESTS, search.iterations or PAPER_GENERATIONS
    return search.nests or NESTS, search.iterations or GENERATIONS


def usual_simulations(plan: Plan) -> int:
    """Return how many simulations the method takes where the model fits."""
    search = plan.case.search
    if search.method in DIRECT:
        return len(DIRECT)
    if search.method == "differential-evolution":
        return (search.nests or POPULATION * len(plan.names)) * (1 + (search.iterations or EVOLVED))
    nests, generations = nests_and_generations(plan)
    return nests * (1 + 2 * generations) + (2 if search.method in WITHOUT_POLISH else POLISHING)
