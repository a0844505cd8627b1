"""The motor's voltage rises slowly behind its command: a soft start, an amplifier, a filter of the command.

Of a linear model that is one more time constant in series, in all that is shown. A motor has two of its own: one of
them stands for it as well, with a resistance or an inductance that the motor has not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.low_pass import lag, through
from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import motor_values
from estimator.fitting.simulator import Nuisance
from estimator.motor.state_space import matrices
from estimator.motor.winding import resistance_of
from estimator.plans.part import LONG
from estimator.plans.plan import Observed, Plan
from estimator.recordings.signal_noise import input_noise
from estimator.recordings.smooth_inputs import moves_smoothly

NAME = "voltage rise"
NOISY = 1e-3  # of the largest voltage: a noise that is more than a command's digits
LONGEST = 0.3  # of a recording: the longest time constant
TRIED = (1.0, 3.0, 10.0, 30.0)  # samples
FASTER = 0.2  # of what stood for the rise: the time constant that the motor begins with instead


def times_of_command(
    plan: Plan, tried: Sequence[float], *, of_some: bool = False, smooth: bool = False
) -> list[tuple[float, tuple[float, ...]]]:
    """Return the longest time, s, that a command's voltage may take to its level, and those that are tried.

    None where a voltage is measured, which has risen, or the FMU is no motor; none is tried in long recordings.

    Parameters
    ----------
    tried : times in samples
    of_some : bool
        Whether it is enough that one of the recordings has a command.
    smooth : bool
        Whether what moves smoothly, without noise, may be a command too, such as a chirp.
    """
    if not plan.binding.is_motor or "v" not in plan.observed[0].inputs:
        return []
    measured = [o.is_measured and not (smooth and _may_be_a_command(o)) for o in plan.observed]
    if all(measured) if of_some else any(measured):
        return []
    step, times = plan.shortest_step, [o.recording.time for o in plan.observed]
    longest = LONGEST * max(float(t[-1] - t[0]) for t in times)
    short = sum(map(len, times)) <= LONG
    return [(max(longest, 2 * step), tuple(n * step for n in tried if n * step <= longest) if short else ())]


def _may_be_a_command(o: Observed) -> bool:
    """Whether a voltage that changes in every row goes on as it went, with no more noise than digits."""
    v = o.inputs["v"]
    return not o.is_quiet and input_noise(v) <= NOISY * float(np.max(np.abs(v))) and moves_smoothly(v)


@dataclass(frozen=True)
class VoltageRise(Effect):
    """A first-order lag of the voltage behind its command, s; shown by all outputs of a linear model."""

    name: str = NAME
    prior: float = SELDOM
    is_last: bool = True
    doubt: str = "something acts as if the motor's voltage were not the one in the recording: measure it at the motor"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return its time constant. Near none, where it is a delay, and in long recordings it is not looked for."""
        return [
            Nuisance(
                NAME, "s", 0.0, longest, 0.0, plan.shortest_step, act=partial(through, lag), sections=lag, between=True,
                tries=tries,
            )
            for longest, tries in times_of_command(plan, TRIED, smooth=True)
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return the rise and the winding exchanged: of the faster two time constants none tells which it is."""
        values, tau = motor_values(fit), fit.value(name)
        if values is None or "L" not in fit.free or not tau > 0:
            return ()
        fast = 1 / float(np.max(np.abs(np.linalg.eigvals(matrices(values)[0]))))
        return ({name: fast, "L": values["L"] * tau / fast},)

    def in_place_of_model(self, fit: Fit) -> Sequence[Mapping[str, float]]:
        """Return both time constants of a motor as the voltage's, the motor faster by as much."""
        values = motor_values(fit)
        if values is None or not {"R", "K", "L", "J"} <= set(fit.free):
            return ()
        rates = np.sort(np.abs(np.linalg.eigvals(matrices(values)[0])))  # two alike, where it oscillates
        if not rates[0] > 0:
            return ()
        slow, fast = (float(1 / rate) for rate in rates)
        winding = {NAME: fast, "L": FASTER * values["L"]}
        resistance = resistance_of(fast, *(values[n] for n in ("K", "J", "B")))  # the fast one is then the motor's slow
        machine = {NAME: slow, "R": resistance, "L": FASTER * fast * resistance}
        return (winding, machine) if np.isfinite(resistance) else (winding,)

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how slowly."""
        return f"the motor's voltage rises behind its command, with a time constant of {1e3 * value:.3g} ms"
