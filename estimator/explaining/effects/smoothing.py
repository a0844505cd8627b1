"""All signals are smoothed alike, sample by sample: by the program that logs them, or before they were written.

Their noise at rest tells it, and how much. A sensor's filter before the converter is another in each channel, and has
white noise behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.average import mean_of_last
from estimator.explaining.effects.base import Effect
from estimator.fitting.simulator import Nuisance
from estimator.noise.recursion import behind
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.recordings.smoothed_noise import LONGEST, part_kept, samples_of_mean

FloatArray = NDArray[np.float64]

ALIKE = 4.5  # standard errors: what two channels keep is the same
LAST, ABOUT, IN_PART = "smoothing by the last", "smoothing about", "smoothing in part"
INSTEAD = ("average", "lag", "second-order lag", "Butterworth low-pass", "smoothing", "voltage ramp", "voltage rise")


def mean_about(y: FloatArray, n: float, h: float) -> FloatArray:
    """Return the mean of n samples about each, the last repeated beyond the end, the first before the start."""
    k = round(n)
    ahead = k // 2
    return mean_of_last(np.concatenate([y, np.repeat(y[-1:], ahead)]), k, h)[ahead:]


def in_part(y: FloatArray, tau: float, h: float) -> FloatArray:
    """Return the recursion x[k] = a x[k-1] + (1 - a) y[k], a = exp(-h / tau), at rest before the first."""
    if tau <= 0:
        return y
    a, shown = float(np.exp(-h / tau)), np.empty(len(y))
    behind((((1 - a,), (-a,)),), np.asarray(y, dtype=np.float64)[:, None], shown)
    return shown


@dataclass(frozen=True)
class Smoothing(Effect):
    """A running mean of all outputs, over the last n samples or about each; or exponential smoothing of all."""

    name: str = "smoothing"
    sharp: bool = True

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return what the noise of all channels shows, where nothing of them is declared."""
        plain = [y for y in plan.outputs if y != "angle" and plan.chains.get(y, ChainSpec()).is_plain]
        resting = [_at_rest(o, y) for o in plan.observed for y in plain]
        if len(plain) < 2 or len(plain) < len(plan.outputs) or not resting:
            return []
        found, h = list[Nuisance](), plan.shortest_step
        lengths = {samples_of_mean(y) for y in resting}
        if len(lengths) == 1 and (n := float(lengths.pop())) > 1:
            ways = {LAST: mean_of_last, **({ABOUT: mean_about} if n % 2 else {})}
            found += [
                Nuisance(
                    name, "samples", 1.0, float(LONGEST), 1.0, 1.0, act=act, tries=(n,), whole=True, excludes=INSTEAD
                )
                for name, act in ways.items()
            ]
        kept, errors = np.array([part_kept(y) for y in resting]).T
        if np.all(kept > 0) and float(np.ptp(kept)) < ALIKE * float(np.hypot(*np.sort(errors)[-2:])):
            tau = -h / float(np.log(np.average(kept, weights=errors**-2.0)))
            found.append(
                Nuisance(
                    IN_PART,
                    "s",
                    0.0,
                    10 * tau,
                    0.0,
                    0.1 * tau,
                    act=in_part,
                    tries=(tau,),
                    absolute=True,
                    excludes=INSTEAD,
                )
            )
        return found

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how."""
        if name == IN_PART:
            moved = -np.expm1(-plan.shortest_step / value) if value > 0 else 1.0
            return f"all signals are smoothed from row to row: each is moved by {moved:.3g} of the way to the one read"
        where = "the last" if name == LAST else "those about it, of"
        return f"each sample of all signals is a mean over {where} {value:.0f}"


def _at_rest(o: Observed, output: str) -> FloatArray:
    """Return the samples of an output that are before the first voltage, (n,), and show nothing of it in their mean.

    None of a motor that runs already.
    """
    if o.excitation.kind == "none" or o.excitation.running or o.excitation.before != 0:
        return np.zeros(0)
    y = o.outputs[output][: max(0, o.excitation.index - LONGEST // 2)]
    return y[~np.isnan(y)]
