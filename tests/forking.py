"""A process that has loaded what others need, and forks them: as started anew, without the time of loading.

It listens on a socket that an environment variable names, so that whoever inherits that can have processes forked: the
workers of pytest-xdist, and the processes that were forked themselves. Knows orders, not what is done about them.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
CAN_FORK = hasattr(os, "pidfd_open") and hasattr(socket, "SOCK_SEQPACKET")
LARGEST = 1 << 17, 16  # bytes and file descriptors of an order


class Fork:
    """A process that was forked; what it offers is as of `subprocess.Popen`.

    Parameters
    ----------
    name : str
        The environment variable that names the socket.
    order : dict
        What to do, as JSON.
    fds : file descriptors
        That it gets.
    """

    def __init__(self, name: str, order: dict[str, Any], fds: Sequence[int]) -> None:
        self.returncode: int | None = None
        self._one = threading.Lock()  # of several threads that wait one is told
        self._told = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._told.connect(os.environ[name])
        socket.send_fds(self._told, [json.dumps(order).encode()], list(fds))
        self.pid = int(self._told.recv(20))

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
                raise subprocess.TimeoutExpired("a forked process", timeout or 0.0)
            with self._one:
                if self.returncode is None:
                    self.returncode = int(self._told.recv(20))
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal; a process that has just ended, its status still under way, gets none."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """End the process by force."""
        self.send_signal(signal.SIGKILL)

    def __del__(self) -> None:
        self._told.close()


class Forking:
    """The process that forks: a script that calls `serve` with what its first argument tells.

    Parameters
    ----------
    name : str
        The environment variable that shall name the socket, as long as this process serves.
    script : Path
    """

    def __init__(self, name: str, script: str) -> None:
        self._name, self._folder = name, tempfile.TemporaryDirectory()
        os.environ[name] = str(Path(self._folder.name) / "orders")
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(os.environ[name])
            listener.listen(64)
            self._process = subprocess.Popen(
                [sys.executable, script, str(listener.fileno())],
                stdin=subprocess.PIPE,
                pass_fds=[listener.fileno()],
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                start_new_session=True,
            )

    def end(self) -> None:
        """End it; what it has forked goes on."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        os.environ.pop(self._name, None)
        self._folder.cleanup()


def serve(number: int, become: Callable[[dict[str, Any], Sequence[int]], int]) -> int:
    """Fork a process for every order until standard input ends; tell who ordered it its pid, then how it ended.

    Each begins a session of its own.

    Parameters
    ----------
    number : file descriptor
        Of the socket.
    become : callable
        What a forked process does about an order and its file descriptors; returns the exit status.

    Returns
    -------
    int
        The exit status: in a forked process its own.
    """
    gc.freeze()
    known: dict[int, tuple[int, socket.socket]] = {}  # descriptors of processes → their pid, who ordered them
    with socket.socket(fileno=number) as listener, selectors.DefaultSelector() as events:
        events.register(listener, selectors.EVENT_READ)
        events.register(0, selectors.EVENT_READ)
        while True:
            for key, _ in events.select():
                if key.fd == 0:
                    return 0
                if key.fd in known:
                    events.unregister(key.fd)
                    _tell(key.fd, *known.pop(key.fd))
                    continue
                asker, _ = listener.accept()
                content, fds, _, _ = socket.recv_fds(asker, *LARGEST)
                if (pid := os.fork()) == 0:
                    os.setsid()
                    with contextlib.suppress(OSError):  # now that it can be killed with its group
                        asker.send(str(os.getpid()).encode())
                    for other in (listener, asker, *(s for _, s in known.values())):
                        other.close()
                    for fd in known:
                        os.close(fd)
                    events.close()
                    gc.unfreeze()
                    return become(json.loads(content), fds)
                for fd in fds:
                    os.close(fd)
                known[ended := os.pidfd_open(pid)] = pid, asker
                events.register(ended, selectors.EVENT_READ)


def _tell(ended: int, pid: int, asker: socket.socket) -> None:
    os.close(ended)
    _, status = os.waitpid(pid, 0)
    with asker, contextlib.suppress(OSError):
        asker.send(str(os.waitstatus_to_exitcode(status)).encode())
