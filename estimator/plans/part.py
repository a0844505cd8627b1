"""The first rows of long recordings, where they say what the whole says, nearly. Knows plans; simulates nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.plans.plan import Observed, Plan

FloatArray = NDArray[np.float64]

LONG = 20_000  # rows: of a longer recording the search sees a part
PART = 10_000  # rows that it sees, at least
TOLD_INPUT, TOLD_OUTPUT = 0.95, 0.7  # of the span of the whole: what half of a part has to show
WORTH = 0.5  # of all rows: a larger part is not worth it


def part_of(plan: Plan) -> Plan | None:
    """Return the plan on the first rows of its long recordings; None where all of it is needed."""
    observed = tuple(_part(o) for o in plan.observed)
    rows, of = (sum(o.before + len(o.recording.time) for o in several) for several in (observed, plan.observed))
    return replace(plan, observed=observed) if rows <= WORTH * of else None


def _part(o: Observed) -> Observed:
    """Return a recording as it is, or its first rows: twice as many as show its inputs and outputs move."""
    rows, half = len(o.recording.time), PART // 2
    if rows <= LONG:
        return o
    while 2 * half < rows and not _moves(o, half):
        half *= 2
    n = min(2 * half, rows)
    return replace(
        o,
        recording=o.recording.between(0, n),
        inputs={name: u[:n].copy() for name, u in o.inputs.items()},
        outputs={name: y[:n].copy() for name, y in o.outputs.items()},
        lead=min(o.lead, n),
        jumps={name: jumped[:n] for name, jumped in o.jumps.items()},
        uncertain=None if o.uncertain is None else o.uncertain[:n],
    )


def _moves(o: Observed, n: int) -> bool:
    """Whether inputs and outputs go nearly as far in the first n rows as in all."""
    for signals, part in ((o.inputs, TOLD_INPUT), (o.outputs, TOLD_OUTPUT)):
        for x in signals.values():
            if np.isnan(x[:n]).all() or _span(x[:n]) < part * _span(x):
                return False
    return True


def _span(x: FloatArray) -> float:
    return float(np.nanmax(x) - np.nanmin(x))
