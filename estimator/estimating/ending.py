"""From where a method ended to an estimate: the step check, the verdict, budget, profiles. Knows no search."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.estimating.session import Session
from estimator.explaining.budget import Budget, applicable, budget, fit_at
from estimator.explaining.explained import Explained
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.problem import Problem
from estimator.fitting.winding_temperature import cold_resistances
from estimator.fmus.failing import with_values
from estimator.judging.budgeted import with_budget
from estimator.judging.derived import products, told_quantities
from estimator.judging.figure_signals import with_fine_signals, with_treatment
from estimator.judging.jumps import Drawn, drawn_errors
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
from estimator.judging.step_check import step_check
from estimator.judging.verdict import Judgement, judge
from estimator.plans.noise_level import beside_means
from estimator.plans.parameters import Box
from estimator.plans.plan import Plan
from estimator.plans.space import steady_state
from estimator.results.result import Comparison, CostProfile, Estimate, ParameterEstimate, SearchHistory

FloatArray = NDArray[np.float64]


def refused(session: Session, reasons: Sequence[str], *, notes: Sequence[str] = ()) -> Estimate:
    """Return the estimate that is none."""
    return _estimate(session, session.plan, None, None, Judgement("refused", tuple(reasons), {}, tuple(notes)))


def finish(
    session: Session,
    values: FloatArray,
    polish: LeastSquaresFit | None,
    *,
    noise: FloatArray | None = None,
    explained: Explained | None = None,
) -> Estimate:
    """Check the step, judge, and return the estimate.

    Parameters
    ----------
    values : (p,) array
    polish : LeastSquaresFit or None
        None for a method that ends with its search.
    noise : (q,) array, optional
        Deviation of each output's noise as the data show it.
    explained : Explained, optional
        What was found of the bench; then `values` and `polish` are its own.
    """
    plan, problem, account = session.plan, session.problem, session.account
    if polish is not None:
        polish = _without_errors(polish, (plan if explained is None else explained.plan).names, session)
    drawn = None
    if polish is not None and session.jumping:
        account.enter("jumps")
        drawn = _drawn(session, polish, explained)
        polish = drawn.polish
    account.enter("step check")
    step = step_check(problem, values, polish, explained)
    account.enter("result")
    if explained is None:
        shown = problem.shown(problem.trajectories(values[None, :]))
    else:
        plan, shown = explained.plan, explained.shown()
    session.fitted = {**plan.fixed, **dict(zip(plan.names, values.tolist(), strict=True))}
    compared = comparisons(plan, shown)
    del shown
    told = figures(plan, compared)
    if noise is None:
        noise = np.array([session.noise[name][0] for name in plan.outputs])
    judgement = judge(
        plan,
        dict(zip(plan.names, values.tolist(), strict=True)),
        polish,
        steady=steady_state(plan),
        noise=noise,
        rmse=np.array([told[0][name] for name in plan.outputs]),
        spread=problem.spread,
        step=step,
        compared=compared,
        explained=explained,
        identifiability=session.identifiability,
    )
    if drawn is not None:
        judgement = _with_jumps(judgement, session, drawn)
    if judgement.verdict == "refused":
        return _estimate(session, plan, None, None, judgement)
    profiles = {}
    if session.profile and polish is not None:
        account.enter("profile")
        profiles = _profiles(problem, plan, polish, explained)
    account.enter("budget")
    budgeted = _budget(session, plan, values, explained)
    derived = {}
    if polish is not None:
        log = np.array([p.log for p in plan.parameters], dtype=bool)
        derived = told_quantities(session.fitted, plan.names, log, polish, budgeted)
        derived |= cold_resistances(plan, values, polish, budgeted.of)
        units = {p.name: p.unit for p in plan.parameters}
        derived |= products(session.identifiability.determined, session.fitted, plan.names, units, log, polish)
    deviations = None
    if polish is not None:
        deviations = polish.deviations if explained is None else explained.noise
    result = _estimate(
        session, plan, values, polish, judgement, compared=compared, told=told, noise=deviations, explained=explained
    )  # fmt: skip
    compared = compared if explained is None else with_treatment(compared, explained)
    if session.profile:
        account.enter("profile")
        compared = with_fine_signals(compared, plan, values, session.crew, sigma=problem.sigma)
        result = dataclasses.replace(result, **account.costs(plan.description.probe_simulations))
    result = dataclasses.replace(result, comparisons=compared, profiles=profiles, derived=derived)
    return with_budget(result, plan, budgeted, None if explained is None else explained.between)


def _drawn(session: Session, polish: LeastSquaresFit, explained: Explained | None) -> Drawn:
    """Return the fit with standard errors that need no derivatives."""
    problem = session.problem
    if explained is not None:
        box = Box.of(explained.plan.parameters)
        return drawn_errors(lambda x: explained.residuals(x) / polish.deviations[0], box, polish, session.rng)
    weights = 1 / polish.deviations[problem.output_of_residual]
    return drawn_errors(lambda x: problem.residuals(x) * weights, problem.box, polish, session.rng)


def _with_jumps(judgement: Judgement, session: Session, drawn: Drawn) -> Judgement:
    """Return a judgement with what jumps do to it."""
    moved = f"{' and '.join(session.problem.outputs)} jump{'s' * (len(session.problem.outputs) == 1)} as"
    moved = f"{moved} {', '.join(session.jumping)} move{'s' * (len(session.jumping) == 1)} (an event falls elsewhere)"
    if drawn.holds:
        how = (
            f"searched without derivatives, and standard errors by {drawn.simulations} simulations around the estimate"
        )
        return dataclasses.replace(judgement, notes=(*judgement.notes, f"{moved}: {how}"))
    if judgement.verdict == "refused":
        return judgement
    why = f"{moved}, and the likelihood around the estimate is not that of one optimum: no standard errors"
    return dataclasses.replace(judgement, verdict="doubtful", reasons=(*judgement.reasons, why))


def _without_errors(polish: LeastSquaresFit, names: Sequence[str], session: Session) -> LeastSquaresFit:
    """Return a fit without the standard errors of what the outputs cannot tell: differences of noise made them."""
    untold = np.isin(np.array(names), session.identifiability.untold)
    return dataclasses.replace(polish, standard_errors=np.where(untold, np.inf, polish.standard_errors))


def _budget(session: Session, plan: Plan, values: FloatArray, explained: Explained | None) -> Budget:
    """Return what no recording tells, propagated through the fit."""
    tolerances = applicable(session.problem.plan)
    if not tolerances:
        return Budget((), plan.names, np.zeros((len(plan.names), 0)), np.zeros(0))
    if explained is not None:
        return budget(explained.fit, tolerances, plan.names)
    return budget(fit_at(plan, session.crew, values, sigma=session.problem.sigma), tolerances, plan.names)


def _profiles(
    problem: Problem, plan: Plan, polish: LeastSquaresFit, explained: Explained | None
) -> dict[str, CostProfile]:
    """Return the cost profiles of the motor's parameters."""
    if explained is None:
        return cost_profiles(
            problem.residuals, problem.box, polish, names=plan.names, output=problem.output_of_residual
        )
    return cost_profiles(
        explained.residuals,
        Box.of(plan.parameters),
        polish,
        names=problem.plan.names,
        output=np.zeros(len(polish.residuals), dtype=np.int64),
    )


def _estimate(
    session: Session,
    plan: Plan,
    values: FloatArray | None,
    polish: LeastSquaresFit | None,
    judgement: Judgement,
    *,
    compared: tuple[Comparison, ...] | None = None,
    told: tuple[dict[str, float], dict[str, float]] = ({}, {}),
    noise: FloatArray | None = None,
    explained: Explained | None = None,
) -> Estimate:
    """Return the result; `compared`: measured with simulated signals, where there are such, and `told` of them."""
    parameters: dict[str, ParameterEstimate] = {}
    chain = {p.name for p in plan.parameters if p.place is not None}
    if values is not None:
        parameters = parameter_estimates(plan, values, polish, judgement)
    rmse, fit = told
    correlated = None if polish is None else correlation(polish)
    history = None
    if session.record.simulations:
        history = SearchHistory(
            simulations=np.array(session.record.simulations),
            best=np.array(session.record.best),
            median=np.array(session.record.median),
            lower=np.array(session.record.lower),
            upper=np.array(session.record.upper),
        )
    description = plan.description
    return Estimate(
        verdict=judgement.verdict,
        reasons=judgement.reasons,
        parameters={n: p for n, p in parameters.items() if n not in chain},
        chain={n: p for n, p in parameters.items() if n in chain},
        rivals=() if values is None or explained is None else explained.rivals,
        not_visible=() if values is None or explained is None else explained.not_visible,
        chosen={} if explained is None else explained.fit.chosen(),
        sensors=sensors(plan, explained),
        effects=() if explained is None else tuple(dict.fromkeys(f.effect for f in explained.found)),
        recordings=recordings(plan),
        method=session.method,
        seed=plan.case.search.seed,
        **session.account.costs(description.probe_simulations),
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
        sample_noise={} if values is None else _sample_noise(session, plan),
        correlation=correlated,
        correlated=plan.names if correlated is not None else (),
        information={} if polish is None else information(polish, plan.names),
        notes=(*session.announced, *judgement.notes),
        failures=tuple(with_values(f, session.problem.values.names) for f in session.account.failures),
        comparisons=measured(plan) if compared is None else compared,
        history=history,
        workers=session.crew.pool.count,
        about={**({"motor": plan.case.motor} if plan.case.motor else {}), **plan.case.about},
    )


def _sample_noise(session: Session, plan: Plan) -> dict[str, float]:
    """Return the deviation of each output's noise as the data alone show it."""
    shown = beside_means(plan, np.array([session.noise[name][0] for name in plan.outputs]))
    return dict(zip(plan.outputs, shown.tolist(), strict=True))
