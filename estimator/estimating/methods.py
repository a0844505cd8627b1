"""The methods besides the default: the paper's two searches, solvers without a search, differential evolution.

None of them ends in a polish, so none gives standard errors.
"""

from __future__ import annotations

import numpy as np

from estimator.estimating.baselines import direct_values
from estimator.estimating.cuckoo import CuckooSearch
from estimator.estimating.differential_evolution import DifferentialEvolution
from estimator.estimating.effort import EVOLUTIONS, POPULATION, nests_and_generations, usual_simulations
from estimator.estimating.ending import finish, refused
from estimator.estimating.session import Session
from estimator.plans.space import Space, paper_space
from estimator.results.result import Estimate

ALPHA = 0.01  # Rodríguez-Abreo et al. 2021: size of the Lévy flights


def paper(session: Session) -> Estimate:
    """Search as the paper does, to the letter; no polish."""
    box = session.problem.box
    nests, generations = nests_and_generations(session.plan)
    session.probe(box.from_cube(np.full(box.dimension, 0.5)))
    session.account.enter("search")
    session.account.expect(usual_simulations(session.plan))
    space = paper_space(session.plan, box) if session.method == "paper" else Space.full(box)
    first = session.rng.random((nests, space.box.dimension))
    if space.redraw is not None:
        first = space.redraw(first, session.rng)
    cuckoo = CuckooSearch(first, rng=session.rng, alpha=ALPHA, redraw=space.redraw)
    return finish(session, session.search(cuckoo, space, generations), None)


def direct(session: Session) -> Estimate:
    """Solve for the parameters without a search: `integral`, `steiglitz-mcbride`."""
    values = direct_values(session.plan, {name: deviation for name, (deviation, _) in session.noise.items()})
    if isinstance(values, str):
        return refused(session, [values])
    session.account.enter("probe")
    if session.problem.trajectories(values[None, :]).failed[0]:
        session.all_failed()
    return finish(session, values, None)


def evolution(session: Session) -> Estimate:
    """Search by differential evolution over all free parameters; no polish."""
    box, search = session.problem.box, session.plan.case.search
    session.probe(box.from_cube(np.full(box.dimension, 0.5)))
    session.account.enter("search")
    session.account.expect(usual_simulations(session.plan))
    first = session.rng.random((search.nests or POPULATION * box.dimension, box.dimension))
    optimiser = DifferentialEvolution(first, rng=session.rng)
    return finish(session, session.search(optimiser, Space.full(box), search.iterations or EVOLUTIONS), None)
