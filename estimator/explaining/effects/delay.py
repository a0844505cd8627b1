"""The outputs of a recording come later than its inputs: a command that reaches the motor late."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit
from estimator.fitting.simulator import Nuisance, per_recording
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import Plan

EARLY = 0.15  # samples before its input: a response that is earlier is impossible
EARLIEST, LATEST = 10.0, 0.5  # samples before; of the recording's length after


@dataclass(frozen=True)
class Delay(Effect):
    """A delay of all outputs behind the inputs, s, of one recording; and one that all recordings have, beside theirs.

    A controller that runs at its own rate delays every recording by another time, a drive all of them by the same. A
    measured voltage that jumps shows that in the row behind: all are before their inputs by a part of a row.
    """

    name: str = "delay"
    sharp: bool = True
    lateness: float = 1.0

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each recording with an input that changes, and one for all of several."""
        found: list[Nuisance] = []
        for e, (o, name) in enumerate(zip(plan.observed, per_recording(plan, self.name), strict=True)):
            if f"delay of {e}" in plan.declared or o.excitation.kind == "none" or not o.inputs:
                continue
            h, is_behind = o.recording.step, o.is_measured and (o.jumps or not plan.case.linear)
            longest = LATEST * float(o.recording.time[-1] - o.recording.time[0])
            found.append(
                Nuisance(
                    name, "s", -max(EARLIEST * h, o.early), max(longest, 20 * h), 0.0, h,
                    place=SensorPlace("delay", e), tries=(0.5 * h, 2 * h, -0.5 * h, -2 * h),
                    foretold=((-1 - EARLY) * h, EARLY * h) if is_behind else None,
                )
            )  # fmt: skip
        if 1 < len(found) == len(plan.observed):
            least, most = max(n.lower for n in found), min(n.upper for n in found)
            found.append(
                dataclasses.replace(
                    found[0], name=self.name, lower=least, upper=most, place=SensorPlace("delay"), foretold=None
                )
            )
        return found

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return the delays at which the outputs leave their rest."""
        names = per_recording(plan, self.name)
        found = {}
        for e, (o, name) in enumerate(zip(plan.observed, names, strict=True)):
            moves = bool(o.inputs) and o.excitation.kind != "none"
            if o.delay != 0 and f"delay of {e}" not in plan.declared and moves:
                found[name] = o.delay
        return found

    def size(self, fit: Fit, name: str) -> float:
        """Return by how much a recording is late in all, with what all of them are."""
        names = per_recording(fit.simulator.plan, self.name)
        return fit.delay(names.index(name)) if name in names else fit.value(name)

    def doubted(self, name: str, value: float, plan: Plan) -> str:
        """Say that no motor responds before its input: the clock is wrong, or another effect is taken for a delay.

        A measured voltage shows a change in the row behind it, up to a row late; one on lines, without jumps,
        shows where it is. Behind a gap it changed in the gap.
        """
        measured = any(o.is_measured and (o.jumps or not plan.case.linear) for o in plan.observed)
        own = dict(zip(per_recording(plan, self.name), (o.early for o in plan.observed), strict=True))
        early = own.get(name, min(own.values()))
        if value < -early - (EARLY + measured) * plan.shortest_step:
            return (
                "no motor does; check the recording's clock, and whether its signals were smoothed (a centred mean"
                f" shows them early), or declare it (delay = {value:.3g} under [[recording]])"
            )
        return ""

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how late, or how early."""
        way = "before" if value < 0 else "after"
        return f"{name}: the outputs come {1e3 * abs(value):.3g} ms {way} the input"
