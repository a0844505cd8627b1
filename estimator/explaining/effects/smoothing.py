"""Signals smoothed after they were recorded, by a centred mean: they show a change before its input does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import ChainSpec, Plan

FloatArray = NDArray[np.float64]

SAMPLES = tuple(map(float, (3, 5, 7, 9, 11, 15, 21, 31, 51)))  # what lies between is found from these


def centred_mean(y: FloatArray, n: float, h: float) -> FloatArray:
    """Return the mean of n samples around each, an odd number; the first and the last are repeated beyond the ends."""
    reach = round(n) // 2
    sums = np.concatenate([[0.0], np.repeat(y[:1], reach), y, np.repeat(y[-1:], reach)])
    np.cumsum(sums, out=sums)
    mean = sums[2 * reach + 1 :] - sums[: -2 * reach - 1]
    mean /= 2 * reach + 1
    return np.asarray(mean)


@dataclass(frozen=True)
class Smoothing(Effect):
    """A centred running mean of all outputs, or of one."""

    name: str = "smoothing"
    prior: float = SELDOM
    doubt: str = "what happens within these samples is lost, and the noise with it: estimate from the raw signals"
    sharp: bool = True

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return that of all outputs, and one for each, of those without a declared filter or mean."""
        shown = [y for y in plan.outputs if y != "angle"]
        plain = [
            y for y in shown if f"average {y}" not in plan.declared and plan.chains.get(y, ChainSpec()).is_plain
        ]  # fmt: skip
        offered = [(self.name, "")] if len(shown) == len(plan.outputs) == len(plain) > 1 else []
        offered += [(f"{self.name} of {y}", y) for y in plain]
        return [
            Nuisance(
                name, "samples", 1.0, SAMPLES[-1], 1.0, 1.0, output=y, act=centred_mean, tries=SAMPLES, whole=True,
                excludes=(self.name, *(f"{other} {y}" for other in ("average", "delay of") if y)),
            )
            for name, y in offered
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return two samples less, and two more."""
        n = round(fit.value(name))
        return [{name: float(k)} for k in (n - 2, n + 2) if 1 < k <= SAMPLES[-1]]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say which signals, over how many samples."""
        which = name.rpartition(" of ")[2] if " of " in name else " and ".join(plan.outputs)
        return f"{which}: smoothed by a centred mean over {value:.0f} samples after the recording"
