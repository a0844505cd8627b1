"""The selection of effects that a plan needs: its simulators, and the FMUs that may stand in. Explains nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition_tests import AdditionTests
from estimator.explaining.effects.base import Effect
from estimator.explaining.explanation_noise import count_deviations
from estimator.explaining.selection import Selection
from estimator.fitting.simulator import Nuisance, Simulator, per_recording
from estimator.fmus.probe import bundled_model
from estimator.fmus.workers import Workers
from estimator.motor.names import MOTOR
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

LINEAR_MOTOR = "dc_motor"  # that a bundled FMU with more effects may replace


def selection_of(
    plan: Plan,
    crew: Workers,
    *,
    sigma: Mapping[str, float],
    deviations: FloatArray,
    effects: Sequence[Effect],
) -> Selection:
    """Return the selection of effects for a plan; arguments as for `explain`."""
    own = [n for e in effects if not e.fmu for n in e.nuisances(plan)]
    wanted = freed_by_the_case(plan)
    own = [n for n in own if n.name not in {w.name for w in wanted}]
    base = Simulator(plan, (*own, *wanted), crew, sigma)
    tests = AdditionTests(base, _Rivals(plan, base, crew, sigma, effects))
    always = tuple(n.name for n in wanted)
    return Selection(tests, always, deviations, count_deviations(plan), tuple(effects))


class _Rivals:
    """Simulators of bundled FMUs that may stand in for the linear motor."""

    def __init__(
        self, plan: Plan, base: Simulator, crew: Workers, sigma: Mapping[str, float], effects: Sequence[Effect]
    ) -> None:
        self.effects = effects
        self.plan, self.base, self.crew, self.sigma = plan, base, crew, sigma
        self.known: dict[str, Simulator | None] = {}

    def __call__(self, name: str) -> Simulator | None:
        if name not in self.known:
            self.known[name] = self._simulator(name) if self._can_stand_in() else None
        return self.known[name]

    def _can_stand_in(self) -> bool:
        plan = self.plan
        is_linear_motor = plan.description.is_bundled and plan.description.path.stem == LINEAR_MOTOR
        return is_linear_motor and {*plan.names, *plan.fixed} <= {*MOTOR, "v", "load"}

    def _simulator(self, name: str) -> Simulator:
        plan = self.plan.on(bundled_model(name))
        has = plan.binding.own
        own = [n for e in self.effects if e.fmu == name for n in e.nuisances(self.plan) if n.target in has]
        own += [n for e in self.effects for n in e.in_place_of_columns(self.plan) if n.target in has]
        return Simulator(plan, (*self.base.nuisances, *own), self.crew, self.sigma)


def freed_by_the_case(plan: Plan) -> list[Nuisance]:
    """Return the values of the measurement chain that the case frees."""
    found = []
    for place in plan.wanted:
        kind, e, y = place.kind, place.recording, place.output
        h = plan.shortest_step
        if kind == "delay" and not y:
            assert e is not None
            name, start = per_recording(plan, "delay")[e], plan.observed[e].delay
            found.append(Nuisance(name, "s", start - 20 * h, start + 20 * h, start, h, place=place))
        elif kind == "delay":
            found.append(Nuisance(f"delay {y}", "s", -20 * h, 20 * h, 0.0, h, place=place))
        elif kind == "gain":
            found.append(Nuisance(f"gain {y}", "", 0.1, 10.0, 1.0, 0.1, log=True, place=place))
        else:
            spread = plan.largest(y)
            name = f"offset {y}" if e is None else per_recording(plan, f"offset {y}")[e]
            unit = plan.unit(y)
            found.append(Nuisance(name, unit, -11 * spread, 11 * spread, 0.0, 0.01 * spread, place=place))
    return found
