"""From a case to an estimate. Knows no file format and prints nothing; the methods are modules of their own."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence

from estimator.cases.case import Case
from estimator.estimating.beginning import begin
from estimator.estimating.methods import direct, evolution, paper
from estimator.estimating.one_thread import one_thread
from estimator.estimating.progress import Progress
from estimator.estimating.search_and_polish import search_and_polish
from estimator.estimating.session import Session
from estimator.explaining.budget import applicable
from estimator.fmus.fmu import FmuDescription, describe, with_kind
from estimator.fmus.kinds import better_kind
from estimator.fmus.probe import driven
from estimator.fmus.workers import TIME_LIMIT, Workers
from estimator.judging.reading import with_what_was_read
from estimator.judging.validation import validated
from estimator.method_names import CUCKOO
from estimator.plans.planning import plan_case, read_case
from estimator.recordings.recording import Recording
from estimator.results.result import Estimate

METHODS: Mapping[str, Callable[[Session], Estimate]] = {
    CUCKOO: search_and_polish,
    "paper": paper,
    "original": paper,
    "integral": direct,
    "steiglitz-mcbride": direct,
    "differential-evolution": evolution,
}


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


@one_thread()
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
    if recordings is None:
        case, recordings = read_case(case)
    described = driven(with_kind(description or describe(case.fmu), case.kind))
    plan = plan_case(case, described, recordings=recordings)
    if case.kind is None:
        step = case.step or plan.observed[0].recording.step
        better, why = better_kind(described, step)
        if why:
            plan = plan_case(case, better, recordings=recordings)
            plan = dataclasses.replace(plan, notes=(why, *plan.notes))
    applicable(plan)  # a tolerance that it has nothing for is an error now, not after the search
    found = _estimated(Session(plan, crew, progress=progress, bounded=bounded, tell=tell, profile=profile))
    found = with_what_was_read(found, plan)
    apart = [k for k in range(len(recordings)) if case.run(k).validate]
    if not apart:
        return found
    case = dataclasses.replace(case, kind=plan.description.kind)
    return validated(found, case, recordings=[recordings[k] for k in apart], runs=[case.run(k) for k in apart])


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _estimated(session: Session) -> Estimate:
    """Run the method of a plan."""
    try:
        return begin(session) or METHODS.get(session.method, search_and_polish)(session)  # a search that a package adds
    except KeyboardInterrupt:
        raise Interrupted(session.account.standing.parameters) from None
