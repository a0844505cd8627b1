"""An estimate with the uncertainty budget of each parameter and its repeatability. Simulates nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from estimator.cases.tolerance import OFFERED
from estimator.explaining.between_runs import BetweenRuns
from estimator.explaining.budget import Budget
from estimator.motor.names import has_motor
from estimator.plans.plan import Plan
from estimator.results.result import Estimate, ParameterEstimate, StandardUncertainty

OFFER = (
    "the bars hold what the recording tells; sensor gains, supply, brushes and temperature come on top:"
    " --tolerance default adds {}"
)


def with_budget(found: Estimate, plan: Plan, budget: Budget, between: BetweenRuns | None) -> Estimate:
    """Return an estimate whose parameters have their budget and their repeatability.

    Parameters
    ----------
    budget : of the plan's names
    between : what varies between the recordings; None where there is no fit of several
    """
    varies = {} if between is None else {v.parameter: v.deviation for v in between.variations}
    several = between is not None and len(plan.observed) > 1
    changed: dict[str, ParameterEstimate] = {}
    for k, parameter in enumerate(plan.parameters):
        estimate = found.parameters.get(parameter.name) or found.chain.get(parameter.name)
        if estimate is None:
            continue
        scale = abs(estimate.value) if parameter.log else 1.0
        one = np.zeros(len(plan.parameters))
        one[k] = scale
        told = (
            several and parameter.place is None and parameter.recording is None and estimate.standard_error is not None
        )
        changed[parameter.name] = dataclasses.replace(
            estimate, budget=budget.of(one), repeatability=varies.get(k, 0.0) * scale if told else None
        )
    tolerances = {
        t.source: StandardUncertainty(t.text, t.distribution, t.standard_uncertainty, t.unit, float(left))
        for t, left in zip(budget.tolerances, budget.left, strict=True)
    }
    notes = [
        f"the tolerance {source!r} is not in the bars: the FMU cannot be simulated with it" for source in budget.failed
    ]
    has_bars = any(p.standard_error is not None for p in found.parameters.values())
    if has_bars and not plan.case.tolerance and has_motor(found.parameters) and "i" in plan.outputs:
        notes.append(OFFER.format(", ".join(f"{source} {text}" for source, text in OFFERED.items())))

    def own(parameters: Mapping[str, ParameterEstimate]) -> dict[str, ParameterEstimate]:
        return {name: changed.get(name, estimate) for name, estimate in parameters.items()}

    return dataclasses.replace(
        found,
        parameters=own(found.parameters),
        chain=own(found.chain),
        tolerances=tolerances,
        notes=(*found.notes, *notes),
    )
