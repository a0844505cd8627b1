"""A channel has an offset: an amplifier, a Hall sensor; an angle that begins anywhere.

What a model that is no motor shows has one where the case says so (offset = "free"): beside free initial states an
offset explains nearly any misfit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.simulator import per_recording
from estimator.motor.names import has_motor
from estimator.plans.plan import Observed, Plan
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

REST = 20  # first rows in which a speed is exactly none: no amplifier shows it; rows that show an offset
SEEN, SAME = 6.0, 4.0  # standard errors of a mean at rest that is off zero; of a difference of two that are alike


@dataclass(frozen=True)
class Offset(Effect):
    """An offset of one output in one recording, in its unit."""

    name: str = "offset"
    small: float = 0.1

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for each output of each recording; a speed from encoder counts has none.

        A speed whose noise is larger than its steps is a tachometer's behind a converter, unless it rests at none.
        """
        plan = fit.simulator.plan
        if "w" not in plan.outputs:
            return self.of_each_output(fit)
        named = zip(plan.observed, per_recording(plan, "offset w"), strict=True)
        counted = {name for o, name in named if _is_counted(o.outputs["w"], plan.resolution(o, "w"))}
        return [group for group in self.of_each_output(fit) if group.name not in counted]

    def of_each_output(self, fit: Fit) -> Sequence[Linear]:
        """Return one for each output of each recording, whatever its samples look like."""
        plan, found = fit.simulator.plan, list[Linear]()
        if not has_motor({*(p.quantity or p.name for p in plan.parameters), *plan.fixed}):
            return found
        for j, y in enumerate(fit.simulator.outputs):
            if f"offset {y}" in plan.declared:
                continue
            for o, clock, name in zip(
                plan.observed, fit.simulator.clocks, per_recording(plan, f"offset {y}"), strict=True
            ):
                columns = np.zeros((fit.simulator.rows, len(fit.simulator.outputs), 1))
                columns[clock.rows, j, 0] = 1.0
                size = 0.01 * float(np.nanmax(np.abs(o.outputs[y])))
                found.append(Linear(name, columns, (plan.unit(y),), size=size))
        return found

    def always(self, fit: Fit) -> Sequence[Linear]:
        """Return the phases of angles whose count begins anywhere."""
        observed = fit.simulator.observed
        names = per_recording(fit.simulator.plan, "offset angle")
        phases = {name for o, name in zip(observed, names, strict=True) if o.has_phase and "angle" in o.outputs}
        return [group for group in self.linear(fit) if group.name in phases]

    def seen(self, fit: Fit) -> Sequence[Linear]:
        """Return those of several recordings whose motor rests before its first voltage: what stays does not coast.

        Of one recording a score test finds it in its turn; of several each alone explains little.
        """
        plan = fit.simulator.plan
        if len(plan.observed) == 1:
            return ()
        shown = {
            name
            for y in fit.simulator.outputs
            for o, name in zip(plan.observed, per_recording(plan, f"offset {y}"), strict=True)
            if y != "angle" and _stays_off_zero(o, y)
        }
        return [group for group in self.linear(fit) if group.name in shown] if shown else ()

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how large."""
        y = name.split(" ")[1]
        return f"{y} has an {name.replace(f'offset {y}', 'offset')} of {value:.3g} {plan.unit(y)}"


def _stays_off_zero(o: Observed, output: str) -> bool:
    """Whether a recording shows an output off zero, by as much in both halves of its rows before the first voltage."""
    y = o.resting(output)
    if len(y) < REST:
        return False
    error = float(np.std(y) / np.sqrt(len(y)))
    half = len(y) // 2
    falls = abs(float(np.mean(y[:half]) - np.mean(y[half:])))
    return abs(float(np.mean(y))) > SEEN * error and falls < SAME * 2 * error


def _is_counted(speed: FloatArray, step: float) -> bool:
    """Whether a speed, (n,), is that of an encoder's counts, which a logger may have put on lines between its rows."""
    return step > noise_deviation(speed) or (len(speed) > REST and not speed[:REST].any())
