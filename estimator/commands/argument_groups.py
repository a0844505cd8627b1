"""What several commands' arguments have in common: their parser, options that they share. Runs nothing."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from estimator.choices import FMI_KINDS
from estimator.commands.argument_values import metres, positive, text_assignment

REPEATABLE: dict[str, Any] = {"action": "append", "default": []}  # an option whose values are collected


def command(
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


def add_kind(parser: argparse.ArgumentParser) -> None:
    """Add the option that says as what an FMU is run."""
    parser.add_argument(
        "--kind",
        choices=FMI_KINDS,
        metavar="KIND",
        help="co-simulation or model-exchange, of an FMU that offers both (default: co-simulation, which brings its own"
        " solver)",
    )


def add_reading(add: Callable[..., Any]) -> None:
    """Add the options that say how a file is to be read; they win over its header."""
    add(
        "--column",
        type=text_assignment("v=U1"),
        metavar="SIGNAL=COLUMN",
        help="which column is v, i, w, angle, load or time, by name or number; repeatable",
        **REPEATABLE,
    )
    add(
        "--unit",
        type=text_assignment("w=rpm"),
        metavar="NAME=UNIT",
        help="unit of a column, or of v, i, w, …, time: --unit w=rpm --unit time=ms; repeatable",
        **REPEATABLE,
    )
    add("--test", metavar="NAME", help="which test, of a file that holds several (default: all, fitted together)")
    add("--motor", metavar="NAME", help="which motor, of a file that holds several: left, right, 1, …")
    add("--supply", metavar="VOLTS", help="of a duty cycle: 12, 12/255 (volts a count), or the column of the battery")
    add("--counts", type=positive, metavar="N", help="of an encoder a turn, of a column of counts")
    add("--per-turn", type=metres, metavar="M", help="metres that a turn goes, of a column in m/s or m: 0.16 or 0.16m")
    add("--rate", type=positive, metavar="HZ", help="of the samples of a file that has no time")


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add the option that shows no progress."""
    parser.add_argument("--quiet", action="store_true", help="show no progress")
