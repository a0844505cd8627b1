"""Which parameters are free, between which bounds, and where to begin. Knows the case, the FMU's table and the data."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import ParameterSpec
from estimator.cases.si_units import is_known
from estimator.errors import InputError
from estimator.fmus.variable import Variable, reach
from estimator.motor.integral_least_squares import integral_estimate, sane, speed_estimate
from estimator.motor.names import BUNDLED, MOTOR
from estimator.plans.binding import Binding
from estimator.plans.parameters import Parameter
from estimator.plans.plan import Observed

FloatArray = NDArray[np.float64]
Limits = tuple[float | None, float | None]

PAPER_BOX = {"R": (0.01, 5.0), "K": (0.005, 0.1), "L": (1e-7, 0.5), "J": (1e-7, 1e-3), "B": (1e-5, 1e-3)}
WIDTH = {"R": 100.0, "K": 100.0, "B": 1e6}  # bounds around the data's start when none are given: factor either way
USUAL_WIDTH = 1e4
FAR = 0.05  # of how far a motor turns in one recording: of one in which it turns less far nothing is guessed
LIMIT, AT_LIMIT = "current_limit", 0.95  # of a drive, A; of the largest current that is shown
MOST_HELD = 6  # parameters named in one sentence


def first_guess(binding: Binding, observed: tuple[Observed, ...]) -> dict[str, float]:
    """Return a first guess of the motor's parameters from the data; empty where they show none.

    From the first recording that tells them; none in which the motor hardly turns beside another.
    """
    driven = [o for o in observed if {"v"} <= set(o.inputs) and o.excitation.kind != "none"]
    whole = [o for o in driven if {"i", "w"} <= set(o.outputs)]
    far = FAR * max(map(_turned, whole), default=0.0)
    for o in (o for o in whole if _turned(o) >= far):
        inputs, outputs = o.in_time()
        v, i, w = inputs["v"], outputs["i"], outputs["w"]
        if any(not np.nanmax(np.abs(x), initial=0.0) for x in (v, i, w)):
            return {}  # a signal that shows nothing
        load = binding.fixed.get("load", 0.0)
        guess = sane(integral_estimate(v, i, w, step=o.recording.step, load=load), v, i, w, step=o.recording.step)
        limit = {LIMIT: AT_LIMIT * float(np.nanmax(np.abs(i)))} if guess and LIMIT in binding.parameters else {}
        return {**guess, **limit}
    for o in driven:
        if {"w", "angle"} & set(o.outputs):
            return _guess_without_current(binding, o)
    return {}


def _turned(o: Observed) -> float:
    """Return how far a motor turns while its current is recorded, rad."""
    shown = float(np.mean(~np.isnan(o.outputs["i"])))
    return shown * o.recording.step * float(np.nansum(np.abs(o.outputs["w"])))


def _guess_without_current(binding: Binding, observed: Observed) -> dict[str, float]:
    """Return what speed or angle say of K, J, B with the resistance and inductance that are given, or the FMU's own."""
    given = {}
    for name in ("R", "L"):
        spec = binding.case.parameters.get(name) or ParameterSpec(name)
        own = binding.parameters.get(name)
        known = (binding.fixed.get(name), spec.nominal, spec.start, _number(own.start) if own else None)
        given[name] = next((value for value in known if value is not None and value > 0), None)
    R, L, step = given["R"], given["L"], observed.recording.step
    if R is None:
        return {}
    inputs, outputs = observed.in_time()
    w = outputs["w"] if "w" in outputs else np.gradient(outputs["angle"], step)
    return speed_estimate(inputs["v"], w, step=step, R=R, L=L)


def free_parameters(
    binding: Binding, guess: Mapping[str, float], recordings: Sequence[str] = ("",)
) -> tuple[Parameter, ...]:
    """Return the free parameters with their bounds and starts; one for each recording where the case says so.

    Raises
    ------
    InputError
        A parameter has no bounds: one sentence.
    """
    found: list[Parameter] = []
    for spec in binding.free:
        parameter = _parameter(spec, binding, guess)
        if not spec.per_recording or len(recordings) == 1:
            found.append(parameter)
            continue
        labels = recordings if len(set(recordings)) == len(recordings) else [str(k + 1) for k in range(len(recordings))]
        found += [
            replace(parameter, name=f"{spec.name} {label}", recording=e, quantity=spec.name)
            for e, label in enumerate(labels)
        ]
    return tuple(found)


def held_parameters(binding: Binding) -> tuple[str, ...]:
    """Return a sentence about the FMU's parameters that are held because nobody named them; none if there are none.

    Where a case names some, it means the others to be held, but hardly those that every motor has.
    """
    held = _held(binding)
    if binding.case.parameters:
        held = [v for v in held if v.name in MOTOR]
    if not held:
        return ()
    unless = " unless the recording shows another" if _may_show_another(binding) else ""
    return (f"held at the FMU's own value{unless}: {_listed(held)}; name under [parameters] what is to be estimated",)


def held_inputs(binding: Binding) -> tuple[str, ...]:
    """Return a sentence about the FMU's inputs that nothing drives and nobody named; no load is what everyone takes."""
    driven = {binding.signal(name).name for name in binding.channels[0].inputs}
    taken = driven | {*binding.case.fixed, *(target for spec in binding.free for target in spec.fmu)}
    held = {n: v for n, v in binding.inputs.items() if v.name not in taken and v.is_real and v.start is not None}
    told = [v for n, v in held.items() if v.start != 0 or not (n == "load" or binding.is_motor)]
    if not told:
        return ()
    first = shlex.quote(f"{told[0].name}=VALUE")
    return (
        f"inputs that no column drives are held at the FMU's own value: {_listed(told)}; --fix {first} gives another,"
        " and what is named under [parameters] is estimated",
    )


def units_taken(binding: Binding) -> tuple[str, ...]:
    """Return sentences about quantities of a motor whose unit the FMU does not say, or says as nobody knows it.

    Where the case says a factor of one, its unit is settled.
    """
    if not binding.is_motor:
        return ()
    used = {p.name: binding.own[p.fmu[0]] for p in binding.free if p.name in MOTOR and not p.gains}
    used |= {name: binding.signal(name) for name in binding.channels[0].inputs}
    used |= {name: binding.signal(name) for name, spec in binding.outputs.items() if spec.gain is None}
    path = binding.description.path.name
    bare = ", ".join(name for name, v in used.items() if not v.unit)
    unknown = ", ".join(f"{v.unit!r} of {name}" for name, v in used.items() if v.unit and not is_known(v))
    told = [f"{path} says no unit of {bare}: taken as SI, here and in what is derived from it"] if bare else []
    told += [f"{path} says units that are not known, {unknown}: its numbers are taken as SI"] if unknown else []
    return tuple(told)


def never_named(binding: Binding) -> tuple[str, ...]:
    """Return the names of all of the FMU's parameters that are held as nobody named them, whatever recordings show."""
    return () if _may_show_another(binding) else tuple(v.name for v in _held(binding))


def _held(binding: Binding) -> list[Variable]:
    taken = {*binding.case.fixed, *(target for spec in binding.free for target in spec.fmu)}
    return [v for v in binding.parameters.values() if v.name not in taken and v.is_real and v.start is not None]


def _listed(held: Sequence[Variable]) -> str:
    """Return variables with the values that they are held at, the first ones."""
    units = ["" if v.unit == "1" else v.unit for v in held]
    values = [f"{v.name} = {_number(v.start):.6g} {unit}".rstrip() for v, unit in zip(held, units, strict=True)]
    listed = ", ".join(values[:MOST_HELD])
    return f"{listed} and {len(held) - MOST_HELD} more" if len(held) > MOST_HELD else listed


def _may_show_another(binding: Binding) -> bool:
    return binding.description.is_bundled and binding.description.path.stem in BUNDLED


def _parameter(spec: ParameterSpec, binding: Binding, guess: Mapping[str, float]) -> Parameter:
    name, is_paper = spec.name, binding.case.search.method in ("paper", "original")
    targets = [binding.target(variable) for variable in spec.fmu]
    gains = spec.gains or (1.0,) * len(targets)
    allowed = _limits(targets, gains)
    if spec.start is not None and _within(spec.start, allowed) != spec.start:
        raise InputError(
            f"parameter {name!r} starts at {spec.start:g}, outside the range {reach(*allowed)} that"
            f" {binding.description.path.name} allows"
        )
    start = spec.start if spec.start is not None else _within(guess.get(name), allowed)
    if start is None:
        start = spec.nominal if spec.nominal is not None else _over(_usual_start(targets[0]), gains[0])
    box = PAPER_BOX.get(name, (None, None)) if is_paper else (None, None)
    given = [box[k] if limit is None else limit for k, limit in enumerate((spec.minimum, spec.maximum))]
    usual = _over(targets[0].nominal, abs(gains[0]))
    lower, upper = _around(start, given, allowed, WIDTH.get(name, USUAL_WIDTH), usual)
    if lower is None or upper is None or not np.isfinite([lower, upper]).all():
        raise InputError(
            f"parameter {name!r} has no bounds and no positive start to put them around; give them with"
            f" --bounds {name}=MIN:MAX or in the case file"
        )
    if lower >= upper:
        raise InputError(f"parameter {name!r}: the lower bound {lower:g} is not below the upper bound {upper:g}")
    low, high = allowed
    if (low is not None and lower < low) or (high is not None and upper > high):
        raise InputError(
            f"parameter {name!r}: the bounds {lower:g} to {upper:g} leave the range"
            f" {reach(low, high)} that {binding.description.path.name} allows"
        )
    return Parameter(
        name=name,
        unit=targets[0].unit,
        lower=float(lower),
        upper=float(upper),
        log=lower > 0 and not is_paper,
        targets=spec.fmu,
        start=None if start is None else float(np.clip(start, lower, upper)),
        nominal=spec.nominal,
        gains=spec.gains,
        vanishes=name not in MOTOR and given[0] is None and allowed[0] == 0,
    )


def _around(
    start: float | None, given: Sequence[float | None], allowed: Limits, width: float, usual: float | None
) -> Limits:
    """Return bounds: those that are given, else a factor around a start within what the FMU allows.

    Around a start of zero that is as many times the FMU's nominal value, `usual`, where it has one: within 1e6 N.m, any
    friction is next to zero. Where the FMU says that a parameter may be negative, it is so by as much as it may be
    positive.
    """
    (lower, upper), (low, high) = given, allowed
    is_positive = start is not None and start > 0
    if start == 0 and usual is not None and usual > 0:
        low, high = (None if end is None else max(-width * usual, min(width * usual, end)) for end in allowed)
    if lower is None:
        lower = low
        if start is not None and is_positive:
            lower = -start * width if low is not None and low < 0 else start / width
        lower = max(lower, low) if lower is not None and low is not None else lower
    if upper is None:
        upper = start * width if start is not None and is_positive else high
        upper = min(upper, high) if upper is not None and high is not None else upper
    return lower, upper


def _usual_start(variable: Variable) -> float | None:
    """Return a variable's start; its nominal value where it starts at its maximum, as a limit does that is none."""
    start = _number(variable.start)
    return variable.nominal if start is not None and start == variable.maximum and variable.nominal else start


def _within(guess: float | None, allowed: Limits) -> float | None:
    """Return the value next to a guess that the FMU allows."""
    if guess is None:
        return None
    low, high = allowed
    return min(max(guess, -np.inf if low is None else low), np.inf if high is None else high)


def _limits(targets: Sequence[Variable], gains: Sequence[float]) -> Limits:
    """Return the range of a parameter in which all its variables stay within theirs."""
    lows, highs = [], []
    for variable, gain in zip(targets, gains, strict=True):
        ends = [_over(variable.minimum, gain), _over(variable.maximum, gain)]
        low, high = ends if gain > 0 else ends[::-1]
        lows += [] if low is None else [low]
        highs += [] if high is None else [high]
    return max(lows, default=None), min(highs, default=None)


def _over(value: float | None, gain: float) -> float | None:
    return None if value is None else value / gain


def _number(value: float | str | None) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
