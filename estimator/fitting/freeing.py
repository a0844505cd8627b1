"""Plans with one more thing free, or one more sensor between: delay, offset, running mean, encoder. No FMU."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.plans.parameters import Parameter, SensorPlace
from estimator.plans.plan import ChainSpec, Plan
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

TRAVEL = 10.0  # of the largest angle: how far a motor may have turned before the first row
DELAY_ROOM = 20.0  # samples on either side of a delay's start
FREED = 4.0  # standard deviations by which a nuisance must improve the fit


def named(kind: str, plan: Plan, recording: int) -> str:
    """Return the name of one recording's nuisance; plain where there is one recording."""
    if len(plan.observed) == 1:
        return kind
    names = [o.recording.name for o in plan.observed]
    return f"{kind} {names[recording] if names.count(names[recording]) == 1 else recording + 1}"


def unit_of(name: str, plan: Plan) -> str:
    """Return the unit of a delay, an offset or a gain by its name; nothing for a gain."""
    kind, _, rest = name.partition(" ")
    if kind == "offset":
        return plan.description.variable(rest.partition(" ")[0]).unit or ""
    return "s" if kind == "delay" else ""


def delay_parameter(plan: Plan, recording: int, start: float) -> Parameter:
    """Return a free delay of one recording, around a start in s."""
    h = plan.observed[recording].recording.step
    return Parameter(
        name=named("delay", plan, recording),
        unit="s",
        lower=start - DELAY_ROOM * h,
        upper=start + DELAY_ROOM * h,
        log=False,
        targets=(),
        start=start,
        place=SensorPlace("delay", recording),
    )


def free_delay(plan: Plan, recording: int, start: float) -> Plan:
    """Return the plan with one recording's delay free."""
    observed = list(plan.observed)
    observed[recording] = dataclasses.replace(observed[recording], delay=0.0)
    parameter = delay_parameter(plan, recording, start)
    return dataclasses.replace(plan, observed=tuple(observed), parameters=(*plan.parameters, parameter))


def without(plan: Plan, name: str) -> Plan:
    """Return the plan with a nuisance at its default again."""
    return dataclasses.replace(plan, parameters=tuple(p for p in plan.parameters if p.name != name))


def with_delay(name: str, recording: int) -> Callable[[Plan, float], Plan]:
    """Return what frees a recording's delay, from a change of it in s."""
    return lambda plan, start: free_delay(plan, recording, plan.observed[recording].delay + start)


def with_offset(name: str, output: str, recording: int | None = None) -> Callable[[Plan, float], Plan]:
    """Return what frees an output's offset, of one recording or of all, from a start in its unit."""

    def extend(plan: Plan, start: float) -> Plan:
        spread = max(float(np.nanmax(np.abs(o.outputs[output]))) for o in plan.observed)
        if output == "angle":  # a motor that runs already has turned on, no longer than it is recorded
            spread += TRAVEL * spread
        parameter = Parameter(
            name=name,
            unit=plan.description.variable(output).unit,
            lower=-spread,
            upper=spread,
            log=False,
            targets=(),
            start=start,
            place=SensorPlace("offset", recording, output),
        )
        return dataclasses.replace(plan, parameters=(*plan.parameters, parameter))

    return extend


def with_channel_delay(name: str, output: str) -> Callable[[Plan, float], Plan]:
    """Return what frees a channel's delay beyond that of its recording, from a start in s."""

    def extend(plan: Plan, start: float) -> Plan:
        room = DELAY_ROOM * plan.observed[0].recording.step
        place = SensorPlace("delay", None, output)
        parameter = Parameter(name, "s", start - room, start + room, log=False, targets=(), start=start, place=place)
        return dataclasses.replace(plan, parameters=(*plan.parameters, parameter))

    return extend


def with_gain(name: str, output: str) -> Callable[[Plan, float], Plan]:
    """Return what frees an output's gain, from a start."""

    def extend(plan: Plan, start: float) -> Plan:
        place = SensorPlace("gain", None, output)
        parameter = Parameter(name, "1", 0.1 * start, 10 * start, log=True, targets=(), start=start, place=place)
        return dataclasses.replace(plan, parameters=(*plan.parameters, parameter))

    return extend


def with_place(plan: Plan, place: SensorPlace) -> Plan:
    """Return the plan with a value of the measurement chain free that the case frees."""
    e = place.recording
    if place.kind == "delay" and not place.output:
        assert e is not None
        return free_delay(plan, e, plan.observed[e].delay)
    name = f"{place.kind} {place.output}" if e is None else named(f"{place.kind} {place.output}", plan, e)
    if place.kind == "offset":
        return with_offset(name, place.output, e)(plan, 0.0)
    if place.kind == "gain":
        return with_gain(name, place.output)(plan, 1.0)
    return with_channel_delay(name, place.output)(plan, 0.0)


def with_average(output: str, samples: int) -> Callable[[Plan, float], Plan]:
    """Return what puts a running mean behind an output."""

    def extend(plan: Plan, start: float) -> Plan:
        chain = dataclasses.replace(plan.chains.get(output, ChainSpec()), average=samples)
        return dataclasses.replace(plan, chains={**plan.chains, output: chain})

    return extend


def with_mean(plan: Plan, start: float) -> Plan:
    """Return the plan with the speed taken as a mean over the sampling interval."""
    return dataclasses.replace(plan, sensors={**plan.sensors, "w": layout.MEAN})
