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
from estimator.fitting.winding_temperature import warmth
from estimator.motor.names import MOTOR
from estimator.noise.clock import Clock
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import Observed, Plan
from estimator.stepping import layout

FloatArray = NDArray[np.float64]
ROUNDING = 1e-6  # of a row
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
        beside_measured = any(o.is_measured for o in plan.observed)
        changes = changes_of_commands(plan)
        is_told = changes is not None and len(changes) > 0 and (beside_measured or changes_differ(plan))  # else a ramp
        is_motor = set(MOTOR) <= {*plan.names, *plan.fixed} and set(plan.outputs) <= {"i", "w"}
        is_plain = not plan.chains and all(p.place is None or p.place.kind == "delay" for p in plan.parameters)
        if not (is_told and is_motor and is_plain):
            return []
        return [
            Nuisance(
                self.name, "s", 0.0, longest, 0.0, plan.shortest_step,
                adds=_added, tries=tries, excludes=(RISE, VoltageRamp.name),
            )
            for longest, tries in times_of_command(plan, TRIED, of_some=True)
        ]  # fmt: skip


def _added(s: Simulator, candidate: FloatArray, earlier: float) -> FloatArray:
    """Return what the outputs show more, (rows, q), than by the command at once; a part of a row earlier."""
    value = dict(zip(s.names, candidate.tolist(), strict=True))
    motor = {**s.plan.fixed, **value}
    warm = warmth(s.plan.temperatures, len(s.clocks))
    commands = [e for e, o in enumerate(s.observed) if not o.is_measured]
    largest = max(float(np.max(np.abs(s.observed[e].changes("v")))) for e in commands)
    result = np.zeros((s.rows, len(s.outputs)))
    for e in commands:
        o, clock = s.observed[e], s.clocks[e]
        corners = missing(o, largest / value[SLEW])
        own = [n.name for n in s.nuisances if n.place == SensorPlace("delay", e)]
        late = earlier * clock.step + (value[own[0]] if own else o.delay)
        is_open = any(value.get(name) == 1.0 for name in (COASTS, per_recording(s.plan, COASTS)[e]))
        known: dict[float, FloatArray] = {}
        for j, output in enumerate(s.outputs):
            behind = late + channel_delay(s, value.__getitem__, output)
            if behind not in known:
                opens = _held(o.inputs["v"], clock, behind) == 0 if is_open else np.zeros(len(clock.time), dtype=bool)
                of_run = {**motor, "R": motor["R"] * warm[e]}
                known[behind] = driven_on_lines(of_run, clock, (corners[0] + behind, *corners[1:]), opens)
            shown = known[behind][:, SEATS[output]]
            if s.plan.sensors[output] == layout.MEAN:
                shown = 0.5 * (shown + np.concatenate([shown[:1], shown[:-1]]))
            result[clock.rows, j] = shown
    return result


def _held(command: FloatArray, clock: Clock, late: float) -> FloatArray:
    """Return a command, (n,), as it is some s later."""
    row = np.floor(np.arange(len(command)) - late / clock.step + ROUNDING).astype(int)
    return np.asarray(command[np.clip(row, 0, len(command) - 1)])


def missing(o: Observed, rate: float) -> Corners:
    """Return a voltage that follows a recording's command, held from row to row, by a rate, V/s, less that command.

    It begins at what the motor was run in with, or at none.
    """
    command, change, time = o.inputs["v"], o.changes("v"), o.times
    found, now, slope = list[tuple[float, float, float]](), float(command[0] - change[0]), 0.0
    edges = np.flatnonzero(change).tolist()
    for first, following in zip(edges, [*edges[1:], None], strict=False):
        target, begins = float(command[first]), float(time[first])
        ends = begins + abs(target - now) / rate
        until = np.inf if following is None else float(time[following])
        own = rate * float(np.sign(target - now))
        found.append((begins, -float(change[first]), own - slope))
        slope, now = own, now + own * (min(ends, until) - begins)
        if ends < until:
            found.append((ends, 0.0, -slope))
            slope = 0.0
    times, jumps, slopes = np.array(found).reshape(-1, 3).T
    return times, jumps, slopes
