"""The arguments of demo, estimate and check: a recording, and what is said of it. Runs nothing."""

from __future__ import annotations

from typing import Any

from estimator.choices import LOSSES
from estimator.commands.argument_groups import REPEATABLE, add_kind, add_quiet, add_reading, command
from estimator.commands.argument_values import (
    assignment,
    bounds,
    case_file,
    named_text,
    path,
    start,
    temperature,
    text_assignment,
    whole,
    window,
)
from estimator.commands.terminal import PROGRAM
from estimator.method_names import METHODS


def add_demo(commands: Any) -> None:
    """Add the command `demo`."""
    demo = command(
        commands,
        "demo",
        "the paper's motor: recording, estimate, figure",
        """\
Emulate the paper's bench (Mavilor CML-050 through the bundled FMU, a step of 10.5 V, noise), estimate
the motor from that recording, and write recording.csv and all results to a folder.""",
        [f"{PROGRAM} demo", f"{PROGRAM} demo -o my-demo", f"{PROGRAM} demo --paper-figures -o figures"],
        module="demo",
    )
    demo.add_argument(
        "-o",
        dest="output",
        type=path,
        metavar="DIR",
        default="fmu-estimator-demo",
        help="folder (default: %(default)s)",
    )
    demo.add_argument(
        "--paper-figures",
        action="store_true",
        help="draw the paper's figures 3 to 10 instead, as PNG, SVG and PDF; some minutes",
    )
    demo.add_argument("--nests", type=whole(2), metavar="N", help="of the paper's searches (default: its 400)")
    demo.add_argument("--iterations", type=whole(1), metavar="N", help="of the paper's searches (default: its 100)")
    add_quiet(demo)


def add_estimate(commands: Any) -> None:
    """Add the command `estimate`."""
    estimate = command(
        commands,
        "estimate",
        "parameters with error bars from a recording",
        """\
Estimate a motor's parameters from a recording (text with a header such as
time [s],voltage [V],current [A],speed [rad/s]), from several together, or from a case file.
Exit status: 0 an estimate, ok or doubtful; 1 refused or failed; 2 bad input.""",
        [
            f"{PROGRAM} estimate step.csv",
            f"{PROGRAM} estimate up.csv down.csv 'run_*.csv'",
            f"{PROGRAM} estimate step.csv --fix L=0.013 --bounds R=0.1:5 -o result",
            f"{PROGRAM} estimate step.csv --fmu my_motor.fmu",
            f"{PROGRAM} estimate motor.case.toml --method paper --seed 7 --json",
        ],
        module="estimation",
    )
    add = estimate.add_argument
    add(
        "sources",
        type=path,
        nargs="+",
        metavar="CASE.case.toml|RECORDING",
        help="a case file; or recordings, which are fitted together: files, a pattern in quotes, - for stdin",
    )
    add("--fmu", type=path, metavar="FMU", help="an .fmu file or a bundled model's name (default: dc_motor)")
    add_kind(estimate)
    add("--method", choices=METHODS, metavar="METHOD", help=f"one of {', '.join(METHODS)} (default: cuckoo)")
    add(
        "--fix",
        type=assignment,
        metavar="NAME=VALUE",
        help="hold a parameter at a value, in SI units; repeatable",
        **REPEATABLE,
    )
    add(
        "--bounds",
        type=bounds,
        metavar="NAME=LOWER:UPPER",
        help="bounds of a parameter, in SI units; repeatable",
        **REPEATABLE,
    )
    add(
        "--start",
        type=start,
        metavar="NAME=VALUE,…|FILE",
        help="a further start, polished beside the search: values in SI units, or a CSV or result.json; repeatable",
        **REPEATABLE,
    )
    add("--loss", choices=LOSSES, metavar="LOSS", help="linear (default), or huber: outliers pull less")
    add("--window", type=window, metavar="FROM:TO", help="use only the samples between two times, in s")
    for option, what in (("scale", "factor on a channel's samples; -1 turns its sign"), ("offset", "added after it")):
        add(
            f"--{option}",
            type=assignment,
            metavar="NAME=VALUE",
            help=f"{what}, in SI units; NAME is i, w, v, … or a column; repeatable",
            **REPEATABLE,
        )
    add_reading(add)
    add("--temperature", type=temperature, metavar="C", help="of the winding; R is then given at 25 degrees too")
    add(
        "--tolerance",
        type=named_text,
        metavar="SOURCE=SIZE",
        help="what no recording tells, such as 'i gain=1 %%', 'v gain=0.5 %% (k=2)', 'supply resistance=0.05 Ohm',"
        " 'brush drop=0.5 V', 'dry friction=10 %%', 'temperature=5 K', or default; repeatable",
        **REPEATABLE,
    )
    add("--seed", type=whole(0), metavar="N", help="of the random numbers (default: 1); same seed, same result")
    add("--workers", type=whole(1), metavar="N", help="processes that simulate (default: all cores free to use)")
    add(
        "--validate",
        type=path,
        metavar="FILE",
        help="a recording, or a pattern, to compare with, not fitted to; --window does not apply to it; repeatable",
        **REPEATABLE,
    )
    add(
        "--about",
        type=text_assignment("motor='CML-050 No. 3'"),
        metavar="NAME=TEXT",
        help="for the head of the report: motor, operator, date, …; repeatable",
        **REPEATABLE,
    )
    add("--json", action="store_true", help="print one JSON object instead of text")
    add(
        "-o",
        dest="output",
        type=path,
        metavar="DIR",
        help="write result.json, report.html, parameters.ssv, figure.png",
    )
    add(
        "--figures",
        choices=("svg", "pdf"),
        help="write figure.svg or figure.pdf too, with -o; repeatable",
        **REPEATABLE,
    )
    add("--save-case", type=case_file, metavar="OUT.case.toml", help="write all that is said here as a case file")
    add("--signals", action="store_true", help="write signals.npz too, with -o: what was measured and simulated")
    add("--checkpoint", metavar="FILE", help="journal a long search there; killed and started again, it goes on")
    add("--progress-json", metavar="FILE", help="write progress there, one JSON object a line, for a program")
    add_quiet(estimate)


def add_check(commands: Any) -> None:
    """Add the command `check`."""
    check = command(
        commands,
        "check",
        "what is read of a recording, before any FMU",
        """\
Show what is read of recordings: which column is what and in which unit, clock, steps, noise, levels, settled values,
and what of it is implausible. No FMU is loaded. Exit status: 0 read; 2 not, with one sentence why.""",
        [
            f"{PROGRAM} check step.csv",
            f"{PROGRAM} check step.csv --unit w=rpm --scale i=-1",
            f"{PROGRAM} check run_1.csv run_2.csv --json",
            f"{PROGRAM} check step.csv -o preview",
            f"{PROGRAM} check step.csv --unit w=rpm --mend mended.csv",
        ],
        module="checking",
    )
    add = check.add_argument
    add(
        "files", nargs="+", type=path, metavar="FILE", help="a recording, a pattern such as 'run_*.csv', or - for stdin"
    )
    add_reading(add)
    add("--scale", type=assignment, metavar="NAME=VALUE", help="factor, as for estimate", **REPEATABLE)
    add("--offset", type=assignment, metavar="NAME=VALUE", help="added after it, as for estimate", **REPEATABLE)
    add("--fix", type=assignment, metavar="v=VOLTS", help="a voltage that was constant, as for estimate", **REPEATABLE)
    add("--json", action="store_true", help="print one JSON object instead of text")
    add("-o", dest="output", type=path, metavar="DIR", help="write check.json and a figure of each recording")
    add("--mend", type=path, metavar="OUT.csv", help="write what is read as CSV: SI units, one clock, usual headings")
