"""A recording's clock set right where its logger lost samples: what follows was taken later. Knows plans, no FMU.

A loss is found to first order (suspects.py). Here the rows that are missing are put back, without samples, so that all
that follows is compared at the time at which it was taken; place and number are those of the least misfit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.fitting.fit import Fit, misfit, squares
from estimator.fitting.problem import Problem
from estimator.fitting.treatment import Accused, Treatment, onset
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.stepping import layout

STRIDES = (1, 4)  # rows by which a place is moved
MOVES = 60  # of place or number, at most


@dataclass(frozen=True)
class Loss:
    """Rows that are missing before the row `place` of what was logged."""

    place: int
    count: int

    def neighbours(self) -> list[Loss]:
        """Return losses nearby that might fit better."""
        moved = [(k, n) for k in {0, *STRIDES, *(-s for s in STRIDES)} for n in (-1, 0, 1)]
        return [Loss(self.place + k, self.count + n) for k, n in moved if self.count + n > 0]


def can_be_set_right(plan: Plan) -> bool:
    """Whether the clock of a plan's only recording may be set right."""
    return len(plan.observed) == 1 and plan.observed[0].recording.even and not plan.counted


def with_loss(plan: Plan, loss: Loss) -> Plan:
    """Return the plan with the missing rows put back into its only recording."""
    o = plan.observed[0].logged or plan.observed[0]
    k, n, r = loss.place, loss.count, o.recording
    later = np.arange(1, n + 1) * r.step
    recording = dataclasses.replace(
        r,
        time=np.concatenate([r.time, r.time[-1] + later]),
        signals={name: np.insert(signal, k, np.full(n, np.nan)) for name, signal in r.signals.items()},
        missing_rows=r.missing_rows + n,
    )
    outputs = {}
    for name, y in o.outputs.items():
        y = y.copy()
        reach = plan.chains.get(name, ChainSpec()).average - 1 + (plan.sensors[name] == layout.MEAN)
        y[k : k + reach] = np.nan  # means over the gap and what follows it
        outputs[name] = np.insert(y, k, np.full(n, np.nan))
    whole = Observed(
        recording,
        {name: np.insert(u, k, np.full(n, u[k - 1])) for name, u in o.inputs.items()},
        outputs,
        o.excitation,
        o.lead,
        plan.observed[0].delay,
        o.notes,
        logged=o,
        has_phase=o.has_phase,
    )
    return dataclasses.replace(plan, observed=(whole,))


def best_loss(first: Loss, score: Callable[[Loss], float], *, earliest: int, rows: int) -> Loss:
    """Return the loss of the least score, by steps from a first one; its place lies after a row and within all."""
    known = {first: score(first)}
    best = first
    for _ in range(MOVES):
        for loss in best.neighbours():
            if loss not in known and earliest < loss.place < rows:
                known[loss] = score(loss)
        lowest = min(known, key=lambda loss: known[loss])
        if lowest == best:
            break
        best = lowest
    return best


def put_back(fit: Fit, lost: Accused, rebuild: Callable[[Plan], Problem]) -> Fit:
    """Return a fit, not treated yet, with the rows that the last accusation says are lost put back.

    Parameters
    ----------
    rebuild : callable
        A plan → a problem.
    """
    plan = fit.problem.plan

    def rough(loss: Loss) -> Fit:
        problem = rebuild(with_loss(plan, loss))
        plain = Treatment.none(len(problem.output_of_residual), len(plan.outputs))
        values, deviations = squares(problem, plain).quick(fit.polish.values, fit.polish.deviations)
        polish = dataclasses.replace(fit.polish, values=values, deviations=deviations)
        return dataclasses.replace(fit, problem=problem, polish=polish, treatment=plain)

    logged = plan.observed[0].logged or plan.observed[0]
    earliest, rows = onset(fit.problem, 0, fit.polish.values), len(logged.recording.time)
    first = Loss(lost.place, max(1, round(lost.size)))
    loss = best_loss(first, lambda loss: misfit(rough(loss)), earliest=earliest, rows=rows)
    found = rough(loss)
    polish = squares(found.problem, found.treatment).polish(found.polish.values, found.polish.deviations)
    known = _known(lost, loss, float(logged.recording.time[loss.place]))
    treatment = dataclasses.replace(found.treatment, accused=(*fit.treatment.accused[:-1], known))
    return dataclasses.replace(found, polish=polish, treatment=treatment)


def _known(lost: Accused, loss: Loss, time: float) -> Accused:
    """Return lost samples of which place and number are known: they take no rows out any more."""
    sentence = (
        f"{loss.count} sample{' seems' if loss.count == 1 else 's seem'} to be missing before t = {time:.4g} s"
        f" ({lost.deviations:.1f} standard deviations); what follows is compared at its time; check the logger's"
        " clock"
    )
    return dataclasses.replace(lost, sentence=sentence, rows=lost.rows[:0], size=float(loss.count), place=loss.place)
