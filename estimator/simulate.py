"""One simulation of an FMU with given inputs, in a worker process. Knows no recording and no search."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator import layout
from estimator.errors import FmuError, InputError, SimulationError, suggestion
from estimator.fmu import FmuDescription, check_usable, describe
from estimator.workers import TIME_LIMIT, Experiment, Job, Workers

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
        In the FMU's units; the others keep their start values.
    inputs : name → (n,) array
        inputs[k] holds from times[k] to times[k + 1]; inputs that are not given keep their start values.
    times : (n,) array
        s, increasing in equal steps, each one communication step.
    time_limit : float
        s that the simulation may take.

    Returns
    -------
    name → (n,) array
        All real outputs; sample k is taken at times[k], before inputs[k] act.

    Raises
    ------
    InputError
        No such FMU, parameter or input, or times that are not equidistant.
    SimulationError
        The FMU failed.
    """
    description = describe(fmu) if isinstance(fmu, str) else fmu
    check_usable(description)
    step = _step(times)
    outputs = [v for v in description.of_causality("output") if v.is_real]
    if not outputs:
        raise FmuError(f"{description.path.name} has no real output, so there is nothing to show")
    values, references = [], []
    held: list[tuple[str, int, float | str]] = []
    for name, value in parameters.items():
        variable = next((v for v in description.of_causality("parameter") if v.name == name), None)
        if variable is None:
            known = [v.name for v in description.of_causality("parameter")]
            raise FmuError(f"{description.path.name} has no parameter {name!r}{suggestion(name, known)}")
        _check_range(description, name, value, variable.minimum, variable.maximum)
        if not variable.is_real:
            if variable.type == "String" or value != round(value):
                raise FmuError(f"{name} of {description.path.name} is {variable.type}; {value:g} is no value for it")
            held.append((variable.type, variable.value_reference, value))
            continue
        values.append(value)
        references.append(variable.value_reference)
    driven = [description.variable(name, role="input") for name in inputs]
    types = ("Real",) * len(references) + tuple(v.type for v in (*driven, *outputs))
    experiment = Experiment(
        start=float(times[0]),
        interval=step,
        substeps=1,
        inputs=np.column_stack([np.asarray(u, dtype=float) for u in inputs.values()])
        if inputs
        else np.empty((len(times), 0)),
        measured=np.zeros((len(times), len(outputs))),
        weights=np.zeros(len(outputs)),
    )
    with Workers(1, time_limit=time_limit) as workers:
        workers.load(
            Job(
                description=description,
                parameter_references=tuple(references),
                input_references=tuple(v.value_reference for v in driven),
                output_references=tuple(v.value_reference for v in outputs),
                sensors=(layout.IDENTITY,) * len(outputs),
                experiments=(experiment,),
                settings=tuple(held),
                types=() if all(v.is_real for v in driven) else types,
            )
        )
        batch = workers.run(np.array(values, dtype=float).reshape(1, 1, len(values)), record=True)
        if batch.failed[0] or batch.shown is None:
            reason = workers.failures[0].reason if workers.failures else "no reason given"
            wrong = FmuError if reason.startswith(("the FMU ", "instantiate ")) else SimulationError
            raise wrong(f"{description.path.name} failed: {reason}")
    return {v.name: batch.shown[0, :, j].copy() for j, v in enumerate(outputs)}


def _step(times: FloatArray) -> float:
    if len(times) < 2:
        raise InputError("a simulation needs at least two times")
    step = float(times[-1] - times[0]) / (len(times) - 1)
    if step <= 0 or float(np.max(np.abs(np.diff(times) - step))) > OFF_GRID * step:
        raise InputError("the times of a simulation must increase in equal steps")
    return round(step, 15)


def _check_range(
    description: FmuDescription, name: str, value: float, minimum: float | None, maximum: float | None
) -> None:
    if (minimum is not None and value < minimum) or (maximum is not None and value > maximum):
        raise InputError(
            f"{name} = {value:g} is outside the range {minimum} to {maximum} that {description.path.name} allows"
        )
