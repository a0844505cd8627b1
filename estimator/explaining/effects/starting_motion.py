"""The motor turns, or carries a current, when the recording begins, without a voltage as cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.effects.base import Effect
from estimator.explaining.effects.drive import coasting_switches, coasts_in
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import free_motion, motor_values, opens_circuit
from estimator.fitting.simulator import Nuisance, per_recording
from estimator.plans.plan import Observed, Plan
from estimator.recordings.samples import filled

UNITS = {"w": "rad/s", "i": "A"}
FIRST_ROWS = 3  # rows whose mean is tried
MOST, SIZE = 20.0, 0.02  # of a channel's largest sample: bounds; a typical change


@dataclass(frozen=True)
class StartingMotion(Effect):
    """Speed and current in the first row beyond the model's, rad/s and A.

    Of a recording that begins within a response, and in an FMU with modes, they are where the simulation begins, if the
    FMU is one of the package's: what moves is as large as the signals, so that its derivatives count, and dry friction
    brakes it. Elsewhere they are columns, and so beside a drive that opens the circuit at no voltage, where a current
    flows in the first rows: it begins to open it with the first voltage only.
    """

    name: str = "motion before the voltage"
    sharp: bool = True
    prior: float = 0.05
    sentence: str = "{name}: the motor moves already in the first row; its speed and current there are estimated"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the motor's free motion from the first row of each recording that may begin in motion."""
        s = fit.simulator
        if motor_values(fit) is None:
            return ()
        found = []
        for e, (o, clock, name) in enumerate(zip(s.observed, s.clocks, per_recording(s.plan, self.name), strict=True)):
            opens, opens_first = opens_circuit(fit, e), _coasts_first(o)
            is_simulated = name in s.index and (opens_first or not opens)
            if not (o.lead or o.at_rest or is_simulated):
                units = (UNITS["w"],) if opens and opens_first else (UNITS["w"], UNITS["i"])  # no current flows then
                columns = free_motion(fit, clock, opens_first=opens and opens_first)[:, :, : len(units)]
                if len(s.clocks) > 1:
                    own, columns = columns, np.zeros((s.rows, len(s.outputs), len(units)))
                    columns[clock.rows] = own
                found.append(Linear(name, columns, units, moves=True))
        return found

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return speed and current in the first row of recordings that begin within a response, or with a coast."""
        found: dict[str, float] = {}
        for o, name in zip(plan.observed, per_recording(plan, self.name), strict=True):
            if not set(UNITS) <= set(o.outputs):
                continue
            first = _first(o)
            if _coasts_first(o):
                found |= {name: first["w"]}
            elif o.is_underway:
                found |= {name: first["w"], f"{name}#1": first["i"]}
        return found

    def seen(self, fit: Fit) -> Sequence[Linear]:
        """Return the motion of recordings that begin within a response."""
        names = per_recording(fit.simulator.plan, self.name)
        underway = {name for o, name in zip(fit.simulator.observed, names, strict=True) if o.is_underway}
        return [group for group in self.linear(fit) if group.name in underway] if underway else ()

    def in_place_of_columns(self, plan: Plan) -> Sequence[Nuisance]:
        """Return speed and current with which the simulation of each recording begins, where both are measured."""
        if not set(UNITS) <= set(plan.outputs):
            return ()
        largest = {y: plan.largest(y) for y in UNITS}
        found: list[Nuisance] = []
        switches = coasting_switches(plan)
        for e, (o, name) in enumerate(zip(plan.observed, per_recording(plan, self.name), strict=True)):
            own = tuple(switch for switch, recording, _ in switches if recording in (None, e))
            names, opens = {"w": name, "i": f"{name}#1"}, _coasts_first(o)
            if opens:  # no current flows
                del names["i"]
            first = _first(o)
            together = {start: first[y] for y, start in names.items() if y != "w"}
            for y, start in names.items():
                reach, is_tried = MOST * largest[y], y == "w" and first[y] != 0 and not (o.lead or o.at_rest)
                found.append(
                    Nuisance(
                        start, UNITS[y], -reach, reach, 0.0, SIZE * largest[y], target=y, recording=e,
                        tries=(first[y],) if is_tried else (), together=(together,),
                        excludes=() if opens else own,
                    )
                )  # fmt: skip
        return found


def _coasts_first(o: Observed) -> bool:
    """Whether a motor is seen to turn before its first voltage, without a current."""
    v = o.inputs.get("v")
    return v is not None and coasts_in(o, np.asarray(np.cumsum(v != 0) == 0))


def _first(o: Observed) -> dict[str, float]:
    """Return speed and current of a recording in its first rows, rad/s and A."""
    return {y: float(np.mean(filled(o.outputs[y])[:FIRST_ROWS])) for y in UNITS}
