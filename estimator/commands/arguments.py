"""The arguments of the command line: commands, options, and how their values are read. Runs nothing.

Nothing heavy is imported here: ``--help`` and ``--version`` answer at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NoReturn

from estimator.commands.argument_values import (
    assignment,
    bounds,
    case_file,
    fmi,
    level_at,
    metres,
    named_text,
    names,
    path,
    percentage,
    positive,
    said,
    share,
    start,
    temperature,
    text_assignment,
    whole,
    window,
)
from estimator.commands.terminal import BAD_INPUT, OK, PROGRAM, say
from estimator.method_names import METHODS
from estimator.version import version

SHELLS = ("bash", "zsh", "fish", "tcsh")  # of shtab
FORMATS = ("csv", "ssv", "ssp", "fmu", "matlab", "modelica", "state-space")  # as in handover_files.py
KINDS = ("co-simulation", "model-exchange")  # as in fmu.py
LOSSES = ("linear", "huber")  # as in case.py
RECORDINGS = (".csv", ".txt", ".tsv", ".dat", ".mat", ".parquet", ".mf4", ".xlsx", ".tdms", ".case.toml")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the parsed arguments; leave with SystemExit after ``--help``, ``--version`` or a complaint.

    ``run`` of the result is the command: it takes the result and returns an exit status.
    """
    joined = _joined(arguments)
    parser = command_line()
    _check_words(parser, joined)
    args, left = parser.parse_known_args(joined)
    if args.command == "estimate":  # recordings may stand on both sides of an option
        args.sources += [word for word in left if not word.startswith("-")]
        left = [word for word in left if word.startswith("-")]
    if left:
        parser.error(f"unrecognized arguments: {' '.join(left)}")
    return args


class _Parser(argparse.ArgumentParser):
    """A parser that complains in one sentence."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the usage and leave with status 2."""
        remedy = "" if "; " in message else f"; see {self.prog} --help"
        self.exit(BAD_INPUT, f"{self.prog}: {message}{remedy}\n")

    @property
    def flags(self) -> tuple[str, ...]:
        """The options that it knows, as they are written."""
        return tuple(self._option_string_actions)


def command_line() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = _Parser(
        prog=PROGRAM,
        description="Motor parameters with error bars from a recording, by co-simulation of an FMU.",
        epilog=f"""examples:
  {PROGRAM} demo
  {PROGRAM} estimate step.csv -o result
  {PROGRAM} estimate motor.case.toml --json
  {PROGRAM} COMMAND --help""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, help="print the version and leave")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    for add in (
        _add_demo,
        _add_estimate,
        _add_simulate,
        _add_inspect,
        _add_check,
        _add_init,
        _add_build,
        _add_new_model,
        _add_batch,
        _add_compare,
        _add_export,
        _add_app,
        _add_schema,
        _add_completion,
    ):
        add(commands)
    parser.set_defaults(flags={"": parser.flags, **{name: own.flags for name, own in commands.choices.items()}})
    return parser


def _add_demo(commands: Any) -> None:
    demo = _command(
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
    _add_quiet(demo)


def _add_estimate(commands: Any) -> None:
    estimate = _command(
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
    _add_kind(estimate)
    add("--method", choices=METHODS, metavar="METHOD", help=f"one of {', '.join(METHODS)} (default: cuckoo)")
    add(
        "--fix",
        type=assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="hold a parameter at a value, in SI units; repeatable",
    )
    add(
        "--bounds",
        type=bounds,
        action="append",
        default=[],
        metavar="NAME=LOWER:UPPER",
        help="bounds of a parameter, in SI units; repeatable",
    )
    add(
        "--start",
        type=start,
        action="append",
        default=[],
        metavar="NAME=VALUE,…|FILE",
        help="a further start, polished beside the search: values in SI units, or a CSV or result.json; repeatable",
    )
    add("--loss", choices=LOSSES, metavar="LOSS", help="linear (default), or huber: outliers pull less")
    add("--window", type=window, metavar="FROM:TO", help="use only the samples between two times, in s")
    for option, what in (("scale", "factor on a channel's samples; -1 turns its sign"), ("offset", "added after it")):
        add(
            f"--{option}",
            type=assignment,
            action="append",
            default=[],
            metavar="NAME=VALUE",
            help=f"{what}, in SI units; NAME is i, w, v, … or a column; repeatable",
        )
    _add_reading(add)
    add("--temperature", type=temperature, metavar="C", help="of the winding; R is then given at 25 degrees too")
    add(
        "--tolerance",
        type=named_text,
        action="append",
        default=[],
        metavar="SOURCE=SIZE",
        help="what no recording tells, such as 'i gain=1 %%', 'v gain=0.5 %% (k=2)', 'supply resistance=0.05 Ohm',"
        " 'brush drop=0.5 V', 'dry friction=10 %%', 'temperature=5 K', or default; repeatable",
    )
    add("--seed", type=whole(0), metavar="N", help="of the random numbers (default: 1); same seed, same result")
    add("--workers", type=whole(1), metavar="N", help="processes that simulate (default: all cores free to use)")
    add(
        "--validate",
        type=path,
        action="append",
        default=[],
        metavar="FILE",
        help="a recording to compare with, not fitted to; repeatable",
    )
    add(
        "--about",
        type=said,
        action="append",
        default=[],
        metavar="NAME=TEXT",
        help="for the head of the report: motor, operator, date, …; repeatable",
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
        action="append",
        default=[],
        choices=("svg", "pdf"),
        help="write figure.svg or figure.pdf too, with -o; repeatable",
    )
    add("--save-case", type=case_file, metavar="OUT.case.toml", help="write all that is said here as a case file")
    add("--signals", action="store_true", help="write signals.npz too, with -o: what was measured and simulated")
    add("--checkpoint", metavar="FILE", help="journal a long search there; killed and started again, it goes on")
    add("--progress-json", metavar="FILE", help="write progress there, one JSON object a line, for a program")
    _add_quiet(estimate)


def _add_reading(add: Callable[..., Any]) -> None:
    """Add the options that say how a file is to be read; they win over its header."""
    add(
        "--column",
        type=text_assignment,
        action="append",
        default=[],
        metavar="SIGNAL=COLUMN",
        help="which column is v, i, w, angle or load; repeatable",
    )
    add(
        "--unit",
        type=text_assignment,
        action="append",
        default=[],
        metavar="NAME=UNIT",
        help="unit of a column, or of v, i, w, …, time: --unit w=rpm --unit time=ms; repeatable",
    )
    add("--test", metavar="NAME", help="which test, of a file that holds several (default: all, fitted together)")
    add("--motor", metavar="NAME", help="which motor, of a file that holds several: left, right, 1, …")
    add("--supply", metavar="VOLTS", help="of a duty cycle: 12, 12/255 (volts a count), or the column of the battery")
    add("--counts", type=positive, metavar="N", help="of an encoder a turn, of a column of counts")
    add("--per-turn", type=metres, metavar="M", help="metres that a turn goes, of a column in m/s or m: 0.16 or 0.16m")
    add("--rate", type=positive, metavar="HZ", help="of the samples of a file that has no time")


def _add_check(commands: Any) -> None:
    check = _command(
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
        ],
        module="checking",
    )
    add = check.add_argument
    add(
        "files", nargs="+", type=path, metavar="FILE", help="a recording, a pattern such as 'run_*.csv', or - for stdin"
    )
    _add_reading(add)
    add("--scale", type=assignment, action="append", default=[], metavar="NAME=VALUE", help="factor, as for estimate")
    add("--json", action="store_true", help="print one JSON object instead of text")
    add("-o", dest="output", type=path, metavar="DIR", help="write check.json and a figure of each recording")


def _add_simulate(commands: Any) -> None:
    simulate = _command(
        commands,
        "simulate",
        "one simulation of an FMU, as a recording",
        """\
Simulate an FMU and print what comes out as CSV, which estimate reads back. Values are in SI units.
Exit status: 0 simulated; 2 bad input, or the FMU fails.""",
        [
            f"{PROGRAM} simulate dc_motor --set R=1.2 --voltage-step 10.5@0.5 -o step.csv",
            f"{PROGRAM} simulate my_motor.fmu --input drive.csv --step 1e-4",
        ],
        module="simulation",
    )
    add = simulate.add_argument
    add("fmu", type=path, metavar="FMU", help="an .fmu file or a bundled model's name")
    add(
        "--set",
        dest="settings",
        type=assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set a parameter, or hold an input; repeatable",
    )
    _add_kind(simulate)
    drive = simulate.add_mutually_exclusive_group()
    drive.add_argument(
        "--voltage-step", type=level_at, metavar="V@T", help="voltage input: 0 V, then V volts from T seconds on"
    )
    drive.add_argument("--input", type=path, metavar="FILE", help="a recording with a column for each input")
    add("--stop", type=positive, metavar="S", help="last instant, in s (default: 2.8)")
    add("--step", type=positive, metavar="S", help="communication step, in s (default: 1e-3)")
    add("-o", dest="output", type=path, metavar="OUT.csv", help="write there instead of to the terminal")


def _add_inspect(commands: Any) -> None:
    inspect = _command(
        commands,
        "inspect",
        "what an FMU is and what can be estimated",
        """\
Show what an FMU is, what can be estimated in it, and what would go wrong; run it in a process of its own
to see whether it repeats itself, can be reset, and honours its parameters and its step.""",
        [f"{PROGRAM} inspect dc_motor", f"{PROGRAM} inspect my_motor.fmu --json"],
    )
    inspect.add_argument("fmu", type=path, metavar="FMU", help="an .fmu file or a bundled model's name")
    _add_kind(inspect)
    inspect.add_argument("--static", action="store_true", help="execute nothing of the FMU")
    inspect.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def _add_kind(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--kind",
        choices=KINDS,
        metavar="KIND",
        help="co-simulation or model-exchange, of an FMU that offers both (default: co-simulation, which brings its own"
        " solver)",
    )


def _add_init(commands: Any) -> None:
    init = _command(
        commands,
        "init",
        "a case file, guessed, commented, ready to edit",
        """\
Guess a case file from an FMU's description and a recording's header: which variable takes which column,
which parameters to estimate and between which bounds. What could not be guessed is marked TODO.""",
        [f"{PROGRAM} init my_motor.fmu step.csv -o motor.case.toml", f"{PROGRAM} init dc_motor step.csv"],
    )
    init.add_argument("fmu", type=path, metavar="FMU", help="an .fmu file or a bundled model's name")
    init.add_argument("recording", type=path, metavar="RECORDING", help="a recording")
    init.add_argument(
        "-o", dest="output", type=path, metavar="OUT.case.toml", help="write there instead of to the terminal"
    )


def _add_build(commands: Any) -> None:
    build = _command(
        commands,
        "build",
        "a model in C → an FMU",
        "Compile a model (a C file, or the name of a bundled one) into an FMU, for co-simulation and model exchange.",
        [f"{PROGRAM} build dc_motor", f"{PROGRAM} build my_motor.c --fmi 3 -o my_motor.fmu"],
    )
    build.add_argument("model", type=path, metavar="MODEL.c|NAME", help="a model's C file, or a bundled model's name")
    build.add_argument("--fmi", type=fmi, default=2, metavar="2|3", help="version of FMI (default: 2)")
    build.add_argument(
        "--platforms",
        type=names,
        metavar="NAME,…",
        help="compile for linux64, linux-aarch64, win64, darwin-x86_64, darwin-aarch64 by the package ziglang"
        " (default: for this machine by its C compiler)",
    )
    build.add_argument(
        "-o", dest="output", type=path, metavar="OUT.fmu", help="default: the model's name, in this folder"
    )


def _add_batch(commands: Any) -> None:
    batch = _command(
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
        module="many",
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
    add("--report", action="store_true", help="write report.html and figure.png of every case too, some 0.5 s a case")
    add(
        "--report-of",
        action="append",
        default=[],
        metavar="CASE",
        help="such a report of this case only; with --resume, later; repeatable",
    )
    add("--parquet", action="store_true", help="write results.parquet too (extra: parquet)")
    _add_quiet(batch)


def _add_compare(commands: Any) -> None:
    compare = _command(
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


def _add_export(commands: Any) -> None:
    export = _command(
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
        action="append",
        default=[],
        choices=FORMATS,
        metavar="FORMAT",
        help=f"one of {', '.join(FORMATS)}; repeatable (default: all that the FMU allows)",
    )
    add("--fmu", type=path, metavar="FMU", help="the FMU, if it has moved since")
    add("-o", dest="output", type=path, metavar="DIR", help="folder (default: that of the result)")


def _add_app(commands: Any) -> None:
    app = _command(
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


def _add_schema(commands: Any) -> None:
    schema = _command(
        commands,
        "schema",
        "the JSON Schema of case files, for editors",
        "Print the JSON Schema of case files, with which an editor completes and checks them.",
        [f"{PROGRAM} schema -o case.schema.json"],
    )
    schema.add_argument("-o", dest="output", metavar="OUT.json", help="write there instead of to the terminal")


def _add_completion(commands: Any) -> None:
    completion = _command(
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
    completion.set_defaults(whole=command_line)


def _command(
    commands: Any, name: str, line: str, text: str, examples: Sequence[str], *, module: str = "commands"
) -> argparse.ArgumentParser:
    """Return the parser of a command, which runs the function of that name in a module of `estimator.commands`."""

    def run(args: argparse.Namespace) -> int:
        functions = import_module(f"estimator.commands.{module}")
        return int(getattr(functions, name.replace("-", "_"))(args))

    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=line,
        description=text,
        epilog="examples:\n" + "\n".join(f"  {example}" for example in examples),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    return parser


def _add_quiet(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quiet", action="store_true", help="show no progress")


class _Version(argparse.Action):
    """Print the version and leave; look it up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        """Print the version and leave."""
        say(f"{PROGRAM} {version()}\n")
        parser.exit(OK)


def _add_new_model(commands: Any) -> None:
    new_model = _command(
        commands,
        "new-model",
        "a model file to start from",
        "Write NAME.c into this folder: a small motor model that builds, with comments, to be changed into your own.",
        [f"{PROGRAM} new-model my_motor", f"{PROGRAM} build my_motor.c"],
    )
    new_model.add_argument("name", metavar="NAME", help="a C identifier, such as my_motor")


def _joined(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with a negative voltage tied to its option; argparse would take it for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--voltage-step":
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _check_words(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    """Leave with a suggestion if the first word is no command, or one that begins with -- none of its options."""
    flags: dict[str, tuple[str, ...]] = parser.get_default("flags")
    name = next((argument for argument in arguments if not argument.startswith("-")), "")
    if name not in flags:
        names = [n for n in flags if n]
        if name.lower().endswith(RECORDINGS):
            parser.error(f"there is no command {name!r}; did you mean {parser.prog} estimate {name}?")
        parser.error(f"there is no command {name!r}{_meant(name, names)} ({', '.join(names)})")
    options = arguments[: arguments.index("--")] if "--" in arguments else arguments
    for option in (argument.partition("=")[0] for argument in options if argument.startswith("--")):
        if option not in flags[name] and option not in flags[""] and (meant := _meant(option, flags[name])):
            parser.error(f"unrecognized arguments: {option}{meant}")


def _meant(word: str, known: Sequence[str]) -> str:
    """Return a question for the nearest of the words that are known; empty if none is near."""
    if word.startswith("--out") and "-o" in known:
        return "; did you mean '-o'?"
    nearest = get_close_matches(word, known, n=1, cutoff=0.7)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""
