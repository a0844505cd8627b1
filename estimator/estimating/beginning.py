"""From a plan to a method that can start: what the data refuse, the FMU loaded, what moves nothing. Knows no method."""

from __future__ import annotations

from estimator.estimating.effort import usual_simulations
from estimator.estimating.ending import refused
from estimator.estimating.run import Run
from estimator.fitting.problem import SIGMA_FLOOR, Problem
from estimator.judging.refusal import lost_transients, refusal, refused_notes
from estimator.judging.structure import structure
from estimator.judging.trial import announcement, unmoved
from estimator.method_names import WITHOUT_POLISH
from estimator.motor.names import MOTOR
from estimator.plans.noise_level import output_deviations
from estimator.results.result import Estimate


def begin(run: Run) -> Estimate | None:
    """Load the FMU and see what the data and the FMU allow; return the refusal where that is nothing."""
    plan = run.plan
    reasons = refusal(plan)
    if run.method in WITHOUT_POLISH:
        reasons += lost_transients(plan)
    if reasons:
        return refused(run, reasons, notes=refused_notes(plan))
    run.noise = output_deviations(plan)
    run.problem = Problem(plan, run.crew, sigma=_sigma(run))
    run.account.opened(usual_simulations(plan))
    still = _unmoved(run)
    return refused(run, still) if still else None


def _unmoved(run: Run) -> list[str]:
    """Return why a parameter cannot be estimated; the bundled motor's all move current and speed."""
    plan = run.plan
    probed = plan.description.probe_simulations
    if probed:
        run.account.phases["probe"] = probed
    known = plan.description.is_bundled and plan.description.is_fast
    if known and {"i", "w"} <= set(plan.outputs) and set(plan.names) <= set(MOTOR):
        return []
    run.account.enter("probe")
    sentences, seconds = unmoved(run.problem, run.start)
    if not sentences and run.method not in WITHOUT_POLISH:
        run.structure = structure(run.problem, run.start)
    announced = announcement(
        seconds,
        simulations=usual_simulations(plan),
        workers=run.crew.count,
        always=not plan.description.is_fast,
    )
    if announced is not None:
        run.announced = (announced,)
        if run.tell is not None:
            run.tell(announced)
    return sentences


def _sigma(run: Run) -> dict[str, float]:
    """Return the deviations that weigh the outputs in the search: the paper divides by the signals' own."""
    result = {}
    for name, (deviation, spread) in run.noise.items():
        if spread == 0:
            spread = 1.0
        result[name] = spread if run.method in ("paper", "original") else max(deviation, SIGMA_FLOOR * spread)
    return result
