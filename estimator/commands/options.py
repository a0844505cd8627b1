"""The command line's options applied to a case: they win over the case file. Knows no recording and runs nothing."""

from __future__ import annotations

import argparse
import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from estimator.choices import LOSSES
from estimator.errors import FmuError, InputError, suggestion
from estimator.recordings.read_as import AS_WRITTEN, ReadAs

if TYPE_CHECKING:
    from estimator.cases.case import Case
    from estimator.cases.starts import Start
    from estimator.fmus.fmu import FmuDescription

SIGNALS = ("v", "i", "w", "angle", "load", "time")  # that a column can be
READING = ("column", "unit", "rate", "test", "motor", "per_turn", "counts", "supply")
T = TypeVar("T")


def with_options(
    case: Case,
    *,
    fmu: str | None = None,
    kind: str | None = None,
    method: str | None = None,
    seed: int | None = None,
    fix: Sequence[tuple[str, float]] = (),
    bounds: Sequence[tuple[str, tuple[float, float]]] = (),
    loss: str | None = None,
    starts: Sequence[Start] = (),
) -> Case:
    """Return a case with the command line's options applied; they win over the case file.

    Raises
    ------
    InputError
        A parameter is given twice, or neither the case nor the FMU has it.
    """
    if fmu is not None:
        is_file = fmu.endswith(".fmu") or os.path.dirname(fmu) or os.path.isfile(fmu)
        case = dataclasses.replace(case, fmu=os.path.abspath(fmu) if is_file else fmu)
    if kind is not None:
        case = dataclasses.replace(case, kind=kind)
    search = case.search
    search = dataclasses.replace(search, method=search.method if method is None else method)
    search = dataclasses.replace(search, seed=search.seed if seed is None else seed)
    if loss is not None and loss not in LOSSES:
        raise InputError(f"there is no loss {loss!r}{suggestion(loss, LOSSES)}")
    search = dataclasses.replace(search, loss=search.loss if loss is None else loss)
    search = dataclasses.replace(search, starts=(*search.starts, *starts))
    case = dataclasses.replace(case, search=search)
    held, limits = unique(fix, option="--fix"), unique(bounds, option="--bounds")
    for name in held.keys() & limits.keys():
        raise InputError(f"{name!r} is given to --fix and to --bounds; leave one out")
    if not held and not limits:
        return case
    from estimator.cases.si_units import in_si_units
    from estimator.fmus.fmu import describe

    description = in_si_units(describe(case.fmu))
    return _bounded(_held(case, held, description), limits, description)


def with_corrections(
    case: Case,
    *,
    window: tuple[float, float] | None = None,
    scale: Sequence[tuple[str, float]] = (),
    offset: Sequence[tuple[str, float]] = (),
    temperature: float | None = None,
    read_as: ReadAs = AS_WRITTEN,
) -> Case:
    """Return a case with what the command line says of its recordings; it holds for each of them.

    Raises
    ------
    InputError
        A channel is given twice.
    """
    factors, offsets = unique(scale, option="--scale"), unique(offset, option="--offset")
    if not factors and not offsets and window is None and temperature is None and read_as == AS_WRITTEN:
        return case
    runs = []
    for run in case.runs_of(max(len(case.recordings), 1)):
        run = dataclasses.replace(run, scale={**run.scale, **factors}, offset={**run.offset, **offsets})
        run = dataclasses.replace(
            run, window=run.window if window is None else window, read_as=run.read_as.with_(read_as)
        )
        runs.append(dataclasses.replace(run, temperature=run.temperature if temperature is None else temperature))
    return dataclasses.replace(case, runs=tuple(runs))


def with_tolerances(case: Case, given: Mapping[str, str | float] | Sequence[tuple[str, str | float]] | str) -> Case:
    """Return a case with further tolerances; one of a source that the case has wins over it.

    Raises
    ------
    InputError
        A source is not known or is given twice, or its size cannot be read.
    """
    if not given:
        return case
    from estimator.cases.tolerance import tolerances

    known = {t.source: t for t in case.tolerance}
    for new in tolerances(given):
        if not (new.offered and new.source in known):
            known[new.source] = new
    return dataclasses.replace(case, tolerance=tuple(known.values()))


def reading(
    *,
    column: Sequence[tuple[str, str]] = (),
    unit: Sequence[tuple[str, str]] = (),
    rate: float | None = None,
    test: str | None = None,
    motor: str | None = None,
    per_turn: float | None = None,
    counts: float | None = None,
    supply: str | None = None,
) -> ReadAs:
    """Return how the user says that files and tables are to be read.

    Raises
    ------
    InputError
        A name is given twice, or a column is given for what is no signal of a motor.
    """
    columns = unique(column, option="--column")
    for name in columns:
        if name not in SIGNALS:
            raise InputError(f"{name!r}, given for a column, is no signal{suggestion(name, SIGNALS)}")
    return ReadAs(
        columns=columns,
        units=unique(unit, option="--unit"),
        rate=rate,
        test=test,
        motor=motor,
        per_turn=per_turn,
        counts=counts,
        supply=supply,
    )


def reading_of(args: argparse.Namespace) -> ReadAs:
    """Return what the arguments of a command say of how its files are to be read."""
    return reading(**{name: getattr(args, name) for name in READING})


def with_held_out(case: Case, files: Sequence[str | os.PathLike[str]], *, fitted: int) -> Case:
    """Return a case with further recordings that are held out of the fit; their channels are corrected alike.

    Parameters
    ----------
    fitted : int
        How many recordings there are already.
    """
    if not files:
        return case
    usual = dataclasses.replace(case.run(0), validate=True, window=None, temperature=None, delay=None)
    runs = (*case.runs_of(fitted), *[usual] * len(files))
    more = tuple(Path(os.path.abspath(file)) for file in files)
    return dataclasses.replace(case, recordings=(*case.recordings, *more), runs=runs)


def unique(pairs: Sequence[tuple[str, T]], *, option: str) -> dict[str, T]:
    """Return the pairs of a repeatable option as a dictionary; each name may come once."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{option} is given twice for {twice!r}; leave one out")
    return found


def _held(case: Case, held: Mapping[str, float], description: FmuDescription) -> Case:
    """Fix parameters: of the case by its names, through its factors, else of the FMU by its names; values are SI."""
    parameters, fixed = dict(case.parameters), dict(case.fixed)
    for name, value in held.items():
        spec = parameters.pop(name, None)
        if spec is None:
            _known_parameter(name, case, description)
        targets = (name,) if spec is None else spec.fmu
        gains = (1.0,) * len(targets) if spec is None else spec.gains or (1.0,) * len(targets)
        for target, gain in zip(targets, gains, strict=True):
            _in_range(target, gain * value, description, by=f"--fix {name}={value:g}")
            fixed[target] = gain * value
    if case.parameters and not parameters and not _usual_parameters(description):
        raise InputError("every parameter is fixed; leave at least one free")
    return dataclasses.replace(case, parameters=parameters, fixed=fixed)


def _in_range(name: str, value: float, description: FmuDescription, *, by: str) -> None:
    if reach := description.variable(name).reach_without(value):
        given = by if by == f"--fix {name}={value:g}" else f"{by}, which sets {name} to {value:g},"
        raise InputError(f"{given} is outside the range {reach} that {description.path.name} allows")


def _bounded(case: Case, limits: Mapping[str, tuple[float, float]], description: FmuDescription) -> Case:
    """Bound parameters; one that the case does not name becomes one to estimate, besides those it would have."""
    from estimator.cases.case import ParameterSpec

    parameters, fixed = dict(case.parameters), dict(case.fixed)
    if limits and not parameters:
        parameters = {n: ParameterSpec(n) for n in _usual_parameters(description) if n not in fixed}
    for name, (lower, upper) in limits.items():
        if name not in parameters:
            _known_parameter(name, case, description)
            fixed.pop(name, None)
        spec = parameters.get(name) or ParameterSpec(name)
        start = None if spec.start is None else min(max(spec.start, lower), upper)
        parameters[name] = dataclasses.replace(spec, minimum=lower, maximum=upper, start=start)
    return dataclasses.replace(case, parameters=parameters, fixed=fixed)


def _usual_parameters(description: FmuDescription) -> tuple[str, ...]:
    """Return those parameters of the FMU that are estimated when nobody names any."""
    from estimator.plans.binding import usual_parameters

    return usual_parameters([variable.name for variable in description.of_causality("parameter")])


def _known_parameter(name: str, case: Case, description: FmuDescription) -> None:
    have = [v.name for v in description.variables if v.causality in ("parameter", "input")]
    if name not in have:
        known = [*case.parameters, *(n for n in have if n not in case.parameters)]
        raise FmuError(f"{description.path.name} has no parameter {name!r}{suggestion(name, known)}")
