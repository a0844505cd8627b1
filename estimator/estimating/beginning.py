"""From a plan to a method that can start: what the data refuse, the FMU loaded, what moves nothing. Knows no method."""

from __future__ import annotations

from estimator.estimating.effort import usual_simulations
from estimator.estimating.ending import refused
from estimator.estimating.session import Session
from estimator.fitting.problem import SIGMA_FLOOR, Problem
from estimator.judging.identifiability import identifiability
from estimator.judging.jumps import jumping
from estimator.judging.refusal import lost_transients, refusal, refused_notes
from estimator.judging.reversed_outputs import reversed_outputs
from estimator.judging.sensitivities import announcement, unmoved
from estimator.method_names import WITHOUT_POLISH
from estimator.motor.names import MOTOR
from estimator.plans.noise_level import output_deviations
from estimator.results.result import Estimate


def begin(session: Session) -> Estimate | None:
    """Load the FMU and see what the data and the FMU allow; return the refusal where that is nothing."""
    plan = session.plan
    reasons = refusal(plan)
    if session.method in WITHOUT_POLISH:
        reasons += lost_transients(plan)
    if reasons:
        return refused(session, reasons, notes=refused_notes(plan, reasons))
    session.noise = output_deviations(plan)
    session.problem = Problem(plan, session.crew, sigma=_sigma(session))
    session.account.opened()
    still = _unmoved(session)
    return refused(session, still) if still else None


def _unmoved(session: Session) -> list[str]:
    """Return why the FMU cannot be estimated; the bundled motor's parameters all move current and speed."""
    plan = session.plan
    probed = plan.description.probe_simulations
    if probed:
        session.account.phases["probe"] = probed
    known = plan.description.is_bundled and plan.description.is_fast
    if known and {"i", "w"} <= set(plan.outputs) and set(plan.names) <= set(MOTOR):
        if not any(chain.gain < 0 for chain in plan.chains.values()):
            return []
        session.account.enter("probe")
        return reversed_outputs(session.problem, session.start)
    session.account.enter("probe")
    sentences, seconds = unmoved(session.problem, session.start)
    sentences = sentences or reversed_outputs(session.problem, session.start)
    if not sentences and session.method not in WITHOUT_POLISH:
        session.identifiability = identifiability(session.problem, session.start)
        session.jumping = jumping(session.problem, session.start)
    announced = announcement(
        seconds,
        simulations=usual_simulations(plan),
        workers=session.crew.pool.count,
        always=not plan.description.is_fast,
    )
    if announced is not None:
        session.announced = (announced,)
        if session.tell is not None:
            session.tell(announced)
    return sentences


def _sigma(session: Session) -> dict[str, float]:
    """Return the deviations that weigh the outputs in the search: the paper divides by the signals' own."""
    result = {}
    for name, (deviation, spread) in session.noise.items():
        if spread == 0:
            spread = 1.0
        result[name] = spread if session.method in ("paper", "original") else max(deviation, SIGMA_FLOOR * spread)
    return result
