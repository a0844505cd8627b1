"""The current's converter takes its mean over a time, as a sigma-delta one or an integrator does.

Means of samples and a low-pass of them do nearly the same, and an inductance the rest, as of a ramp of the voltage.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect, longest_lateness
from estimator.explaining.effects.low_pass import FORMS, LATE_SPEED
from estimator.fitting.fit import Fit
from estimator.fitting.simulator import Nuisance
from estimator.motor.winding import time_constant
from estimator.noise.in_parts import blocks
from estimator.plans.part import LONG
from estimator.plans.plan import ChainSpec, Plan

FloatArray = NDArray[np.float64]

TIMES = (0.7, 1.5, 3.0, 6.0, 12.0)  # samples that a mean over a time lasts, of those that are tried
OF_DELAY = 0.6  # of its delay: means in its place come no further from that


def mean_over_time(y: FloatArray, length: float, h: float) -> FloatArray:
    """Return the mean of y over the last `length` s, exact for a signal on lines between samples, at rest before."""
    if length <= 0:
        return y
    rows, part = divmod(length / h, 1.0)
    before, mean = int(rows) + 1, np.empty(len(y))
    for at in blocks(len(y)):  # a long recording is held once more, not seven times
        known = y[max(0, at.start - before) : at.stop]
        known = np.concatenate([np.repeat(y[:1], before + at.stop - at.start - len(known)), known])
        whole = np.zeros(len(known))
        np.cumsum(0.5 * (known[1:] + known[:-1]), out=whole[1:])
        n, begins = at.stop - at.start, slice(1, 1 + at.stop - at.start)  # the row behind which it begins, or at which
        first = known[begins]
        cut = whole[begins] - part * first + 0.5 * part**2 * (first - known[:n])
        mean[at] = (whole[before:] - cut) * h / length
    return mean


def means_and_a_lag(fit: Fit, late: float, *, of_speed: float) -> list[dict[str, float]]:
    """Return values at which means of the current's samples and a lag of it are in the place of a mean over a time.

    The winding keeps a half of what the means leave, or all that it has; the speed is later by what it has lost.

    Parameters
    ----------
    late, of_speed : float
        By how much current and speed are late by the mean in whose place they come, s.
    """
    s, h = fit.simulator, fit.simulator.plan.shortest_step
    if not {"average i", "lag of i"} <= set(s.index) or not {"R", "L"} <= set(fit.free):
        return []
    winding = time_constant(fit.value("R"), fit.value("L"))
    own = next(((f"{form} of w", by) for form, (_, by, _) in FORMS.items() if f"{form} of w" in fit.free), None)
    speed, by = own or (LATE_SPEED, 1.0)
    found = []
    for n in s.nuisance("average i").tries:
        rest = late - 0.5 * (n - 1) * h
        if not abs(rest) < OF_DELAY * late:
            continue
        for lag, left in ((0.5 * (rest + winding), 0.5 * (rest + winding)), (rest, winding)):
            later = fit.value(speed) + (of_speed + winding - left) / by if speed in s.index else 0.0
            if lag > 0:
                found.append({"average i": n, "lag of i": lag, "L": fit.value("L") * left / winding})
                if later > 0:
                    found[-1][speed] = later
    return found


@dataclass(frozen=True)
class TimeMean(Effect):
    """A current whose converter takes its mean over a time, s, up to its instant: sigma-delta, or an integrator."""

    name: str = "time mean"
    prior: float = SELDOM / 10
    sharp: bool = True
    is_last: bool = True
    lateness: float = 0.5
    sentence: str = "{channel} is a mean over the last {ms:.3g} ms: its converter's"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return that of the current, where no mean is declared; in long recordings it is not looked for."""
        h, longest = plan.shortest_step, longest_lateness(plan)
        if "i" not in plan.outputs or "average i" in plan.declared or not plan.chains.get("i", ChainSpec()).is_plain:
            return ()
        is_long = sum(len(o.recording.time) for o in plan.observed) > LONG
        tries = () if is_long else tuple(n * h for n in TIMES if n * h < 0.5 * longest)
        return [
            Nuisance(
                f"{self.name} of i", "s", 0.0, longest, 0.0, h, output="i", act=mean_over_time, between=True,
                tries=tries, excludes=("average i",),
            )
        ]  # fmt: skip

    def in_two(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return means of the current's samples and a lag of it, as late as the mean and the winding are now."""
        late = self.lateness * fit.value(name)
        return [{name: 0.0, **others} for others in means_and_a_lag(fit, late, of_speed=0.0)]
