"""A sensor that shows changes alone: a current clamp, or an oscilloscope, that is AC-coupled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.low_pass import lag, through
from estimator.fitting.simulator import Nuisance
from estimator.noise.recursion import Sections
from estimator.plans.part import LONG
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

TRIED = 0.3  # of a recording's length over the time constant
SHORTEST = 0.03  # of the length: a shorter time constant leaves nothing of what settles


def without_mean(rate: float, h: float) -> Sections:
    """Return the section of x' + rate x = y', exact for a signal on lines between its samples; none where rate is 0."""
    low = lag(1 / rate, h) if rate > 0 else ()
    return tuple(((1 - b[0], a[0] - b[1]), a) for b, a in low)


@dataclass(frozen=True)
class AcCoupling(Effect):
    """A high-pass of first order in the current's channel: the inverse of its time constant, 1/s."""

    name: str = "AC coupling"
    prior: float = SELDOM / 10  # where it is meant to show a motor
    doubt: str = "what is constant is guessed by how it fades"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return that of the current without a declared filter, where no recording is long or begins in motion."""
        length = max(float(o.recording.time[-1] - o.recording.time[0]) for o in plan.observed)
        is_short = sum(len(o.recording.time) for o in plan.observed) <= LONG
        rests = not any(o.excitation.running for o in plan.observed)
        if "i" not in plan.outputs or "filter i" in plan.declared or not (is_short and rests and length > 0):
            return []
        return [
            Nuisance(
                f"{self.name} of i", "1/s", 0.0, 1 / (SHORTEST * length), 0.0, 0.1 * TRIED / length,
                output="i", act=partial(through, without_mean), sections=without_mean,
                tries=(TRIED / length,),
            )
        ]  # fmt: skip

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how fast what is constant vanishes."""
        fades = np.inf if value <= 0 else 1 / value
        sensor = "the sensor of i is AC-coupled: what is constant fades"
        return f"{sensor} with a time constant of {fades:.3g} s; couple it to DC"
