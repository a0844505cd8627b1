"""What long and many recordings cost the whole program: rows, recordings fitted together, cases of a batch.

    OPENBLAS_NUM_THREADS=1 python benchmarks/long_jobs.py [rows] [joint] [batch]

Prints a Markdown table for each, of processor time: that of the program and of the processes that it has waited for.
Memory is the program's own largest; a table is its four columns as doubles. Without a word: all three.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from estimator.batches.batch import gather, run_batch
from estimator.batches.worker_pool import run_here
from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_by
from estimator.fmus.simulate import simulate
from estimator.fmus.workers import Workers
from estimator.recordings.reading import read_recording

ROOT = Path(__file__).resolve().parent.parent
MOTOR = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}
HEADER = "time [s],voltage [V],current [A],speed [rad/s]"
PERIOD = 3.0  # s of rest and run
STEP_COST = 14e-9  # s, of the stepper alone
ROWS = (2_801, 100_000, 200_000, 1_000_000)


def recorded(path: Path, rows: int, *, seed: int = 1, interval: float = 1e-3, voltage: float = 10.5) -> Path:
    """Write a recording of so many rows, switched on and off every `PERIOD` / 2, with noise."""
    times = np.arange(rows, dtype=np.float64) * interval
    inputs = np.where(times % PERIOD < PERIOD / 2, 0.0, voltage)
    shown = simulate("dc_motor", parameters=MOTOR, inputs={"v": inputs}, times=times)
    rng = np.random.default_rng(seed)
    noisy = [shown[n] + s * rng.standard_normal(rows) for n, s in (("i", 0.02), ("w", 1.0))]
    table = np.column_stack([times, inputs, *noisy])
    np.savetxt(path, table, fmt=["%.6g", *["%.6g"] * 3], delimiter=",", header=HEADER, comments="")
    return path


def cost(*words: str) -> tuple[float, float, bytes]:
    """Return processor time, s, own largest memory, bytes, and output of a Python command."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen([sys.executable, *words], stdout=out, stderr=subprocess.DEVNULL, env=environment)
        _, _, used = os.wait4(process.pid, 0)
        process.returncode = 0
        out.seek(0)
        return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024.0, out.read()


def rows(folder: Path) -> None:
    """Print what a recording of many rows costs."""
    print("\n| rows | steps | s of processor | s × numpy.loadtxt | s × steps × 14 ns | memory, MB | memory × table |")
    print("|---|---|---|---|---|---|---|")
    empty = min(cost("-c", "import numpy")[0] for _ in range(3))
    for many in ROWS:
        path = recorded(folder / f"rows_{many}.csv", many)
        load = f"import numpy; numpy.loadtxt({str(path)!r}, delimiter=',', skiprows=1)"
        reading = min(cost("-c", load)[0] for _ in range(3)) - empty
        used, memory, out = cost("-m", "estimator", "estimate", str(path), "--json", "--quiet")
        steps = json.loads(out)["steps"]
        table = many * 4 * 8
        print(
            f"| {many} | {steps / 1e6:.0f} M | {used:.1f} | {used / max(reading, 1e-3):.0f} |"
            f" {used / (steps * STEP_COST):.1f} | {memory / 2**20:.0f} | {memory / table:.0f} |",
            flush=True,
        )


def joint(folder: Path) -> None:
    """Print what recordings cost that are fitted together, as they are and with offsets of each one's own."""
    print("\n| recordings | steps | s of processor | s a recording | with offsets: steps | s | s a recording |")
    print("|---|---|---|---|---|---|---|")
    plain = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
    free = {y: dataclasses.replace(o, offset="free") for y, o in plain.outputs.items()}
    paths = [recorded(folder / f"run_{k}.csv", 2801, seed=k, voltage=6.0 + k) for k in range(8)]
    recordings = [read_recording(path) for path in paths]
    with Workers(1) as crew:
        worker = psutil.Process(crew.pool.pids[0])

        def used() -> float:
            own = worker.cpu_times()
            return sum(os.times()[:2]) + float(own.user + own.system)

        estimate_by(crew, dataclasses.replace(plain, recordings=tuple(paths[:1])), recordings=recordings[:1])
        for many in (1, 2, 4, 8):
            told = []
            for case in (plain, dataclasses.replace(plain, outputs=free)):
                before = used()
                several = dataclasses.replace(case, recordings=tuple(paths[:many]))
                found = estimate_by(crew, several, recordings=recordings[:many])
                took = used() - before
                told.append(f"{found.steps / 1e6:.2f} M | {took:.2f} | {took / many:.2f}")
            print(f"| {many} | {' | '.join(told)} |", flush=True)


def batch(folder: Path, *, cases: int = 60, length: int = 500) -> None:
    """Print how many short cases are done in a second once all processes are at work."""
    print("\n| processes | cases a second | s of processor a case |\n|---|---|---|")
    paths = [recorded(folder / f"case_{k:03d}.csv", length, seed=k, interval=PERIOD / length) for k in range(cases)]
    for processes in (1, 2):
        begun = sum(os.times()[:4])
        ends: list[float] = []

        def timed(tasks, processes=processes, ends=ends):  # type: ignore[no-untyped-def]
            for answer in run_here(tasks, processes=processes):
                ends.append(time.perf_counter())
                yield answer

        run_batch(gather(paths), folder / f"out_{processes}", timed)
        after = cases // 3  # the start-up
        rate = (cases - 1 - after) / (ends[-1] - ends[after])
        print(f"| {processes} | {rate:.1f} | {(sum(os.times()[:4]) - begun) / cases:.3f} |", flush=True)


def main() -> None:
    """Print the tables that are asked for."""
    asked = sys.argv[1:] or ["rows", "joint", "batch"]
    for name in asked:
        with tempfile.TemporaryDirectory() as folder:
            {"rows": rows, "joint": joint, "batch": batch}[name](Path(folder))


if __name__ == "__main__":
    main()
