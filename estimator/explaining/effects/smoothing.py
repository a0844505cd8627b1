"""Signals that are means of their samples: all of them alike, or of the samples about each, as their noise tells.

A program that logs them takes the last ones; one that smooths them afterwards may take as many on either side. Of one
signal alone the last ones are an `Average`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.average import mean_of_last
from estimator.explaining.effects.base import Effect
from estimator.explaining.effects.low_pass import FORMS
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import ChainSpec, Plan
from estimator.recordings.smoothed_noise import LONGEST, samples_of_mean

FloatArray = NDArray[np.float64]

LAST, ABOUT = "smoothing by the last", "smoothing about"
BOTH = ("average", *FORMS, "smoothing", "voltage ramp", "voltage rise")  # what does as a mean of all


def mean_about(y: FloatArray, n: float, h: float) -> FloatArray:
    """Return the mean of n samples about each, the last repeated beyond the end, the first before the start."""
    k = round(n)
    ahead = k // 2
    return mean_of_last(np.concatenate([y, np.repeat(y[-1:], ahead)]), k, h)[ahead:]


@dataclass(frozen=True)
class Smoothing(Effect):
    """A running mean of all outputs over the last n samples or about each; or of one output about each."""

    name: str = "smoothing"
    sharp: bool = True

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return what the noise at rest shows, where nothing of an output is declared."""
        if any(y == "angle" or not plan.chains.get(y, ChainSpec()).is_plain for y in plan.outputs):
            return []
        shown = {y: {samples_of_mean(o.resting(y, without=LONGEST // 2)) for o in plan.observed} for y in plan.outputs}
        lengths = {y: found.pop() if len(found) == 1 else 1 for y, found in shown.items()}
        n = next(iter(lengths.values()))
        if len(lengths) > 1 and n > 1 and set(lengths.values()) == {n}:
            ways = {LAST: mean_of_last, **({ABOUT: mean_about} if n % 2 else {})}
            return [
                Nuisance(name, "samples", 1.0, LONGEST, 1.0, 1.0, act=act, tries=(n,), whole=True, excludes=BOTH)
                for name, act in ways.items()
            ]
        return [
            Nuisance(
                f"{ABOUT} {y}", "samples", 1.0, LONGEST, 1.0, 1.0, output=y, act=mean_about, tries=(n,), whole=True,
                excludes=(*(f"{form} of {y}" for form in FORMS), f"average {y}"),
            )
            for y, n in lengths.items()
            if n > 1 and n % 2
        ]  # fmt: skip

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say of which samples."""
        which = "all signals" if name in (LAST, ABOUT) else name.rpartition(" ")[2]
        many = f"the last {value:.0f} samples" if name == LAST else f"{value:.0f} samples, as many before it as behind"
        return f"each sample of {which} is a mean over {many}"
