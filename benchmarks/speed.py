"""What one FMU simulation costs, and the paper's whole job, against fmpy's own loops and against no FMI at all.

    python benchmarks/speed.py [--quick] [--program]

With --program: commands cold, against what importing fmpy and scipy.optimize costs; estimates in Python with imports
done; reading 200 000 rows, against numpy.loadtxt. Otherwise what a simulation costs.

Prints Markdown tables: the median of several rounds, all contenders in turn within each round, so that the ratios hold
where the machine's speed drifts. Contenders on dc_motor.fmu at 1 ms over the paper's 2 801 samples:

    simulate_fmu     fmpy.simulate_fmu on the extracted FMU, one instance re-used, output_interval 1 ms
    FMU2Slave loop   reset, setReal, doStep, getReal by fmpy's methods, the error sum in numpy
    stepper          this package: one C call a batch, in a worker process
    floor            the same recursion with its error sum in plain C, same compiler flags, no FMI (floor.c)
"""

from __future__ import annotations

import argparse
import compileall
import contextlib
import ctypes
import dataclasses
import io
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

from estimator.cases.case import case_for_recording
from estimator.estimating.estimate import estimate_by, estimate_recordings
from estimator.fmus.archive import extract
from estimator.fmus.fmu import describe
from estimator.fmus.job import Experiment, Job
from estimator.fmus.simulate import simulate
from estimator.fmus.workers import Workers
from estimator.recordings.reading import recording_from_arrays
from estimator.stepping import layout
from fmu_build.compiler import compile_library

CML050 = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}
RMCS2004 = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}
SAMPLES = 2801
WEIGHTS = np.array([4.0, 1e-3])


def machine() -> str:
    model = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        lines = [x for x in Path("/proc/cpuinfo").read_text().splitlines() if x.startswith("model name")]
        model = lines[0].split(":")[1].strip() if lines else model
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}, {sys.platform}"


def signals(motor: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    times = np.arange(SAMPLES, dtype=float) * 1e-3
    voltage = np.where(times >= 0.5 - 1e-9, 10.5, 0.0)
    shown = simulate("dc_motor", parameters=motor, inputs={"v": voltage}, times=times)
    return times, voltage, np.column_stack([shown["i"], shown["w"]])


def job(samples: int = SAMPLES, recordings: int = 1) -> Job:
    description = describe("dc_motor")
    _, voltage, measured = signals(CML050)
    repeat = -(-samples // SAMPLES)
    inputs = np.tile(voltage, repeat)[:samples, None]
    experiment = Experiment(0.0, 1e-3, 1, inputs, np.tile(measured, (repeat, 1))[:samples], WEIGHTS)

    def references(names: str) -> tuple[int, ...]:
        return tuple(description.variable(n).value_reference for n in names)

    return Job(
        description=description,
        parameter_references=references("RKLJB"),
        input_references=references("v"),
        output_references=references("iw"),
        sensors=(layout.IDENTITY, layout.IDENTITY),
        experiments=(experiment,) * recordings,
    )


def candidates(count: int, recordings: int = 1) -> np.ndarray:
    nominal = np.array([CML050[n] for n in "RKLJB"])
    rows = nominal * np.exp(0.2 * np.random.default_rng(1).standard_normal((count, 5)))
    return np.repeat(rows[:, None, :], recordings, axis=1)


def contender_simulate_fmu(folder: Path) -> Callable[[int], int]:
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    description = fmpy.read_model_description(str(folder))
    times, voltage, measured = signals(CML050)
    fmu = FMU2Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=str(folder),
        instanceName="benchmark",
    )
    fmu.instantiate()
    table = np.array(list(zip(times, voltage, strict=True)), dtype=[("time", float), ("v", float)])
    rows = candidates(8)[:, 0]

    def run(index: int) -> int:
        fmu.reset()
        with contextlib.redirect_stdout(io.StringIO()):  # it warns of inputs that are not given
            result = fmpy.simulate_fmu(
                str(folder),
                model_description=description,
                fmu_instance=fmu,
                start_values=dict(zip("RKLJB", rows[index % 8], strict=True)),
                input=table,
                output=["i", "w"],
                stop_time=2.8,
                output_interval=1e-3,
                step_size=1e-3,
            )
        shown = np.column_stack([result["i"], result["w"]])
        float(np.sum((shown[:SAMPLES] - measured) ** 2 @ WEIGHTS))
        return len(result) - 1

    return run


def contender_slave_loop(folder: Path) -> Callable[[int], int]:
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    description = fmpy.read_model_description(str(folder))
    references = {v.name: v.valueReference for v in description.modelVariables}
    times, voltage, measured = signals(CML050)
    fmu = FMU2Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=str(folder),
        instanceName="benchmark",
    )
    fmu.instantiate()
    rows = candidates(8)[:, 0]
    parameters, v, outputs = [references[n] for n in "RKLJB"], [references["v"]], [references["i"], references["w"]]

    def run(index: int) -> int:
        fmu.reset()
        fmu.setupExperiment(startTime=0.0)
        fmu.setReal(parameters, list(rows[index % 8]))
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        shown = np.empty((SAMPLES, 2))
        shown[0] = fmu.getReal(outputs)
        last = None
        for k in range(SAMPLES - 1):
            if voltage[k] != last:
                last = voltage[k]
                fmu.setReal(v, [last])
            fmu.doStep(times[k], 1e-3)
            shown[k + 1] = fmu.getReal(outputs)
        float(np.sum((shown - measured) ** 2 @ WEIGHTS))
        return SAMPLES - 1

    return run


def contender_floor(folder: Path) -> Callable[[int], int]:
    library = folder / "floor.so"
    compile_library(Path(__file__).with_name("floor.c"), library)
    function = ctypes.CDLL(str(library)).floor_run
    function.restype = ctypes.c_double
    pointer = np.ctypeslib.ndpointer(dtype=np.float64, flags="C")
    function.argtypes = [ctypes.c_int64, ctypes.c_int64, *[pointer] * 5]
    from scipy.linalg import expm

    p = CML050
    A = np.zeros((4, 4))
    A[0] = [-p["R"] / p["L"], -p["K"] / p["L"], 0, 1 / p["L"]]
    A[1] = [p["K"] / p["J"], -p["B"] / p["J"], 0, 0]
    A[2, 1] = 1
    E = expm(A * 1e-3) - np.eye(4)
    _, voltage, measured = signals(CML050)
    transition, gain = np.ascontiguousarray(E[:3, :3]), np.ascontiguousarray(E[:3, 3])

    def run(count: int) -> int:
        function(count, SAMPLES, transition, gain, voltage, measured, WEIGHTS)
        return count * (SAMPLES - 1)

    return run


def per_step(rounds: int, batch: int) -> None:
    rows: dict[str, list[float]] = {"simulate_fmu": [], "FMU2Slave loop": [], "stepper": [], "floor": []}
    with tempfile.TemporaryDirectory() as name, Workers(1) as workers:
        folder = Path(name)
        extract(describe("dc_motor").path, folder)
        slow, loop, floor = contender_simulate_fmu(folder), contender_slave_loop(folder), contender_floor(folder)
        workers.load(job())
        many = candidates(batch)
        workers.run(many)
        for index in range(rounds):
            for label, run in (("simulate_fmu", slow), ("FMU2Slave loop", loop)):
                started = time.perf_counter()
                steps = run(index)
                rows[label].append((time.perf_counter() - started) / steps)
            started = time.perf_counter()
            steps = int(workers.run(many).steps.sum())
            rows["stepper"].append((time.perf_counter() - started) / steps)
            started = time.perf_counter()
            steps = floor(batch)
            rows["floor"].append((time.perf_counter() - started) / steps)
    ours = statistics.median(rows["stepper"])
    print("\n| loop | µs a step | µs a candidate | against the stepper |\n|---|---|---|---|")
    for label, values in rows.items():
        middle = statistics.median(values)
        ratio = statistics.median(a / b for a, b in zip(values, rows["stepper"], strict=True))
        print(f"| {label} | {1e6 * middle:.4g} | {1e6 * middle * (SAMPLES - 1):.4g} | {ratio:.4g} × |")
    floor_ratio = statistics.median(a / b for a, b in zip(rows["stepper"], rows["floor"], strict=True))
    print(f"\nstepper {1e9 * ours:.1f} ns a step; {floor_ratio:.2f} × the floor")


def papers_job(rounds: int, nests: int, iterations: int) -> None:
    case = case_for_recording(Path("motor.csv"))
    print("\n| motor, method | steps | saved | s bounded | s unbounded | s at simulate_fmu's rate | ratio |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        extract(describe("dc_motor").path, Path(name))
        slow = contender_simulate_fmu(Path(name))
        for label, motor, method in (
            ("RMCS2004, paper", RMCS2004, "paper"),
            ("CML-050, paper", CML050, "paper"),
            ("CML-050, original", CML050, "original"),
        ):
            times, voltage, shown = signals(motor)
            recording = recording_from_arrays(
                label, times, {"voltage [V]": voltage, "current [A]": shown[:, 0], "speed [rad/s]": shown[:, 1]}
            )
            seconds: dict[bool, list[float]] = {True: [], False: []}
            steps: dict[bool, int] = {}
            rates = []
            for seed in range(rounds):
                for bounded in (True, False):
                    search = dataclasses.replace(
                        case.search, method=method, seed=seed, nests=nests, iterations=iterations
                    )
                    started = time.perf_counter()
                    (e,) = estimate_recordings(
                        [dataclasses.replace(case, search=search)], [[recording]], bounded=bounded
                    )
                    seconds[bounded].append(time.perf_counter() - started)
                    steps[bounded] = e.steps
                started = time.perf_counter()
                done = sum(slow(k) for k in range(5))
                rates.append((time.perf_counter() - started) / done)
            at_rate = statistics.median(rates) * steps[False]
            middle = {b: statistics.median(s) for b, s in seconds.items()}
            ratio = statistics.median(r * steps[False] / s for r, s in zip(rates, seconds[True], strict=True))
            print(
                f"| {label} | {steps[False]:.3g} | {100 * (1 - steps[True] / steps[False]):.0f} % |"
                f" {middle[True]:.2f} | {middle[False]:.2f} | {at_rate:.0f} | {ratio:.0f} × |"
            )
    print(
        "\nTimes with start-up of the workers. simulate_fmu's rate: five runs a round, extrapolated to the job's steps."
    )


def two_workers(blocks: int) -> None:
    """Blocks of candidates by one worker and by two, in turn: this host's clock changes from second to second."""
    many = candidates(4096)
    ready = []
    with contextlib.ExitStack() as stack:
        crews = []
        for processes in (1, 2):
            started = time.perf_counter()
            workers = stack.enter_context(Workers(processes))
            workers.pool.busy_before_more = 0.0
            workers.load(job())
            workers.run(many[:1])
            while len(workers.pool.pids) < processes or not workers.pool.all_ready():
                workers.run(many[:64])
            ready.append(time.perf_counter() - started)
            crews.append(workers)
        seconds = np.empty((blocks, 2))
        for block in range(blocks):
            for which, workers in enumerate(crews):
                started = time.perf_counter()
                workers.run(many)
                seconds[block, which] = time.perf_counter() - started
    one, two = seconds.sum(axis=0)
    ratio = np.median(seconds[:, 0] / seconds[:, 1])
    print(
        f"\n{blocks * len(many)} candidates: two workers {ratio:.2f} × as fast as one"
        f" (median of {blocks} blocks; {one:.1f} s and {two:.1f} s in all); start-up {max(ready):.2f} s"
    )


def linear(rounds: int) -> None:
    print("\n| candidates | samples | recordings | ns a step |\n|---|---|---|---|")
    for count, samples, recordings in (
        (500, 2801, 1),
        (1000, 2801, 1),
        (4000, 2801, 1),
        (1000, 701, 1),
        (1000, 28010, 1),
        (1000, 2801, 4),
    ):
        with Workers(1) as workers:
            workers.load(job(samples, recordings))
            many = candidates(count, recordings)
            workers.run(many)
            values = []
            for _ in range(rounds):
                started = time.perf_counter()
                steps = int(workers.run(many).steps.sum())
                values.append((time.perf_counter() - started) / steps)
        print(f"| {count} | {samples} | {recordings} | {1e9 * statistics.median(values):.1f} |")


def memory(total: int) -> None:
    for label, reinstantiate, count in (("reset", False, total), ("new instance", True, min(total, 10_000))):
        with Workers(1) as workers:
            workers.load(dataclasses.replace(job(samples=101), reinstantiate=reinstantiate))
            many = candidates(1000)
            first = min(10_000, max(1000, count // 10))
            for _ in range(first // 1000):
                workers.run(many)
            before = psutil.Process(workers.pool.pids[0]).memory_info().rss + psutil.Process().memory_info().rss
            for _ in range(count // 1000):
                workers.run(many)
            after = psutil.Process(workers.pool.pids[0]).memory_info().rss + psutil.Process().memory_info().rss
        print(
            f"{count} candidates by {label}: memory grew by {(after - before) / 2**20:.2f} MB after the first {first}"
        )


def seconds(run: Callable[[], object]) -> tuple[float, float]:
    """Return how long a call takes, and its processor time with that of the processes that it waited for, s."""
    clock, used = time.perf_counter(), sum(os.times()[:4])
    run()
    return time.perf_counter() - clock, sum(os.times()[:4]) - used


def in_turn(rounds: int, runs: dict[str, Callable[[], object]], *, rival: str) -> None:
    """Run all in turn, round by round, and print medians and ratios to the rival's."""
    found = np.array([[seconds(run) for run in runs.values()] for _ in range(rounds)])
    against = found / found[:, [list(runs).index(rival)]]
    print(f"\n| work | s | s of processor | × {rival} | × its processor time |\n|---|---|---|---|---|")
    for name, (clock, used), (ratio, share) in zip(
        runs, np.median(found, axis=0), np.median(against, axis=0), strict=True
    ):
        print(f"| {name} | {clock:.3g} | {used:.3g} | {ratio:.3g} | {share:.3g} |")


def program(rounds: int, folder: Path) -> None:
    """Print what the whole program costs, cold and warm; its modules compiled, as an installation leaves them."""
    from estimator.api import estimate_parameters
    from estimator.recordings.reading import read_recording

    examples = Path(__file__).resolve().parent.parent / "examples"
    for package in ("estimator", "fmu_build"):
        compileall.compile_dir(examples.parent / package, quiet=2)
    step, real = str(examples / "cml050_step.csv"), str(examples / "esp32_step.csv")

    def command(*words: str) -> Callable[[], object]:
        line = [sys.executable, "-m", "estimator", *words]
        environment = {**os.environ, "PYTHONPATH": str(examples.parent)}
        return lambda: subprocess.run(line, env=environment, capture_output=True, check=False)

    bare = "import fmpy, scipy.optimize"
    cold: dict[str, Callable[[], object]] = {
        bare: lambda: subprocess.run([sys.executable, "-c", bare], check=True),
        "--help": command("--help"),
        "check": command("check", step),
        "a misspelt command": command("estimat", step),
        "estimate, clean step": command("estimate", step),
        "the same with -o": command("estimate", step, "-o", str(folder / "out")),
        "estimate, real step": command("estimate", real),
    }
    in_turn(rounds, cold, rival=bare)
    up = "clean step, workers up"
    with Workers(1) as crew:
        in_turn(
            rounds,
            {
                up: lambda: estimate_by(crew, case_for_recording(Path(step))),
                "real step, workers up": lambda: estimate_by(crew, case_for_recording(Path(real))),
                "estimate_parameters, clean step": lambda: estimate_parameters(step),
            },
            rival=up,
        )
    times = np.arange(200_000) * 1e-4
    shown = np.random.default_rng(1).standard_normal((len(times), 2))
    table = np.column_stack([times, np.where(times > 1, 10.0, 0.0), shown])
    long = folder / "long.csv"
    header = "time [s],voltage [V],current [A],speed [rad/s]"
    np.savetxt(long, table, fmt=["%.4f", *["%.6g"] * 3], delimiter=",", header=header, comments="")
    load = "numpy.loadtxt"
    reading: dict[str, Callable[[], object]] = {
        load: lambda: np.loadtxt(long, delimiter=",", skiprows=1),
        "read_recording": lambda: read_recording(long),
    }
    in_turn(rounds, reading, rival=load)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the work, for a look")
    parser.add_argument("--program", action="store_true", help="the whole program instead of its stepper")
    args = parser.parse_args()
    quick = args.quick
    print(machine())
    if args.program:
        with tempfile.TemporaryDirectory() as name:
            program(3 if quick else 9, Path(name))
        return
    per_step(rounds=5 if quick else 21, batch=500 if quick else 2000)
    papers_job(rounds=1 if quick else 2, nests=40 if quick else 400, iterations=10 if quick else 100)
    two_workers(10 if quick else 100)
    linear(rounds=3 if quick else 9)
    memory(20_000 if quick else 1_000_000)


if __name__ == "__main__":
    main()
