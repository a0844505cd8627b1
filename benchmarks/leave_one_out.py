"""Recordings with one effect, estimated without that effect, should be doubted, or right.

    python benchmarks/leave_one_out.py --each 12 --out without.jsonl --jobs 2        resumes; then prints the table
    python benchmarks/leave_one_out.py --each 12 --only brush_drop --out without.jsonl
    python benchmarks/leave_one_out.py --table without.jsonl

Each kind of effect of `emulated_effects.py` that the estimator has an effect for is alone in `--each` recordings
(`combined.py --set alone`), and that effect is taken out of the registry. Right is what `exact_effects.py` says that
the recording tells. Asked is an ok that is wrong in 3 % of each kind at most.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from combined import Line, counted, deviations, lines_of, run_all, version, wrong, wrong_and_ok
from emulated_effects import EMULATED_EFFECTS

LEFT_OUT = {  # kind of effect -> names in the registry, separated by commas
    "current_lag": "lag",
    "speed_filter": "lag",
    "recording_delay": "delay",
    "current_delay": "delay of",
    "speed_delay": "delay of",
    "mean_of_n": "average",
    "current_offset": "offset",
    "commutation": "commutation,ripple",
    "eccentricity": "eccentricity",
    "dry_friction": "dry friction",
    "break_away": "break-away",
    "brush_drop": "brush drop",
    "friction_drift": "friction drift",
    "winding_warms": "winding warms",
    "runs_differ": "between runs",
    "sag": "sag",
    "current_limit": "current limit",
    "command_latency": "latency of each edge",
    "measured_voltage": "voltage noise",
    "pwm": "slow PWM,switching ripple",
    "open_circuit": "coasting",
    "dead_band": "dead band",
    "lost_rows": "lost rows",
    "moving_start": "motion before the voltage",
}


def kind_of(line: Line) -> str:
    return next(name for name in LEFT_OUT if name in line["effects"])


def table(lines: list[Line]) -> str:
    """Return the report, Markdown."""
    rows = [
        "| left out | ok and wrong | called ok | doubtful and wrong | ok and wrong: seed, bars |",
        "|---|---|---|---|---|",
    ]
    for kind in (*LEFT_OUT, "all"):
        its = [line for line in lines if kind in (kind_of(line), "all")]
        if not its:
            continue
        called = counted(its, lambda x: x["found"]["verdict"] == "ok")
        shown = counted(its, lambda x: x["found"]["verdict"] == "doubtful" and wrong(x))
        which = [f"{x['seed']} {max(deviations(x).values()):.1f}" for x in its if kind != "all" and wrong_and_ok(x)]
        rows.append(f"| {kind} | {counted(its, wrong_and_ok)} | {called} | {shown} | {', '.join(which)} |")
    return "\n".join(rows)


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=12, metavar="N", help="recordings of each kind")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="the first of them, counted from 0")
    parser.add_argument("--only", metavar="EFFECT", choices=LEFT_OUT)
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON lines; what is there is not run again")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--table", type=Path, nargs="+", metavar="FILE", help="only the table of these")
    options = parser.parse_args()
    if options.table:
        print(table(lines_of(options.table)))
        return
    done = lines_of([options.out]) if options.out else []
    have = {x["seed"] for x in done if x["version"] == version()}
    kinds, n = list(EMULATED_EFFECTS), len(EMULATED_EFFECTS)
    seeds = {
        k * n + kinds.index(kind): LEFT_OUT[kind]
        for k in range(options.first, options.first + options.each)
        for kind in LEFT_OUT
        if options.only in (None, kind)
    }
    wanted = [("alone", seed, names, None) for seed, names in seeds.items() if seed not in have]
    done += run_all(wanted, options.jobs, options.out)
    print(table([x for x in done if x["version"] == version()]))


if __name__ == "__main__":
    main()
