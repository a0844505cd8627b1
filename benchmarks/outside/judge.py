"""Run an estimator over emulated cases and compare what it says with the truth.

    judge.py TREE CASES_DIR OUT.jsonl A:B [--python FILE] [--only TROUBLE]
        seeds A to B - 1; those in OUT.jsonl are kept; with one trouble alone, or none
    judge.py table OUT.jsonl
    judge.py show OUT.jsonl SEED

A parameter is compared with the apparent truth (see ``emulate.Case``): a sensor's gain of up to 1 %
cannot be told from any recording. Its bar is ``uncertainty`` where that stands, else ``standard_error``.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import emulate
import numpy as np

Row = dict[str, Any]
NAMES = ("R", "K", "L", "J", "B", "Tc")
WRONG = 4.0
TIMEOUT = 200.0


def run(python: Path, tree: Path | None, cases: Path, seed: int, only: str | None) -> Row | None:
    """Write the case, run the estimator on it, and keep what it answered; None: it cannot have that trouble."""
    case = emulate.case(seed, only=only)
    if only not in (None, "none") and not case.troubles:
        return None
    files = emulate.write(case, cases / f"{seed:06d}")
    row: Row = {
        "seed": seed, "story": case.story, "troubles": case.troubles, "untellable": case.untellable,
        "truth": case.truth, "apparent": case.apparent, "excitations": [r.excitation for r in case.recordings],
    }  # fmt: skip
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    if tree:
        env["PYTHONPATH"] = os.pathsep.join([str(tree), str(tree / "src")])
    command = [str(python), "-m", "estimator", "estimate", *(str(f.resolve()) for f in files), "--json", "--quiet"]
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            command, cwd=folder, env=env, text=True, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        try:
            out, err = process.communicate(timeout=TIMEOUT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return row | {
                "verdict": "timeout",
                "seconds": time.monotonic() - begin,
                "parameters": {},
                "reasons": [],
                "notes": [],
            }
    row |= {"seconds": round(time.monotonic() - begin, 3), "exit": process.returncode}
    try:
        answer = json.loads(out)
    except json.JSONDecodeError:
        verdict = "bad input" if process.returncode == 2 else "crash"
        return row | {"verdict": verdict, "parameters": {}, "reasons": [err.strip()[-2000:]], "notes": []}
    keep = ("value", "standard_error", "uncertainty", "status", "at_bound")
    parameters = {n: {k: p[k] for k in keep if k in p} for n, p in (answer.get("parameters") or {}).items()}
    return row | {
        "verdict": answer.get("verdict"), "reasons": answer.get("reasons", []), "notes": answer.get("notes", []),
        "parameters": parameters,
    }  # fmt: skip


def errors(row: Row, truth: str = "apparent") -> dict[str, tuple[float, float | None]]:
    """Return, per identified parameter, the relative error and the error in bars (None without a bar)."""
    found: dict[str, tuple[float, float | None]] = {}
    for name in NAMES:
        p, true = row["parameters"].get(name), row[truth][name]
        if not p or p.get("value") is None or p.get("status") == "not identified":
            continue
        bar = p.get("uncertainty") if p.get("uncertainty") is not None else p.get("standard_error")
        error = p["value"] - true
        found[name] = (error / true if true else float("nan"), error / bar if bar else None)
    return found


def is_wrong(row: Row, truth: str = "apparent") -> bool:
    """Tell whether an ok verdict has a parameter off by more than four bars."""
    return row["verdict"] == "ok" and any(z is not None and abs(z) > WRONG for _, z in errors(row, truth).values())


def coverage(rows: Iterable[Row]) -> tuple[int, int]:
    """Count how many 95 % intervals hold the truth, of how many."""
    z = [z for row in rows for _, z in errors(row).values() if z is not None]
    return sum(abs(x) <= 1.96 for x in z), len(z)


def percent(part: int, whole: int) -> str:
    """Write a share as text."""
    return f"{100 * part / whole:5.1f} %" if whole else "    –  "


def load(path: Path) -> list[Row]:
    """Read the rows of a result file, sorted by seed."""
    if not path.exists():
        return []
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    return sorted(rows, key=lambda r: r["seed"])


def table(rows: list[Row]) -> None:
    """Print the summary."""
    verdicts = sorted({r["verdict"] for r in rows}, key=str)
    ok = [r for r in rows if r["verdict"] == "ok"]
    wrong = [r for r in rows if is_wrong(r)]
    print(f"cases {len(rows)}: " + ", ".join(f"{v} {sum(r['verdict'] == v for r in rows)}" for v in verdicts))
    print(f"ok {percent(len(ok), len(rows))}")
    raw = sum(is_wrong(r, "truth") for r in rows)
    print(
        f"ok and wrong {len(wrong)} of {len(ok)} ({percent(len(wrong), len(ok)).strip()}); "
        f"{raw} where untellable gains count"
    )
    for r in wrong:
        off = ", ".join(
            f"{n} {100 * e:+.2g} % ({z:+.1f})" for n, (e, z) in errors(r).items() if z is not None and abs(z) > WRONG
        )
        print(
            f"  {r['seed']:6d}  {off:44s} {', '.join(f'{n} {x:g}' for n, x in r['troubles'].items()) or 'no trouble'}"
        )
    for verdict in ("ok", "doubtful"):
        print(
            f"95 % intervals, {verdict:9s}",
            "{2} ({0} of {1})".format(*(c := coverage(r for r in rows if r["verdict"] == verdict)), percent(*c)),
        )
    print("\nparameter   median |error|: ok, doubtful; coverage ok, doubtful; not identified")
    for name in NAMES:
        line = f"  {name:3s}"
        shares = []
        for verdict in ("ok", "doubtful"):
            found = [errors(r).get(name) for r in rows if r["verdict"] == verdict]
            size = [abs(f[0]) for f in found if f and f[0] == f[0]]
            line += f"  {100 * statistics.median(size):9.3g} %" if size else "          –  "
            z = [f[1] for f in found if f and f[1] is not None]
            shares.append(percent(sum(abs(x) <= 1.96 for x in z), len(z)))
        missing = sum(r["parameters"].get(name, {}).get("status") == "not identified" for r in rows)
        print(f"{line}   {'  '.join(shares)}   {missing}")
    seconds = [r["seconds"] for r in rows]
    if seconds:
        print(
            f"\nseconds: median {np.median(seconds):.1f}, 90 % {np.quantile(seconds, 0.9):.1f}, "
            f"longest {max(seconds):.1f}"
        )
    print(f"\n{'trouble':20s}   n  ok doubtful refused other  wrong  covered (ok + doubtful)")
    kinds = sorted({n for r in rows for n in r["troubles"]})
    for kind in ["(none)", "(untellable gain)", *kinds]:
        own = {
            "(none)": [r for r in rows if not r["troubles"]],
            "(untellable gain)": [r for r in rows if r["untellable"]],
        }
        these = own.get(kind) or [r for r in rows if kind in r["troubles"]]
        if these:
            counts = [sum(r["verdict"] == v for r in these) for v in ("ok", "doubtful", "refused")]
            held = coverage(r for r in these if r["verdict"] in ("ok", "doubtful"))
            print(
                f"{kind:20s} {len(these):3d} {counts[0]:3d} {counts[1]:8d} {counts[2]:7d} "
                f"{len(these) - sum(counts):5d} {sum(is_wrong(r) for r in these):6d}  {percent(*held)} of {held[1]}"
            )


def show(row: Row) -> None:
    """Print one case in full."""
    print(f"seed {row['seed']}: {row['verdict']}, {row['seconds']:.1f} s\n{row['story']}")
    for name, value in row["untellable"].items():
        print(f"untellable: {name} {value:g}")
    print(f"\n{'':4s}{'truth':>13s}{'apparent':>13s}{'estimate':>13s}{'bar':>11s}{'error':>10s}{'in bars':>9s}  status")
    found = errors(row)
    for name in [*NAMES, *(n for n in row["parameters"] if n not in NAMES)]:
        p = row["parameters"].get(name, {})
        bar = p.get("uncertainty") if p.get("uncertainty") is not None else p.get("standard_error")
        e, z = found.get(name, (None, None))
        number = [row["truth"].get(name), row["apparent"].get(name), p.get("value")]
        print(
            f"{name:4s}" + "".join(f"{x:13.5g}" if x is not None else f"{'–':>13s}" for x in number)
            + (f"{bar:11.3g}" if bar is not None else f"{'–':>11s}")
            + (f"{100 * e:8.2f} %" if e is not None else f"{'–':>10s}")
            + (f"{z:9.1f}" if z is not None else f"{'–':>9s}") + f"  {p.get('status', '')}"
        )  # fmt: skip
    for key in ("troubles", "reasons", "notes"):
        print(f"\n{key}:")
        items = row[key].items() if isinstance(row[key], dict) else row[key]
        for item in items:
            print("  ", f"{item[0]} {item[1]:g}" if isinstance(item, tuple) else item)


def judge(tree: Path, cases: Path, out: Path, seeds: range, python: Path | None, only: str | None) -> None:
    """Run what is not in ``out`` yet, two cases at once."""
    done = {r["seed"] for r in load(out)}
    lock = threading.Lock()
    program = python or tree.resolve() / ".venv/bin/python"
    if not program.exists():
        sys.exit(f"{program} does not exist; name another with --python")
    out.parent.mkdir(parents=True, exist_ok=True)

    def one(seed: int) -> None:
        row = run(program, tree.resolve() if python else None, cases, seed, only)
        if row is None:
            return
        with lock, out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(
            f"{seed} {row['verdict']} {row['seconds']:.1f} s{'  WRONG' if is_wrong(row) else ''}",
            file=sys.stderr,
            flush=True,
        )

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(one, [s for s in seeds if s not in done]))


def main(arguments: list[str]) -> None:
    """Read the command line and do what it says."""
    if arguments[:1] == ["table"] and len(arguments) == 2:
        return table(load(Path(arguments[1])))
    if arguments[:1] == ["show"] and len(arguments) == 3:
        rows = [r for r in load(Path(arguments[1])) if r["seed"] == int(arguments[2])]
        return show(rows[0]) if rows else sys.exit(f"no seed {arguments[2]} in {arguments[1]}")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", type=Path)
    parser.add_argument("cases", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("seeds", help="A:B")
    parser.add_argument("--python", type=Path, help="interpreter, where TREE has no .venv")
    parser.add_argument("--only", metavar="TROUBLE", help='the one trouble of each case; "none": there is none')
    given = parser.parse_args(arguments)
    first, last = (int(x) for x in given.seeds.split(":"))
    judge(given.tree, given.cases, given.out, range(first, last), given.python, given.only)


if __name__ == "__main__":
    main(sys.argv[1:])
