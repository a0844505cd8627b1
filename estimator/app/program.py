"""The program's own commands, run as child processes: what the app does, anyone can repeat. Knows no HTTP."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from estimator.errors import EstimatorError, InputError

# -P: a file numpy.py in the folder must not be taken for the package.
INTERPRETER = (sys.executable, "-P", "-c", "import sys; from estimator.door import main; sys.exit(main())")

_running: set[subprocess.Popen[bytes]] = set()  # whose output is waited for


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


def output_of(arguments: Sequence[str], *, folder: Path, limit: float, good: Sequence[int] = (0,)) -> str:
    """Run a command to its end and return what it prints.

    Parameters
    ----------
    limit : float
        s that it may take.
    good : exit statuses
        With which it has done its work.

    Raises
    ------
    InputError
        It complains: its sentence.
    EstimatorError
        It takes longer than `limit` s.
    """
    process = subprocess.Popen(
        [*INTERPRETER, *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env=_environment(),
    )
    _running.add(process)
    try:
        output, errors = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        raise EstimatorError(f"{shown(arguments)}: no answer within {limit:g} s") from None
    finally:
        _running.discard(process)
        if process.poll() is None:
            _kill(process)
            process.communicate()
    if process.returncode not in good:
        raise InputError(sentence(errors.decode(errors="replace")) or f"{shown(arguments)} has failed")
    return output.decode(errors="replace")


def end_all() -> None:
    """Kill the commands whose output is waited for, as the app ends."""
    for process in list(_running):
        _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a command and what it has started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def sentence(errors: str) -> str:
    """Return the last thing that a command has said on stderr, without the program's name."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    return lines[-1].removeprefix("fmu-estimator: ") if lines else ""


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONUNBUFFERED": "1"}
