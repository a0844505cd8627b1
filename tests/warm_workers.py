"""Worker processes forked from one that has loaded what they need: as started anew, without the 0.1 s of loading.

For tests that ask what an FMU is simulated or estimated to, and what becomes of a worker; one process forks for all
workers of pytest-xdist, and for the commands that `forked.py` forks. How a worker is started, and how it is found by
its environment with all that its FMU has started, is asked of workers that are started: fixture `started_workers`, and
every program that is started anew. Knows no FMU.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import selectors
import socket
import subprocess
import sys
import tempfile
import types
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NoReturn

ROOT = Path(__file__).resolve().parent.parent
SOCKET = "FMU_ESTIMATOR_TESTS_WORKERS"  # the environment variable that names the socket of the process that forks
CAN_FORK = hasattr(os, "pidfd_open") and hasattr(socket, "SOCK_SEQPACKET")
LARGEST = 1 << 17  # bytes of an order
MODULE = "estimator.stepping.worker"
start_anew = subprocess.Popen  # as it is: some tests take it away


class Warm:
    """A worker process that was forked; what it offers is as of `subprocess.Popen`."""

    def __init__(self, arguments: Sequence[str], env: dict[str, str]) -> None:
        order = json.dumps({"arguments": arguments, "cwd": os.getcwd(), "env": env}).encode()
        (reads, own_in), (own_out, writes) = os.pipe(), os.pipe()
        self.returncode: int | None = None
        self._told = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._told.connect(os.environ[SOCKET])
        socket.send_fds(self._told, [order], [reads, writes])
        os.close(reads)
        os.close(writes)
        self.pid = int(self._told.recv(20))
        self.stdin: IO[bytes] = os.fdopen(own_in, "wb")
        self.stdout: IO[bytes] = os.fdopen(own_out, "rb")

    def poll(self) -> int | None:
        """Return the exit status, None while the process runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; return the exit status, of a signal its negative."""
        if self.returncode is None:
            waiting = select.poll()
            waiting.register(self._told, select.POLLIN)
            if not waiting.poll(None if timeout is None else 1e3 * timeout):
                raise subprocess.TimeoutExpired("a forked worker", timeout or 0.0)
            self.returncode = int(self._told.recv(20))
            self._told.close()
        return self.returncode

    def __del__(self) -> None:
        self._told.close()


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


class Forking:
    """The process that forks, for as long as the tests of this one and of its workers run."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        os.environ[SOCKET] = str(Path(self._folder.name) / "workers")
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(os.environ[SOCKET])
            listener.listen(64)
            self._process = subprocess.Popen(
                [sys.executable, __file__, str(listener.fileno())],
                stdin=subprocess.PIPE,
                pass_fds=[listener.fileno()],
                env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                start_new_session=True,
            )

    def end(self) -> None:
        """End it; what it has forked ends with its owner."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        os.environ.pop(SOCKET, None)
        self._folder.cleanup()


def serve(listener: socket.socket) -> None:
    """Fork a worker for every order until standard input ends; tell who ordered it its number, then how it ended."""
    import fmpy.fmi2  # noqa: F401

    import estimator.stepping.probing
    import estimator.stepping.worker  # noqa: F401

    gc.freeze()
    known: dict[int, tuple[int, socket.socket]] = {}
    with selectors.DefaultSelector() as events:
        events.register(listener, selectors.EVENT_READ)
        events.register(0, selectors.EVENT_READ)
        while True:
            for key, _ in events.select():
                if key.fd == 0:
                    return
                if key.fd in known:
                    pid, asker = known.pop(key.fd)
                    events.unregister(key.fd)
                    os.close(key.fd)
                    _, status = os.waitpid(pid, 0)
                    with asker, contextlib.suppress(OSError):
                        asker.send(str(os.waitstatus_to_exitcode(status)).encode())
                    continue
                asker, _ = listener.accept()
                content, given, _, _ = socket.recv_fds(asker, LARGEST, 2)
                pid = os.fork()
                if pid == 0:
                    events.close()
                    for fd in [listener.fileno(), asker.fileno(), *known, *(s.fileno() for _, s in known.values())]:
                        os.close(fd)
                    _become(json.loads(content), given)
                for fd in given:
                    os.close(fd)
                with contextlib.suppress(OSError):
                    asker.send(str(pid).encode())
                known[ended := os.pidfd_open(pid)] = pid, asker
                events.register(ended, selectors.EVENT_READ)


def _become(order: dict[str, Any], given: Sequence[int]) -> NoReturn:
    """Make this forked process one that was just started, and be a worker in it."""
    status = 1
    try:
        os.setsid()
        for number, fd in enumerate((*given, os.open(os.devnull, os.O_WRONLY))):
            os.dup2(fd, number)
            os.close(fd)
        os.chdir(order["cwd"])
        os.environ.clear()
        os.environ.update(order["env"])
        sys.argv = ["-c", *order["arguments"]]
        gc.unfreeze()
        from estimator.stepping import worker

        worker.main()
        status = 0
    finally:
        os._exit(status)


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
