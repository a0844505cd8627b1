"""Table IV again, on an emulated bench, by every method; and whether 95 % intervals cover the truth.

    OPENBLAS_NUM_THREADS=1 python benchmarks/bench_recording.py --seeds 100              Table IV, and error over bound
    OPENBLAS_NUM_THREADS=1 python benchmarks/bench_recording.py --seeds 100 --coverage   how often 95 % intervals cover

A cell holds the RMS error and the bias in percent, the RMS error over the reported standard error, and how often the
95 % interval covers the truth. `--paper-method` adds the paper's method, 80 400 simulations a recording.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench import MOTORS, NAMES, PAPER_BENCH, Bench, real_bench

from estimator.case import Case, Chebyshev1, OutputSpec, SearchSpec
from estimator.estimate import estimate_recordings
from estimator.result import Estimate

PLAIN = Case(fmu="dc_motor", recordings=(Path("bench.csv"),))
FILTERED = replace(
    PLAIN,
    inputs={"v": "voltage"},
    outputs={
        "i": OutputSpec("current"),
        "w": OutputSpec("speed", sensor="mean", filter=Chebyshev1(order=4, ripple=0.5, cutoff=100)),
    },
)


def row(title: str, estimates: list[Estimate], motor: dict[str, float]) -> str:
    """Return one row of the table: bias and RMS error of each parameter in %, RMS error over standard error."""
    good = [e for e in estimates if e.parameters]
    truth = np.array([motor[n] for n in NAMES])
    values = np.array([[e.parameters[n].value for n in NAMES] for e in good])
    errors = np.array([[e.parameters[n].standard_error or np.nan for n in NAMES] for e in good])
    relative = 100 * (values / truth - 1)
    rms = np.sqrt(np.mean(relative**2, axis=0))
    cells = [f"{r:.2g} ({b:+.2g})" for r, b in zip(rms, relative.mean(axis=0), strict=True)]
    if not np.isnan(errors).all():
        z = (values - truth) / errors
        ratios = np.sqrt(np.nanmean(z**2, axis=0))
        covered = 100 * np.nanmean(np.abs(z) < 1.96, axis=0)
        cells = [f"{c}, {r:.2f}, {v:.0f} %" for c, r, v in zip(cells, ratios, covered, strict=True)]
    rmse = {y: np.mean([e.rmse[y] for e in good]) for y in good[0].rmse}
    shown = ", ".join(f"{y} {v:.3g}" for y, v in rmse.items())
    return f"| {title} | {' | '.join(cells)} | {shown} | {len(good)}/{len(estimates)} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--coverage", action="store_true")
    parser.add_argument("--paper-method", action="store_true")
    parser.add_argument("--motor", choices=[*MOTORS], action="append")
    options = parser.parse_args()
    print(
        "| recording, method | "
        + " | ".join(f"{n}: rms % (bias), rms/se, covered" for n in NAMES)
        + " | rmse | found |"
    )
    print("|---" * 8 + "|")
    for motor_name in options.motor or MOTORS:
        motor = MOTORS[motor_name]
        rows: list[tuple[str, Callable[[int], Bench], Case, str]] = [
            ("white noise", lambda s, m=motor: Bench(motor=m), PLAIN, "cuckoo"),
            ("speed", lambda s, m=motor: replace(PAPER_BENCH, motor=m), PLAIN, "cuckoo"),
            ("counts", lambda s, m=motor: replace(PAPER_BENCH, motor=m, counts=True), PLAIN, "cuckoo"),
        ]
        filtered = [
            ("filtered", lambda s, m=motor: replace(PAPER_BENCH, motor=m, chebyshev=(4, 0.5, 100)), FILTERED, "cuckoo"),
            (
                "filtered",
                lambda s, m=motor: replace(PAPER_BENCH, motor=m, chebyshev=(4, 0.5, 100)),
                PLAIN,
                "steiglitz-mcbride",
            ),
        ]
        rows += [("real", lambda s, m=motor: real_bench(s, m), PLAIN, "cuckoo")] if options.coverage else filtered
        if options.paper_method:
            rows.append((*filtered[1][:3], "paper"))
        for title, bench, case, method in rows:
            recordings = [[bench(s).record(s)] for s in range(options.first, options.first + options.seeds)]
            cases = [replace(case, search=SearchSpec(method=method))] * len(recordings)
            print(row(f"{motor_name}, {title}, {method}", estimate_recordings(cases, recordings), motor), flush=True)


if __name__ == "__main__":
    main()
