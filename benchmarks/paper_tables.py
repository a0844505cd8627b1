"""Tables II and III of the paper again, through the FMU, over seeds.

    python benchmarks/paper_tables.py --seeds 100

For both motors the noise-free step response of the paper (10.5 V at 0.5 s, 2.8 s, 1 ms) is simulated in dc_motor.fmu;
the methods `paper` and, on the CML-050, `original` estimate it from every seed. Printed beside each other: the
paper's figure, the 5th, 50th and 95th percentile of ours, and the percentile at which the paper's figure lies.

Source of the paper's figures: Rodríguez-Abreo et al., IEEE Access 2021, doi 10.1109/ACCESS.2021.3078578.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy as np

from estimator.cases.case import Case, case_for_recording
from estimator.estimating.estimate import estimate_recordings
from estimator.fmus.simulate import simulate
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording

NOMINAL = {
    "RMCS2004": {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678},
    "CML-050": {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4},
}
RMSE_PRINTED = {
    ("RMCS2004", "paper"): {"w": 0.0099, "i": 0.0011},
    ("CML-050", "paper"): {"w": 0.0093, "i": 0.00016},
    ("CML-050", "original"): {"w": 0.5741, "i": 0.0091},
}
ERROR_PRINTED = {  # %
    ("RMCS2004", "paper"): {"R": 0.07, "K": 0.01, "L": 0.14, "J": 0.24, "B": 0.01},
    ("CML-050", "paper"): {"R": 0.17, "K": 0.04, "L": 0.04, "J": 0.05},
    ("CML-050", "original"): {"R": 5.78, "K": 1.23, "L": 10.07, "J": 1.66},
}


def step_recording(motor: str) -> Recording:
    """Return the paper's noise-free step response of a motor, simulated in dc_motor.fmu."""
    time_s = np.arange(2801, dtype=float) * 1e-3
    voltage = np.where(time_s >= 0.5 - 1e-9, 10.5, 0.0)
    shown = simulate("dc_motor", parameters=NOMINAL[motor], inputs={"v": voltage}, times=time_s)
    signals = {"voltage [V]": voltage, "current [A]": shown["i"], "speed [rad/s]": shown["w"]}
    return recording_from_arrays(motor, time_s, signals)


def case_of(motor: str, method: str) -> Case:
    """Return the case of a motor and a method, with the paper's bounds."""
    case = case_for_recording(Path(f"{motor}.csv"))
    return dataclasses.replace(case, search=dataclasses.replace(case.search, method=method))


def run(motor: str, method: str, seeds: int) -> dict[str, object]:
    """Estimate a motor by a method from every seed; return the table's rows."""
    started = time.monotonic()
    recording, case = step_recording(motor), case_of(motor, method)
    cases = [dataclasses.replace(case, search=dataclasses.replace(case.search, seed=s)) for s in range(seeds)]
    estimates = estimate_recordings(cases, [[recording]] * seeds)
    rmse = {y: np.array([e.rmse[y] for e in estimates]) for y in ("w", "i")}
    errors = {
        p: np.array([100 * abs(e.parameters[p].value / NOMINAL[motor][p] - 1) for e in estimates])
        for p in NOMINAL[motor]
    }
    return {
        "motor": motor,
        "method": method,
        "seeds": seeds,
        "seconds": time.monotonic() - started,
        "simulations": int(np.median([e.simulations for e in estimates])),
        "rmse": {y: _row(values, RMSE_PRINTED[motor, method].get(y)) for y, values in rmse.items()},
        "error %": {p: _row(values, ERROR_PRINTED[motor, method].get(p)) for p, values in errors.items()},
    }


def _row(values: np.ndarray, printed: float | None) -> dict[str, float | None]:
    low, middle, high = np.percentile(values, [5, 50, 95])
    at = None if printed is None else 100 * float(np.mean(values < printed))
    return {"paper": printed, "p5": low, "median": middle, "p95": high, "paper's percentile": at}


def main() -> None:
    """Print the tables, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, metavar="N")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    tables = [run(motor, method, arguments.seeds) for motor, method in RMSE_PRINTED]
    if arguments.json:
        print(json.dumps(tables))
        return
    for table in tables:
        print(
            f"\n{table['motor']}, method {table['method']}: {table['seeds']} seeds, {table['simulations']} FMU"
            f" simulations each, {table['seconds']:.1f} s in all"
        )
        print(f"{'':>10} {'paper':>10} {'5 %':>10} {'median':>10} {'95 %':>10}   paper's percentile")
        for group in ("rmse", "error %"):
            for name, row in table[group].items():  # type: ignore[attr-defined]
                printed = "–" if row["paper"] is None else f"{row['paper']:.4g}"
                at = "" if row["paper's percentile"] is None else format(row["paper's percentile"], ".0f")
                print(
                    f"{group.split()[0] + ' ' + name:>10} {printed:>10} {row['p5']:>10.4g} {row['median']:>10.4g}"
                    f" {row['p95']:>10.4g}   {at}"
                )


if __name__ == "__main__":
    main()
