"""The selection of effects that a plan needs: its simulators, and the FMUs that may stand in. Explains nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition_tests import AdditionTests
from estimator.explaining.effects.base import Effect
from estimator.explaining.explanation_noise import count_deviations
from estimator.explaining.first_fit import FirstFit
from estimator.explaining.selection import Selection
from estimator.fitting.effort import Effort
from estimator.fitting.simulator import Nuisance, Simulator, per_recording
from estimator.fmus.probe import bundled_model
from estimator.fmus.workers import Workers
from estimator.motor.names import BUNDLED
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]


def selection_of(
    plan: Plan,
    crew: Workers,
    *,
    sigma: Mapping[str, float],
    deviations: FloatArray,
    effects: Sequence[Effect],
    effort: Effort,
) -> Selection:
    """Return the selection of effects for a plan; arguments as for `explain` and `Selection`."""
    own = [n for e in effects if not e.fmu for n in e.nuisances(plan)]
    own += _in_place_of_columns(effects, plan)
    wanted = freed_by_the_case(plan)
    own = [n for n in own if n.name not in {w.name for w in wanted}]
    base = Simulator(plan, (*own, *wanted), crew, sigma, effort)
    tests = AdditionTests(base, _rivals(base, effects))
    always = tuple(n.name for n in wanted)
    first = FirstFit(tests, always, deviations, tuple(effects))
    return Selection(tests, first, count_deviations(plan), tuple(effects), effort)


def _rivals(base: Simulator, effects: Sequence[Effect]) -> Callable[[str], Simulator | None]:
    """Return what makes simulators of bundled FMUs that may stand in for the plan's, by name, each once."""
    plan, can_stand_in = base.plan, may_be_replaced(base.plan)

    @cache
    def simulator(name: str) -> Simulator | None:
        if not can_stand_in:
            return None
        there = plan.on(bundled_model(name))
        own = [n for e in effects if e.fmu == name for n in e.nuisances(plan)]
        own += [n for e in effects for n in e.in_place_of_columns(plan)]
        held = {n.name for n in base.nuisances}
        own = [n for n in own if _is_open(n, plan, there) and n.name not in held]
        return Simulator(there, (*base.nuisances, *own), base.crew, base.sigma, base.effort)

    return simulator


def _in_place_of_columns(effects: Sequence[Effect], plan: Plan) -> list[Nuisance]:
    """Return the nuisance parameters of effects that a plan's FMU simulates, as one of the package's own does.

    What moves from the first row is as large as the signals where a recording begins within a response. Elsewhere
    columns do: they know what was before the first row, which an output shows that is late.
    """
    if not plan.description.is_bundled or not any(o.is_underway for o in plan.observed):
        return []
    return [n for e in effects for n in e.in_place_of_columns(plan) if n.target in plan.binding.own]


def _is_open(nuisance: Nuisance, plan: Plan, there: Plan) -> bool:
    """Whether a plan says nothing of what a nuisance parameter sets in the FMU that may stand in, and has none."""
    target = nuisance.target
    if target not in there.binding.own or target in there.fixed:
        return False
    return target not in {t for p in plan.parameters for t in p.targets}


def may_be_replaced(plan: Plan) -> bool:
    """Return whether the plan's FMU is a bundled motor, in whose place one with more effects may stand."""
    is_motor = plan.description.is_bundled and plan.description.path.stem in BUNDLED
    known = {*(p.quantity or p.name for p in plan.parameters), *plan.fixed}
    return is_motor and known <= {*plan.binding.parameters, "v", "load"}


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
