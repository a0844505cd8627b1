"""The program's own commands, run as child processes: what the app does, anyone can repeat. Knows no HTTP."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from estimator.errors import EstimatorError, InputError

# -P: a file numpy.py in the folder must not be taken for the package.
INTERPRETER = (sys.executable, "-P", "-c", "import sys; from estimator.cli import main; sys.exit(main())")


def shown(arguments: Sequence[str]) -> str:
    """Return the command as one types it."""
    return shlex.join(["fmu-estimator", *arguments])


def start(arguments: Sequence[str], *, folder: Path, errors: int, keep: Sequence[int] = ()) -> subprocess.Popen[bytes]:
    """Start a command in a folder, in a session of its own: a Ctrl-C in the terminal reaches the app alone.

    Parameters
    ----------
    errors : file descriptor
        Where stderr goes.
    keep : file descriptors
        That the command inherits.
    """
    return subprocess.Popen(
        [*INTERPRETER, *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        pass_fds=keep,
        start_new_session=True,
        env=_environment(),
    )


def output_of(arguments: Sequence[str], *, folder: Path, limit: float) -> str:
    """Run a command to its end and return what it prints.

    Raises
    ------
    InputError
        It complains: its sentence.
    EstimatorError
        It takes longer than `limit` s.
    """
    try:
        done = subprocess.run(
            [*INTERPRETER, *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=limit,
            start_new_session=True,
            env=_environment(),
        )
    except subprocess.TimeoutExpired:
        raise EstimatorError(f"{shown(arguments)}: no answer within {limit:g} s") from None
    if done.returncode:
        raise InputError(sentence(done.stderr.decode(errors="replace")) or f"{shown(arguments)} has failed")
    return done.stdout.decode(errors="replace")


def sentence(errors: str) -> str:
    """Return the last thing that a command has said on stderr, without the program's name."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    return lines[-1].removeprefix("fmu-estimator: ") if lines else ""


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONUNBUFFERED": "1"}
