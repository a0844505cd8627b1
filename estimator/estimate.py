"""From a case to an estimate: probe, search, polish, check, judge. Knows no file format and prints nothing.

`paper` and `original` are the paper's searches to the letter, without a polish. `cuckoo`, the default, searches few
nests on logarithmic scales, seeded from the data, then polishes all free parameters by weighted least squares; where
the polish does not reach the noise of the data it searches again, wider, before it believes that the model is wrong.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.baselines import DIRECT, POPULATION, direct_values, evolve
from estimator.case import Case
from estimator.cuckoo import CuckooSearch
from estimator.derived import derived_quantities
from estimator.errors import SimulationError
from estimator.failing import with_cause, with_values
from estimator.fit import Fit, log_likelihood
from estimator.fmu import FmuDescription, describe, with_kind
from estimator.noise_level import beside_means, output_deviations
from estimator.nuisance import Refinement
from estimator.outcome import comparisons, correlation, figures, parameter_estimates, recordings, sensors, versions
from estimator.plan import MOTOR, Plan
from estimator.planning import plan_case
from estimator.polish import LeastSquares, Polish
from estimator.probe import driven
from estimator.problem import SIGMA_FLOOR, Problem
from estimator.profile import cost_profiles
from estimator.progress import Progress
from estimator.recording import Recording
from estimator.refusal import lost_transients, refusal, refused_notes
from estimator.result import Estimate, ParameterEstimate, SearchHistory
from estimator.search import SearchRecord, run_search
from estimator.space import Space, paper_space, reduced_space, steady_state
from estimator.starts import many_starts, needs_many
from estimator.step_check import step_check
from estimator.structure import Structure, structure
from estimator.trial import announcement, unmoved
from estimator.validation import validated
from estimator.verdict import Judgement, judge
from estimator.winding import cold_resistances
from estimator.workers import TIME_LIMIT, Workers

FloatArray = NDArray[np.float64]

PAPER_NESTS, PAPER_GENERATIONS, PAPER_PA, PAPER_ALPHA = 400, 100, 0.25, 0.01
NESTS, GENERATIONS, PA, ALPHA = 10, 8, 0.25, 1.0
POLISHING = 130  # simulations that usually follow the search: polish, nuisances, checks
EVOLVED = 200  # generations that differential evolution usually takes
WIDER = ((30, 40), (60, 100))  # nests, generations of the searches that follow a poor polish
STARTS, POLISHED = 400, 12  # where few samples tell the transient; of these are polished
POOR_FIT = 1.5  # residuals' deviation over the noise that the data show
NOISE_FREE = 1e-6  # of a signal's deviation: residuals below are no misfit
START_L = 5.0  # times h R: start of L that cures the spurious optimum L → 0


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during an estimation.

    Attributes
    ----------
    best : mapping of parameter → value, or None
        The best candidate so far.
    """

    def __init__(self, best: Mapping[str, float] | None) -> None:
        super().__init__("interrupted")
        self.best = best


def estimate(
    case: Case,
    *,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    time_limit: float = TIME_LIMIT,
    bounded: bool = True,
    tell: Callable[[str], None] | None = None,
    profile: bool = False,
) -> Estimate:
    """Estimate a case's free parameters.

    Parameters
    ----------
    case : Case
    workers : int, optional
        Processes that simulate; by default the cores that this process may use. The result does not depend on it.
    progress : callable, optional
        Told where the estimation stands, often.
    time_limit : float
        s that one candidate may take.
    bounded : bool
        Let a candidate stop once it can no longer replace its nest; the result is the same without.
    tell : callable, optional
        Told, in a sentence and before the search, what one simulation costs and how long the search will take, where
        that is long or the FMU is not simulated at full speed.
    profile : bool
        Simulate the cost around the optimum too, some 36 simulations a parameter; the estimate is the same without.

    Returns
    -------
    Estimate

    Raises
    ------
    InputError
        Something in the case is wrong.
    SimulationError
        The FMU fails at every start.
    Interrupted
        Ctrl-C.
    """
    count = available_cores() if workers is None else workers
    with Workers(count, time_limit=time_limit) as crew:
        return estimate_by(crew, case, progress=progress, bounded=bounded, tell=tell, profile=profile)


def estimate_recordings(
    cases: Sequence[Case],
    recordings: Sequence[Sequence[Recording]],
    *,
    workers: int | None = None,
    time_limit: float = TIME_LIMIT,
    bounded: bool = True,
) -> list[Estimate]:
    """Estimate many cases from recordings in memory, one after the other in the same worker processes.

    Parameters
    ----------
    cases : sequence of Case
        Their recordings' paths are not read.
    recordings : sequence of sequences of Recording
        One sequence a case.

    Raises
    ------
    InputError, SimulationError
        As `estimate`.
    """
    count = available_cores() if workers is None else workers
    with Workers(count, time_limit=time_limit) as crew:
        return [
            estimate_by(crew, case, recordings=measured, bounded=bounded)
            for case, measured in zip(cases, recordings, strict=True)
        ]


def estimate_by(
    crew: Workers,
    case: Case,
    *,
    description: FmuDescription | None = None,
    recordings: Sequence[Recording] | None = None,
    progress: Callable[[Progress], None] | None = None,
    bounded: bool = True,
    tell: Callable[[str], None] | None = None,
    profile: bool = False,
) -> Estimate:
    """Estimate one case by worker processes that are there already, for whoever has many cases.

    Parameters
    ----------
    crew : Workers
        After an error it may be in any state: close it and take another.
    description : FmuDescription, optional
        Of the case's FMU, if it is known.
    recordings : sequence of Recording, optional
        Instead of reading the case's.
    tell, profile
        As `estimate`.

    Raises
    ------
    InputError, SimulationError, Interrupted
        As `estimate`.
    """
    described = driven(with_kind(description or describe(case.fmu), case.kind))
    plan = plan_case(case, described, recordings=recordings)
    found = _Estimation(plan, crew, progress=progress, bounded=bounded, tell=tell, profile=profile).run()
    count = len(case.recordings if recordings is None else recordings)
    apart = [k for k in range(count) if case.run(k).validate]
    if not apart:
        return found
    return validated(found, case, recordings=None if recordings is None else [recordings[k] for k in apart])


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Estimation:
    """One estimation under way."""

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
        self.tell = tell
        self.announced: tuple[str, ...] = ()
        self.structure = Structure()
        self.started = time.monotonic()
        self.profile = profile
        self.plan, self.crew, self.progress, self.bounded = plan, crew, progress, bounded
        self.method = plan.case.search.method
        self.rng = np.random.default_rng(plan.case.search.seed)
        self.phases: dict[str, int] = {}
        self.phase = ""
        self.counted = 0
        self.loaded = False
        self.expected: int | None = None
        self.best: FloatArray | None = None
        self.best_cost = np.inf
        self.record = SearchRecord()

    def run(self) -> Estimate:
        """Run the method, and account for it."""
        plan = self.plan
        reasons = refusal(plan)
        if self.method != "cuckoo":
            reasons += lost_transients(plan)
        if reasons:
            return self._result(None, None, Judgement("refused", tuple(reasons), {}, refused_notes(plan)))
        noise = output_deviations(plan)
        sigma = self._sigma(noise)
        self.problem = Problem(plan, self.crew, sigma=sigma)
        self.loaded = True
        self.crew.on_tick = self._tell
        try:
            if still := self._unmoved():
                return self._result(None, None, Judgement("refused", tuple(still), {}))
            if self.method == "cuckoo":
                return self._cuckoo({name: n for name, (n, _) in noise.items()})
            if self.method in DIRECT:
                return self._direct({name: n for name, (n, _) in noise.items()})
            if self.method == "differential-evolution":
                return self._evolution()
            return self._paper()
        except KeyboardInterrupt:
            best = None if self.best is None else dict(zip(plan.names, self.best.tolist(), strict=True))
            raise Interrupted(best) from None

    def _unmoved(self) -> list[str]:
        """Return why a parameter cannot be estimated; the bundled motor's all move current and speed."""
        plan = self.plan
        probed = plan.description.probe_simulations
        if probed:
            self.phases["probe"] = probed
        if plan.description.is_bundled and {"i", "w"} <= set(plan.outputs) and set(plan.names) <= set(MOTOR):
            return []
        self._enter("probe")
        box = self.problem.box
        middle = box.from_cube(np.full(box.dimension, 0.5))
        start = np.array([m if p.start is None else p.start for p, m in zip(plan.parameters, middle, strict=True)])
        sentences, seconds = unmoved(self.problem, start)
        if not sentences and self.method == "cuckoo":
            self.structure = structure(self.problem, start)
        announced = announcement(
            seconds,
            simulations=self._usual_simulations(),
            workers=self.crew.count,
            always=not plan.description.is_fast,
        )
        if announced is not None:
            self.announced = (announced,)
            if self.tell is not None:
                self.tell(announced)
        return sentences

    def _usual_simulations(self) -> int:
        """Return how many simulations the method takes where the model fits."""
        search = self.plan.case.search
        if self.method in DIRECT:
            return len(DIRECT)
        if self.method == "differential-evolution":
            return (search.nests or POPULATION * len(self.plan.names)) * (1 + (search.iterations or EVOLVED))
        if self.method == "cuckoo":
            return (search.nests or NESTS) * (1 + 2 * (search.iterations or GENERATIONS)) + POLISHING
        return (search.nests or PAPER_NESTS) * (1 + 2 * (search.iterations or PAPER_GENERATIONS)) + 2

    # The paper's searches

    def _paper(self) -> Estimate:
        box = self.problem.box
        search = self.plan.case.search
        nests, generations = search.nests or PAPER_NESTS, search.iterations or PAPER_GENERATIONS
        self.expected = self._usual_simulations()
        self._probe(box.from_cube(np.full(box.dimension, 0.5)))
        self._enter("search")
        space = paper_space(self.plan, box) if self.method == "paper" else Space.full(box)
        first = self.rng.random((nests, space.box.dimension))
        if space.redraw is not None:
            first = space.redraw(first, self.rng)
        cuckoo = CuckooSearch(first, rng=self.rng, pa=PAPER_PA, alpha=PAPER_ALPHA, redraw=space.redraw)
        self._search(cuckoo, space, generations)
        values = space.values(cuckoo.best[None, :])[0]
        if not np.isfinite(cuckoo.best_cost):
            self._all_failed()
        return self._finish(values, None)

    # The other methods

    def _direct(self, noise: Mapping[str, float]) -> Estimate:
        values = direct_values(self.plan, noise)
        if isinstance(values, str):
            return self._result(None, None, Judgement("refused", (values,), {}))
        self._enter("probe")
        if self.problem.trajectories(values[None, :]).failed[0]:
            self._all_failed()
        return self._finish(values, None)

    def _evolution(self) -> Estimate:
        box, search = self.problem.box, self.plan.case.search
        self._probe(box.from_cube(np.full(box.dimension, 0.5)))
        self._enter("search")

        def on_generation(best: FloatArray, cost: float) -> None:
            self.best, self.best_cost = best, cost
            self._tell()

        values = evolve(
            self.problem.costs,
            box,
            rng=self.rng,
            population=search.nests,
            generations=search.iterations,
            on_generation=on_generation,
        )
        if not np.isfinite(self.problem.costs(values[None, :])[0]):
            self._all_failed()
        return self._finish(values, None)

    # The default

    def _cuckoo(self, noise: Mapping[str, float]) -> Estimate:
        problem, box, plan = self.problem, self.problem.box, self.plan
        start = np.array([p.start if p.start is not None else np.nan for p in plan.parameters])
        start = np.where(np.isnan(start), box.from_cube(np.full(box.dimension, 0.5)), start)
        self._probe(start)
        steady = steady_state(plan)
        reduced = reduced_space(plan, box, steady)
        nests, generations = plan.case.search.nests or NESTS, plan.case.search.iterations or GENERATIONS
        self.expected = self._usual_simulations()
        candidates = [self._searched(reduced or Space.full(box), start, nests, generations)]
        squares = LeastSquares(
            problem.residuals,
            box,
            output=problem.output_of_residual,
            spread=problem.spread,
            loss=plan.case.search.loss,
        )
        floor = np.array([max(noise[y], 1e-12 * s) for y, s in zip(problem.outputs, problem.spread, strict=True)])
        sigma = np.array([max(n, SIGMA_FLOOR * s) for n, s in zip(floor, problem.spread, strict=True)])
        polish = self._polished(squares, candidates, sigma)
        if steady is not None and set(plan.names) == set(MOTOR) and needs_many(plan, polish):
            polish = self._best_of_many(
                squares, polish, many_starts(plan, polish, steady, box, count=STARTS, rng=self.rng)
            )
        fit = self._refined(polish)
        for extra in self._restarts(polish, start):
            if self._is_good(fit, floor, problem.spread):
                break
            better = self._better(polish, self._polished(squares, [extra], sigma), sigma)
            if better is not polish:
                polish, fit = better, self._refined(better)
        for wider_nests, wider_generations in WIDER:
            if self._is_good(fit, floor, problem.spread) or not self._worth_searching(fit, floor):
                break
            found = self._searched(Space.full(box), polish.values, wider_nests, wider_generations)
            better = self._better(polish, self._polished(squares, [found], sigma), sigma)
            if better is polish:
                break
            polish, fit = better, self._refined(better)
        self.problem, self.plan = fit.problem, fit.problem.plan
        return self._finish(fit.polish.values, fit.polish, noise=floor, fit=fit)

    def _best_of_many(self, squares: LeastSquares, polish: Polish, starts: FloatArray) -> Polish:
        """Polish the best of many starts; return the most likely optimum."""
        self._enter("polish")
        problem = self.problem
        costs = problem.costs(starts)
        found = []
        for start in starts[np.argsort(costs)[:POLISHED]]:
            values, _ = squares.fit(start, polish.deviations, tolerance=1e4)
            found.append((log_likelihood(problem, squares.deviations(values, free=len(values))), values))
        lowest, values = min(found, key=lambda f: f[0])
        if lowest >= log_likelihood(problem, polish.deviations):
            return polish
        better = squares.polish(values, polish.deviations)
        self.best = better.values
        return better

    def _refined(self, polish: Polish) -> Fit:
        """Free the nuisances that the data show."""
        self._enter("nuisances")
        base = self.problem

        def rebuild(plan: Plan) -> Problem:
            return Problem(plan, self.crew, sigma=base.sigma, keep_counts=True)

        refinement = Refinement(rebuild)
        return refinement.run(*refinement.delayed(base, polish))

    def _searched(self, space: Space, start: FloatArray, nests: int, generations: int) -> FloatArray:
        """Search from nests of which a third lies around the start; return the best candidate."""
        self._enter("search")
        d = space.box.dimension
        first = self.rng.random((nests, d))
        home = space.cube(start)
        first[0] = home
        near = max(1, nests // 5)
        first[1 : 1 + near] = np.clip(home + 0.05 * self.rng.standard_normal((near, d)), 0.0, 1.0)
        if space.redraw is not None:
            first = space.redraw(first, self.rng)
        cuckoo = CuckooSearch(first, rng=self.rng, pa=PA, alpha=ALPHA, redraw=space.redraw)
        self._search(cuckoo, space, generations)
        if not np.isfinite(cuckoo.best_cost):
            self._all_failed()
        return np.asarray(space.values(cuckoo.best[None, :])[0])

    def _polished(self, squares: LeastSquares, starts: list[FloatArray], sigma: FloatArray) -> Polish:
        self._enter("polish")
        results = [squares.polish(start, sigma) for start in starts]
        best = min(results, key=lambda r: self._cost_at(r, sigma))
        self.best = best.values
        return best

    def _cost_at(self, polish: Polish, sigma: FloatArray) -> float:
        """Return a polish's cost at common deviations, so that two can be compared."""
        scale = (polish.deviations / sigma)[self.problem.output_of_residual]
        weighted = polish.residuals * scale
        return float(weighted @ weighted)

    def _better(self, old: Polish, new: Polish, sigma: FloatArray) -> Polish:
        return new if self._cost_at(new, sigma) < 0.999 * self._cost_at(old, sigma) else old

    def _is_good(self, fit: Fit, floor: FloatArray, spread: FloatArray) -> bool:
        """Whether the residuals are no larger than the noise of the data."""
        deviations = fit.problem.noise_shown(fit.polish.deviations)
        floor = beside_means(fit.problem.plan, floor)
        return bool(np.all(deviations <= np.maximum(POOR_FIT * floor, NOISE_FREE * spread)))

    def _worth_searching(self, fit: Fit, floor: FloatArray) -> bool:
        floor = beside_means(fit.problem.plan, floor)
        return bool(np.any(fit.problem.noise_shown(fit.polish.deviations) > POOR_FIT * floor))

    def _restarts(self, polish: Polish, start: FloatArray) -> list[FloatArray]:
        """Return further starts: the data's guess, and for a motor one that leaves the optimum at L → 0."""
        restarts = [start]
        names = self.plan.names
        if "L" in names and "R" in names:
            again = polish.values.copy()
            h = self.plan.observed[0].recording.step
            again[names.index("L")] = START_L * h * again[names.index("R")]
            if "J" in names:
                again[names.index("J")] /= 1.15
            restarts.insert(0, np.clip(again, self.problem.box.lower, self.problem.box.upper))
        return restarts

    # Common parts

    def _sigma(self, noise: Mapping[str, tuple[float, float]]) -> dict[str, float]:
        """Return the deviations that weigh the outputs in the search: the paper divides by the signals' own."""
        result = {}
        for name, (deviation, spread) in noise.items():
            if spread == 0:
                spread = 1.0
            result[name] = spread if self.method in ("paper", "original") else max(deviation, SIGMA_FLOOR * spread)
        return result

    def _search(self, cuckoo: CuckooSearch, space: Space, generations: int) -> None:
        def costs(eggs: FloatArray, bounds: FloatArray) -> FloatArray:
            return self.problem.costs(space.values(eggs), bounds)

        def on_generation(search: CuckooSearch, generation: int) -> None:
            if search.best_cost < self.best_cost or self.best is None:
                self.best, self.best_cost = space.values(search.best[None, :])[0], search.best_cost
            self._tell()

        run_search(
            cuckoo,
            costs,
            generations=generations,
            record=self.record,
            bounded=self.bounded,
            on_generation=on_generation,
        )

    def _probe(self, start: FloatArray) -> None:
        """Simulate the start once: an FMU that cannot do this cannot be searched."""
        self._enter("probe")
        failed = self.problem.trajectories(start[None, :]).failed
        if failed[0]:
            middle = self.problem.box.from_cube(self.rng.random((20, self.problem.box.dimension)))
            if self.problem.trajectories(middle).failed.all():
                self._all_failed()

    def _all_failed(self) -> None:
        description = self.plan.description
        known = [with_cause(f, description, self.problem.variables) for f in self.crew.failures[:1]]
        why = known[0] if known else "no reason is known"
        raise SimulationError(f"every simulation of {description.path.name} failed: {why}")

    def _enter(self, phase: str) -> None:
        self._count()
        self.phase = phase
        self._tell()

    def _count(self) -> None:
        done = self.crew.simulations - self.counted
        if done:
            self.phases[self.phase] = self.phases.get(self.phase, 0) + done
        self.counted = self.crew.simulations

    def _tell(self) -> None:
        if self.progress is None:
            return
        best = None if self.best is None else dict(zip(self.plan.names, self.best.tolist(), strict=True))
        cost = float(self.best_cost) if np.isfinite(self.best_cost) else None
        self.progress(Progress(self.phase, self.crew.simulations, self.expected, cost, best))

    def _finish(
        self, values: FloatArray, polish: Polish | None, *, noise: FloatArray | None = None, fit: Fit | None = None
    ) -> Estimate:
        problem = self.problem
        self._enter("step check")
        step = step_check(problem, values, polish, fit)
        self._enter("result")
        batch = problem.trajectories(values[None, :])
        judgement = judge(
            self.plan,
            dict(zip(self.plan.names, values.tolist(), strict=True)),
            polish,
            steady=steady_state(self.plan),
            noise=noise,
            spread=problem.spread,
            step=step,
            fit=fit,
            structure=self.structure,
        )
        if judgement.verdict == "refused":
            return self._result(None, None, judgement)
        profiles = {}
        if self.profile and polish is not None:
            self._enter("profile")
            treat = fit.treatment.apply if fit is not None else np.asarray
            profiles = cost_profiles(
                lambda candidates: treat(problem.residuals(candidates)),
                problem.box,
                polish,
                names=self.plan.names,
                output=problem.output_of_residual,
            )
        derived = {}
        if polish is not None:
            found = {**self.plan.fixed, **dict(zip(self.plan.names, values.tolist(), strict=True))}
            derived = derived_quantities(found, self.plan.names, problem.box.log, polish)
            derived |= cold_resistances(self.plan, values, polish)
        result = self._result(values, polish, judgement, shown=problem.shown(batch))
        return dataclasses.replace(result, profiles=profiles, derived=derived)

    def _result(
        self,
        values: FloatArray | None,
        polish: Polish | None,
        judgement: Judgement,
        *,
        shown: list[FloatArray] | None = None,
    ) -> Estimate:
        self._count()
        plan = self.plan
        parameters: dict[str, ParameterEstimate] = {}
        chain = {p.name for p in plan.parameters if p.place is not None}
        if values is not None:
            parameters = parameter_estimates(plan, values, polish, judgement)
        compared = comparisons(plan, shown) if shown is not None else ()
        rmse, fit = figures(plan, compared)
        correlated = None if polish is None else correlation(polish)
        history = None
        if self.record.simulations:
            history = SearchHistory(
                simulations=np.array(self.record.simulations),
                best=np.array(self.record.best),
                median=np.array(self.record.median),
                lower=np.array(self.record.lower),
                upper=np.array(self.record.upper),
            )
        description = plan.description
        failures = self.crew.failures if self.loaded else []  # else they are another case's
        return Estimate(
            verdict=judgement.verdict,
            reasons=judgement.reasons,
            parameters={n: p for n, p in parameters.items() if n not in chain},
            chain={n: p for n, p in parameters.items() if n in chain},
            sensors=sensors(plan),
            recordings=recordings(plan),
            method=self.method,
            seed=plan.case.search.seed,
            simulations=self.crew.simulations + description.probe_simulations if self.loaded else 0,
            simulations_by_phase=dict(self.phases),
            failed_simulations=self.crew.failed if self.loaded else 0,
            steps=self.crew.steps if self.loaded else 0,
            seconds=time.monotonic() - self.started,
            fmu={
                "name": description.name,
                "path": str(description.path),
                "fmi_version": description.fmi_version,
                "kind": description.kind,
                "guid": description.guid,
                "generation_tool": description.generation_tool,
                "restart": description.restart,
                "communication_step": [
                    o.recording.step if plan.case.step is None else plan.case.step for o in plan.observed
                ][0],
            },
            versions=versions(),
            rmse=rmse,
            fit_percent=fit,
            noise={}
            if polish is None
            else dict(zip(plan.outputs, self.problem.noise_shown(polish.deviations).tolist(), strict=True)),
            correlation=correlated,
            correlated=plan.names if correlated is not None else (),
            notes=(*self.announced, *judgement.notes),
            failures=tuple(with_values(f, self.problem.variables) for f in failures),
            comparisons=compared,
            history=history,
            workers=self.crew.count,
        )
