"""What a motor's outputs show more by a voltage that is missing from its command. Knows motors that are linear.

A command that the drive does not follow, each change by another amount, is no mean of what is simulated by it. What is
missing is a voltage on lines: the linear motor's response to it is exact, and is added.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.lateness import channel_delay, recording_delay
from estimator.fitting.motor_response import COASTS, driven_on_lines, sensed
from estimator.fitting.simulator import Simulator, per_recording
from estimator.fitting.winding_temperature import warmth
from estimator.motor.names import MOTOR
from estimator.noise.clock import Clock
from estimator.plans.plan import Observed, Plan

FloatArray = NDArray[np.float64]
Corners = tuple[FloatArray, FloatArray, FloatArray]  # times, s; jumps, V; changes of slope, V/s
Missing = Callable[[Simulator, float, Observed], Corners]  # of a recording, by the value of a nuisance parameter

ROUNDING = 1e-6  # of a row


def is_linear(plan: Plan) -> bool:
    """Whether a plan is that of a motor whose outputs are shown as they are: what is missing may be added to these."""
    is_motor = set(MOTOR) <= {*plan.names, *plan.fixed} and set(plan.outputs) <= {"i", "w"}
    return is_motor and not plan.chains and all(p.place is None or p.place.kind == "delay" for p in plan.parameters)


def shown_more(name: str, missing: Missing, s: Simulator, candidate: FloatArray, earlier: float) -> FloatArray:
    """Return what the outputs show more, (rows, q), than by the command at once; a part of a row earlier.

    Parameters
    ----------
    name : of the nuisance parameter
    missing : callable
        What is missing from the command of a recording, by that parameter's value.
    """
    value = dict(zip(s.names, candidate.tolist(), strict=True))
    motor = {**s.plan.fixed, **value}
    warm = warmth(s.plan)
    result = np.zeros((s.rows, len(s.outputs)))
    for e in (e for e, o in enumerate(s.observed) if not o.is_measured):
        o, clock = s.observed[e], s.clocks[e]
        corners = missing(s, value[name], o)
        late = earlier * clock.step + recording_delay(s, value.__getitem__, e)
        is_open = any(value.get(name) == 1.0 for name in (COASTS, per_recording(s.plan, COASTS)[e]))
        known: dict[float, FloatArray] = {}
        for j, output in enumerate(s.outputs):
            behind = late + channel_delay(s, value.__getitem__, output)
            if behind not in known:
                opens = _held(o.inputs["v"], clock, behind) == 0 if is_open else np.zeros(len(clock.time), dtype=bool)
                of_run = {**motor, "R": motor["R"] * warm[e]}
                known[behind] = driven_on_lines(of_run, clock, (corners[0] + behind, *corners[1:]), opens)
            result[clock.rows, j] = sensed(s, output, known[behind].T, clock)
    return result


def _held(command: FloatArray, clock: Clock, late: float) -> FloatArray:
    """Return a command, (n,), as it is some s later."""
    row = np.floor(np.arange(len(command)) - late / clock.step + ROUNDING).astype(int)
    return np.asarray(command[np.clip(row, 0, len(command) - 1)])
