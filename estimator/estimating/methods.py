"""The methods besides the default: the paper's two searches, solvers without a search, differential evolution.

None of them ends in a polish, so none gives standard errors.
"""

from __future__ import annotations

import numpy as np

from estimator.estimating.baselines import direct_values
from estimator.estimating.cuckoo import CuckooSearch
from estimator.estimating.differential_evolution import DifferentialEvolution
from estimator.estimating.effort import EVOLUTIONS, POPULATION, nests_and_generations
from estimator.estimating.ending import finish, refused
from estimator.estimating.run import Run
from estimator.plans.space import Space, paper_space
from estimator.results.result import Estimate

ALPHA = 0.01  # Rodríguez-Abreo et al. 2021: size of the Lévy flights


def paper(run: Run) -> Estimate:
    """Search as the paper does, to the letter; no polish."""
    box = run.problem.box
    nests, generations = nests_and_generations(run.plan)
    run.probe(box.from_cube(np.full(box.dimension, 0.5)))
    run.account.enter("search")
    space = paper_space(run.plan, box) if run.method == "paper" else Space.full(box)
    first = run.rng.random((nests, space.box.dimension))
    if space.redraw is not None:
        first = space.redraw(first, run.rng)
    cuckoo = CuckooSearch(first, rng=run.rng, alpha=ALPHA, redraw=space.redraw)
    return finish(run, run.search(cuckoo, space, generations), None)


def direct(run: Run) -> Estimate:
    """Solve for the parameters without a search: `integral`, `steiglitz-mcbride`."""
    values = direct_values(run.plan, {name: deviation for name, (deviation, _) in run.noise.items()})
    if isinstance(values, str):
        return refused(run, [values])
    run.account.enter("probe")
    if run.problem.trajectories(values[None, :]).failed[0]:
        run.all_failed()
    return finish(run, values, None)


def evolution(run: Run) -> Estimate:
    """Search by differential evolution over all free parameters; no polish."""
    box, search = run.problem.box, run.plan.case.search
    run.probe(box.from_cube(np.full(box.dimension, 0.5)))
    run.account.enter("search")
    first = run.rng.random((search.nests or POPULATION * box.dimension, box.dimension))
    optimiser = DifferentialEvolution(first, rng=run.rng)
    return finish(run, run.search(optimiser, Space.full(box), search.iterations or EVOLUTIONS), None)
