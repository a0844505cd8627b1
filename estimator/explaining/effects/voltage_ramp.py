"""The drive takes the voltage to each level by a ramp: a command that is limited in its slope, or a soft start.

Of a linear model a ramp is a mean over the time that it takes, in all that is shown: a mean of each channel over whole
samples stands for it too, and an inductance for the difference. All changes last as long: those of several sizes may
not (`slew_limit.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.time_mean import mean_over_time, means_and_a_lag
from estimator.explaining.effects.voltage_rise import NAME as RISE
from estimator.explaining.effects.voltage_rise import times_of_command
from estimator.fitting.fit import Fit
from estimator.fitting.latency import EDGE
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

MOST_CHANGES = 100  # of a recording: more are a signal
ONE_SIZE = 0.05  # of the largest change: all are of one size, but for that
SLEW = "slew limit"
TRIED = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # samples that a ramp takes


def changes_of_commands(plan: Plan) -> FloatArray | None:
    """Return the sizes of all changes of a motor's commands, V, (n,); None where those of a recording are no levels."""
    if any("v" not in o.inputs for o in plan.observed):
        return None
    sizes = [np.abs(o.changes("v")) for o in plan.observed if not o.is_measured]
    sizes = [change[change > 0] for change in sizes]
    return np.concatenate([np.zeros(0), *sizes]) if max(map(len, sizes), default=0) <= MOST_CHANGES else None


def changes_differ(plan: Plan) -> bool:
    """Whether the changes of a motor's commands are of several sizes, and few enough to be levels."""
    sizes = changes_of_commands(plan)
    if sizes is None or not len(sizes):
        return False
    large = sizes[sizes > EDGE * np.max(sizes)]
    return float(np.ptp(large)) > ONE_SIZE * float(np.max(large))


@dataclass(frozen=True)
class VoltageRamp(Effect):
    """How long the voltage takes to each new level of its command, s; shown by all outputs of a linear model."""

    name: str = "voltage ramp"
    prior: float = SELDOM
    sharp: bool = True
    lateness: float = 0.5
    sentence: str = "the motor's voltage reaches each level of its command by a ramp of {ms:.3g} ms"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return that of all recordings; what is measured shows its ramps. In long ones it is not looked for."""
        return [
            Nuisance(
                self.name, "s", 0.0, longest, 0.0, plan.shortest_step,
                act=mean_over_time, between=True, tries=tries, excludes=(RISE, SLEW),
            )
            for longest, tries in times_of_command(plan, TRIED)
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return a voltage that rises as late in its place, by a time constant."""
        late = self.lateness * fit.value(name)
        return [{name: 0.0, RISE: late}] if RISE in fit.simulator.index and late > 0 else []

    def in_two(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return means of the current's samples and a lag of it, as late as the ramp and the winding are now.

        The winding keeps a half of what the means leave; the speed is later by what it has lost.
        """
        ramp = self.lateness * fit.value(name)
        return [{name: 0.0, **others} for others in means_and_a_lag(fit, ramp, of_speed=ramp)]
