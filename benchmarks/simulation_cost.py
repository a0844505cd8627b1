"""What one simulation of an FMU costs here and by fmpy.simulate_fmu, kind by kind, and how far the two lie apart.

    python benchmarks/simulation_cost.py FMU… [--samples 1000] [--rounds 3]

Both sides keep the extracted FMU and one instance, set its real parameters to their start values, hold its real inputs
at a step half way, and read the same variables at the same instants: its outputs, or its local variables where it has
none. simulate_fmu goes with its own tolerance (that of the FMU, or 1e-5); the distance is told against a second run of
it at 1e-10, as a share of each signal's span, the worst signal's.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.errors import EstimatorError
from estimator.fmus.archive import extract
from estimator.fmus.fmu import FmuDescription, describe, with_kind
from estimator.fmus.job import Experiment, Job
from estimator.fmus.probe import driven
from estimator.fmus.workers import Workers
from estimator.stepping.layout import IDENTITY

FloatArray = NDArray[np.float64]
MOST = 8  # variables that are read
CANDIDATES = 16


def signals(description: FmuDescription, samples: int) -> tuple[float, float, FloatArray, list[Any], list[Any]]:
    """Return start and interval in s, inputs (n, m), the input variables and those that are read."""
    stated = description.default_experiment
    start = stated["start_time"] or 0.0
    length = (stated["stop_time"] or start + 1.0) - start
    h = stated["step_size"] or length / (samples - 1)
    if description.kind == "model-exchange" or not 0 < h * (samples - 1) <= 1.0001 * length:
        h = length / (samples - 1)
    inputs = [v for v in description.of_causality("input") if v.is_real]
    read = [v for v in description.of_causality("output") if v.is_real]
    read = (read or [v for v in description.of_causality("local") if v.is_real])[:MOST]
    driven = np.zeros((samples, len(inputs)))
    for j, v in enumerate(inputs):
        driven[:, j] = v.start if isinstance(v.start, float) else 0.0
        driven[samples // 2 :, j] += v.nominal or 1.0
    return start, h, driven, inputs, read


def ours(description: FmuDescription, samples: int, rounds: int) -> tuple[float, FloatArray]:
    """Return s of one simulation, of the candidates of a batch in one process, and what is read, (n, q)."""
    start, h, driven_inputs, inputs, read = signals(description, samples)
    experiment = Experiment(start, h, 1, driven_inputs, np.zeros((samples, len(read))), np.zeros(len(read)))
    job = Job(
        description=driven(description),
        parameter_references=(),
        input_references=tuple(v.value_reference for v in inputs),
        output_references=tuple(v.value_reference for v in read),
        sensors=(IDENTITY,) * len(read),
        experiments=(experiment,),
        reinstantiate=driven(description).restart == "re-instantiate",
        fresh_process=driven(description).restart == "fresh process",
    )
    with Workers(1) as workers:
        workers.load(job)
        first = workers.run(np.empty((1, 1, 0)), record=True)
        if first.failed[0] or first.shown is None:
            raise RuntimeError(workers.failures[0].reason)
        taken = []
        for _ in range(rounds):
            began = time.perf_counter()
            workers.run(np.empty((CANDIDATES, 1, 0)))
            taken.append((time.perf_counter() - began) / CANDIDATES)
    return statistics.median(taken), first.shown[0]


def theirs(description: FmuDescription, samples: int, rounds: int) -> tuple[float, FloatArray]:
    """Return the same by fmpy.simulate_fmu; what is read is that of a run at a tolerance of 1e-10."""
    import fmpy

    start, h, driven_inputs, inputs, read = signals(description, samples)
    times = start + np.arange(samples) * h
    stamps = np.repeat(times, 2)[1:-1]
    table = None
    if inputs:
        columns = [np.repeat(driven_inputs[:, j], 2)[:-2] for j in range(len(inputs))]
        table = np.array(
            list(zip(stamps, *columns, strict=True)), dtype=[("time", float), *((v.name, float) for v in inputs)]
        )
        table = table[np.r_[True, np.diff(driven_inputs, axis=0).any(axis=1).repeat(2)[:-1], True][: len(table)]]
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        extract(description.path, Path(folder))
        their = fmpy.read_model_description(folder, validate=False)
        kind = "CoSimulation" if description.kind == "co-simulation" else "ModelExchange"
        instance = fmpy.instantiate_fmu(folder, their, kind)

        def run(tolerance: float | None = None) -> Any:
            instance.reset()
            return fmpy.simulate_fmu(
                folder,
                validate=False,
                model_description=their,
                fmu_instance=instance,
                fmi_type=kind,
                input=table,
                output=[v.name for v in read],
                start_time=start,
                stop_time=times[-1],
                output_interval=h,
                relative_tolerance=tolerance,
            )

        taken = []
        for _ in range(rounds):
            began = time.perf_counter()
            run()
            taken.append(time.perf_counter() - began)
        fine = run(1e-10)
    at = np.searchsorted(fine["time"], times - 1e-6 * h).clip(max=len(fine) - 1)
    return statistics.median(taken), np.column_stack([fine[v.name][at] for v in read])


def row(path: Path, kind: str, samples: int, rounds: int) -> str:
    description = with_kind(describe(path), kind)
    cells = [path.stem[-40:], description.generation_tool[:24], f"{description.fmi_version} {kind}"]
    try:
        mine, shown = ours(description, samples, rounds)
    except (EstimatorError, RuntimeError) as error:
        return "| " + " | ".join([*cells, f"not simulated here: {error}"[:90], "", "", ""]) + " |"
    try:
        other, expected = theirs(description, samples, rounds)
    except Exception as error:  # whatever fmpy says
        return "| " + " | ".join([*cells, f"{1e3 * mine:.3g}", f"fails: {str(error)[:60]}", "", ""]) + " |"
    span = np.ptp(expected, axis=0)
    span[span == 0] = 1.0
    apart = float(np.nanmax(np.abs(shown - expected) / span))
    return (
        "| "
        + " | ".join([*cells, f"{1e3 * mine:.3g}", f"{1e3 * other:.3g}", f"{other / mine:.0f}", f"{apart:.1g}"])
        + " |"
    )


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fmu", nargs="+", type=Path)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args(arguments)
    print("| FMU | made by | kind | here, ms | simulate_fmu, ms | ratio | apart, of the span |\n" + "|---" * 7 + "|")
    measurements: list[Callable[[], str]] = []
    for path in given.fmu:
        for kind in describe(path).kinds:
            measurements.append(lambda path=path, kind=kind: row(path, kind, given.samples, given.rounds))  # type: ignore[misc]
    for measurement in measurements:
        print(measurement(), flush=True)


if __name__ == "__main__":
    main()
