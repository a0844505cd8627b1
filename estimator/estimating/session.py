"""One estimation under way: what a method works with, and the searches that it runs. Knows no method and no verdict."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from estimator.errors import SimulationError
from estimator.estimating.account import Account
from estimator.estimating.optimiser import Optimiser
from estimator.estimating.progress import Progress
from estimator.estimating.search import SearchRecord, run_search
from estimator.fitting.problem import Problem
from estimator.fmus.failing import with_cause
from estimator.fmus.workers import Workers
from estimator.judging.identifiability import Identifiability
from estimator.plans.plan import Plan
from estimator.plans.space import Space

FloatArray = NDArray[np.float64]


class Session:
    """What a method works with: the plan, the problem, the random numbers, the account.

    Parameters
    ----------
    plan : Plan
    crew : Workers
    progress, tell, bounded, profile
        As `estimator.estimating.estimate.estimate`.

    Attributes
    ----------
    problem : Problem
        From `beginning.begin` on.
    noise : output → (deviation of its noise, deviation of the signal)
        As the data show them; from `beginning.begin` on.
    jumping : parameters that make the outputs jump, so that differences are no derivatives
    fitted : parameter → value, SI
        What the method ended with, which a refused estimate does not show.
    """

    problem: Problem

    def __init__(
        self,
        plan: Plan,
        crew: Workers,
        *,
        progress: Callable[[Progress], None] | None,
        bounded: bool,
        tell: Callable[[str], None] | None = None,
        profile: bool = False,
    ) -> None:
        self.plan, self.crew, self.bounded, self.profile, self.tell = plan, crew, bounded, profile, tell
        self.method = plan.case.search.method
        self.rng = np.random.default_rng(plan.case.search.seed)
        self.account = Account(crew, progress)
        self.record = SearchRecord()
        self.announced: tuple[str, ...] = ()
        self.identifiability = Identifiability()
        self.jumping: tuple[str, ...] = ()
        self.noise: dict[str, tuple[float, float]] = {}
        self.fitted: dict[str, float] = {}

    def on(self, plan: Plan) -> Session:
        """Return the same session on a part of its plan's rows: one account, one sequence of random numbers."""
        part = copy.copy(self)
        part.plan = plan
        part.problem = Problem(plan, self.crew, sigma=self.problem.sigma, keep_counts=True)
        return part

    @property
    def start(self) -> FloatArray:
        """Where to begin, (p,): the data's guess, and the middle of the bounds where there is none."""
        middle = self.problem.box.from_cube(np.full(self.problem.box.dimension, 0.5))
        return np.array([m if p.start is None else p.start for p, m in zip(self.plan.parameters, middle, strict=True)])

    def search(self, optimiser: Optimiser, space: Space, generations: int, *, enough: float = -np.inf) -> FloatArray:
        """Run a search, to a cost that is enough; return its best candidate, (p,)."""

        def costs(points: FloatArray, bounds: FloatArray) -> FloatArray:
            return self.problem.costs(space.values(points), bounds)

        def on_generation(search: Optimiser, generation: int) -> None:
            known = self.account.standing.best_cost
            if known is None or search.best_cost < known:
                self.account.found(self.plan.names, space.values(search.best[None, :])[0], search.best_cost)
            self.account.tell()

        run_search(
            optimiser,
            costs,
            generations=generations,
            record=self.record,
            stop=lambda search, _: search.best_cost <= enough,
            bounded=self.bounded,
            on_generation=on_generation,
        )
        if not np.isfinite(optimiser.best_cost):
            self.all_failed()
        return np.asarray(space.values(optimiser.best[None, :])[0])

    def probe(self, start: FloatArray) -> None:
        """Simulate the start once: an FMU that cannot do this cannot be searched."""
        self.account.enter("probe")
        failed = self.problem.trajectories(start[None, :]).failed
        if failed[0]:
            middle = self.problem.box.from_cube(self.rng.random((20, self.problem.box.dimension)))
            if self.problem.trajectories(middle).failed.all():
                self.all_failed()

    def all_failed(self) -> NoReturn:
        """Say that no candidate can be simulated, and why."""
        description = self.plan.description
        known = [with_cause(f, description, self.problem.values.names) for f in self.crew.failures[:1]]
        why = known[0] if known else "no reason is known"
        raise SimulationError(f"every simulation of {description.path.name} failed: {why}")
