"""Completion of the command line in the user's shell, made from the parser by shtab. Knows no command's work."""

from __future__ import annotations

import argparse

import shtab


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return a script that completes commands, options and their words; files where any other word stands.

    Parameters
    ----------
    shell : one of ``arguments.SHELLS``
    """
    for action in parser._actions:
        for command in action.choices.values() if isinstance(action, argparse._SubParsersAction) else ():
            for taken in command._actions:
                if taken.nargs != 0 and not taken.choices:
                    taken.complete = shtab.FILE
    return str(shtab.complete(parser, shell=shell))
