"""Worker processes forked from one that has loaded what they need: as started anew, without the 0.1 s of loading.

For tests that ask what an FMU is simulated or estimated to, and what becomes of a worker. How a worker is started, and
how it is found by its environment with all that its FMU has started, is asked of workers that are started: fixture
`started_workers`, and every program that is started anew. Knows no FMU.
"""

from __future__ import annotations

import os
import subprocess
import sys
import types
from collections.abc import Sequence
from typing import IO, Any, NoReturn

from forking import CAN_FORK, Fork, Forking, serve

SOCKET = "FMU_ESTIMATOR_TESTS_WORKERS"  # the environment variable that names the socket of the process that forks
MODULE = "estimator.stepping.worker"
start_anew = subprocess.Popen  # as it is: some tests take it away


class Warm(Fork):
    """A process that was forked, with pipes to and from it: a worker, or what else the socket of that name is for."""

    def __init__(self, arguments: Sequence[str], env: dict[str, str], *, name: str = SOCKET) -> None:
        (reads, own_in), (own_out, writes) = os.pipe(), os.pipe()
        super().__init__(name, {"arguments": arguments, "cwd": os.getcwd(), "env": env}, [reads, writes])
        os.close(reads)
        os.close(writes)
        self.stdin: IO[bytes] = os.fdopen(own_in, "wb")
        self.stdout: IO[bytes] = os.fdopen(own_out, "rb")


def forking() -> Forking | None:
    """Return a process that forks workers from here on, where the system has what that takes."""
    return Forking(SOCKET, __file__) if CAN_FORK else None


def take() -> None:
    """Let estimations in this process, and in those forked from it, take workers that are forked, where there are."""
    if SOCKET in os.environ:
        from estimator.fmus import process

        names = {name: getattr(subprocess, name) for name in ("PIPE", "DEVNULL", "TimeoutExpired")}
        process.subprocess = types.SimpleNamespace(Popen=_started, **names)  # type: ignore[assignment]


def _started(arguments: Sequence[str], *, env: dict[str, str], **how: Any) -> Warm | subprocess.Popen[bytes]:
    """Start the process of a worker, and whatever else as it is asked for."""
    if SOCKET in os.environ and MODULE in arguments[2]:
        return Warm(arguments[3:], env)
    return start_anew(arguments, env=env, **how)


def _become(order: dict[str, Any], fds: Sequence[int]) -> NoReturn:
    """Make this forked process one that was just started, and be a worker in it."""
    status = 1
    try:
        for number, fd in enumerate((*fds, os.open(os.devnull, os.O_WRONLY))):
            os.dup2(fd, number)
            os.close(fd)
        os.chdir(order["cwd"])
        os.environ.clear()
        os.environ.update(order["env"])
        sys.argv = ["-c", *order["arguments"]]
        from estimator.stepping import worker

        worker.main()
        status = 0
    finally:
        os._exit(status)


def main() -> int:
    """Load what workers load, and serve the socket that the first argument names."""
    import fmpy.fmi2  # noqa: F401

    import estimator.stepping.probing
    import estimator.stepping.worker  # noqa: F401

    return serve(int(sys.argv[1]), _become)


if __name__ == "__main__":
    main()
