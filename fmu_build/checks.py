"""A model's faults, found when it is built; and what depends on what. Knows the table and the equations, no FMI."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from .errors import BuildError
from .model import Equations, Model, Variable
from .units import base_exponents

PROBES = 16  # random points at which equations are looked at, in every combination of modes
MOST_COMBINATIONS = 64


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
            mode = name.partition(".")[0] in {v.name for v in model.of_kind("mode")}
            what = f"s->{name if '.' in name else name + '.margin'}" if mode else f"d->{name}"
            raise BuildError(
                f"{source}: {what} is not set, or not finite at the start values; set it, or other start values"
            )
    if model.linear:
        _check_linearity(model, equations, source)


def dependencies(model: Model, equations: Equations, *, text: str, source: Path) -> dict[str, frozenset[str]]:
    """Return for each state's derivative, calculated output and mode's margin the variables that change it, modes too.

    They are found by looking: in every mode, at random points of very different size, states at rest among them, one
    variable after another is changed. What is read in the model's text and was not seen to change anything may do so
    in a corner: it counts as changing all.

    Parameters
    ----------
    text : str
        The model file's.

    Raises
    ------
    BuildError
        An input or a parameter is read nowhere, in a sentence with the model file and the variable.
    """
    known = model.of_kind("input", "parameter", "state")
    found: dict[str, set[str]] = {unknown.name: set() for unknown in model.of_kind("state", "output", "mode")}
    rng = random.Random(1)
    combinations = list(_combinations_of_modes(model))
    for modes in combinations:
        for probe in range(PROBES):
            reach = 10 ** rng.uniform(-3, 0.5)
            point = _start(model) | modes | {v.name: _random_value(v, rng, reach=reach) for v in known}
            if probe % 2:
                point |= {v.name: 0.0 for v in known if v.kind == "state" and rng.random() < 0.5}
            here = equations(point)
            changes = [{v.name: _random_value(v, rng, reach=reach)} for v in known]
            changes += [{name: value} for name, value in rng.choice(combinations).items() if value != modes[name]]
            for change in changes:
                there = equations(point | change)
                for unknown, names in found.items():
                    if there[unknown] != here[unknown] and math.isfinite(there[unknown] - here[unknown]):
                        names |= set(change)
    for variable in model.of_kind("input", "parameter"):
        if variable.name in set().union(*found.values()) or variable.min == variable.max:
            continue
        if not _reads(text, variable.name):
            raise BuildError(
                f"{source}: {variable.kind} {variable.name} changes no derivative and no output; use it or remove it"
            )
        for names in found.values():
            names.add(variable.name)
    return {unknown: frozenset(names) for unknown, names in found.items()}


def _combinations_of_modes(model: Model) -> Iterator[dict[str, float]]:
    """Give all combinations, or where there are too many, some."""
    modes = model.of_kind("mode")
    values = [[float(value) for value in range(round(v.min), round(v.max) + 1)] for v in modes]
    rng = random.Random(2)
    every = product(*values) if math.prod(map(len, values)) <= MOST_COMBINATIONS else None
    for combination in every or ([rng.choice(some) for some in values] for _ in range(MOST_COMBINATIONS)):
        yield dict(zip((v.name for v in modes), combination, strict=True))


def _reads(text: str, name: str) -> bool:
    """Return whether C text takes a structure's member of this name, comments left out."""
    code = re.sub(r"/\*.*?\*/|//[^\n]*", " ", text, flags=re.S)
    return re.search(rf"(->|\.)\s*{name}\b", code) is not None


def _check_variable(variable: Variable, source: Path) -> None:
    def wrong(what: str) -> BuildError:
        return BuildError(f"{source}: variable {variable.name} {what}")

    if variable.name == "time":
        raise wrong("has the name of the independent variable; give it another")
    if not -math.inf < variable.min <= variable.max < math.inf:
        raise wrong(f"has min {variable.min:g} and max {variable.max:g}; min <= max and both finite are needed")
    if variable.kind != "output" and not variable.min <= variable.start <= variable.max:
        raise wrong(
            f"starts at {variable.start:g}, not within min {variable.min:g} and max {variable.max:g}; start within"
        )
    if not 0 < variable.nominal < math.inf:
        raise wrong(f"has nominal {variable.nominal:g}; a typical magnitude above 0 is needed")
    if variable.kind == "mode" and variable.max - variable.min > MOST_COMBINATIONS:
        raise wrong(f"is a mode from {variable.min:g} to {variable.max:g}; give it the few whole numbers that it takes")
    if not variable.description:
        raise wrong("has no description; say what it is")
    try:
        base_exponents(variable.unit)
    except BuildError as error:
        raise BuildError(f"{source}: unit of variable {variable.name}: {error}") from error


def _check_linearity(model: Model, equations: Equations, source: Path) -> None:
    """Check f(x1 + x2, u) - f(0, u) = f(x1, 0) - f(0, 0) + f(x2, 0) - f(0, 0) at random states and inputs.

    f: the derivatives, and what margins are told to be made of. Every other time parameters are random too: those that
    start at 0 may take their modes away.
    """
    rng = random.Random(1)
    states, inputs, modes = (model.of_kind(kind) for kind in ("state", "input", "mode"))
    rest = _start(model) | {v.name: 0.0 for v in (*states, *inputs)}
    for combination, probe in product(_combinations_of_modes(model), range(PROBES)):
        zero = rest | combination
        held = {v.name: _random_value(v, rng) for v in inputs}
        one, two = ({v.name: _random_value(v, rng) for v in states} for _ in range(2))
        both = {name: one[name] + two[name] for name in one}
        if probe % 2 and modes:
            zero |= {v.name: _random_value(v, rng) for v in model.of_kind("parameter")}
        terms = [equations(zero | held | both), equations(zero | held)]
        terms += [equations(zero | one), equations(zero | two), equations(zero)]
        for name in (name for name in terms[0] if all(name in term for term in terms)):
            f = [term[name] for term in terms]
            if abs(f[0] - f[1] - f[2] - f[3] + 2 * f[4]) <= 1e-9 * sum(map(abs, f)):
                continue
            if name in {v.name for v in states}:
                raise BuildError(f"{source}: d->{name} is not linear in the states; say MODEL_LINEAR 0")
            if name.endswith(".linear"):
                raise BuildError(f"{source}: s->{name} is not linear in the states; leave it and most out")
        here = terms[0]
        for name in (v.name for v in modes if f"{v.name}.told" in here):
            apart = abs(here[name] - here[f"{name}.told"])
            if min(here[v.name] for v in modes) >= 0 and apart > 1e-9 * (abs(here[name]) + abs(here[f"{name}.linear"])):
                raise BuildError(f"{source}: s->{name}.margin is not what its linear and most say; set them alike")


def _start(model: Model) -> dict[str, float]:
    return {v.name: v.start for v in model.variables}


def _random_value(variable: Variable, rng: random.Random, *, reach: float = 1.0) -> float:
    """Return a value of about `reach` times the variable's nominal, within its bounds; a parameter's of its nominal."""
    sign = rng.choice((-1, 1)) if variable.min < 0 else 1
    size = variable.nominal * (1.0 if variable.kind == "parameter" else reach)
    return min(max(sign * size * rng.uniform(0.5, 2), variable.min), variable.max)
