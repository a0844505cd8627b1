"""The program's door: loads the command line; Ctrl-C meanwhile ends it in one sentence. Knows no command."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command that the program was started with; return its exit status."""
    for name in ("stdout", "stderr"):  # a service manager may have closed it
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - for as long as it runs
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # in the background it is ignored
        signal.signal(signal.SIGINT, end_at_once)
    from estimator import cli

    return cli.main(begins=listen)


def end_at_once(number: int, frame: FrameType | None) -> None:
    """End the program while it is loaded: there is nothing to tidy up yet, and no import is left half done."""
    os.write(2, b"fmu-estimator: interrupted\n")
    os._exit(128 + number)


def listen() -> None:
    """Let Ctrl-C be an exception from here on: a command has begun, and tidies up."""
    if signal.getsignal(signal.SIGINT) is end_at_once:
        from estimator import cli

        signal.signal(signal.SIGINT, cli.interrupt)
