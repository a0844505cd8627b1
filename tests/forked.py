"""Commands in processes forked from one that has loaded the package: as started anew, without the time of loading.

For tests that ask what a command does in a process of its own, with its terminal, its signals and its exit status. How
the program is loaded, and what Ctrl-C does meanwhile, is asked of programs that are started.
"""

from __future__ import annotations

import array
import atexit
import contextlib
import hashlib
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parent.parent
LOADED = (
    "estimator.commands.commands",
    "estimator.commands.checking",
    "estimator.commands.demo",
    "estimator.estimating.checkpoint",
    "estimator.estimating.estimate",
    "estimator.results.export",
    "scipy.optimize",
)
OF_AN_EXTRA = ("estimator.app.server", "uvicorn.protocols.http.h11_impl", "uvicorn.lifespan.on")


class Forked:
    """A command in a forked process; what it offers is as of `subprocess.Popen`.

    Parameters
    ----------
    streams : standard input, output and error
    terminal : bool
        Standard input is a terminal, which the process shall control; "ready" is written there before the command.
    """

    def __init__(
        self, *arguments: str, cwd: Path, streams: tuple[int, int, int], env: dict[str, str], terminal: bool = False
    ) -> None:
        order = {"arguments": arguments, "cwd": str(cwd), "env": env, "terminal": terminal}
        self._told, telling = os.pipe()
        self.returncode: int | None = None
        with _server() as server:
            server.sendall(len(content := json.dumps(order).encode()).to_bytes(4, "big"))
            fds = array.array("i", (*streams, telling))
            server.sendmsg([content[:1]], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, fds)])
            server.sendall(content[1:])
            self.pid = int.from_bytes(_exactly(server, 4), "big")
        os.close(telling)

    def poll(self) -> int | None:
        """Return the exit status, None while the process runs."""
        if self.returncode is None and select.select([self._told], [], [], 0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; return the exit status, of a signal its negative."""
        if self.returncode is None:
            if not select.select([self._told], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("a forked command", timeout or 0.0)
            self.returncode = int(os.read(self._told, 20))
            os.close(self._told)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End the process by force."""
        self.send_signal(signal.SIGKILL)


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, with nothing on its standard input; return what it wrote, and its exit status."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors, open(os.devnull) as nothing:
        streams = (nothing.fileno(), out.fileno(), errors.fileno())
        status = Forked(*arguments, cwd=cwd, streams=streams, env=dict(os.environ)).wait()
        told = [os.pread(f.fileno(), os.fstat(f.fileno()).st_size, 0).decode() for f in (out, errors)]
    return subprocess.CompletedProcess(arguments, status, *told)


class _Held:
    """The socket to the process that forks, one order at a time."""

    def __init__(self) -> None:
        self._own, other = socket.socketpair()
        self._lock = threading.Lock()
        self.process = subprocess.Popen(
            [sys.executable, __file__, str(other.fileno())],
            pass_fds=[other.fileno()],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            start_new_session=True,
        )
        other.close()

    def __enter__(self) -> socket.socket:
        self._lock.acquire()
        return self._own

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def end(self) -> None:
        """End the process that forks; what it has forked goes on."""
        self._own.close()
        self.process.wait()


@cache
def _server() -> _Held:
    return _Held()


def end() -> None:
    """End the process that forks, where there is one."""
    if _server.cache_info().currsize:
        _server().end()
        _server.cache_clear()


def _exactly(stream: socket.socket, count: int) -> bytes:
    """Return so many bytes, or fewer where the stream ends."""
    content = b""
    while len(content) < count and (part := stream.recv(count - len(content))):
        content += part
    return content


def serve(stream: socket.socket) -> int:
    """Fork a process for every order until the orders end; return, in such a process, the command's exit status."""
    import importlib

    for name in LOADED:
        importlib.import_module(name)
    with contextlib.suppress(ImportError):
        for name in OF_AN_EXTRA:
            importlib.import_module(name)
    import compiled
    import warm_workers
    from drawing import draw_here

    from estimator.results.plots import warm_up

    warm_up()
    draw_here()
    compiled.keep()
    warm_workers.take()
    own, answers = os.getpid(), tempfile.mkdtemp()
    with contextlib.suppress(ImportError):
        _keep_answers(Path(answers))
    status = _fork(stream)
    if os.getpid() == own:
        shutil.rmtree(answers)
    return status


def _keep_answers(answers: Path) -> None:
    """Let the app's commands `check` and `inspect` answer as they did, asked the same of the same files."""
    from estimator.app import program

    asked = program.output_of

    def answered(arguments: Sequence[str], *, folder: Path, **how: Any) -> str:
        if arguments[0] not in ("check", "inspect"):
            return asked(arguments, folder=folder, **how)
        files = [folder / word for word in arguments if (folder / word).is_file()]
        about = repr((arguments, [path.read_bytes() for path in files]))
        kept = answers / hashlib.sha256(about.encode()).hexdigest()
        if not kept.exists():
            text = asked(arguments, folder=folder, **how)
            unfinished = kept.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
            unfinished.write_text(text, encoding="utf-8")
            unfinished.replace(kept)
        return kept.read_text(encoding="utf-8")

    program.output_of = answered


def _fork(stream: socket.socket) -> int:
    """Fork a process for every order; return 0 where they end, and in a forked process its exit status."""
    while head := _exactly(stream, 4):
        first, rights, _, _ = stream.recvmsg(1, socket.CMSG_SPACE(4 * 4))
        order = json.loads(first + _exactly(stream, int.from_bytes(head, "big") - 1))
        fds = array.array("i")
        fds.frombytes(rights[0][2])
        pid = os.fork()
        if pid == 0:
            stream.close()
            return _ended(_become(order, fds))
        for fd in fds[:3]:
            os.close(fd)
        threading.Thread(target=_tell, args=(pid, fds[3])).start()
        stream.sendall(pid.to_bytes(4, "big"))
    return 0


def _tell(pid: int, told: int) -> None:
    _, status = os.waitpid(pid, 0)
    os.write(told, str(os.waitstatus_to_exitcode(status)).encode())
    os.close(told)


def _ended(status: int) -> int:
    """End this process as Python would, without tearing down what was loaded before the fork: that takes 0.2 s.

    Where standard output cannot be written, Python ends it with its own complaint: then this returns.
    """
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return status
    os._exit(status)


def _become(order: dict[str, Any], fds: array.array[int]) -> int:
    """Make this forked process one that was just started, and run the command in it."""
    for number, fd in enumerate(fds[:3]):
        os.dup2(fd, number)
    for fd in set(fds):
        os.close(fd)
    os.setsid()
    os.chdir(order["cwd"])
    os.environ.clear()
    os.environ.update(order["env"])
    sys.argv = ["fmu-estimator", *order["arguments"]]
    sys.stdin = os.fdopen(0, closefd=False, encoding="utf-8")
    sys.stdout = os.fdopen(1, "w", buffering=1 if os.isatty(1) else -1, closefd=False, encoding="utf-8")
    sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False, encoding="utf-8", errors="backslashreplace")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from estimator import door

    if order["terminal"]:
        import fcntl
        import termios

        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        signal.signal(signal.SIGINT, door.end_at_once)
        sys.stderr.write("ready\n")
    try:
        return door.main()
    except SystemExit as end:  # of --help and --version
        if isinstance(end.code, int | None):
            return end.code or 0
        raise


def main() -> NoReturn:
    """Serve the socket that the first argument names."""
    sys.exit(serve(socket.socket(fileno=int(sys.argv[1]))))


if __name__ == "__main__":
    main()
