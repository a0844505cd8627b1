"""Which parameters are free, between which bounds, and where to begin. Knows the case, the FMU's table and the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import Case, ParameterSpec
from estimator.cases.mapping import how_to_map, target
from estimator.errors import FmuError, InputError
from estimator.fmus.fmu import FmuDescription, Variable
from estimator.motor.integral_least_squares import integral_estimate, sane, speed_estimate
from estimator.motor.names import MOTOR
from estimator.plans.parameters import Parameter
from estimator.plans.plan import Observed

FloatArray = NDArray[np.float64]

PAPER_BOX = {"R": (0.01, 5.0), "K": (0.005, 0.1), "L": (1e-7, 0.5), "J": (1e-7, 1e-3), "B": (1e-5, 1e-3)}
WIDTH = {"R": 100.0, "K": 100.0, "B": 1e6}  # bounds around the data's start when none are given: factor either way
USUAL_WIDTH = 1e4
FREE_TOO = ("friction",)  # beside the motor's five, where the FMU has it: the Coulomb friction of dc_motor_friction
MOST_HELD = 6  # parameters named in one sentence


def first_guess(case: Case, observed: tuple[Observed, ...], description: FmuDescription) -> dict[str, float]:
    """Return a first guess of the motor's parameters from the data; empty where they show none."""
    for o in observed:
        if {"v"} <= set(o.inputs) and {"i", "w"} <= set(o.outputs) and o.excitation.kind != "none":
            inputs, outputs = o.in_time()
            v, i, w = inputs["v"], outputs["i"], outputs["w"]
            if any(not np.nanmax(np.abs(x), initial=0.0) for x in (v, i, w)):
                return {}  # a signal that shows nothing
            load = case.fixed.get("load", 0.0)
            guess = integral_estimate(v, i, w, step=o.recording.step, load=load)
            return sane(guess, v, i, w, step=o.recording.step)
    for o in observed:
        if "v" in o.inputs and {"w", "angle"} & set(o.outputs) and o.excitation.kind != "none":
            return _guess_without_current(case, o, description)
    return {}


def _guess_without_current(case: Case, observed: Observed, description: FmuDescription) -> dict[str, float]:
    """Return what speed or angle say of K, J, B with the resistance and inductance that are given, or the FMU's own."""
    given = {}
    for name in ("R", "L"):
        spec = case.parameters.get(name) or ParameterSpec(name)
        own = next((_number(v.start) for v in description.of_causality("parameter") if v.name == name), None)
        known = (case.fixed.get(name), spec.nominal, spec.start, own)
        given[name] = next((value for value in known if value is not None and value > 0), None)
    R, L, step = given["R"], given["L"], observed.recording.step
    if R is None:
        return {}
    inputs, outputs = observed.in_time()
    w = outputs["w"] if "w" in outputs else np.gradient(outputs["angle"], step)
    return speed_estimate(inputs["v"], w, step=step, R=R, L=L)


def free_parameters(
    case: Case, description: FmuDescription, guess: Mapping[str, float], recordings: Sequence[str] = ("",)
) -> tuple[Parameter, ...]:
    """Return the free parameters with their bounds and starts; one for each recording where the case says so.

    Raises
    ------
    FmuError, InputError
        A parameter is unknown, or has no bounds: one sentence.
    """
    available = [v.name for v in description.of_causality("parameter")]
    names = [n for n in case.parameters if n not in case.fixed]
    if not case.parameters:
        names = [n for n in (*MOTOR, *FREE_TOO) if n in available and n not in case.fixed]
        if not names and not any(n in available for n in MOTOR):
            listed = ", ".join(available[:20]) or "none"
            raise FmuError(
                f"{description.path.name} has none of the parameters R, K, L, J, B (its parameters: {listed});"
                f" {how_to_map(case, description, 'parameters', 'which parameters to estimate')}"
            )
    elif all(n in MOTOR for n in case.parameters) and all(n in available for n in MOTOR):
        names = [n for n in MOTOR if n not in case.fixed]  # bounds for some do not fix the others
    found: list[Parameter] = []
    for name in names:
        parameter = _parameter(name, case, description, guess)
        if (spec := case.parameters.get(name)) is None or not spec.per_recording or len(recordings) == 1:
            found.append(parameter)
            continue
        labels = recordings if len(set(recordings)) == len(recordings) else [str(k + 1) for k in range(len(recordings))]
        found += [
            replace(parameter, name=f"{name} {label}", recording=e, quantity=name) for e, label in enumerate(labels)
        ]
    return tuple(found)


def held_parameters(case: Case, description: FmuDescription, free: Sequence[Parameter]) -> tuple[str, ...]:
    """Return a sentence about the FMU's parameters that are held because nobody named any; none if there are none."""
    if case.parameters:
        return ()
    taken = {*case.fixed, *(target for p in free for target in p.targets)}
    held = [
        v for v in description.of_causality("parameter") if v.name not in taken and v.is_real and v.start is not None
    ]
    if not held:
        return ()
    listed = ", ".join(f"{v.name} = {_number(v.start):.6g} {v.unit}".rstrip() for v in held[:MOST_HELD])
    more = f" and {len(held) - MOST_HELD} more" if len(held) > MOST_HELD else ""
    return (f"held at the FMU's own value: {listed}{more}; name under [parameters] what is to be estimated",)


def _parameter(name: str, case: Case, description: FmuDescription, guess: Mapping[str, float]) -> Parameter:
    spec = case.parameters.get(name) or ParameterSpec(name=name)
    targets = [target(description, variable) for variable in (spec.fmu or (name,))]
    first, gains = targets[0], spec.gains or (1.0,) * len(targets)
    for variable in targets:
        if not variable.is_real:
            raise FmuError(
                f"{variable.name!r} of {description.path.name} is {variable.type}; only real parameters are estimated;"
                " give it a value under [fixed]"
            )
    paper = case.search.method in ("paper", "original")
    start = spec.start if spec.start is not None else guess.get(name)
    if start is None:
        start = spec.nominal if spec.nominal is not None else _over(_number(first.start), gains[0])
    lower, upper = spec.minimum, spec.maximum
    if paper and name in PAPER_BOX:
        lower = PAPER_BOX[name][0] if lower is None else lower
        upper = PAPER_BOX[name][1] if upper is None else upper
    width = WIDTH.get(name, USUAL_WIDTH)
    low, high = _limits(targets, gains)
    if lower is None:
        lower = start / width if start is not None and start > 0 else low
        if low is not None and lower is not None:
            lower = max(lower, low)
    if upper is None:
        upper = start * width if start is not None and start > 0 else high
        if high is not None and upper is not None:
            upper = min(upper, high)
    if lower is None or upper is None or not np.isfinite([lower, upper]).all():
        raise InputError(
            f"parameter {name!r} has no bounds and no positive start to put them around; give them with"
            f" --bounds {name}=MIN:MAX or in the case file"
        )
    if lower >= upper:
        raise InputError(f"parameter {name!r}: the lower bound {lower:g} is not below the upper bound {upper:g}")
    if (low is not None and lower < low) or (high is not None and upper > high):
        raise InputError(
            f"parameter {name!r}: the bounds {lower:g} to {upper:g} leave the range"
            f" {low} to {high} that {description.path.name} allows"
        )
    return Parameter(
        name=name,
        unit=first.unit,
        lower=float(lower),
        upper=float(upper),
        log=lower > 0 and not paper,
        targets=tuple(v.name for v in targets),
        start=None if start is None else float(np.clip(start, lower, upper)),
        nominal=spec.nominal,
        gains=spec.gains,
    )


def _limits(targets: Sequence[Variable], gains: Sequence[float]) -> tuple[float | None, float | None]:
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
