"""Which of the ways to read recordings is the likelier, by what the effects explain. Knows no effect."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.explanation import Explanation, moved_to
from estimator.explaining.explanation_noise import by_noise_of
from estimator.explaining.interpretations import Interpretation, interpretations
from estimator.explaining.rivals import EXCHANGED
from estimator.explaining.selection import Selection
from estimator.fitting.gauss_newton import solved
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

UNDECIDED = 2.0  # times z'z of the better first fit: the other way to read the recordings may be the right one


def likelier_interpretation(
    plan: Plan, begin: Callable[[Plan], Selection], starts: Sequence[FloatArray], known: Explanation | None
) -> tuple[Sequence[Interpretation], list[Selection], Explanation]:
    """Return the ways to read the recordings, the likelier first, a selection for each, and what explains the first.

    The first fit tells which; where it hardly does, and what was found is likelier by the other, both are explained.

    Parameters
    ----------
    begin : callable
        Returns the selection of effects for a plan.
    starts : (p,) arrays
        Of the plan's free parameters.
    known : Explanation, optional
        Of a part of the rows.
    """
    ways: Sequence[Interpretation] = interpretations(plan)
    selections = [begin(way.plan) for way in ways]
    costs = [selection.first.cost(starts) for selection in selections] if len(ways) > 1 else [0.0]
    order = np.argsort(costs, kind="stable").tolist()
    ways, selections = [ways[k] for k in order], [selections[k] for k in order]
    explanation, n = selections[0].explain(starts, known), selections[0].tests.samples
    if len(ways) == 1 or max(costs) > UNDECIDED * min(costs):
        return ways, selections, explanation
    if on_simulators_of(explanation, selections[1]).fit.cost < explanation.fit.cost - EXCHANGED:
        again = selections[1].explain(starts)
        if again.criterion(n) < by_noise_of(again, explanation).criterion(n):
            return ways[::-1], selections[::-1], again
    return ways, selections, explanation


def on_simulators_of(explanation: Explanation, other: Selection) -> Explanation:
    """Return an explanation fitted by the simulators of another selection, of recordings that it may read otherwise."""
    own, base = explanation.fit.simulator.plan.description.path.stem, other.tests.base
    simulator = base if own == base.plan.description.path.stem else other.tests.rivals(own)
    assert simulator is not None  # the first way has it
    return dataclasses.replace(explanation, fit=solved(moved_to(explanation.fit, simulator)))
