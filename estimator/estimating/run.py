"""One estimation under way: its phases, their simulations, what is told, and how it ends. Knows no method."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from estimator.errors import SimulationError
from estimator.estimating.cuckoo import CuckooSearch
from estimator.estimating.effort import usual_simulations
from estimator.estimating.progress import Progress
from estimator.estimating.search import SearchRecord, run_search
from estimator.fitting.budget import Budget, applicable, budget, fit_at
from estimator.fitting.explained import Explained
from estimator.fitting.polish import Polish
from estimator.fitting.problem import SIGMA_FLOOR, Problem
from estimator.fitting.winding import cold_resistances
from estimator.fmus.failing import with_cause, with_values
from estimator.fmus.workers import Workers
from estimator.judging.budgeted import with_budget
from estimator.judging.derived import derived_quantities
from estimator.judging.outcome import (
    comparisons,
    correlation,
    figures,
    information,
    measured,
    parameter_estimates,
    recordings,
    sensors,
    versions,
)
from estimator.judging.profile import cost_profiles
from estimator.judging.refusal import lost_transients, refusal, refused_notes
from estimator.judging.shown import with_fine_signals, with_treatment
from estimator.judging.step_check import step_check
from estimator.judging.structure import Structure, structure
from estimator.judging.trial import announcement, unmoved
from estimator.judging.verdict import Judgement, judge
from estimator.plans.noise_level import beside_means, output_deviations
from estimator.plans.parameters import Box
from estimator.plans.plan import Plan
from estimator.plans.space import Space, steady_state
from estimator.results.linear import MOTOR
from estimator.results.result import CostProfile, Estimate, ParameterEstimate, SearchHistory

FloatArray = NDArray[np.float64]


class Run:
    """What a method works with: the plan, the problem, the random numbers, the account.

    Parameters
    ----------
    plan : Plan
    crew : Workers
    progress, tell, bounded, profile
        As `estimator.estimating.estimate.estimate`.
    """

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
        self.standing = Progress("", 0)  # replaced as a whole: whoever reads it, Ctrl-C too, finds it in one piece
        self.counted = 0
        self.loaded = False
        self.record = SearchRecord()
        self.noise: dict[str, tuple[float, float]] = {}
        self.explained: Explained | None = None

    def begin(self) -> Estimate | None:
        """Load the FMU and see what the data and the FMU allow; return the refusal where that is nothing."""
        plan = self.plan
        reasons = refusal(plan)
        if self.method != "cuckoo":
            reasons += lost_transients(plan)
        if reasons:
            return self.refused(reasons, notes=refused_notes(plan))
        self.noise = output_deviations(plan)
        self.problem = Problem(plan, self.crew, sigma=self._sigma())
        self.loaded = True
        self.expect(usual_simulations(plan))
        self.crew.on_tick = self.tell_progress
        still = self._unmoved()
        return self.refused(still) if still else None

    def refused(self, reasons: Sequence[str], *, notes: Sequence[str] = ()) -> Estimate:
        """Return the estimate that is none."""
        return self._result(None, None, Judgement("refused", tuple(reasons), {}, tuple(notes)))

    @property
    def start(self) -> FloatArray:
        """Where to begin, (p,): the data's guess, and the middle of the bounds where there is none."""
        middle = self.problem.box.from_cube(np.full(self.problem.box.dimension, 0.5))
        return np.array([m if p.start is None else p.start for p, m in zip(self.plan.parameters, middle, strict=True)])

    def search(self, cuckoo: CuckooSearch, space: Space, generations: int) -> FloatArray:
        """Run a cuckoo search; return its best candidate, (p,)."""

        def costs(eggs: FloatArray, bounds: FloatArray) -> FloatArray:
            return self.problem.costs(space.values(eggs), bounds)

        def on_generation(search: CuckooSearch, generation: int) -> None:
            if search.best_cost < (np.inf if self.standing.best_cost is None else self.standing.best_cost):
                self.found(self.plan.names, space.values(search.best[None, :])[0], search.best_cost)
            self.tell_progress()

        run_search(
            cuckoo,
            costs,
            generations=generations,
            record=self.record,
            bounded=self.bounded,
            on_generation=on_generation,
        )
        if not np.isfinite(cuckoo.best_cost):
            self.all_failed()
        return np.asarray(space.values(cuckoo.best[None, :])[0])

    def probe(self, start: FloatArray) -> None:
        """Simulate the start once: an FMU that cannot do this cannot be searched."""
        self.enter("probe")
        failed = self.problem.trajectories(start[None, :]).failed
        if failed[0]:
            middle = self.problem.box.from_cube(self.rng.random((20, self.problem.box.dimension)))
            if self.problem.trajectories(middle).failed.all():
                self.all_failed()

    def all_failed(self) -> NoReturn:
        """Say that no candidate can be simulated, and why."""
        description = self.plan.description
        known = [with_cause(f, description, self.problem.variables) for f in self.crew.failures[:1]]
        why = known[0] if known else "no reason is known"
        raise SimulationError(f"every simulation of {description.path.name} failed: {why}")

    def enter(self, phase: str) -> None:
        """Begin a phase; the simulations until the next are its own."""
        self._count()
        self.standing = dataclasses.replace(self.standing, phase=phase)
        self.tell_progress()

    def expect(self, simulations: int) -> None:
        """Expect so many simulations from here to the end."""
        self.standing = dataclasses.replace(self.standing, expected=self._simulations + simulations)

    def found(self, names: Sequence[str], values: FloatArray, cost: float) -> None:
        """Remember the best candidate, (p,), by the names that it was found under: a plan may free more later."""
        best = dict(zip(names, values.tolist(), strict=True))
        self.standing = dataclasses.replace(self.standing, parameters=best, best_cost=float(cost))

    @property
    def _simulations(self) -> int:
        return self.crew.simulations if self.loaded else 0  # else they are another case's

    def _count(self) -> None:
        done = self._simulations - self.counted
        if done:
            self.phases[self.standing.phase] = self.phases.get(self.standing.phase, 0) + done
        self.counted = self._simulations

    def tell_progress(self) -> None:
        """Tell where the estimation stands."""
        self.standing = dataclasses.replace(self.standing, simulations=self._simulations)
        if self.progress is not None:
            self.progress(self.standing)

    def finish(
        self,
        values: FloatArray,
        polish: Polish | None,
        *,
        noise: FloatArray | None = None,
        explained: Explained | None = None,
    ) -> Estimate:
        """Check the step, judge, and return the estimate.

        Parameters
        ----------
        values : (p,) array
        polish : Polish or None
            None for a method that ends with its search.
        noise : (q,) array, optional
            Deviation of each output's noise as the data show it.
        explained : Explained, optional
            What was found of the bench; then `values` and `polish` are its own.
        """
        problem, self.explained = self.problem, explained
        self.enter("step check")
        step = step_check(problem, values, polish, explained)
        self.enter("result")
        if explained is None:
            shown = problem.shown(problem.trajectories(values[None, :]))
        else:
            self.plan, shown = explained.plan, explained.shown()
        compared = comparisons(self.plan, shown)
        rmse = figures(self.plan, compared)[0]
        if noise is None:
            noise = np.array([self.noise[name][0] for name in self.plan.outputs])
        judgement = judge(
            self.plan,
            dict(zip(self.plan.names, values.tolist(), strict=True)),
            polish,
            steady=steady_state(self.plan),
            noise=noise,
            rmse=np.array([rmse[name] for name in self.plan.outputs]),
            spread=problem.spread,
            step=step,
            explained=explained,
            structure=self.structure,
            compared=compared,
        )
        if judgement.verdict == "refused":
            return self._result(None, None, judgement)
        profiles = {}
        if self.profile and polish is not None:
            self.enter("profile")
            profiles = self._profiles(polish, explained)
        self.enter("budget")
        budgeted = self._budget(values, explained)
        derived = {}
        if polish is not None:
            found = {**self.plan.fixed, **dict(zip(self.plan.names, values.tolist(), strict=True))}
            log = np.array([p.log for p in self.plan.parameters], dtype=bool)
            derived = derived_quantities(found, self.plan.names, log, polish, budgeted)
            derived |= cold_resistances(self.plan, values, polish, budgeted.of)
        deviations = None
        if polish is not None:
            deviations = problem.noise_shown(polish.deviations) if explained is None else explained.noise
        result = self._result(values, polish, judgement, shown=shown, noise=deviations)
        compared = result.comparisons if explained is None else with_treatment(result.comparisons, explained)
        if self.profile:
            self.enter("profile")
            compared = with_fine_signals(compared, self.plan, values, self.crew, sigma=problem.sigma)
            self._count()
            result = dataclasses.replace(result, **self._account())
        result = dataclasses.replace(result, comparisons=compared, profiles=profiles, derived=derived)
        return with_budget(result, self.plan, budgeted, None if explained is None else explained.between)

    def _budget(self, values: FloatArray, explained: Explained | None) -> Budget:
        """Return what no recording tells, propagated through the fit."""
        tolerances = applicable(self.problem.plan)
        if not tolerances:
            return Budget((), self.plan.names, np.zeros((len(self.plan.names), 0)), np.zeros(0))
        if explained is not None:
            return budget(explained.fit, tolerances, self.plan.names)
        return budget(fit_at(self.plan, self.crew, values, sigma=self.problem.sigma), tolerances, self.plan.names)

    def _profiles(self, polish: Polish, explained: Explained | None) -> dict[str, CostProfile]:
        """Return the cost profiles of the motor's parameters."""
        problem = self.problem
        if explained is None:
            return cost_profiles(
                problem.residuals, problem.box, polish, names=self.plan.names, output=problem.output_of_residual
            )
        return cost_profiles(
            explained.residuals,
            Box.of(self.plan.parameters),
            polish,
            names=problem.plan.names,
            output=np.zeros(len(polish.residuals), dtype=np.int64),
        )

    def _result(
        self,
        values: FloatArray | None,
        polish: Polish | None,
        judgement: Judgement,
        *,
        shown: list[FloatArray] | None = None,
        noise: FloatArray | None = None,
    ) -> Estimate:
        self._count()
        plan = self.plan
        parameters: dict[str, ParameterEstimate] = {}
        chain = {p.name for p in plan.parameters if p.place is not None}
        if values is not None:
            parameters = parameter_estimates(plan, values, polish, judgement)
        compared = comparisons(plan, shown) if shown is not None else measured(plan)
        rmse, fit = figures(plan, compared) if shown is not None else ({}, {})
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
            sensors=sensors(plan, self.explained),
            recordings=recordings(plan),
            method=self.method,
            seed=plan.case.search.seed,
            **self._account(),
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
            noise={} if noise is None else dict(zip(plan.outputs, noise.tolist(), strict=True)),
            sample_noise={} if values is None else self._sample_noise(),
            correlation=correlated,
            correlated=plan.names if correlated is not None else (),
            information={} if polish is None else information(polish, plan.names),
            rivals=() if values is None or self.explained is None else self.explained.rivals,
            notes=(*self.announced, *judgement.notes),
            failures=tuple(with_values(f, self.problem.variables) for f in failures),
            comparisons=compared,
            history=history,
            workers=self.crew.count,
            about={**({"motor": plan.case.motor} if plan.case.motor else {}), **plan.case.about},
        )

    def _account(self) -> dict[str, Any]:
        """Return what the estimation has cost so far."""
        done = self.loaded
        return {
            "simulations": self._simulations + self.plan.description.probe_simulations if done else 0,
            "simulations_by_phase": dict(self.phases),
            "failed_simulations": self.crew.failed if done else 0,
            "steps": self.crew.steps if done else 0,
            "seconds": time.monotonic() - self.started,
        }

    def _unmoved(self) -> list[str]:
        """Return why a parameter cannot be estimated; the bundled motor's all move current and speed."""
        plan = self.plan
        probed = plan.description.probe_simulations
        if probed:
            self.phases["probe"] = probed
        known = plan.description.is_bundled and plan.description.is_fast
        if known and {"i", "w"} <= set(plan.outputs) and set(plan.names) <= set(MOTOR):
            return []
        self.enter("probe")
        sentences, seconds = unmoved(self.problem, self.start)
        if not sentences and self.method == "cuckoo":
            self.structure = structure(self.problem, self.start)
        announced = announcement(
            seconds,
            simulations=usual_simulations(plan),
            workers=self.crew.count,
            always=not plan.description.is_fast,
        )
        if announced is not None:
            self.announced = (announced,)
            if self.tell is not None:
                self.tell(announced)
        return sentences

    def _sample_noise(self) -> dict[str, float]:
        """Return the deviation of each output's noise as the data alone show it."""
        shown = beside_means(self.plan, np.array([self.noise[name][0] for name in self.plan.outputs]))
        return dict(zip(self.plan.outputs, shown.tolist(), strict=True))

    def _sigma(self) -> dict[str, float]:
        """Return the deviations that weigh the outputs in the search: the paper divides by the signals' own."""
        result = {}
        for name, (deviation, spread) in self.noise.items():
            if spread == 0:
                spread = 1.0
            result[name] = spread if self.method in ("paper", "original") else max(deviation, SIGMA_FLOOR * spread)
        return result
