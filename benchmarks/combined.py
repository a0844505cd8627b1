"""Second bench: random motors with several effects at once, judged through the public door. Knows no effect by name.

    python benchmarks/combined.py --seeds 0:60 --out dev.jsonl --jobs 2         resumes; then prints the table
    python benchmarks/combined.py --seeds 0:1000 --out dev.jsonl --only dry_friction
    python benchmarks/combined.py --set good --seeds 0:100 --out good.jsonl     also: lag, machine, alone
    python benchmarks/combined.py --seeds 0:1000 --only current_lag --without-effect NAME --out without.jsonl
    python benchmarks/combined.py --table dev.jsonl good.jsonl

Each recording is written to a file and given to `python -m estimator estimate --json`, several of one motor by a case
file; one worker, seed 1, 120 s of processor time. Right is what `exact_effects.py` says the recording tells.
`--reference FILE` takes that from the lines of an earlier run.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from emulated_bench import MOTOR, Bench, write
from emulated_effects import EMULATED_EFFECTS, draw
from exact_effects import ExactEffects

TIME_LIMIT = 120.0  # s of processor time; ten times as long by the clock
WRONG = 4.0  # standard errors
JUDGED = 0.3  # a bar that no fit can have below this share of the value is not compared
FINAL = 1_000_000  # seeds from here on are looked at once, at the end
LAGS = (0.3, 1.0, 2.0, 5.0)  # samples
LAG_EXCITATIONS = ("step", "two levels", "zero", "reversal")
MACHINE = {  # effect → words, one of which names it
    "dry_friction": ("dry", "coulomb", "friction"),
    "brush_drop": ("brush",),
    "current_limit": ("limit",),
    "sag": ("sag", "supply", "source"),
}
SETS = ("random", "good", "lag", "machine", "alone")
Line = dict[str, Any]


def bench_of(kind: str, seed: int) -> Bench:
    """Return the bench of a set and a seed."""
    if kind == "good":
        return draw(seed, effects=(), excitation=("step", "two levels", "zero", "reversal", "staircase")[seed % 5])
    if kind == "lag":
        lag, excitation = LAGS[seed % 4], LAG_EXCITATIONS[seed // 4 % 4]
        return draw(seed, effects=("current_lag",), excitation=excitation, sizes={"tau_i": lag})
    if kind == "machine":
        return draw(seed, effects=(list(MACHINE)[seed % 4],), excitation=LAG_EXCITATIONS[1 + seed // 4 % 3])
    if kind == "alone":
        return alone(list(EMULATED_EFFECTS)[seed % len(EMULATED_EFFECTS)], seed)
    return draw(seed)


def alone(effect: str, seed: int) -> Bench:
    """Return a bench with one effect, in an excitation that has it; of runs that differ there are several."""
    if effect == "runs_differ":
        return next(b for k in range(1000) if len((b := draw(1000 * seed + k, effects=(effect,))).recordings) > 1)
    fit = {"open_circuit": ("coasting", "zero"), "command_latency": LAG_EXCITATIONS}
    some = fit.get(effect, (*LAG_EXCITATIONS, "staircase", "prbs"))
    return draw(seed, effects=(effect,), excitation=some[seed // len(EMULATED_EFFECTS) % len(some)])


@functools.cache
def version() -> str:
    """Return what the reference depends on: these files' digest."""
    here = Path(__file__).parent
    names = ("emulated_motor.c", "emulated_bench.py", "emulated_effects.py", "exact_effects.py")
    return hashlib.sha256(b"".join((here / name).read_bytes() for name in names)).hexdigest()[:12]


def source_of(paths: list[Path]) -> Path:
    """Return what is estimated: the recording, or a case file of several."""
    if len(paths) == 1:
        return paths[0]
    case = paths[0].with_name("motor.case.toml")
    case.write_text(
        '[fmu]\npath = "dc_motor"\n\n[inputs]\nv = "voltage [V]"\n\n[outputs]\n'
        'i = "current [A]"\nw = "speed [rad/s]"\n'
        + "".join(f'\n[[recording]]\nfile = "{path.name}"\n' for path in paths)
    )
    return case


def used(pid: int) -> float:
    """Return the processor time of a process and what it started, s: a busy machine makes nobody slow."""
    total = 0.0
    with contextlib.suppress(psutil.NoSuchProcess):
        root = psutil.Process(pid)
        for process in (root, *root.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                total += sum(process.cpu_times()[:4])
    return total


def estimated(paths: list[Path], without: str | None) -> Line:
    """Return the command line's JSON object; its verdict is "timeout" or "failed" where there is none."""
    arguments = [sys.executable, "-m", "estimator", "estimate", str(source_of(paths))]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    if without:
        environment["FMU_ESTIMATOR_WITHOUT"] = without
    process = subprocess.Popen(
        [*arguments, "--json", "--workers", "1", "--seed", "1"], env=environment, text=True, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    began = time.perf_counter()
    while True:
        try:
            out, err = process.communicate(timeout=1.0)
            break
        except subprocess.TimeoutExpired:
            if used(process.pid) > TIME_LIMIT or time.perf_counter() - began > 10.0 * TIME_LIMIT:
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()
                return {"verdict": "timeout"}
    try:
        found = json.loads(out)
    except ValueError:
        return {"verdict": "failed", "reasons": [err.strip()[-500:]]}
    return dict(found)


def run(kind: str, seed: int, without: str | None, reference: Line | None) -> Line:
    """Return one line: what the bench is, what its recordings tell, what was estimated."""
    bench = bench_of(kind, seed)
    line: Line = {
        "set": kind, "seed": seed, "without": without, "version": version(), "effects": list(bench.effects),
        "excitations": [r.excitation for r in bench.recordings], "h": bench.recordings[0].h,
        "rows": [r.rows for r in bench.recordings],
        "story": {f"{name}{'' if k < 0 else f' {k + 1}'}": value for (name, k), value in bench.story.items()},
    }  # fmt: skip
    began = time.perf_counter()
    line["told"] = reference or asdict(ExactEffects(bench).tell())
    line["told_seconds"] = round(time.perf_counter() - began, 3)
    with tempfile.TemporaryDirectory() as folder:
        paths = write(bench, Path(folder))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = estimated(paths, without)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    line["seconds"] = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 3)  # of processors
    kept = ("verdict", "reasons", "notes", "parameters", "measurement_chain", "comparisons", "rivals", "effects")
    line["found"] = {key: found[key] for key in kept if key in found}
    for p in line["found"].get("parameters", {}).values():
        for key in set(p) - {"value", "standard_error", "uncertainty", "status"}:
            del p[key]
    return line


def run_all(
    wanted: Iterable[tuple[str, int, str | None, Line | None]], jobs: int | None, out: Path | None
) -> Iterator[Line]:
    """Run what is wanted, in so many processes; yield each line as it comes, tell it, and add it to a file."""
    with ProcessPoolExecutor(jobs) as pool:
        for job in as_completed([pool.submit(run, *own) for own in wanted]):
            line = job.result()
            if out:
                with out.open("a") as stream:
                    stream.write(json.dumps(line) + "\n")
            z = max(deviations(line).values(), default=float("nan"))
            print(f"{line['set']} {line['seed']} {line['found']['verdict']} z {z:.1f} {line['seconds']:.1f} s "
                  f"{'+'.join(line['excitations'])}: {', '.join(line['effects'])}", file=sys.stderr)  # fmt: skip
            yield line


def bar_of(parameter: Mapping[str, Any]) -> float | None:
    """Return the whole uncertainty where it is told, else the standard error; None: nothing is claimed."""
    if parameter.get("status") == "not identified":
        return None
    bar = parameter.get("uncertainty", parameter.get("standard_error"))
    return float(bar) if bar else None


def deviations(line: Line) -> dict[str, float]:
    """Return each parameter's error over its bar, by the truth or by the motor that cannot be told from it."""
    told, found = line["told"], line["found"].get("parameters", {})
    bars = {name: bar for name in MOTOR if name in found and (bar := bar_of(found[name])) is not None}
    by_truth: dict[str, float] = {}
    by_alike: dict[str, float] = {}
    for name, bar in bars.items():
        value = found[name]["value"]
        for by, motor in ((by_truth, "truth"), (by_alike, "alike")):
            same = told[motor][name] / told["truth"][name]  # a parameter that changes does so in both motors
            low, high = (same * told[end][name] for end in ("lower", "upper"))
            by[name] = max(low - value, value - high, 0.0) / bar
    return min(by_truth, by_alike, key=lambda z: max(z.values(), default=0.0))


def named(line: Line) -> bool:
    """Return whether what is said of the recording names the effect; what it could not show does not count."""
    found = line["found"]
    said = [*found.get("reasons", ()), *(n for n in found.get("notes", ()) if "not visible" not in n)]
    said += [json.dumps(found.get(key, "")) for key in ("measurement_chain", "comparisons", "rivals", "effects")]
    text = " ".join(said).lower()
    return any(word in text for word in MACHINE[line["effects"][0]])


def wilson(k: int, n: int) -> str:
    """Return a share with its 95 % interval (Wilson 1927)."""
    if not n:
        return "–"
    z, p = 1.96, k / n
    centre, half = (p + z * z / 2 / n), z * np.sqrt(p * (1 - p) / n + z * z / 4 / n / n)
    low, high = (centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)
    return f"{100 * p:.1f} % ({k} of {n}; {100 * max(low, 0):.1f}–{100 * min(high, 1):.1f})"


def wrong(line: Line) -> bool:
    return max(deviations(line).values(), default=0.0) > WRONG


def wrong_and_ok(line: Line) -> bool:
    return bool(line["found"]["verdict"] == "ok" and wrong(line))


def counted(lines: Iterable[Line], what: Any) -> str:
    lines = list(lines)
    return wilson(sum(bool(what(line)) for line in lines), len(lines))


def rows_of(kind: str, lines: list[Line]) -> Iterator[tuple[str, str]]:
    """Yield figure and value, for the lines of one set."""
    verdicts = {v: [x for x in lines if x["found"]["verdict"] == v] for v in ("ok", "doubtful", "refused")}
    yield "recordings", str(len(lines))
    yield "ok, an error above 4 standard errors, of all", counted(lines, wrong_and_ok)
    for verdict in ("ok", "doubtful"):
        z = [z for line in verdicts[verdict] for z in deviations(line).values()]
        yield f"95 % intervals cover, {verdict}", wilson(sum(value < 1.96 for value in z), len(z))
    for verdict, some in verdicts.items():
        yield f"called {verdict}", wilson(len(some), len(lines))
    for verdict in ("timeout", "failed"):
        yield verdict, counted(lines, lambda line, v=verdict: line["found"]["verdict"] == v)
    for verdict in ("ok", "doubtful"):
        ratios = [
            bar / line["told"]["bar"][name]
            for line in verdicts[verdict] for name in MOTOR
            if (bar := bar_of(line["found"]["parameters"].get(name, {}))) is not None
            and line["told"]["bar"][name] < JUDGED * line["told"]["truth"][name]
        ]  # fmt: skip
        spread = (
            "{:.2f} ({:.2f}–{:.2f} are the middle half)".format(*np.quantile(ratios, [0.5, 0.25, 0.75]))
            if ratios
            else "–"
        )
        yield f"bar over that of the true story, {verdict}", spread
    seconds = [line["seconds"] for line in lines]
    yield (
        "s of processor time an estimate, median, 90 %, longest",
        "{:.1f}, {:.1f}, {:.1f}".format(*np.quantile(seconds, [0.5, 0.9, 1.0])),
    )
    z = [
        abs(t["value"][n] - t["alike"][n]) / t["bar"][n]
        for line in lines
        for n in MOTOR
        if (t := line["told"])["bar"][n]
    ]
    yield "the true story's own 95 % intervals cover", wilson(sum(value < 1.96 for value in z), len(z))
    if kind == "good":
        yield "good, wrongly doubted or refused", counted(lines, lambda line: line["found"]["verdict"] != "ok")
    if kind == "machine":
        for k, name in enumerate(MACHINE):
            some = [line for line in lines if line["seed"] % 4 == k]
            yield f"{name}: named or right", counted(some, lambda line: named(line) or right(line))
        yield "named or right", counted(lines, lambda line: named(line) or right(line))
        yield "named", counted(lines, named)
    if kind == "lag":
        for lag in LAGS:
            some = [line for line in lines if LAGS[line["seed"] % 4] == lag]
            yield f"lag of {lag} samples: ok and wrong", counted(some, wrong_and_ok)
        for excitation in LAG_EXCITATIONS:
            some = [line for line in lines if line["excitations"] == [excitation]]
            yield f"lag, {excitation}: ok and wrong", counted(some, wrong_and_ok)


def right(line: Line) -> bool:
    return line["found"]["verdict"] in ("ok", "doubtful") and not wrong(line)


def table(lines: list[Line]) -> str:
    """Return the report, Markdown."""
    parts = []
    for kind in SETS:
        some = [line for line in lines if line["set"] == kind]
        if not some:
            continue
        parts += [f"## {kind}", "", "| figure | value |", "|---|---|"]
        parts += [f"| {figure} | {value} |" for figure, value in rows_of(kind, some)] + [""]
        if kind == "random":
            parts += ["| effect | ok and wrong | called ok | cannot be told |", "|---|---|---|---|"]
            for name in ("none", *sorted({name for line in some for name in line["effects"]})):
                its = [line for line in some if name in (line["effects"] or ["none"])]
                called = counted(its, lambda x: x["found"]["verdict"] == "ok")
                untold = counted(its, lambda x, n=name: n in x["told"]["untold"])
                parts += [f"| {name} | {counted(its, wrong_and_ok)} | {called} | {untold} |"]
            parts += ["", "ok and wrong: seeds " + ", ".join(str(x["seed"]) for x in some if wrong_and_ok(x)), ""]
    return "\n".join(parts)


def lines_of(paths: Iterable[Path]) -> list[Line]:
    return [json.loads(text) for path in paths if path.exists() for text in path.read_text().splitlines()]


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=SETS, default="random")
    parser.add_argument("--seeds", default="0:60", metavar="A:B")
    parser.add_argument("--only", metavar="EFFECT", help="recordings that have this effect")
    parser.add_argument("--without-effect", metavar="NAME", help="FMU_ESTIMATOR_WITHOUT=NAME for the estimator")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="JSON lines, one a seed; what is there is not run again"
    )
    parser.add_argument("--reference", type=Path, metavar="FILE", help="an earlier --out: the true story's fits")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--final", action="store_true", help=f"seeds from {FINAL} on: once, at the end")
    parser.add_argument("--table", type=Path, nargs="+", metavar="FILE", help="only the table of these")
    options = parser.parse_args()
    if options.table:
        print(table(lines_of(options.table)))
        return
    first, last = map(int, options.seeds.split(":"))
    if last > FINAL and not options.final:
        parser.error(f"--seeds: those from {FINAL} on are kept unseen for the end; --final runs them")
    done = lines_of([options.out]) if options.out else []
    have = {(x["set"], x["seed"], x["without"], x["version"]) for x in done}
    known = {(x["set"], x["seed"]): x["told"] for x in lines_of([options.reference] if options.reference else [])
             if x["version"] == version()}  # fmt: skip
    seeds = [s for s in range(first, last) if (options.set, s, options.without_effect, version()) not in have]
    if options.only:
        seeds = [s for s in seeds if options.only in bench_of(options.set, s).effects]
    wanted = [(options.set, s, options.without_effect, known.get((options.set, s))) for s in seeds]
    done += run_all(wanted, options.jobs, options.out)
    print(table([x for x in done if x["version"] == version()]))


if __name__ == "__main__":
    main()
