"""The command line's parser: its commands, and what is answered to a word that it does not know. Runs nothing.

Nothing heavy is imported here: ``--help`` and ``--version`` answer at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from estimator.commands import estimate_arguments, fmu_arguments, result_arguments
from estimator.commands.terminal import BAD_INPUT, OK, PROGRAM, say
from estimator.errors import is_text
from estimator.version import version

RECORDINGS = (".csv", ".txt", ".tsv", ".dat", ".mat", ".parquet", ".mf4", ".xlsx", ".tdms", ".case.toml")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the parsed arguments; leave with SystemExit after ``--help``, ``--version`` or a complaint.

    ``run`` of the result is the command: it takes the result and returns an exit status.
    """
    joined = _joined(arguments)
    parser = command_line()
    _check_words(parser, joined)
    for word in joined:
        if not is_text(word):
            parser.error(f"{word!r} is no UTF-8 text; rename the file or folder")
    args, left = parser.parse_known_args(joined)
    if args.command == "estimate":  # recordings may stand on both sides of an option
        args.sources += [word for word in left if not word.startswith("-")]
        left = [word for word in left if word.startswith("-")]
    if left:
        parser.prog = f"{parser.prog} {args.command}"  # whose --help tells them
        parser.error(f"unrecognized arguments: {' '.join(left)}")
    return args


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
        estimate_arguments.add_demo,
        estimate_arguments.add_estimate,
        fmu_arguments.add_simulate,
        fmu_arguments.add_inspect,
        estimate_arguments.add_check,
        fmu_arguments.add_init,
        fmu_arguments.add_build,
        fmu_arguments.add_new_model,
        result_arguments.add_batch,
        result_arguments.add_compare,
        result_arguments.add_export,
        result_arguments.add_app,
        result_arguments.add_schema,
        result_arguments.add_completion,
    ):
        add(commands)
    commands.choices["completion"].set_defaults(whole=command_line)
    parser.set_defaults(flags={"": parser.flags, **{name: own.flags for name, own in commands.choices.items()}})
    return parser


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


class _Version(argparse.Action):
    """Print the version and leave; look it up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        """Print the version and leave."""
        say(f"{PROGRAM} {version()}\n")
        parser.exit(OK)


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
    written = {"--output": "-o", "--out": "-o"} if "-o" in known else {}
    nearest = get_close_matches(word, [*known, *written], n=1, cutoff=0.7)
    return f"; did you mean {written.get(nearest[0], nearest[0])!r}?" if nearest else ""
