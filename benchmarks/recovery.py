"""Parameters of FMUs that others made, recovered from emulated recordings: error over standard error, and time.

    python benchmarks/recovery.py FOLDER [--seed 1]

FOLDER holds the FMUs under any names that end as in EXAMPLES below (docs/foreign-fmus.md says whose they are). Each is
simulated with its start values times the factors below, at its inputs; noise of 0.2 % of each output's span is added;
the case file holds bounds of a third to three times the start, within the FMU's limits, and nothing else.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from simulation_cost import ours, theirs

from estimator.cases.case import read_case
from estimator.errors import EstimatorError
from estimator.estimating.estimate import estimate
from estimator.fmus.fmu import FmuDescription, describe, with_kind
from estimator.fmus.job import Experiment, Job
from estimator.fmus.probe import driven
from estimator.fmus.workers import Workers
from estimator.stepping.layout import IDENTITY, types_of

FloatArray = NDArray[np.float64]
NOISE = 2e-3  # of each output's span
FACTORS = (1.2, 0.85, 1.1, 0.9, 1.15)  # of the starts: the truth
PATIENCE = 60.0  # s, for simulate_fmu
STEPS = 12  # of the inputs, at random


@dataclass(frozen=True)
class Example:
    """One FMU: how its file name ends, what is estimated and shown, how it is driven, for how long."""

    file: str
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    length: float  # s
    inputs: tuple[tuple[str, float, float], ...] = ()  # name, mean, deviation of the steps
    samples: int = 1000
    kind: str = "co-simulation"
    starts: tuple[float, ...] = ()  # where the description has none that is of use


EXAMPLES = (
    Example("ref2__VanDerPol.fmu", ("mu",), ("x0", "x1"), 20.0),
    Example("ref2__VanDerPol.fmu", ("mu",), ("x0", "x1"), 20.0, kind="model-exchange"),
    Example("ref3__VanDerPol.fmu", ("mu",), ("x0", "x1"), 20.0, kind="model-exchange"),
    Example("ref2__Dahlquist.fmu", ("k",), ("x",), 5.0, kind="model-exchange", samples=501),
    Example("ref3__Dahlquist.fmu", ("k",), ("x",), 5.0, samples=51),
    Example("libcosim__tests_data_fmi2_Dahlquist.fmu", ("k",), ("x",), 5.0, samples=51),
    Example(
        "DC_Motor_linux.fmu",
        ("dcpmData.Ra", "dcpmData.La", "inertia.J"),
        ("y", "dC_PermanentMagnet.la.i"),
        1.0,
        (("u", 100.0, 40.0),),
    ),
    Example(
        "DC_Motor_linux.fmu",
        ("dcpmData.Ra", "dcpmData.La", "inertia.J"),
        ("y", "dC_PermanentMagnet.la.i"),
        1.0,
        (("u", 100.0, 40.0),),
        kind="model-exchange",
    ),
    Example("omsi__testsuite_resources_HelloWorld.fmu", ("a", "x_start"), ("x",), 3.0, kind="model-exchange"),
    Example("HelloWorldWithInput.fmu", ("a", "x_start"), ("x",), 6.0, (("u", 0.5, 1.0),), kind="model-exchange"),
    Example(
        "Lin2DimODE.fmu",
        ("a11", "a12", "a21", "a22"),
        ("x1", "x2"),
        4.0,
        kind="model-exchange",
        starts=(-1.0, 2.0, -2.0, -1.0),
    ),
    Example("fmpy__tests_resources_Drivetrain.fmu", ("spring.c", "inertia2.J"), ("w",), 2.0, (("tau", 0.0, 1.0),)),
    Example(
        "fmpy__tests_resources_Drivetrain.fmu",
        ("spring.c", "inertia2.J"),
        ("w",),
        2.0,
        (("tau", 0.0, 1.0),),
        kind="model-exchange",
    ),
    Example(
        "2022x_2.0_SpringPendulumExtForce1D.fmu",
        ("spring.c", "mass.m", "mass_s0"),
        ("v", "a"),
        10.0,
        (("extForce", 0.0, 2.0),),
        kind="model-exchange",
    ),
    Example(
        "2023x_2.0_SpringPendulumExtForce1D.fmu",
        ("spring.c", "mass.m", "mass_s0"),
        ("v", "a"),
        10.0,
        (("extForce", 0.0, 2.0),),
    ),
    Example(
        "2023x_3.0_SpringPendulumExtForce1D.fmu",
        ("spring.c", "mass.m", "mass_s0"),
        ("v", "a"),
        10.0,
        (("extForce", 0.0, 2.0),),
        kind="model-exchange",
    ),
    Example("2022x_2.0_SpringDamperPendulum1D.fmu", ("spring.c", "mass.m"), ("s", "v"), 5.0, kind="model-exchange"),
    Example(
        "2023x_2.0_SpringFrictionPendulumExtForce1D.fmu",
        ("fricScale", "spring.c", "mass.m"),
        ("v", "a"),
        10.0,
        (("extForce", 0.0, 3.0),),
        kind="model-exchange",
    ),
    Example(
        "2023x_3.0_SpringFrictionPendulumExtForce1D.fmu",
        ("fricScale", "spring.c"),
        ("v", "a"),
        10.0,
        (("extForce", 0.0, 3.0),),
        kind="model-exchange",
    ),
    Example(
        "maestro__mass_spring_damper_MassSpringDamper1.fmu", ("c1", "d1", "m1"), ("x1", "v1"), 20.0, (("fk", 0.0, 2.0),)
    ),
    Example(
        "maestro__mass_spring_damper_MassSpringDamper2.fmu",
        ("c2", "d2", "m2"),
        ("x2", "v2"),
        20.0,
        (("x1", 0.0, 1.0), ("v1", 0.0, 0.5)),
    ),
    Example("quarter_truck_Chassis.fmu", ("mass",), ("position", "velocity"), 5.0, (("force", 4000.0, 300.0),)),
    Example("ref2__BouncingBall.fmu", ("g", "e"), ("h",), 1.5, samples=151, kind="model-exchange"),
    Example(
        "pyfmi__src_pyfmi_examples_files_FMUs_ME2.0_bouncingBall.fmu",
        ("g", "e"),
        ("h",),
        1.5,
        samples=151,
        kind="model-exchange",
    ),
    Example(
        "pyfmi__src_pyfmi_examples_files_FMUs_ME1.0_bouncingBall.fmu",
        ("g",),
        ("h",),
        0.4,
        samples=201,
        kind="model-exchange",
    ),
    Example("FirstOrder_64bit.fmu", ("a", "b"), ("y",), 10.0, (("u", 1.0, 1.0),), kind="model-exchange"),
    Example(
        "simple2R1C_ic_Simple2R1C_ic_linux64.fmu",
        ("R1", "R2"),
        ("T",),
        36000.0,
        (("Ti1", 280.0, 8.0), ("Ti2", 275.0, 8.0)),
        samples=601,
        starts=(0.1, 0.25),
    ),
)


def emulate(
    example: Example, description: FmuDescription, truth: FloatArray, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Return times, (n,), and inputs beside noisy outputs, (n, m + q)."""
    rng = np.random.default_rng(seed)
    n = example.samples
    driven_inputs = np.empty((n, len(example.inputs)))
    for j, (_, mean, deviation) in enumerate(example.inputs):
        driven_inputs[:, j] = np.repeat(mean + deviation * rng.standard_normal(STEPS), -(-n // STEPS))[:n]
    variables = {v.name: v for v in description.variables}
    shown = [variables[name] for name in example.outputs]
    chosen = [variables[name] for name in example.parameters]
    inputs = [variables[name] for name, _, _ in example.inputs]
    way = driven(description).restart
    start = description.default_experiment["start_time"] or 0.0
    recording = Experiment(
        start, example.length / (n - 1), 1, driven_inputs, np.zeros((n, len(shown))), np.zeros(len(shown))
    )
    job = Job(
        description=description,
        parameter_references=tuple(v.value_reference for v in chosen),
        input_references=tuple(v.value_reference for v in inputs),
        output_references=tuple(v.value_reference for v in shown),
        sensors=(IDENTITY,) * len(shown),
        experiments=(recording,),
        reinstantiate=way == "re-instantiate",
        fresh_process=way == "fresh process",
        types=types_of([v.type for v in (*chosen, *inputs, *shown)]),
    )
    with Workers(1) as workers:
        workers.load(job)
        batch = workers.run(truth.reshape(1, 1, -1), record=True)
        if batch.failed[0] or batch.shown is None:
            raise RuntimeError(workers.failures[0].reason)
    clean = batch.shown[0]
    noisy = clean + NOISE * np.ptp(clean, axis=0) * rng.standard_normal(clean.shape)
    times: FloatArray = np.asarray(start + np.arange(n) * recording.interval)
    return times, np.column_stack([driven_inputs, noisy])


def row(example: Example, path: Path, seed: int) -> str:
    description = with_kind(describe(path), example.kind)
    variables = {v.name: v for v in description.variables}
    starts = np.array(example.starts or [float(variables[n].start or 1.0) for n in example.parameters])
    truth = starts * np.array(FACTORS[: len(starts)])
    cells = [
        path.stem.split("__")[-1][-46:],
        description.generation_tool[:26],
        f"{description.fmi_version[:3]} {example.kind}",
    ]
    with tempfile.TemporaryDirectory() as folder:
        times, columns = emulate(example, description, truth, seed)
        names = [*(name for name, _, _ in example.inputs), *example.outputs]
        header = ",".join(["time [s]", *(f"c{j}" for j in range(len(names)))])
        np.savetxt(
            Path(folder) / "run.csv", np.column_stack([times, columns]), delimiter=",", header=header, comments=""
        )
        m = len(example.inputs)
        lines = [f'[fmu]\npath = "{path}"\nkind = "{example.kind}"', "[inputs]"]
        lines += [f'"{name}" = "c{j}"' for j, name in enumerate(names[:m])]
        lines += ["[outputs]", *(f'"{name}" = "c{j + m}"' for j, name in enumerate(names[m:])), "[parameters]"]
        for name, x in zip(example.parameters, starts, strict=True):
            low, high = sorted((x / 3, 3 * x))
            low, high = max(low, variables[name].minimum or low), min(high, variables[name].maximum or high)
            lines.append(f'"{name}" = {{ min = {low!r}, max = {high!r} }}'.replace("np.float64(", "").replace(")", ""))
        case = Path(folder) / "run.case.toml"
        case.write_text("\n".join([*lines, '[[recording]]\nfile = "run.csv"']) + "\n")
        began = time.perf_counter()
        try:
            found = estimate(read_case(case))
        except EstimatorError as error:
            return (
                "| " + " | ".join([*cells, ", ".join(example.parameters), str(error)[:80], "", "", "", "", ""]) + " |"
            )
        seconds = time.perf_counter() - began
    worst, largest = 0.0, 0.0
    for name, x in zip(example.parameters, truth, strict=True):
        p = found.parameters[name]
        largest = max(largest, abs(p.value / x - 1))
        worst = max(worst, abs(p.value - x) / p.standard_error if p.standard_error else np.inf)
    try:
        mine, _ = ours(description, example.samples, 3)
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:  # an FMU may end its process
            other, _ = apart.submit(theirs, description, example.samples, 1).result(timeout=PATIENCE)
        speed = [f"{1e3 * mine:.3g}", f"{1e3 * other:.3g}", f"{other / mine:.0f}"]
    except Exception as failure:
        speed = ["", f"fails: {str(failure)[:30]}", ""]
    cells += [
        ", ".join(example.parameters),
        f"{100 * largest:.2g} %",
        f"{worst:.1f}",
        found.verdict,
        f"{seconds:.1f}",
        *speed,
    ]
    return "| " + " | ".join(cells) + " |"


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    titles = ["FMU", "made by", "kind", "estimated", "largest error", "error / bar", "verdict", "estimate, s"]
    titles += ["one simulation, ms", "by simulate_fmu, ms", "ratio"]
    print("| " + " | ".join(titles) + " |\n" + "|---" * len(titles) + "|")
    for example in EXAMPLES:
        path = next((p for p in sorted(given.folder.glob("*.fmu")) if p.name.endswith(example.file)), None)
        if path is None:
            print(f"| {example.file} | is not there |" + " |" * (len(titles) - 2))
            continue
        try:
            print(row(example, path, given.seed), flush=True)
        except Exception as error:
            print(f"| {example.file} | {example.kind} | fails: {type(error).__name__} {str(error)[:90]} |", flush=True)


if __name__ == "__main__":
    main()
