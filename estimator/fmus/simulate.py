"""One simulation of an FMU with given inputs, in a worker process. Knows no recording and no search."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.errors import FmuError, InputError, SimulationError, suggestion
from estimator.fmus.failing import with_cause
from estimator.fmus.fmu import FmuDescription, check_usable, describe
from estimator.fmus.job import Experiment, Job
from estimator.fmus.variable import Variable
from estimator.fmus.workers import TIME_LIMIT, Workers
from estimator.stepping.layout import IDENTITY, MAX_SIGNALS, types_of

FloatArray = NDArray[np.float64]

OFF_GRID = 1e-6  # of a step


def simulate(
    fmu: str | FmuDescription,
    *,
    parameters: Mapping[str, float],
    inputs: Mapping[str, FloatArray],
    times: FloatArray,
    time_limit: float = TIME_LIMIT,
) -> dict[str, FloatArray]:
    """Simulate an FMU from rest and return its outputs.

    Parameters
    ----------
    fmu : str or FmuDescription
        A file, a bundled model's name, or what `describe` returned.
    parameters : name → value
        In the units of the description: the FMU's, or SI after `in_si_units`; the others keep their start values.
    inputs : name → (n,) array
        inputs[k] holds from times[k] to times[k + 1]; inputs that are not given keep their start values.
    times : (n,) array
        s, increasing in equal steps, each one communication step.
    time_limit : float
        s that the simulation may take.

    Returns
    -------
    name → (n,) array
        All real outputs, in the units of the description; sample k is taken at times[k], before inputs[k] act.

    Raises
    ------
    InputError
        No such FMU, parameter or input, times that are not equidistant, or an input that is not as long as they are.
    SimulationError
        The FMU failed.
    """
    times = _numbers("times", times)
    description = describe(fmu) if isinstance(fmu, str) else fmu
    check_usable(description)
    outputs = [v for v in description.of_causality("output") if v.is_real]
    if not outputs:
        raise FmuError(f"{description.path.name} has no real output, so there is nothing to show")
    chosen = [(_parameter(description, name, value), value) for name, value in parameters.items()]
    driven = [description.variable(name, role="input") for name in inputs]
    shown: dict[str, FloatArray] = {}
    with Workers(1, time_limit=time_limit) as workers:
        for k in range(0, len(outputs), MAX_SIGNALS):
            read = outputs[k : k + MAX_SIGNALS]
            experiment = _experiment(description, driven, inputs, times, outputs=len(read))
            shown |= _shown(workers, description, chosen, driven, read, experiment)
    return shown


def _shown(
    workers: Workers,
    description: FmuDescription,
    chosen: Sequence[tuple[Variable, float]],
    driven: Sequence[Variable],
    outputs: Sequence[Variable],
    experiment: Experiment,
) -> dict[str, FloatArray]:
    """Simulate once and return some of the outputs."""
    reals = [(v, value) for v, value in chosen if v.is_real]
    held = [(v, value) for v, value in chosen if not v.is_real]
    job = Job(
        description=description,
        parameter_references=tuple(v.value_reference for v, _ in reals),
        input_references=tuple(v.value_reference for v in driven),
        output_references=tuple(v.value_reference for v in outputs),
        sensors=(IDENTITY,) * len(outputs),
        experiments=(experiment,),
        reinstantiate=description.restart == "re-instantiate",
        fresh_process=description.restart == "fresh process",
        types=types_of([*(v.type for v, _ in reals), *(v.type for v in (*driven, *outputs))]),
        settings=tuple((v.type, v.value_reference, value) for v, value in held),
        scale=tuple((v.factor, v.offset) for v in outputs) if any(not v.is_as_it_is for v in outputs) else (),
        names=tuple(v.name for v in (*(v for v, _ in reals), *(v for v, _ in held), *driven)),
    )
    workers.load(job)
    values = np.array([_own(v, value) for v, value in reals], dtype=float)
    batch = workers.run(values.reshape(1, 1, len(values)), record=True)
    if batch.failed[0] or batch.shown is None:
        first = workers.failures[0]
        wrong = FmuError if first.reason.startswith(("the FMU ", "instantiate ")) else SimulationError
        raise wrong(f"{description.path.name} failed: {with_cause(first, description, job.names[: len(values)])}")
    return {v.name: batch.shown[0, :, j].copy() for j, v in enumerate(outputs)}


def _parameter(description: FmuDescription, name: str, value: float) -> Variable:
    """Return the parameter of that name, if it takes the value."""
    parameters = description.of_causality("parameter")
    variable = next((v for v in parameters if v.name == name), None)
    if variable is None:
        raise FmuError(
            f"{description.path.name} has no parameter {name!r}{suggestion(name, [v.name for v in parameters])}"
        )
    if not isinstance(value, numbers.Real) or not math.isfinite(value):
        raise InputError(f"{name} = {value!r} is no finite number")
    if reach := variable.reach_without(value):
        raise InputError(f"{name} = {value:g} is outside the range {reach} that {description.path.name} allows")
    if not variable.is_real and (variable.type == "String" or value != round(value)):
        raise FmuError(f"{name} of {description.path.name} is {variable.type}; {value:g} is no value for it")
    return variable


def _experiment(
    description: FmuDescription,
    driven: Sequence[Variable],
    inputs: Mapping[str, FloatArray],
    times: FloatArray,
    *,
    outputs: int,
) -> Experiment:
    interval = _step(times)
    columns = [_own(v, _over(times, v.name, inputs[v.name])) for v in driven]
    return Experiment(
        start=float(times[0]) or description.default_experiment["start_time"] or 0.0,
        interval=interval,
        substeps=1,
        inputs=np.column_stack(columns) if columns else np.empty((len(times), 0)),
        measured=np.zeros((len(times), outputs)),
        weights=np.zeros(outputs),
    )


def _over(times: FloatArray, name: str, signal: FloatArray) -> FloatArray:
    """Return an input as an array, (n,), that has a value at each time."""
    values = _numbers(f"the input {name!r}", signal)
    if values.shape != (len(times),):
        raise InputError(f"the input {name!r} has shape {values.shape}; it should be as long as times, ({len(times)},)")
    return values


def _numbers(what: str, given: Any) -> FloatArray:
    try:
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: no array of numbers; give one float per sample") from None


def _own(variable: Variable, value: Any) -> Any:
    """Return a value or an array in the FMU's own unit."""
    return value if variable.is_as_it_is else (value - variable.offset) / variable.factor


def _step(times: FloatArray) -> float:
    if times.ndim != 1 or len(times) < 2:
        raise InputError("a simulation needs at least two times")
    step = float(times[-1] - times[0]) / (len(times) - 1)
    if not step > 0 or not float(np.max(np.abs(np.diff(times) - step))) <= OFF_GRID * step:
        raise InputError("the times of a simulation must increase in equal steps")
    return round(step, 15)
