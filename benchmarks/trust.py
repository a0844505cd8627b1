"""How far the numbers can be trusted: every table of docs/trust.md, on emulated benches, over seeds.

    OPENBLAS_NUM_THREADS=1 python benchmarks/trust.py bound      RMS error over the Cramér–Rao bound, by every method
    … coverage   how often 95 % intervals cover the truth, ideal and quantised
    … real       the same with averages, ripple, friction that drifts and a delay
    … named      wrong assumptions put into good recordings, and good ones accused
    … motors     200 random motors: optimum reached, false confidence, aliases
    … robust     delay, offsets, outliers, missing samples, jitter, each alone

    --seeds N     recordings a row; by default those of the docs
    --jobs N      processes
    --out DIR     one line of JSON a recording; those that are there are not estimated again
    --only WORD   rows whose title holds the word
    --print       the tables from what is there, nothing estimated

Recordings come from `paper_bench.py`, estimates from the public API with no settings but a declared filter. The truth
and the bound are the closed form's, never the estimator's own standard errors.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from bound import cramer_rao, from_the_truth, likelihood
from numpy.typing import NDArray
from paper_bench import CML050, MOTORS, NAMES, PAPER_BENCH, Bench, random_motor, real_bench

from estimator.cases.case import Case, Chebyshev1, OutputSpec, SearchSpec
from estimator.estimating.beginning import begin
from estimator.estimating.estimate import METHODS
from estimator.estimating.session import Session
from estimator.fmus.fmu import FmuDescription, describe
from estimator.fmus.probe import driven
from estimator.fmus.workers import Workers
from estimator.plans.planning import plan_case
from estimator.recordings.recording import Recording
from estimator.results.result import Estimate

FloatArray = NDArray[np.float64]
Made = Callable[[int], Bench]

PLAIN = Case(fmu="dc_motor", recordings=(Path("bench.csv"),))
FILTER = (4, 0.5, 100.0)  # Chebyshev I: order, dB, Hz
FILTERED = replace(
    PLAIN,
    inputs={"v": "voltage"},
    outputs={
        "i": OutputSpec("current"),
        "w": OutputSpec("speed", sensor="mean", filter=Chebyshev1(*FILTER)),
    },
)
LINES = (500, 1000, 2000)  # of an encoder
FEW = (4, 16, 100)  # the CML-050 runs at half a count to eleven a sample
REACHED = 0.05  # of −2 ln likelihood above the optimum from the truth
CONFIDENT = 5.0  # standard errors
COVERS = 1.96


@dataclass(frozen=True)
class Row:
    """Recordings of one kind and the method that estimates them; `asked` is what ought to be named in them."""

    title: str
    bench: Made
    case: Case = PLAIN
    method: str = "cuckoo"
    asked: str = ""
    seeds: int | None = None


@dataclass(frozen=True)
class Table:
    """Rows, the seeds of each, and how to print what was found."""

    rows: tuple[Row, ...]
    seeds: int
    show: Callable[[Row, list[dict[str, Any]]], str]
    head: tuple[str, ...]


# What an estimate says, as one line of JSON


def line(
    row: Row, seed: int, bench: Bench, recording: Recording, found: Estimate, fitted: dict[str, float]
) -> dict[str, Any]:
    """Return what is kept of one estimate; `fitted` are its parameters even where they are refused."""
    entry: dict[str, Any] = {
        "row": row.title,
        "seed": seed,
        "verdict": found.verdict,
        "reasons": found.reasons,
        "named": sorted(named(found)),
        "simulations": found.simulations,
        "truth": bench.motor,
        "found": {
            n: (p.value, p.standard_error, p.status) for n, p in {**found.parameters, **found.chain}.items() if p.free
        },
        "rmse": dict(found.rmse),
    }
    if "delay" in found.chain:
        entry["delay"] = bench.delay
    if row.asked == "optimum":
        measured = np.column_stack([recording.signals["current"], recording.signals["speed"]])
        entry["best"] = from_the_truth(bench, measured)[1]
        if set(NAMES) <= set(fitted):
            entry["reached"] = likelihood(bench, np.array([fitted[n] for n in NAMES]), measured)
    return entry


def named(found: Estimate) -> set[str]:
    """Return what an estimate says about its measurement chain and its motor."""
    said = {
        "average": "is a mean over the last",
        "supply sag": "the supply sags",
        "lost samples": "seem to be missing",
        "dry friction": "the motor has a dry friction",
        "gain": "shown with a gain of",
        "channel delay": "ms after the other signals",
        "lag": "is shown through a low-pass",
        "drift": "over the recording; the parameters stand for the mean",
        "ripple": "has a ripple of order",
        "alias": "the motor oscillates at",
        "alias possible": "may be what is lost (aliasing)",
    }
    text = " ".join((*found.reasons, *found.notes))
    names = {name for name, words in said.items() if words in text}
    rivals = " ".join(r for r in found.reasons if "nearly as well" in r)
    names |= {name for name in ("dry friction", "gain", "lag") if name in rivals}
    if "sag" in rivals.split() or "the motor's voltage is too low at first" in text:
        names.add("supply sag")
    if "the transient is lost" in text:
        names.add("lost samples")
    if any(n.startswith("delay ") for n in found.chain):  # of one channel: the recording's has no more words
        names.add("channel delay")
    return names | {n.split()[0] for n in found.chain if n == "delay" or n.split()[0] in ("offset", "gain")}


# The tables


def quantised(motor: dict[str, float], seed: int, of: tuple[int, ...] = LINES, **changes: Any) -> Bench:
    """Return the paper's bench with an encoder of so many lines, by the seed."""
    lines = int(np.random.default_rng([seed, 5]).choice(of))
    return replace(PAPER_BENCH, motor=motor, lines=lines, **changes)


def bound_rows() -> Iterator[Row]:
    """Yield every method on encoder counts and on filtered speed, both motors."""
    for name, motor in MOTORS.items():

        def counts(seed: int, motor: dict[str, float] = motor) -> Bench:
            return replace(PAPER_BENCH, motor=motor, counts=True)

        def speed(seed: int, motor: dict[str, float] = motor) -> Bench:
            return replace(PAPER_BENCH, motor=motor, chebyshev=FILTER)

        yield Row(f"{name}, encoder counts", counts)
        yield Row(f"{name}, filtered speed", speed, FILTERED)
        yield Row(f"{name}, filtered speed, Steiglitz–McBride", speed, method="steiglitz-mcbride")
        yield Row(f"{name}, filtered speed, paper", speed, method="paper", seeds=100)


def coverage_rows() -> Iterator[Row]:
    """Yield ideal and quantised benches of both motors."""
    for name, motor in MOTORS.items():
        yield Row(f"{name}, white noise", lambda s, m=motor: Bench(motor=m))  # type: ignore[misc]
        yield Row(f"{name}, differenced counts", lambda s, m=motor: quantised(m, s))  # type: ignore[misc]
        yield Row(f"{name}, 4 to 100 lines", lambda s, m=motor: quantised(m, s, FEW), seeds=100)  # type: ignore[misc]


def real_rows() -> Iterator[Row]:
    """Yield the real benches of both motors."""
    for name, motor in MOTORS.items():
        yield Row(f"{name}, real bench", lambda s, m=motor: real_bench(s, m))  # type: ignore[misc]


def wrong_rows() -> Iterator[Row]:
    """Yield good recordings and wrong ones."""

    def made(**changes: Callable[[np.random.Generator], Any]) -> Made:
        def bench(seed: int) -> Bench:
            rng = np.random.default_rng([seed, 3])
            return replace(Bench(), **{name: draw(rng) for name, draw in changes.items()})

        return bench

    R, K, B = (CML050[n] for n in ("R", "K", "B"))
    final = 10.5 * K / (R * B + K * K)  # rad/s

    def dry(seed: int) -> Bench:  # the torque at no load stays what it is
        return replace(Bench(), coulomb=0.5 * B * final, motor={**CML050, "B": 0.5 * B})

    yield Row("good", made())
    yield Row("delay 5–250 ms", made(delay=lambda r: r.uniform(0.005, 0.25)), asked="delay")
    yield Row("current averaged over 2–5", made(average=lambda r: int(r.integers(2, 6))), asked="average")
    gain = made(current_gain=lambda r: r.choice([0.9, 1.1]))
    known = replace(PLAIN, fixed={"B": CML050["B"]})
    yield Row("gain of the current 0.9 or 1.1", gain, asked="gain")
    yield Row("gain of the current 0.9 or 1.1, B known", gain, known, asked="gain")
    beside = made(speed_gain=lambda r: r.choice([0.9, 1.1]), beside=lambda r: True)
    yield Row("gain of the speed 0.9 or 1.1, angle logged beside it", beside, asked="gain")
    yield Row("good, angle logged beside the speed", made(beside=lambda r: True))
    yield Row("offset of the current 10 mA", made(current_offset=lambda r: r.choice([-0.01, 0.01])), asked="offset")
    yield Row("supply sags by 5 %, 30 ms", made(sag=lambda r: 0.05), asked="supply sag")
    yield Row("half of the friction dry", dry, asked="dry friction")
    late = made(speed_delay=lambda r: r.uniform(0.5e-3, 3e-3))
    yield Row("speed shown 0.5 to 3 ms late", late, asked="channel delay")
    yield Row("five samples lost", five_lost, asked="lost samples")


def five_lost(seed: int) -> Bench:
    """Return a bench whose logger loses five samples in the transient."""
    return replace(Bench(), clock_loss=(int(np.random.default_rng([seed, 3]).integers(3, 25)), 5))


def five_lost_of_means(seed: int) -> Bench:
    """Return such a bench whose logger takes means of the current, too."""
    return replace(five_lost(seed), average=2 + seed % 4)


def robust_rows() -> Iterator[Row]:
    """Yield one trouble at a time."""

    def drawn(seed: int, **changes: tuple[float, float]) -> Bench:
        rng = np.random.default_rng([seed, 4])
        found: dict[str, Any] = {name: rng.uniform(*ends) for name, ends in changes.items()}
        return replace(Bench(), **found)

    yield Row("delay 0–300 ms", lambda s: drawn(s, delay=(0.0, 0.3)))
    yield Row("offsets ±20 mA, ±1 rad/s", lambda s: drawn(s, current_offset=(-0.02, 0.02), speed_offset=(-1, 1)))
    yield Row("1 % outliers", lambda s: Bench(outliers=0.01))
    yield Row("5 % missing", lambda s: Bench(missing=0.05))
    yield Row("five samples lost", five_lost)
    yield Row("five samples lost, current averaged over 2–5", five_lost_of_means)
    yield Row("clock jitters by 0.05 ms", lambda s: Bench(jitter=5e-5))


# How they are printed


def columns(entries: list[dict[str, Any]]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return truth, values and standard errors, (n, 5), of those with an estimate."""
    good = [e for e in entries if set(NAMES) <= set(e["found"])]
    truth = np.array([[e["truth"][n] for n in NAMES] for e in good])
    values = np.array([[e["found"][n][0] for n in NAMES] for e in good])
    errors = np.array([[e["found"][n][1] or np.nan for n in NAMES] for e in good])
    return truth, values, errors


def over_bound(row: Row, entries: list[dict[str, Any]]) -> str:
    """Return RMS error over the bound, and in percent with its bias."""
    truth, values, _ = columns(entries)
    relative = values / truth - 1
    bound = cramer_rao(row.bench(0))
    rms = np.sqrt(np.mean(relative**2, axis=0))
    cells = [
        f"{r / b:.2f} ({100 * r:.2g} %, bias {100 * m:+.1g} %)"
        for r, b, m in zip(rms, bound, relative.mean(axis=0), strict=True)
    ]
    return " | ".join([f"{len(values)}/{len(entries)}", *cells])


def covered(row: Row, entries: list[dict[str, Any]]) -> str:
    """Return how often intervals cover the truth, RMS and largest error over the standard error, and the verdicts."""
    truth, values, errors = columns(entries)
    z = (values - truth) / errors
    cells = []
    for own in z.T:
        known = own[np.isfinite(own)]
        share, rms = 100 * np.mean(np.abs(known) < COVERS), np.sqrt(np.mean(known**2))
        cells.append(f"{share:.1f} %, {rms:.2f}, {np.max(np.abs(known)):.1f}")
    verdicts = [sum(e["verdict"] == v for e in entries) for v in ("ok", "doubtful", "refused")]
    return " | ".join([str(len(entries)), *cells, " / ".join(map(str, verdicts))])


def told(row: Row, entries: list[dict[str, Any]]) -> str:
    """Return how often what was asked for was named, and what else was said."""
    counts: dict[str, int] = {}
    for e in entries:
        for name in {*e["named"], *([] if e["verdict"] == "ok" else [e["verdict"]])}:
            counts[name] = counts.get(name, 0) + 1
    accused = sum(e["verdict"] != "ok" or bool(e["named"]) for e in entries)
    asked = f"{counts.get(row.asked, 0)}" if row.asked else f"{accused} accused"
    rest = ", ".join(f"{name} {count}" for name, count in sorted(counts.items(), key=lambda c: -c[1]))
    return f"{len(entries)} | {asked} | {rest}"


def trusted(row: Row, entries: list[dict[str, Any]]) -> str:
    """Return what random motors showed."""
    reached = sum(e.get("reached", np.inf) <= e["best"] + REACHED for e in entries)
    false = []
    for e in entries:
        for n in NAMES:
            value, error, status = e["found"].get(n, (0.0, None, ""))
            if status == "ok" and error and abs(value - e["truth"][n]) > CONFIDENT * error:
                false.append(f"{n} of {e['seed']}")
    aliased = [e for e in entries if aliases(e["truth"])]
    said = sum("alias" in e["named"] for e in aliased)
    may = sum("alias possible" in e["named"] for e in aliased)
    refused = [e for e in entries if e["verdict"] == "refused"]
    of_these = sum(e.get("reached", np.inf) <= e["best"] + REACHED for e in refused)
    return (
        f"{len(entries)} | {reached} ({of_these} of {len(refused)} refused) | {', '.join(false) or 'none'} |"
        f" {said} said, {may} said to be possible, of {len(aliased)} | {len(refused)}"
    )


def aliases(motor: dict[str, float], step: float = 1e-3) -> bool:
    """Whether a motor oscillates faster than the samples can show."""
    R, K, L, J, B = (motor[n] for n in NAMES)
    return bool(np.max(np.abs(np.linalg.eigvals([[-R / L, -K / L], [K / J, -B / J]]).imag)) * step > np.pi)


COVERAGE_HEAD = ("seeds", *(f"{n}: covered, rms, largest" for n in NAMES), "ok / doubtful / refused")
TABLES = {
    "bound": Table(tuple(bound_rows()), 1000, over_bound, ("found", *NAMES)),
    "coverage": Table(tuple(coverage_rows()), 4000, covered, COVERAGE_HEAD),
    "real": Table(tuple(real_rows()), 300, covered, COVERAGE_HEAD),
    "named": Table(tuple(wrong_rows()), 100, told, ("recordings", "named", "all that was said")),
    "motors": Table(
        (Row("random motors", lambda s: Bench(motor=random_motor(s)), asked="optimum"),),
        200,
        trusted,
        ("motors", "optimum reached", "ok but > 5 errors off", "aliased", "refused: transient lost"),
    ),
    "robust": Table(tuple(robust_rows()), 200, covered, COVERAGE_HEAD),
}


# Running


class Hand:
    """One process that estimates, with its worker."""

    def __init__(self) -> None:
        self.crew = Workers(1)
        self.description: FmuDescription = driven(describe("dc_motor"))

    def run(self, task: tuple[str, int, int]) -> tuple[str, dict[str, Any]]:
        """Estimate one recording."""
        table, index, seed = task
        row = TABLES[table].rows[index]
        bench = row.bench(seed)
        recording = bench.record(seed)
        case = replace(row.case, search=SearchSpec(method=row.method, seed=seed + 1))
        try:
            plan = plan_case(case, self.description, recordings=[recording])
            session = Session(plan, self.crew, progress=None, bounded=True)
            found = begin(session) or METHODS[session.method](session)
        except BaseException:
            self.crew.close()
            raise
        return table, line(row, seed, bench, recording, found, session.fitted)


_hand: Hand | None = None


def _run(task: tuple[str, int, int]) -> tuple[str, dict[str, Any]]:
    global _hand
    _hand = _hand or Hand()
    return _hand.run(task)


def kept(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a file, without one that was cut short."""
    if not path.exists():
        return []
    whole = [text for text in path.read_text().split("\n") if text.endswith("}")]
    return [json.loads(text) for text in whole]


def estimate_all(tables: list[str], folder: Path, options: argparse.Namespace) -> None:
    """Estimate what is not there yet, and write it down as it comes."""
    tasks = []
    for table in tables:
        done = {(e["row"], e["seed"]) for e in kept(folder / f"{table}.jsonl")}
        for index, row in enumerate(TABLES[table].rows):
            if options.only not in row.title:
                continue
            count = min(options.seeds or TABLES[table].seeds, row.seeds or TABLES[table].seeds)
            tasks += [(table, index, seed) for seed in range(count) if (row.title, seed) not in done]
    with multiprocessing.get_context("spawn").Pool(options.jobs) as pool:
        for table, entry in pool.imap_unordered(_run, tasks):
            with (folder / f"{table}.jsonl").open("a") as file:
                file.write(json.dumps(entry) + "\n")


def show(table: str, folder: Path, *, only: str, seeds: int | None) -> None:
    """Print one table."""
    entries = kept(folder / f"{table}.jsonl")
    print(f"\n| {table} | {' | '.join(TABLES[table].head)} |")
    print("|---" * (1 + len(TABLES[table].head)) + "|")
    for row in TABLES[table].rows:
        own = [e for e in entries if e["row"] == row.title and only in row.title and (not seeds or e["seed"] < seeds)]
        if own:
            print(f"| {row.title} | {TABLES[table].show(row, sorted(own, key=lambda e: e['seed']))} |")


def main() -> None:
    """Estimate, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", choices=[*TABLES, []], default=[])
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/trust"))
    parser.add_argument("--only", default="")
    parser.add_argument("--print", action="store_true", dest="printing")
    options = parser.parse_args()
    tables = options.tables or list(TABLES)
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.printing:
        estimate_all(tables, options.out, options)
    for table in tables:
        show(table, options.out, only=options.only, seeds=options.seeds)


if __name__ == "__main__":
    main()
