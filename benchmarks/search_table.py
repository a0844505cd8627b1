"""Where least squares alone fails: four searches at equal simulations, on problems that are hard for one reason each.

    OPENBLAS_NUM_THREADS=1 python benchmarks/search_table.py --seeds 10        needs the extra `benchmarks` (CMA-ES)

Every method works through the same FMU on the same weighted squares, over the same box on logarithmic scales. Ours
runs first, with its defaults; the others get as many simulations as it took, and, in brackets, ten times as many. A
cell says in how many of the seeds the method came within 1 of the least chi-square that is known, the polish from the
truth included: within about a standard error. Least squares starts again at random until its simulations are used.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from paper_bench import CML050, Bench

import fmu_build
from estimator.cases.case import Case, OutputSpec, ParameterSpec, SearchSpec
from estimator.estimating.differential_evolution import DifferentialEvolution
from estimator.estimating.estimate import estimate_by
from estimator.estimating.search import SearchRecord, run_search
from estimator.fitting.least_squares import LeastSquares
from estimator.fitting.problem import Problem
from estimator.fmus.fmu import FmuDescription, describe
from estimator.fmus.probe import driven
from estimator.fmus.simulate import simulate
from estimator.fmus.workers import Workers
from estimator.plans.noise_level import output_deviations
from estimator.plans.planning import plan_case
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording

FloatArray = NDArray[np.float64]
MODELS = Path(__file__).resolve().parent.parent / "models"
WITHIN = 1.0  # of chi-square
DECADES = 6.0  # of a box
NOISE = {"i": 0.02, "w": 1.0}
BOTH = {"i": OutputSpec("current"), "w": OutputSpec("speed")}


@dataclass(frozen=True)
class Task:
    """A problem: its case, what is true, and a recording by the seed."""

    title: str
    case: Case
    truth: dict[str, float]
    record: Callable[[int], Recording]


def boxed(truth: dict[str, float], seed: int, decades: float) -> dict[str, ParameterSpec]:
    """Return bounds that hold the truth anywhere in their middle half, on a logarithmic scale."""
    rng = np.random.default_rng([seed, 21])
    specs = {}
    for name, value in truth.items():
        low = value * 10 ** -(decades * rng.uniform(0.25, 0.75))
        specs[name] = ParameterSpec(name=name, minimum=low, maximum=low * 10**decades)
    return specs


def failing_fmu(folder: Path) -> Path:
    """Build dc_motor with a model that fails where R L is more than twice that of the CML-050: half of a box."""
    limit = 2 * CML050["R"] * CML050["L"]
    text = (MODELS / "dc_motor.c").read_text().replace("MODEL_LINEAR 1", "MODEL_LINEAR 0")
    text = text.replace("/ m->L;", f"/ m->L + 0 * sqrt({limit!r} - m->R * m->L);")
    source = folder / "half.c"
    source.write_text(text.replace('#include "model.h"', '#include <math.h>\n#include "model.h"'))
    target = folder / "half.fmu"
    fmu_build.build(str(source), output=target)
    return target


def sticking(fmu: Path, truth: dict[str, float]) -> Callable[[int], Recording]:
    """Return recordings of a motor that sticks at the first of three voltage levels, through the FMU."""

    def record(seed: int) -> Recording:
        time = np.arange(1201, dtype=float) * 1e-3
        voltage = np.select([time < 0.1, time < 0.4, time < 0.8], [0.0, 0.5, 6.0], 10.0)
        shown = simulate(str(fmu), parameters=truth, inputs={"v": voltage}, times=time)
        rng = np.random.default_rng(seed)
        noisy = {y: shown[y] + NOISE[y] * rng.standard_normal(len(time)) for y in ("i", "w")}
        return recording_from_arrays(
            "sticks", time, {"voltage [V]": voltage, "current [A]": noisy["i"], "speed [rad/s]": noisy["w"]}
        )

    return record


def tasks(folder: Path) -> Iterator[Callable[[int], Task]]:
    """Yield the problems, each by the seed."""
    plain = Case(fmu="dc_motor", recordings=(Path("bench.csv"),), inputs={"v": "voltage"}, outputs=BOTH)
    short = Bench(duration=0.8, lead=0.1)

    def wide(seed: int) -> Task:
        case = replace(plain, parameters=boxed(CML050, seed, DECADES))
        return Task("bounds six decades wide", case, CML050, short.record)

    half = failing_fmu(folder)

    def failing(seed: int) -> Task:
        case = replace(plain, fmu=str(half), parameters=boxed(CML050, seed, 3.0))
        return Task("fails in half of the box", case, CML050, short.record)

    small = {**CML050, "L": 0.15 * 1e-3 * CML050["R"]}

    def minima(seed: int) -> Task:
        case = replace(plain, parameters=boxed(small, seed, 4.0))
        return Task("two minima (L below a sample)", case, small, replace(short, motor=small).record)

    def missing(seed: int) -> Task:
        free = {n: CML050[n] for n in ("L", "J", "B")}
        case = replace(
            plain,
            outputs={"w": OutputSpec("speed")},
            parameters=boxed(free, seed, DECADES),
            fixed={n: CML050[n] for n in ("R", "K")},
        )
        return Task("no current measured", case, free, short.record)

    dry = folder / "dry.fmu"
    fmu_build.build("dc_motor_friction", output=dry)
    sticky = {**CML050, "B": 8.45e-5, "friction": 0.0149}
    recorded = sticking(dry, sticky)

    def stiction(seed: int) -> Task:
        case = replace(plain, fmu=str(dry), parameters=boxed(sticky, seed, 3.0))
        return Task("stiction", case, sticky, recorded)

    yield from (failing, stiction, minima, wide, missing)


class Contest:
    """One problem and seed, with every method's least cost."""

    def __init__(self, crew: Workers, task: Task, seed: int, description: FmuDescription) -> None:
        self.crew, self.task, self.seed = crew, task, seed
        case = replace(task.case, search=SearchSpec(seed=seed + 1))
        self.recording = task.record(seed)
        self.found = estimate_by(crew, case, description=description, recordings=[self.recording])
        self.budget = self.found.simulations
        plan = plan_case(case, driven(description), recordings=[self.recording])
        plan = replace(plan, observed=tuple(replace(o, delay=0.0) for o in plan.observed))  # seen where it only sticks
        sigma = {y: NOISE[y] for y in output_deviations(plan)}
        self.problem = Problem(plan, crew, sigma=sigma)
        self.box, self.names = self.problem.box, plan.names
        self.sigma = np.array([sigma[y] for y in plan.outputs])

    def cost(self, values: FloatArray) -> float:
        """Return a candidate's chi-square."""
        return float(self.problem.costs(values[None, :])[0])

    def ours(self) -> float:
        """Return the default method's chi-square."""
        if not set(self.names) <= set(self.found.parameters):
            return np.inf
        return self.cost(np.array([self.found.parameters[n].value for n in self.names]))

    def squares(self) -> LeastSquares:
        """Return the least-squares problem that all share."""
        problem = self.problem
        return LeastSquares(problem.residuals, self.box, output=problem.output_of_residual, spread=problem.spread)

    def known(self) -> float:
        """Return the chi-square of the polish from the truth."""
        values, cost = self.squares().fit(np.array([self.task.truth[n] for n in self.names]), self.sigma)
        return cost

    def least_squares(self, budget: int) -> float:
        """Return the least chi-square of polishes from random starts."""
        rng = np.random.default_rng([self.seed, 31])
        best, last = np.inf, self.crew.simulations + budget
        while self.crew.simulations < last:
            values, cost = self.squares().fit(self.box.from_cube(rng.random(self.box.dimension)), self.sigma)
            best = min(best, cost if self.crew.simulations <= last else np.inf)
        return best

    def differential_evolution(self, budget: int) -> float:
        """Return what differential evolution finds."""
        size = min(15 * self.box.dimension, max(5, budget // 10))
        generations = max(1, budget // size - 1)
        rng = np.random.default_rng([self.seed, 32])
        search = DifferentialEvolution(rng.random((size, self.box.dimension)), rng=rng)

        def costs(points: FloatArray, bounds: FloatArray) -> FloatArray:
            return self.problem.costs(self.box.from_cube(points), bounds)

        run_search(search, costs, generations=generations, record=SearchRecord())
        return self.cost(self.box.from_cube(search.best[None, :])[0])

    def cma(self, budget: int) -> float:
        """Return what CMA-ES finds, started again where it ends early."""
        import cma

        rng = np.random.default_rng([self.seed, 33])
        best, left = np.inf, budget
        while left > 0:
            options = {"bounds": [0, 1], "maxfevals": left, "verbose": -9, "seed": int(rng.integers(1, 2**31))}
            search = cma.CMAEvolutionStrategy(rng.random(self.box.dimension), 0.3, options)
            while not search.stop() and left > 0:
                points = search.ask()
                costs = self.problem.costs(self.box.from_cube(np.array(points)))
                search.tell(points, np.where(np.isfinite(costs), costs, 1e12).tolist())
                left -= len(points)
                best = min(best, float(np.min(costs)))
        return best


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--more", type=int, default=10, help="times the simulations, in brackets")
    options = parser.parse_args()
    print("| problem | simulations | ours | least squares | differential evolution | CMA-ES |")
    print("|---" * 6 + "|")
    with tempfile.TemporaryDirectory() as folder, Workers(1) as crew:
        for make in tasks(Path(folder)):
            row(crew, make, options.seeds, options.more)


def row(crew: Workers, make: Callable[[int], Task], seeds: int, more: int) -> None:
    """Print one row."""
    reached = {name: [0, 0] for name in ("least squares", "differential evolution", "CMA-ES")}
    ours, budgets = 0, []
    description = describe(make(0).case.fmu)
    for seed in range(seeds):
        contest = Contest(crew, make(seed), seed, description)
        least = contest.known()
        mine = contest.ours()
        costs = {
            "least squares": [contest.least_squares(f * contest.budget) for f in (1, more)],
            "differential evolution": [contest.differential_evolution(f * contest.budget) for f in (1, more)],
            "CMA-ES": [contest.cma(f * contest.budget) for f in (1, more)],
        }
        least = min(least, mine, *(c for pair in costs.values() for c in pair))
        ours += mine < least + WITHIN
        budgets.append(contest.budget)
        for name, pair in costs.items():
            for k, cost in enumerate(pair):
                reached[name][k] += cost < least + WITHIN
    cells = " | ".join(f"{once} ({often})" for once, often in reached.values())
    print(f"| {make(0).title} | {int(np.median(budgets))} | {ours} of {seeds} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
