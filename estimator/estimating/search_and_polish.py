"""The default method: a short search seeded from the data, a polish, the measurement chain, and again if that is poor.

Few nests on logarithmic scales search first; all free parameters are then polished by weighted least squares, and what
the bench adds is found (explaining/explained.py). Where that does not hold, it searches wider before it believes that
the model is wrong.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.cases.starts import values_of
from estimator.conventions import MISFIT, NUMERICAL
from estimator.estimating.cuckoo import CuckooSearch
from estimator.estimating.effort import nests_and_generations
from estimator.estimating.ending import finish
from estimator.estimating.multistart import many_starts, needs_many
from estimator.estimating.optimiser import Optimiser
from estimator.estimating.session import Session
from estimator.explaining.adequacy import Adequacy
from estimator.explaining.effects import known_effects
from estimator.explaining.explained import Explained, explain
from estimator.explaining.explanation import Explanation
from estimator.fitting.least_squares import LeastSquares
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.problem import SIGMA_FLOOR
from estimator.fitting.whole_fits import WholeFits
from estimator.method_names import CUCKOO, loaded
from estimator.motor.names import MOTOR
from estimator.plans.parameters import Box
from estimator.plans.part import part_of
from estimator.plans.space import Space, reduced_space, steady_state
from estimator.results.result import Estimate

FloatArray = NDArray[np.float64]

ALPHA = 1.0  # size of the Lévy flights
WIDER = ((30, 40), (60, 100))  # nests, generations of the searches that follow a poor polish
STARTS, POLISHED = 400, 12  # where few samples show the transient; of these, and of many of the user's, are polished
TRIED = 20  # simulations of the residuals by which a start is to come below the best: few need more than ten
NARROWINGS, NARROWED = 4, 0.2  # searches where the outputs jump; each over so much of the last one's bounds
BETTER = 0.999  # of the cost: less of an improvement is none
START_L = 5.0  # times h R: start of L that cures the spurious optimum L → 0


def search_and_polish(session: Session) -> Estimate:
    """Search, polish, refine, and judge."""
    attempts = _Attempts(session)
    session.probe(session.start)
    return attempts.best()


class _Attempts:
    """The fits of one estimation, and how they compare; `briefly`: for a start, without rivals."""

    def __init__(self, session: Session, *, briefly: bool = False) -> None:
        self.briefly = briefly
        self.session, self.problem, self.plan = session, session.problem, session.plan
        self._search: Callable[..., Optimiser] = partial(CuckooSearch, alpha=ALPHA)
        if session.method != CUCKOO:
            self._search = loaded(session.method)
        self.squares = LeastSquares(
            session.problem.residuals,
            session.problem.box,
            output=session.problem.output_of_residual,
            spread=session.problem.spread,
            loss=session.plan.case.search.loss,
            whole=WholeFits(session.problem).fits,
        )
        noise = np.array([session.noise[y][0] for y in session.problem.outputs])
        self.floor = np.maximum(noise, 1e-12 * session.problem.spread)
        self.sigma = np.maximum(self.floor, SIGMA_FLOOR * session.problem.spread)

    def best(self) -> Estimate:
        """Return the estimate of the best fit."""
        polish, explained = self._of_a_part() or self.found()
        session = self.session
        if explained is None:
            session.account.found(self.plan.names, polish.values, self._cost_at(polish))
            return finish(session, polish.values, polish, noise=self.floor)
        session.account.found(explained.plan.names, explained.polish.values, explained.polish.cost)
        return finish(session, explained.polish.values, explained.polish, noise=self.floor, explained=explained)

    def _of_a_part(self) -> tuple[LeastSquaresFit, Explained | None] | None:
        """Return the best fit, found from the first rows of long recordings; None where these are not enough."""
        session = self.session
        part = None if session.jumping else part_of(self.plan)
        if part is None:
            return None
        polish, known = _Attempts(session.on(part), briefly=True).found()
        if known is None:
            return self._polished(polish.values), None
        values = known.fit.values[: len(self.plan.names)]
        deviations, at_bound = self.squares.deviations(values), self.squares.at_bound(values)
        polish = dataclasses.replace(polish, values=values, deviations=deviations, at_bound=at_bound)
        good = not _is_poor(known.adequacy)
        explained = self._explained(
            polish, session.start, known=known.explanation, is_wanted=lambda checked: not (good and _is_poor(checked))
        )
        return None if explained is None or (good and _is_poor(explained.adequacy)) else (polish, explained)

    def found(self) -> tuple[LeastSquaresFit, Explained | None]:
        """Return the best fit and what it finds of the bench; None where it is exact."""
        session, box, start = self.session, self.problem.box, self.session.start
        given = self._given_starts(start)
        steady = steady_state(self.plan)
        space = reduced_space(self.plan, box, steady) or Space.full(box)
        enough = MISFIT**2 * len(self.problem.output_of_residual) if self._is_usual() else -np.inf
        polish = self._polished(self._searched(space, start, *nests_and_generations(self.plan), enough=enough))
        if any(spec.start is not None for spec in self.plan.case.parameters.values()):  # whatever the search says
            given = [start, *given]
        for other in given:
            tried = self._polished(other)
            polish = tried if self._is_better(tried, polish) else polish
        if steady is not None and set(self.plan.names) == set(MOTOR) and needs_many(self.plan, polish):
            starts = many_starts(self.plan, polish, steady, box, count=STARTS, rng=session.rng)
            polish = self._best_of_many(polish, starts)
        for other in self._other_starts(polish, start):  # before the bench is asked: it would explain a false optimum
            if self._is_good(polish):
                break
            tried = self._polished(other)
            polish = tried if self._is_better(tried, polish) else polish
        if session.jumping:
            polish = self._across_jumps(polish)
        explained = self._explained(polish, start)
        for nests, generations in WIDER:
            if explained is None or not _is_poor(explained.adequacy):
                break
            tried = self._polished(self._searched(Space.full(box), polish.values, nests, generations))
            if not self._is_better(tried, polish):
                break
            polish, explained = tried, self._explained(tried, start)
        return polish, explained

    def _given_starts(self, start: FloatArray) -> list[FloatArray]:
        """Return the user's further starts, those of tables brought within the bounds; of many those that fit best."""
        parameters, box = self.plan.parameters, self.problem.box
        reach = {
            name: (float(low), float(high))
            for p, low, high in zip(parameters, box.lower, box.upper, strict=True)
            for name in (p.name, p.quantity)
            if name
        }
        rows = values_of(self.plan.case.search.starts, reach, self.plan.fixed)
        usual = start.tolist()
        points = [
            [row.get(p.name, row.get(p.quantity, x)) for p, x in zip(parameters, usual, strict=True)] for row in rows
        ]
        given = [np.clip(np.array(point), box.lower, box.upper) for point in points]
        if len(given) > POLISHED:
            self.session.account.enter("search")
            given = [given[k] for k in np.argsort(self.problem.costs(np.array(given)))[:POLISHED]]
        return given

    def _is_usual(self) -> bool:
        """Whether the search is the default one: whoever asks for another, or for its size, gets all of it."""
        search = self.plan.case.search
        return search.method == CUCKOO and search.nests is None and search.iterations is None

    def _searched(
        self, space: Space, start: FloatArray, nests: int, generations: int, *, enough: float = -np.inf
    ) -> FloatArray:
        """Search from nests of which a fifth lies around the start; return the best candidate.

        Parameters
        ----------
        enough : float
            A cost at which the search ends: what is left is noise, and the polish does the rest.
        """
        self.session.account.enter("search")
        rng, d = self.session.rng, space.box.dimension
        first = rng.random((nests, d))
        home = space.cube(start)
        first[0] = home
        near = max(1, nests // 5)
        first[1 : 1 + near] = np.clip(home + 0.05 * rng.standard_normal((near, d)), 0.0, 1.0)
        optimiser = self._search(first, rng=rng)
        self.session.account.expect(nests * (1 + optimiser.asks * generations))
        return self.session.search(optimiser, space, generations, enough=enough)

    def _polished(self, start: FloatArray) -> LeastSquaresFit:
        self.session.account.enter("polish")
        polish = self.squares.polish(start, self.sigma)
        self.session.account.found(self.plan.names, polish.values, self._cost_at(polish))
        return polish

    def _best_of_many(self, polish: LeastSquaresFit, starts: FloatArray) -> LeastSquaresFit:
        """Polish the best of many starts; return the most likely optimum."""
        self.session.account.enter("polish")
        problem = self.problem
        output = problem.output_of_residual
        first = problem.costs(starts[: 2 * POLISHED])  # what costs more than the best of these is not polished
        enough = np.full(
            len(starts) - len(first), np.sort(first)[min(POLISHED, len(first)) - 1]
        )  # more is not polished
        costs = np.concatenate([first, problem.costs(starts[len(first) :], bounds=enough)])
        best = list(starts[np.argsort(costs, kind="stable")[:POLISHED]])
        fits = self.squares.fits(best, polish.deviations, evaluations=TRIED, tolerance=1e4, known=polish)
        ends = [values for values, _ in fits if values is not polish.values]
        if not ends:
            return polish
        deviations = self.squares.deviations_of(ends)
        found = [(_log_likelihood(output, d), values) for d, values in zip(deviations, ends, strict=True)]
        lowest, values = min(found, key=lambda f: f[0])
        if lowest >= _log_likelihood(output, polish.deviations):
            return polish
        better = self.squares.polish(values, polish.deviations)
        self.session.account.found(self.plan.names, better.values, self._cost_at(better))
        return better

    def _across_jumps(self, polish: LeastSquaresFit) -> LeastSquaresFit:
        """Search all of the bounds, then ever smaller parts of them around the best, without derivatives."""
        box, best, cost = self.problem.box, polish.values, self._cost_of(polish.values)
        reach = 0.5
        for nests, generations in WIDER[:1] * NARROWINGS:
            centre = box.to_cube(best)
            low, high = np.clip(centre - reach, 0.0, 1.0), np.clip(centre + reach, 0.0, 1.0)
            part = Box(box.from_cube(low), box.from_cube(high), box.log)
            found = self._searched(Space.full(part), best, nests, generations)
            if (reached := self._cost_of(found)) < cost:
                best, cost = found, reached
            reach *= NARROWED
        tried = self._polished(best)
        if self._cost_at(tried) > cost:
            tried = self.squares.judge(best, self.squares.deviations(best))
        return tried if self._cost_at(tried) < self._cost_at(polish) else polish

    def _cost_of(self, values: FloatArray) -> float:
        weighted = self.problem.residuals(values[None, :])[0] / self.sigma[self.problem.output_of_residual]
        return float(weighted @ weighted) if np.isfinite(weighted).all() else np.inf

    def _explained(
        self,
        polish: LeastSquaresFit,
        start: FloatArray,
        *,
        known: Explanation | None = None,
        is_wanted: Callable[[Adequacy], bool] = lambda checked: True,
    ) -> Explained | None:
        """Find what the bench adds; None where the fit is exact, so that there is nothing to explain.

        Parameters
        ----------
        known : Explanation, optional
            Of a part of the rows: the descent begins there.
        is_wanted : callable
            As `explain`.
        """
        session, problem = self.session, self.problem
        session.account.enter("nuisances")
        exact = np.all(polish.deviations < NUMERICAL * problem.spread)
        if exact and not any(o.delay for o in self.plan.observed) and not self.plan.wanted:
            return None
        held = polish.at_given_bound(self.plan)
        return explain(
            self.plan,
            session.crew,
            [polish.values, *([] if known or self._is_good(polish) else self._other_starts(polish, start))],
            sigma=problem.sigma,
            deviations=self.sigma,
            effects=() if held else known_effects(),
            enter=session.account.enter,
            known=known,
            briefly=self.briefly,
            is_wanted=is_wanted,
        )

    def _other_starts(self, polish: LeastSquaresFit, start: FloatArray) -> list[FloatArray]:
        """Return further starts: the data's guess, and for a motor one that leaves the optimum at L → 0."""
        names = self.plan.names
        if not {"L", "R"} <= set(names):
            return [start]
        again = polish.values.copy()
        again[names.index("L")] = START_L * self.plan.observed[0].recording.step * again[names.index("R")]
        if "J" in names:
            again[names.index("J")] /= 1.15
        return [np.clip(again, self.problem.box.lower, self.problem.box.upper), start]

    def _is_better(self, new: LeastSquaresFit, old: LeastSquaresFit) -> bool:
        return self._cost_at(new) < BETTER * self._cost_at(old)

    def _cost_at(self, polish: LeastSquaresFit) -> float:
        """Return a polish's cost at common deviations, so that two can be compared."""
        weighted = polish.residuals * (polish.deviations / self.sigma)[self.problem.output_of_residual]
        return float(weighted @ weighted)

    def _is_good(self, polish: LeastSquaresFit) -> bool:
        """Whether the residuals are no larger than the noise of the data."""
        allowed = np.maximum(MISFIT * self.floor, NUMERICAL * self.problem.spread)
        return bool(np.all(polish.deviations <= allowed))


def _is_poor(checked: Adequacy) -> bool:
    """Whether residuals are left that are far above their noise."""
    return any(f.what == "size" and f.excess > MISFIT for f in checked.failures)


def _log_likelihood(output: NDArray[np.int16], deviations: FloatArray) -> float:
    """Return −2 log likelihood, up to a constant, of normal noise; `output` is that of each residual."""
    counts = np.bincount(output, minlength=len(deviations))
    return float(np.sum(2 * counts * np.log(deviations)))
