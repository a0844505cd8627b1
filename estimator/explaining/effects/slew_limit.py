"""The drive changes the motor's voltage at a limited rate: a larger change of its command takes longer.

Changes of one size all take as long: that is a ramp (`voltage_ramp.py`). Those of several sizes are no mean of what is
simulated by the command. What is missing until they are over is a voltage on lines: the motor's linear response to it
is exact, and is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.voltage_ramp import SLEW, TRIED, VoltageRamp, changes_differ, changes_of_commands
from estimator.explaining.effects.voltage_rise import NAME as RISE
from estimator.explaining.effects.voltage_rise import times_of_command
from estimator.fitting.lateness import channel_delay
from estimator.fitting.motor_response import COASTS, SEATS, driven_on_lines
from estimator.fitting.simulator import Nuisance, Simulator, per_recording
from estimator.motor.names import MOTOR
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import Plan
from estimator.stepping import layout

FloatArray = NDArray[np.float64]
Corners = tuple[FloatArray, FloatArray, FloatArray]  # times, s; jumps, V; changes of slope, V/s


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
        if not any(o.is_measured for o in plan.observed):
            is_told = changes_differ(plan)  # else that is a ramp
        else:
            is_told = changes_of_commands(plan) is not None
        is_motor = set(MOTOR) <= {*plan.names, *plan.fixed} and set(plan.outputs) <= {"i", "w"}
        if not is_told or plan.chains or not is_motor:
            return []
        return [
            Nuisance(
                self.name, "s", 0.0, longest, 0.0, plan.shortest_step,
                adds=_added, tries=tries, excludes=(RISE, VoltageRamp.name),
            )
            for longest, tries in times_of_command(plan, TRIED, of_some=True)
        ]  # fmt: skip


def _added(s: Simulator, candidate: FloatArray, earlier: float) -> FloatArray:
    """Return what the outputs show more, (rows, q), than by the command at once; a time earlier, s."""
    value = dict(zip(s.names, candidate.tolist(), strict=True))
    motor = {**s.plan.fixed, **value}
    commands = [(e, clock) for e, clock in enumerate(s.clocks) if not s.observed[e].is_measured]
    changes = [np.diff(s.inputs("v")[clock.rows], prepend=0.0) for _, clock in commands]
    rate = max(float(np.max(np.abs(change))) for change in changes) / value[SLEW]
    result = np.zeros((s.rows, len(s.outputs)))
    for e, clock in commands:
        command = s.inputs("v")[clock.rows]
        times, jumps, slopes = missing(command, clock.time, rate)
        own = [n.name for n in s.nuisances if n.place == SensorPlace("delay", e)]
        late = earlier + (value[own[0]] if own else s.observed[e].delay)
        is_open = any(value.get(name) == 1.0 for name in (COASTS, per_recording(s.plan, COASTS)[e]))
        opens = (command == 0) & is_open
        known: dict[float, FloatArray] = {}
        for j, output in enumerate(s.outputs):
            behind = late + channel_delay(s, value.__getitem__, output)
            if behind not in known:
                known[behind] = driven_on_lines(motor, clock, (times + behind, jumps, slopes), opens)
            shown = known[behind][:, SEATS[output]]
            if s.plan.sensors[output] == layout.MEAN:
                shown = 0.5 * (shown + np.concatenate([shown[:1], shown[:-1]]))
            result[clock.rows, j] = shown
    return result


def missing(command: FloatArray, time: FloatArray, rate: float) -> Corners:
    """Return a voltage that follows a command, (n,), held from row to row, V, by a rate, V/s, from 0 V, less that."""
    found, now, slope = list[tuple[float, float, float]](), 0.0, 0.0
    edges = np.flatnonzero(np.diff(command, prepend=0.0)).tolist()
    for first, following in zip(edges, [*edges[1:], None], strict=True):
        target, begins = float(command[first]), float(time[first])
        ends = begins + abs(target - now) / rate
        until = np.inf if following is None else float(time[following])
        own = rate * float(np.sign(target - now))
        found.append((begins, float(command[first - 1] if first else 0.0) - target, own - slope))
        slope, now = own, now + own * (min(ends, until) - begins)
        if ends < until:
            found.append((ends, 0.0, -slope))
            slope = 0.0
    times, jumps, slopes = np.array(found).reshape(-1, 3).T
    return times, jumps, slopes
