"""What drives an FMU in one simulation: a voltage step, or the columns of a recording. Simulates nothing."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.errors import FmuError, InputError, RecordingError, suggestion
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.reading import read_recording
from estimator.results.result import FloatArray

if TYPE_CHECKING:
    from estimator.fmus.fmu import FmuDescription
    from estimator.fmus.variable import Variable

VOLTAGE_NAMES = ("v", "u", "voltage")  # of an input without a unit
MOST_INSTANTS = 20_000_000  # of one simulation: some 2 GB of text


def instants(*, stop: float, step: float) -> FloatArray:
    """Return the sampling instants 0, step, …, stop, shape (n,), in s: each the float nearest to k times the step.

    Raises
    ------
    InputError
        There are more than a simulation may have.
    """
    numerator, denominator = Fraction(repr(step)).as_integer_ratio()
    whole = stop / step
    if whole >= MOST_INSTANTS:
        raise InputError(
            f"{stop:g} s in steps of {step:g} s are {whole:.3g} samples, more than {MOST_INSTANTS:,}; "
            "give a longer --step or a shorter --stop"
        )
    count = int(np.floor(whole + 1e-6)) + 1
    return np.fromiter((k * numerator / denominator for k in range(count)), float, count)  # of integers: rounded once


def stepped_voltage(times: FloatArray, *, level: float, at: float) -> FloatArray:
    """Return a voltage, shape (n,), that holds 0 V before `at` and `level` from the first time at or after it."""
    tolerance = 1e-6 * (times[1] - times[0]) if len(times) > 1 else 0.0
    return np.where(times >= at - tolerance, level, 0.0)


def settable(description: FmuDescription, name: str) -> str:
    """Return whether a name is a "parameter" or an "input" of the FMU.

    Raises
    ------
    FmuError
        It is neither.
    """
    for causality in ("parameter", "input"):
        if any(variable.name == name for variable in description.of_causality(causality)):
            return causality
    known = [v.name for causality in ("parameter", "input") for v in description.of_causality(causality)]
    raise FmuError(f"{description.path.name} has no parameter {name!r}{suggestion(name, known)}")


def voltage_input(description: FmuDescription) -> str:
    """Return the name of the one input that is a voltage.

    Raises
    ------
    FmuError
        There is none, or it is not clear which.
    """
    inputs = description.of_causality("input")
    volts = [variable.name for variable in inputs if variable.unit == "V"]
    named = [variable.name for variable in inputs if variable.name.lower() in VOLTAGE_NAMES]
    for found in (volts, named, [variable.name for variable in inputs]):
        if len(found) == 1:
            return found[0]
    listed = ", ".join(variable.name for variable in inputs) or "none"
    raise FmuError(f"{description.path.name}: it is not clear which input is the voltage ({listed}); use --input FILE")


def inputs_from(path: Path, description: FmuDescription) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the times of a recording, shape (n,), and the inputs over them, by their names or a motor's usual ones.

    Raises
    ------
    RecordingError
        No column is an input, or a sample is missing.
    """
    recording = read_recording(path)
    inputs = description.of_causality("input")
    columns = {v.name: v.name for v in inputs if v.name in recording.signals}
    for role, column in motor_columns(recording, required=()).items():
        for variable in inputs:
            if variable.name not in columns and _has_role(variable, role):
                columns[variable.name] = column
    if not columns:
        listed = ", ".join(variable.name for variable in inputs) or "none"
        raise RecordingError(
            f"{path}: no column is an input of {description.path.name} (its inputs: {listed}); "
            "name a column after an input"
        )
    signals = {}
    for name, column in columns.items():
        signals[name] = recording.signal(column, unit=description.variable(name).unit or None)
        missing = [k for k, value in enumerate(signals[name].tolist()) if value != value]
        if missing:
            raise RecordingError(
                f"{path}: {column} has no sample at t = {recording.time[missing[0]]:g} s; an input needs them all"
            )
    return recording.time, signals


def _has_role(variable: Variable, role: str) -> bool:
    return variable.name == role or (role == "v" and variable.unit == "V")
