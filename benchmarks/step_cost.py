"""What a step of the bundled motors costs, ns of the worker's processor time, by what is set and how the voltage goes.

    python benchmarks/step_cost.py [--rounds 9] [--candidates 200]

A step here is a communication step, and what comes with it: the inputs set where they change, two outputs read and
compared. The voltage goes up and down in levels, so that some steps see changes of mode, which cost much more.
"""

from __future__ import annotations

import argparse
import statistics
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.fmus.fmu import describe
from estimator.fmus.job import Experiment, Job
from estimator.fmus.workers import Workers
from estimator.stepping.layout import IDENTITY

FloatArray = NDArray[np.float64]
CML050 = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}
STEP = 1e-3  # s
ROWS = 3000
DRY = {"friction": 0.006, "stiction": 0.003}
LEVELS = np.array([0.0, 6.0, 10.5, 3.0, 0.0, -8.0]).repeat(ROWS // 6)  # V
NOISY = LEVELS + np.random.default_rng(1).normal(0.0, 0.02, ROWS)
PULSED = np.where(np.arange(ROWS) % 10 < 6, 10.5, 0.0)


@dataclass(frozen=True)
class Work:
    """What is stepped: a model, the parameters that are set beside the motor's, and the voltage, (n,)."""

    name: str
    model: str = "dc_motor_drive"
    effects: dict[str, float] = field(default_factory=dict)
    voltage: FloatArray = field(default_factory=LEVELS.copy)
    late: float = 0.0  # of a step, by which the current is shown late: two communication steps a row


WORKS = (
    Work("linear motor", "dc_motor"),
    Work("linear motor, noisy voltage", "dc_motor", voltage=NOISY),
    Work("linear motor, late current", "dc_motor", late=0.4),
    Work("linear motor, noisy voltage, late current", "dc_motor", voltage=NOISY, late=0.4),
    Work("nothing set"),
    Work("nothing set, noisy voltage", voltage=NOISY),
    Work("dry friction", effects=DRY),
    Work("dry friction, noisy voltage", effects=DRY, voltage=NOISY),
    Work("dry friction, late current", effects=DRY, late=0.4),
    Work("dry friction, noisy voltage, late current", effects=DRY, voltage=NOISY, late=0.4),
    Work("dry friction, little inductance, noisy voltage", effects=DRY | {"L": 2e-5}, voltage=NOISY),
    Work("falling friction", effects=DRY | {"stribeck_torque": 0.004, "stribeck_speed": 40.0}),
    Work("brush drop", effects={"brush": 0.6}),
    Work("brush drop and friction, noisy voltage", effects=DRY | {"brush": 0.6}, voltage=NOISY),
    Work("limit, not reached", effects={"current_limit": 50.0}),
    Work("limit, reached", effects={"current_limit": 1.5}),
    Work("sag", effects={"supply_resistance": 0.8, "supply_time": 0.02}),
    Work(
        "sag and friction, noisy voltage", effects=DRY | {"supply_resistance": 0.8, "supply_time": 0.02}, voltage=NOISY
    ),
    Work("dead band, pulsed voltage", effects={"dead_band": 1.5}, voltage=PULSED),
    Work("dead band and friction, pulsed voltage", effects=DRY | {"dead_band": 1.5}, voltage=PULSED),
    Work(
        "open below a dead band, brushes, pulsed",
        effects={"dead_band": 1.5, "coasts": 1.0, "brush": 0.6},
        voltage=PULSED,
    ),
    Work("motor with friction", "dc_motor_friction", DRY),
    Work("motor with friction, noisy voltage", "dc_motor_friction", DRY, NOISY),
)


def job(work: Work) -> tuple[Job, FloatArray]:
    """Return what the worker is asked, and the parameters' values, (p,)."""
    description = describe(work.model)
    effects = work.effects if work.model != "dc_motor" else {}
    off = {"friction": 0.0} if work.model == "dc_motor_friction" else {}
    parameters = CML050 | off | effects

    def references(*names: str) -> tuple[int, ...]:
        return tuple(description.variable(n).value_reference for n in names)

    experiment = Experiment(0.0, STEP, 1, work.voltage[:, None], np.zeros((ROWS, 2)), np.array([4.0, 1e-3]))
    asked = Job(
        description=description,
        parameter_references=references(*parameters),
        input_references=references("v"),
        output_references=references("i", "w"),
        sensors=(IDENTITY, IDENTITY),
        experiments=(experiment,),
        sensor_values=7 if work.late else 0,
    )
    return asked, np.array(list(parameters.values()))


def candidates(values: FloatArray, count: int, late: float = 0.0) -> FloatArray:
    """Return parameters around the given ones, (count, 1, p), and what the sensors show; the first as given."""
    rows = values * np.exp(0.1 * np.random.default_rng(1).standard_normal((count, len(values))))
    rows[0] = values
    sensors = [0.0, 1.0, 0.0, late * STEP, 1.0, 0.0, 0.0] if late else []
    return np.column_stack([rows, np.tile(sensors, (count, 1))])[:, None, :]


def processor_time(pid: int) -> float:
    """Return what a process has used, s; the kernel counts it to the ns."""
    return 1e-9 * int(Path(f"/proc/{pid}/schedstat").read_text().split()[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--candidates", type=int, default=200)
    parser.add_argument("--only", default="", help="of the works whose names hold this")
    args = parser.parse_args()
    print("| work | ns a step |\n|---|---:|")
    with Workers(1) as workers:
        for work in WORKS:
            if args.only not in work.name:
                continue
            asked, values = job(work)
            workers.load(asked)
            many = candidates(values, args.candidates, work.late)
            taken = []
            for _ in range(1 + args.rounds):
                begun = processor_time(workers.pool.pids[0])
                steps = int(workers.run(many).steps.sum())
                taken.append((processor_time(workers.pool.pids[0]) - begun) / steps)
            print(f"| {work.name} | {1e9 * statistics.median(taken[1:]):.1f} |", flush=True)


if __name__ == "__main__":
    main()
