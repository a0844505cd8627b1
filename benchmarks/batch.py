"""A batch of 1 000 cases: rate, overhead beside the search, memory, and the same table after 20 kills.

    python benchmarks/batch.py [--cases 1000] [--kills 20] [--folder DIR]

Each case is 1 000 samples of the example with noise of its own and a short search (4 nests, 2 generations).
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"


def write_cases(folder: Path, count: int) -> None:
    folder.mkdir(parents=True)
    lines = EXAMPLE.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line[:1].isdigit())
    columns = np.array([[float(cell) for cell in line.split(",")] for line in lines[head:]])[300:1300]
    for k in range(count):
        noisy = columns.copy()
        noisy[:, 2:4] += np.random.default_rng(k).standard_normal((len(noisy), 2)) * [0.02, 1.0]
        rows = [",".join(f"{x:.6g}" for x in row) for row in noisy]
        (folder / f"motor_{k:04}.csv").write_text("\n".join([lines[head - 1], *rows]) + "\n")
    case = '[search]\nnests = 4\niterations = 2\n[[recording]]\nfile = "motor_*.csv"\n'
    (folder / "line.case.toml").write_text(case)


def start(folder: Path, out: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "estimator", "batch", "line.case.toml", "--resume", "-o", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL)


def memory(process: subprocess.Popen[bytes]) -> list[float]:
    """Return the resident memory, in MB, of the batch and of all its processes together."""
    try:
        own = psutil.Process(process.pid)
        return [own.memory_info().rss / 1e6, sum(p.memory_info().rss for p in own.children(recursive=True)) / 1e6]
    except psutil.NoSuchProcess:
        return []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--folder", type=Path, default=Path("batch-benchmark"))
    args = parser.parse_args()
    write_cases(args.folder, args.cases)
    whole, killed = args.folder.absolute() / "whole", args.folder.absolute() / "killed"

    began = time.monotonic()
    process = start(args.folder, whole)
    samples = []
    while process.poll() is None:
        time.sleep(0.5)
        done = len(list((whole / "cases").glob("line*"))) if whole.exists() else 0
        if len(found := memory(process)) == 2:
            samples.append((done, *found))
    seconds = time.monotonic() - began
    print(f"{args.cases} cases in {seconds:.1f} s, {args.cases / seconds:.2f}/s")
    for share in (0.1, 0.5, 0.9):
        done, own, others = min(samples, key=lambda s: abs(s[0] - share * args.cases))
        print(f"memory at {done} cases: {own:.1f} MB the batch, {others:.1f} MB its processes")
    with (whole / "timings.csv").open() as stream:
        times = list(csv.DictReader(stream))
    searching = sum(float(row["search_seconds"]) for row in times)
    inside = sum(float(row["seconds"]) for row in times)
    print(f"a case: {searching / len(times):.3f} s search, {(inside - searching) / len(times) * 1e3:.1f} ms beside it")

    rng = np.random.default_rng(0)
    for k in range(args.kills):
        process = start(args.folder, killed)
        try:
            process.wait(timeout=rng.uniform(1.0, 4.0 + 2 * seconds / max(1, args.kills)))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
        print(f"kill {k + 1}: {len(list((killed / 'cases').glob('line*')))} cases on disk")
    start(args.folder, killed).wait()
    same = all((whole / name).read_bytes() == (killed / name).read_bytes() for name in ("results.csv", "results.jsonl"))
    print("after the kills: " + ("the same table, bit for bit" if same else "ANOTHER TABLE"))
    shutil.rmtree(args.folder)


if __name__ == "__main__":
    main()
