"""The drive changes the motor's voltage at a limited rate: a larger change of its command takes longer.

Changes of one size all take as long: that is a ramp (`voltage_ramp.py`). Of those of several sizes a voltage is missing
until they are over (`missing_voltage.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.missing_voltage import Corners, is_linear, shown_more
from estimator.explaining.effects.voltage_ramp import SLEW, TRIED, VoltageRamp, changes_differ, changes_of_commands
from estimator.explaining.effects.voltage_rise import NAME as RISE
from estimator.explaining.effects.voltage_rise import times_of_command
from estimator.fitting.simulator import Nuisance, Simulator
from estimator.plans.plan import Observed, Plan

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SlewLimit(Effect):
    """How long the largest change of all commands takes, s; smaller ones as much less as they are smaller.

    A voltage that is measured has its own ramps.
    """

    name: str = SLEW
    prior: float = SELDOM
    sharp: bool = True
    lateness: float = 0.4
    sentence: str = "the drive changes the voltage at a limited rate: its largest change takes {ms:.3g} ms"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return it for changes of several sizes, or beside what is measured; not in long recordings."""
        beside_measured = any(o.is_measured for o in plan.observed)
        changes = changes_of_commands(plan)
        is_told = changes is not None and len(changes) > 0 and (beside_measured or changes_differ(plan))  # else a ramp
        if not (is_told and is_linear(plan)):
            return []
        return [
            Nuisance(
                self.name, "s", 0.0, longest, 0.0, plan.shortest_step,
                adds=partial(shown_more, SLEW, _missing), tries=tries, excludes=(RISE, VoltageRamp.name),
            )
            for longest, tries in times_of_command(plan, TRIED, of_some=True)
        ]  # fmt: skip


def _missing(s: Simulator, longest: float, o: Observed) -> Corners:
    commands = [own for own in s.observed if not own.is_measured]
    return missing(o, max(float(np.max(np.abs(own.changes("v")))) for own in commands) / longest)


def missing(o: Observed, rate: float) -> Corners:
    """Return a voltage that follows a recording's command, held from row to row, by a rate, V/s, less that command.

    It begins at what the motor was run in with, or at none.
    """
    command, change, time = o.inputs["v"], o.changes("v"), o.times
    found, now, slope = list[tuple[float, float, float]](), float(command[0] - change[0]), 0.0
    edges = np.flatnonzero(change).tolist()
    for first, following in zip(edges, [*edges[1:], None], strict=False):
        target, begins = float(command[first]), float(time[first])
        ends = begins + abs(target - now) / rate
        until = np.inf if following is None else float(time[following])
        own = rate * float(np.sign(target - now))
        found.append((begins, -float(change[first]), own - slope))
        slope, now = own, now + own * (min(ends, until) - begins)
        if ends < until:
            found.append((ends, 0.0, -slope))
            slope = 0.0
    times, jumps, slopes = np.array(found).reshape(-1, 3).T
    return times, jumps, slopes
