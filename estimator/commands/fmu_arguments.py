"""The arguments of simulate, inspect, init, build and new-model: an FMU, or the model of one. Runs nothing."""

from __future__ import annotations

from typing import Any

from estimator.commands.argument_groups import REPEATABLE, add_kind, add_reading, command
from estimator.commands.argument_values import assignment, fmi, level_at, names, path, positive
from estimator.commands.terminal import PROGRAM


def add_simulate(commands: Any) -> None:
    """Add the command `simulate`."""
    simulate = command(
        commands,
        "simulate",
        "one simulation of an FMU, as a recording",
        """\
Simulate an FMU and print what comes out as CSV, which estimate reads back. Values are in SI units.
Exit status: 0 simulated; 2 bad input, or the FMU fails.""",
        [
            f"{PROGRAM} simulate dc_motor --set R=1.2 --voltage-step 10.5@0.5 -o step.csv",
            f"{PROGRAM} simulate my_motor.fmu --input drive.csv -o response.csv",
        ],
        module="simulation",
    )
    add = simulate.add_argument
    add("fmu", type=path, metavar="FMU", help="an .fmu file or a bundled model's name")
    add(
        "--set",
        dest="settings",
        type=assignment,
        metavar="NAME=VALUE",
        help="set a parameter, or hold an input; repeatable",
        **REPEATABLE,
    )
    add_kind(simulate)
    drive = simulate.add_mutually_exclusive_group()
    drive.add_argument(
        "--voltage-step", type=level_at, metavar="V@T", help="voltage input: 0 V, then V volts from T seconds on"
    )
    drive.add_argument("--input", type=path, metavar="FILE", help="a recording of times and inputs")
    add("--stop", type=positive, metavar="S", help="last instant, in s (default: 2.8)")
    add("--step", type=positive, metavar="S", help="communication step, in s (default: 1e-3)")
    add("-o", dest="output", type=path, metavar="OUT.csv", help="write there instead of to the terminal")


def add_inspect(commands: Any) -> None:
    """Add the command `inspect`."""
    inspect = command(
        commands,
        "inspect",
        "what an FMU is and what can be estimated",
        """\
Show what an FMU is, what can be estimated in it, and what would go wrong; run it in a process of its own
to see whether it repeats itself, can be reset, and honours its parameters and its step.""",
        [f"{PROGRAM} inspect dc_motor", f"{PROGRAM} inspect my_motor.fmu --json"],
    )
    inspect.add_argument("fmu", type=path, metavar="FMU", help="an .fmu file or a bundled model's name")
    add_kind(inspect)
    inspect.add_argument("--static", action="store_true", help="execute nothing of the FMU")
    inspect.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def add_init(commands: Any) -> None:
    """Add the command `init`."""
    init = command(
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
    add_reading(init.add_argument_group("how the file is read").add_argument)
    init.add_argument(
        "-o", dest="output", type=path, metavar="OUT.case.toml", help="write there instead of to the terminal"
    )


def add_build(commands: Any) -> None:
    """Add the command `build`."""
    build = command(
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


def add_new_model(commands: Any) -> None:
    """Add the command `new-model`."""
    new_model = command(
        commands,
        "new-model",
        "a model file to start from",
        "Write NAME.c into this folder: a small motor model that builds, with comments, to be changed into your own.",
        [f"{PROGRAM} new-model my_motor", f"{PROGRAM} build my_motor.c"],
    )
    new_model.add_argument("name", metavar="NAME", help="a C identifier, such as my_motor")
