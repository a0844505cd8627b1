"""The arguments of batch, compare, export, app, schema and completion: what many cases came to. Runs nothing."""

from __future__ import annotations

from typing import Any

from estimator.commands.argument_groups import REPEATABLE, add_quiet, command
from estimator.commands.argument_values import path, percentage, positive, share, whole
from estimator.commands.terminal import PROGRAM

SHELLS = ("bash", "zsh", "fish", "tcsh")  # of shtab
FORMATS = ("csv", "ssv", "ssp", "fmu", "matlab", "modelica", "state-space")  # as in handover_files.py


def add_batch(commands: Any) -> None:
    """Add the command `batch`."""
    batch = command(
        commands,
        "batch",
        "many cases: a folder of motors, unattended",
        """\
Estimate many cases, one a core, each on disk as soon as it is done; then one table of all.
A case is a case file, all those in a folder, or a recording. Exit status: 0 all estimated; 1 some
refused or failed, or stopped by a full disk; 2 bad usage. With --watch it goes on until Ctrl-C (status 0), and again
where it stood when it is started again.""",
        [
            f"{PROGRAM} batch line.case.toml -o monday",
            f"{PROGRAM} batch line.case.toml --watch logger/ -o line --then ./tell-the-plc",
            f"{PROGRAM} batch line.case.toml -o monday --resume",
            f"{PROGRAM} batch cases/ --dask tcp://10.0.0.5:8786 -o study",
        ],
        module="batch",
    )
    add = batch.add_argument
    add("sources", metavar="CASE", nargs="*", help="a case file, a folder with case files, or a recording")
    add("-o", dest="output", metavar="DIR", default="fmu-estimator-batch", help="folder (default: %(default)s)")
    add("--resume", action="store_true", help="go on with the batch in the folder: run only what is missing")
    add("--dask", metavar="ADDRESS", help="of a Dask scheduler, such as tcp://10.0.0.5:8786 (extra: cluster)")
    add("--workers", type=whole(1), metavar="N", help="cases at a time on this machine (default: all cores)")
    many = batch.add_mutually_exclusive_group()
    for kind, how in (("monte-carlo", "white noise"), ("bootstrap", "its own residuals")):
        many.add_argument(
            f"--{kind}", type=whole(2), metavar="N", help=f"instead, each case N times: its best fit with {how}"
        )
    add(
        "--watch",
        metavar="FOLDER",
        help="estimate what appears there, as the case files say, or each recording by itself; nothing is moved",
    )
    add(
        "--settled",
        type=positive,
        metavar="S",
        help="with --watch: a file counts once it has not changed for so long (default: 2)",
    )
    add(
        "--then",
        metavar="COMMAND",
        help="with --watch: run it for every verdict, with the case as JSON on its stdin and 0 or 1, passed or not, in"
        " FMU_ESTIMATOR_STATUS",
    )
    add("--report", action="store_true", help="write report.html and figure.png of every case too, some 0.1 s a case")
    add(
        "--report-of",
        metavar="CASE",
        help="such a report of this case only; with --resume, later; repeatable",
        **REPEATABLE,
    )
    add("--parquet", action="store_true", help="write results.parquet too (extra: parquet)")
    add_quiet(batch)


def add_compare(commands: Any) -> None:
    """Add the command `compare`."""
    compare = command(
        commands,
        "compare",
        "what changed between results: motors, days, methods",
        """\
Compare results of estimate -o with the first of them: differences with their standard errors, a
threshold with a stated false alarm rate, repeatability of three results and more.
Exit status: 0 nothing differs; 1 something does; 2 bad usage, or nothing that could be compared.""",
        [
            f"{PROGRAM} compare monday friday",
            f"{PROGRAM} compare reference/result.json motors/*/result.json --within 2 -o changes",
        ],
    )
    add = compare.add_argument
    add("results", type=path, metavar="RESULT", nargs="+", help="folder or result.json of estimate -o, two or more")
    add(
        "--false-alarm",
        type=share,
        metavar="RATE",
        default=0.01,
        help="probability that anything is said to differ where nothing does (default: %(default)s)",
    )
    add(
        "--within",
        type=percentage,
        metavar="PERCENT",
        default=0.0,
        help="what differs by no more than so much of the first result's value is alike (default: 0)",
    )
    add("--json", action="store_true", help="print one JSON object instead of text")
    add("-o", dest="output", type=path, metavar="DIR", help="write compare.html, compare.svg, compare.json")


def add_export(commands: Any) -> None:
    """Add the command `export`."""
    export = command(
        commands,
        "export",
        "an estimate → files for other tools",
        """\
Write what another tool reads, from the folder (or the result.json) that estimate -o wrote: parameters.csv,
parameters.ssv, an .ssp with the FMU and its parameters, the FMU built again with the estimates as start values,
a MATLAB script, a Modelica modifier, and a motor's state space.""",
        [
            f"{PROGRAM} export result",
            f"{PROGRAM} export result --format ssp --format matlab -o handover",
        ],
    )
    add = export.add_argument
    add("result", type=path, metavar="DIR|RESULT.json", help="what estimate -o wrote")
    add(
        "--format",
        dest="formats",
        choices=FORMATS,
        metavar="FORMAT",
        help=f"one of {', '.join(FORMATS)}; repeatable (default: all that the FMU allows)",
        **REPEATABLE,
    )
    add("--fmu", type=path, metavar="FMU", help="the FMU, if it has moved since")
    add("-o", dest="output", type=path, metavar="DIR", help="folder (default: that of the result)")


def add_app(commands: Any) -> None:
    """Add the command `app`."""
    app = command(
        commands,
        "app",
        "the bench in a browser: see, choose, estimate live",
        """\
Serve a page to this machine's browser: choose or drop recordings, see them, say what is what, estimate live, look at
results. Files stay in the folder; what the page does is a case file there and a command, which it shows.
It listens on 127.0.0.1 only, at an address that nobody can guess, until Ctrl-C (extra: app).""",
        [f"{PROGRAM} app", f"{PROGRAM} app bench/monday --port 8765 --no-browser"],
    )
    add = app.add_argument
    add("folder", nargs="?", type=path, default=".", metavar="FOLDER", help="to work in (default: this one)")
    add("--port", type=whole(0), default=0, metavar="N", help="to listen on (default: any that is free)")
    add("--no-browser", action="store_true", help="print the address, open no browser")


def add_schema(commands: Any) -> None:
    """Add the command `schema`."""
    schema = command(
        commands,
        "schema",
        "the JSON Schema of case files, for editors",
        "Print the JSON Schema of case files, with which an editor completes and checks them.",
        [f"{PROGRAM} schema -o case.schema.json"],
    )
    schema.add_argument("-o", dest="output", metavar="OUT.json", help="write there instead of to the terminal")


def add_completion(commands: Any) -> None:
    """Add the command `completion`."""
    completion = command(
        commands,
        "completion",
        "completion of this command line in a shell",
        "Print a script that lets a shell complete commands and options.",
        [
            f'eval "$({PROGRAM} completion bash)"',
            f"{PROGRAM} completion fish > ~/.config/fish/completions/{PROGRAM}.fish",
        ],
    )
    completion.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"one of {', '.join(SHELLS)}")
