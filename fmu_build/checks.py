"""A model's faults, found when it is built; and what depends on what. Knows the table and the equations, no FMI."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from pathlib import Path

from .errors import BuildError
from .model import Equations, Model, Variable
from .units import base_exponents

PROBES = 16  # random points at which equations are looked at


def check_model(model: Model, equations: Equations, *, source: Path) -> None:
    """Refuse a table or equations that would make a wrong FMU.

    Raises
    ------
    BuildError
        A sentence with the model file and the variable.
    """
    for variable in model.variables:
        _check_variable(variable, source)
    for name, rate in equations(_start(model)).items():
        if not math.isfinite(rate):
            raise BuildError(f"{source}: d->{name} is not set, or not finite at the start values")
    if model.linear:
        _check_linearity(model, equations, source)


def check_use(model: Model, changed_by: Mapping[str, frozenset[str]], *, source: Path) -> None:
    """Refuse an input or a parameter that changes nothing.

    Parameters
    ----------
    changed_by : mapping of str to frozenset of str
        What `dependencies` found.

    Raises
    ------
    BuildError
        A sentence with the model file and the variable.
    """
    used = frozenset[str]().union(*changed_by.values())
    for variable in model.of_kind("input", "parameter"):
        if variable.name not in used and variable.min < variable.max:
            raise BuildError(
                f"{source}: {variable.kind} {variable.name} changes no derivative and no output; use it or remove it"
            )


def dependencies(model: Model, equations: Equations) -> dict[str, frozenset[str]]:
    """Return for each calculated output and each state's derivative the variables that change it.

    They are found by looking: at random points of very different size one variable after another is changed.
    """
    known = model.of_kind("input", "parameter", "state")
    found: dict[str, set[str]] = {unknown.name: set() for unknown in model.of_kind("state", "output")}
    rng = random.Random(1)
    for _ in range(PROBES):
        reach = 10 ** rng.uniform(-3, 0.5)
        point = _start(model) | {v.name: _random_value(v, rng, reach=reach) for v in known}
        here = equations(point)
        for variable in known:
            there = equations(point | {variable.name: _random_value(variable, rng, reach=reach)})
            for unknown, names in found.items():
                if there[unknown] != here[unknown]:
                    names.add(variable.name)
    return {unknown: frozenset(names) for unknown, names in found.items()}


def _check_variable(variable: Variable, source: Path) -> None:
    def wrong(what: str) -> BuildError:
        return BuildError(f"{source}: variable {variable.name} {what}")

    if variable.name == "time":
        raise wrong("has the name of the independent variable; give it another")
    if not -math.inf < variable.min <= variable.max < math.inf:
        raise wrong(f"has min {variable.min:g} and max {variable.max:g}; min <= max and both finite are needed")
    if variable.kind != "output" and not variable.min <= variable.start <= variable.max:
        raise wrong(f"starts at {variable.start:g}, not within min {variable.min:g} and max {variable.max:g}")
    if not 0 < variable.nominal < math.inf:
        raise wrong(f"has nominal {variable.nominal:g}; a typical magnitude above 0 is needed")
    if not variable.description:
        raise wrong("has no description")
    try:
        base_exponents(variable.unit)
    except BuildError as error:
        raise BuildError(f"{source}: unit of variable {variable.name}: {error}") from error


def _check_linearity(model: Model, equations: Equations, source: Path) -> None:
    """Check f(x1 + x2, u) - f(0, u) = f(x1, 0) - f(0, 0) + f(x2, 0) - f(0, 0) at random states and inputs."""
    rng = random.Random(1)
    states, inputs = model.of_kind("state"), model.of_kind("input")
    zero = _start(model) | {v.name: 0.0 for v in (*states, *inputs)}
    for _ in range(PROBES):
        held = {v.name: _random_value(v, rng) for v in inputs}
        one, two = ({v.name: _random_value(v, rng) for v in states} for _ in range(2))
        both = {name: one[name] + two[name] for name in one}
        terms = [equations(zero | held | both), equations(zero | held)]
        terms += [equations(zero | one), equations(zero | two), equations(zero)]
        for state in states:
            f = [term[state.name] for term in terms]
            if not abs(f[0] - f[1] - f[2] - f[3] + 2 * f[4]) <= 1e-9 * sum(map(abs, f)):
                raise BuildError(f"{source}: d->{state.name} is not linear in the states; say MODEL_LINEAR 0")


def _start(model: Model) -> dict[str, float]:
    return {v.name: v.start for v in model.variables}


def _random_value(variable: Variable, rng: random.Random, *, reach: float = 1.0) -> float:
    """Return a value of about `reach` times the variable's nominal, within its bounds; a parameter's of its nominal."""
    sign = rng.choice((-1, 1)) if variable.min < 0 else 1
    size = variable.nominal * (1.0 if variable.kind == "parameter" else reach)
    return min(max(sign * size * rng.uniform(0.5, 2), variable.min), variable.max)
