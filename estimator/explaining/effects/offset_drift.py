"""A channel's offset drifts over a recording: an amplifier or a Hall sensor that warms."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from estimator.explaining.effects.base import SELDOM
from estimator.explaining.effects.offset import Offset
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.simulator import per_recording
from estimator.plans.plan import Plan


@dataclass(frozen=True)
class OffsetDrift(Offset):
    """An offset of one output in one recording that changes along a line, by its unit from the first to the last row.

    Of the current alone: friction that drifts shows in the speed as well, and more often.
    """

    name: str = "offset drift"
    prior: float = SELDOM

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for the current of each recording, zero in the middle of its time."""
        s, found = fit.simulator, list[Linear]()
        clocks = dict(zip(per_recording(s.plan, "offset i"), s.clocks, strict=True))
        for group in (g for g in self.of_each_output(fit) if g.name in clocks):
            clock, columns = clocks[group.name], group.columns.copy()
            t = clock.time
            columns[clock.rows, :, 0] *= ((t - t[0]) / (t[-1] - t[0]) - 0.5)[:, None]
            name = group.name.replace("offset", "offset drift", 1)
            found.append(dataclasses.replace(group, name=name, columns=columns))
        return found

    def always(self, fit: Fit) -> Sequence[Linear]:
        """Return none: no count drifts."""
        return ()

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say by how much."""
        y = name.split(" ")[2]
        of = name.removeprefix(f"offset drift {y}")
        return f"the offset of {y}{of} drifts by {value:.3g} {plan.unit(y)} over the recording"
