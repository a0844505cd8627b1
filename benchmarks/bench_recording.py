"""Table IV of the paper again, on an emulated bench, over seeds: nominal, Steiglitz–McBride, the paper's method, ours.

    OPENBLAS_NUM_THREADS=1 python benchmarks/bench_recording.py --seeds 100

The bench: 12-bit converter over ±5 A with 0.02 A noise, encoder of 500 to 2 000 lines × 4 differenced at 1 kHz with a
random phase, Chebyshev I (order 4, 0.5 dB, 100 Hz) on the speed, 10.5 V at 0.5 s, 2.8 s. Every seed has a motor of
its own: a CML-050 whose parameters are off their nominal values by up to 5 %. A cell holds the RMS error and the bias
in percent; the RMSE of current and speed is that of the noise-free response against the true motor's. Ours knows
the filter, which the case file declares; the paper's method and Steiglitz–McBride have no place for it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from paper_bench import CML050, NAMES, Bench
from trust import FILTER, FILTERED, PLAIN, quantised

from estimator.cases.case import Case, SearchSpec
from estimator.estimating.estimate import estimate_by
from estimator.fmus.fmu import describe
from estimator.fmus.workers import Workers

FloatArray = NDArray[np.float64]
TOLERANCE = 0.05  # of a nominal value
METHODS: dict[str, Case] = {"Steiglitz–McBride": PLAIN, "paper": PLAIN, "ours": FILTERED}
NAMED = {"Steiglitz–McBride": "steiglitz-mcbride", "paper": "paper", "ours": "cuckoo"}


def bench(seed: int) -> Bench:
    """Return the bench of a seed, with its motor."""
    off = np.random.default_rng([seed, 9]).uniform(-TOLERANCE, TOLERANCE, len(NAMES))
    motor = {name: CML050[name] * (1 + x) for name, x in zip(NAMES, off, strict=True)}
    return quantised(motor, seed, chebyshev=FILTER)


def distance(made: Bench, values: FloatArray) -> FloatArray:
    """Return the RMSE of current and speed, (2,), between the responses of R … B and of the true motor."""
    time = np.arange(round(made.duration / made.step) + 1, dtype=float) * made.step - made.lead
    other = replace(made, motor=dict(zip(NAMES, values.tolist(), strict=True)))
    errors = np.stack(other.response(time)[:2]) - np.stack(made.response(time)[:2])
    return np.asarray(np.sqrt(np.mean(errors**2, axis=1)))


def row(title: str, found: list[FloatArray | None], benches: list[Bench]) -> str:
    """Return one row of the table."""
    good = [(values, made) for values, made in zip(found, benches, strict=True) if values is not None]
    relative = np.array([100 * (values / [made.motor[n] for n in NAMES] - 1) for values, made in good])
    rms = np.sqrt(np.mean(relative**2, axis=0))
    cells = [f"{r:.2g} ({b:+.2g})" for r, b in zip(rms, relative.mean(axis=0), strict=True)]
    i, w = np.sqrt(np.mean([distance(made, values) ** 2 for values, made in good], axis=0))
    return f"| {title} | {' | '.join(cells)} | {i:.2g} | {w:.2g} | {len(good)}/{len(found)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--method", choices=[*METHODS], action="append")
    options = parser.parse_args()
    benches = [bench(seed) for seed in range(options.seeds)]
    print(f"| method | {' | '.join(f'{n} %' for n in NAMES)} | RMSE i [A] | RMSE w [rad/s] | found |")
    print("|---" * 9 + "|")
    print(row("nominal", [np.array([CML050[n] for n in NAMES])] * len(benches), benches), flush=True)
    description = describe("dc_motor")
    with Workers(1) as crew:
        for title in options.method or METHODS:
            found: list[FloatArray | None] = []
            for seed, made in enumerate(benches):
                case = replace(METHODS[title], search=SearchSpec(method=NAMED[title], seed=seed + 1))
                result = estimate_by(crew, case, description=description, recordings=[made.record(seed)])
                known = set(NAMES) <= set(result.parameters)
                found.append(np.array([result.parameters[n].value for n in NAMES]) if known else None)
            print(row(title, found, benches), flush=True)


if __name__ == "__main__":
    main()
