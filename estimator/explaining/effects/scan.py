"""A converter that takes its channels one after the other: the last of a row is sampled late, and shows what comes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.simulator import Nuisance
from estimator.plans.part import LONG
from estimator.plans.plan import Plan
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

MOST, USUAL_PART = 0.5, 0.1  # of a row: two channels share one; a converter waits as long between them


def sampled_late(y: FloatArray, by: float, h: float) -> FloatArray:
    """Return a signal, (n,), on lines between its samples, later by so many s; its last one stays."""
    rows = np.arange(len(y), dtype=np.float64)
    return np.interp(rows + by / h, rows, y)


@dataclass(frozen=True)
class Scan(Effect):
    """By how many s the output that is last among the file's columns is sampled behind the others of its row."""

    name: str = "scan"
    prior: float = 0.1
    sharp: bool = True
    sentence: str = "{channel} is sampled {ms:.3g} ms behind the other signals of its row, as by a converter of several"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return that of the last output, if there are several."""
        is_long = sum(len(o.recording.time) for o in plan.observed) > LONG  # it would hold columns between the rows
        if is_long or len(plan.outputs) < 2 or any(len(o.outputs) < 2 for o in plan.observed):
            return ()
        places = list(plan.observed[0].recording.signals)
        columns = {y: plan.observed[0].recording.column(plan.binding.outputs[y].column) for y in plan.outputs}
        y = max(plan.outputs, key=lambda y: places.index(columns[y]))
        if plan.sensors[y] != layout.IDENTITY or f"delay {y}" in plan.declared:
            return ()
        h = plan.shortest_step
        return [
            Nuisance(
                f"scan of {y}", "s", 0.0, MOST * h, 0.0, h,
                output=y, act=sampled_late, between=True, tries=(USUAL_PART * h,), excludes=("delay of",),
            )
        ]  # fmt: skip
