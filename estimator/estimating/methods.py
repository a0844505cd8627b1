"""The methods besides the default: the paper's two searches, solvers without a search, differential evolution.

None of them ends in a polish, so none gives standard errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.estimating.baselines import direct_values, evolve
from estimator.estimating.cuckoo import CuckooSearch
from estimator.estimating.effort import nests_and_generations
from estimator.estimating.run import Run
from estimator.plans.space import Space, paper_space
from estimator.results.result import Estimate

FloatArray = NDArray[np.float64]

PA, ALPHA = 0.25, 0.01  # Rodríguez-Abreo et al. 2021: chance of discovery, size of the Lévy flights


def paper(run: Run) -> Estimate:
    """Search as the paper does, to the letter; no polish."""
    box = run.problem.box
    nests, generations = nests_and_generations(run.plan)
    run.probe(box.from_cube(np.full(box.dimension, 0.5)))
    run.enter("search")
    space = paper_space(run.plan, box) if run.method == "paper" else Space.full(box)
    first = run.rng.random((nests, space.box.dimension))
    if space.redraw is not None:
        first = space.redraw(first, run.rng)
    cuckoo = CuckooSearch(first, rng=run.rng, pa=PA, alpha=ALPHA, redraw=space.redraw)
    return run.finish(run.search(cuckoo, space, generations), None)


def direct(run: Run) -> Estimate:
    """Solve for the parameters without a search: `integral`, `steiglitz-mcbride`."""
    values = direct_values(run.plan, {name: deviation for name, (deviation, _) in run.noise.items()})
    if isinstance(values, str):
        return run.refused([values])
    run.enter("probe")
    if run.problem.trajectories(values[None, :]).failed[0]:
        run.all_failed()
    return run.finish(values, None)


def evolution(run: Run) -> Estimate:
    """Search by scipy's differential evolution; no polish."""
    box, search = run.problem.box, run.plan.case.search
    run.probe(box.from_cube(np.full(box.dimension, 0.5)))
    run.enter("search")

    def on_generation(best: FloatArray, cost: float) -> None:
        run.found(run.plan.names, best, cost)
        run.tell_progress()

    values = evolve(
        run.problem.costs,
        box,
        rng=run.rng,
        population=search.nests,
        generations=search.iterations,
        on_generation=on_generation,
    )
    if not np.isfinite(run.problem.costs(values[None, :])[0]):
        run.all_failed()
    return run.finish(values, None)
