"""One channel is later than the others: a converter or a bus behind one sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimator.explaining.effects.base import Effect, longest_lateness
from estimator.fitting.simulator import Nuisance
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import Plan
from estimator.stepping import layout


@dataclass(frozen=True)
class ChannelDelay(Effect):
    """A delay of one output behind the others, s, never negative."""

    name: str = "delay of"
    prior: float = 0.1
    sharp: bool = True
    lateness: float = 1.0
    sentence: str = "{channel} is shown {ms:.3g} ms after the other signals"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each output, if there are several."""
        h, longest = plan.shortest_step, longest_lateness(plan)
        return [
            Nuisance(
                f"delay of {y}", "s", 0.0, longest, 0.0, h,
                place=SensorPlace("delay", None, y), tries=(0.5 * h, 2 * h), excludes=("delay of", f"average {y}"),
            )
            for y in plan.outputs
            if len(plan.outputs) > 1 and f"delay {y}" not in plan.declared and plan.sensors[y] == layout.IDENTITY
        ]  # fmt: skip
