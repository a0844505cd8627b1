"""Commands in processes forked from one that has loaded the package: as started anew, without the time of loading.

For tests that ask what a command does in a process of its own, with its terminal, its signals and its exit status. How
the program is loaded, and what Ctrl-C does meanwhile, is asked of programs that are started.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import types
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from forking import Fork, Forking, serve
from warm_workers import Warm

SOCKET = "FMU_ESTIMATOR_TESTS_COMMANDS"  # the environment variable that names the socket of the process that forks
ANEW = "FMU_ESTIMATOR_TESTS_ANEW"  # the environment variable by which the app starts its commands as it always does
LOADED = (
    "estimator.cli",
    "estimator.batches.batch",
    "estimator.commands.argument_groups",
    "estimator.commands.inspection",
    "estimator.recordings.recording_mat",
    "estimator.results.page_figures",
    "estimator.results.picture",
    "estimator.results.report_html",
    "fmpy",
    "fmu_build.export",
    "jinja2",
    "estimator.commands.commands",
    "estimator.commands.checking",
    "estimator.commands.demo",
    "estimator.commands.estimation",
    "estimator.commands.batch",
    "estimator.commands.simulation",
    "estimator.commands.paper_bench",
    "estimator.estimating.checkpoint",
    "estimator.estimating.estimate",
    "estimator.results.export",
    "scipy.optimize",
)
OF_AN_EXTRA = ("estimator.app.server", "uvicorn.protocols.http.h11_impl", "uvicorn.lifespan.on")


class Forked(Fork):
    """A command in a forked process.

    Parameters
    ----------
    streams : standard input, output and error
    terminal : bool
        Standard input is a terminal, which the process shall control; "ready" is written there before the command.
    keep : file descriptors
        That the command finds under the same numbers.
    """

    def __init__(
        self,
        *arguments: str,
        cwd: Path,
        streams: tuple[int, int, int],
        env: dict[str, str],
        terminal: bool = False,
        keep: Sequence[int] = (),
    ) -> None:
        server()
        env = {**env, SOCKET: os.environ[SOCKET]}
        order = {"arguments": arguments, "cwd": str(cwd), "env": env, "terminal": terminal, "keep": list(keep)}
        super().__init__(SOCKET, order, (*streams, *keep))


class Kept(Forked):
    """A command whose outputs are kept until its end, but for those that a file descriptor gets."""

    def __init__(
        self,
        *arguments: str,
        cwd: Path,
        env: dict[str, str] | None = None,
        stdin: int | None = None,
        stdout: int | None = None,
        stderr: int | None = None,
        keep: Sequence[int] = (),
    ) -> None:
        self._output = [tempfile.TemporaryFile() for _ in range(2)]  # noqa: SIM115 (closed with the command)
        with open(os.devnull) as nothing:
            own = (nothing.fileno(), *(file.fileno() for file in self._output))
            given = (stdin, stdout, stderr)
            first, second, third = (fd if to is None else to for to, fd in zip(given, own, strict=True))
            streams, env = (first, second, third), dict(os.environ) if env is None else env
            super().__init__(*arguments, cwd=cwd, streams=streams, env=env, keep=keep)

    def communicate(self, timeout: float | None = None) -> tuple[bytes, bytes]:
        """Wait for the end; return what it wrote."""
        self.wait(timeout)
        out, errors = (os.pread(f.fileno(), os.fstat(f.fileno()).st_size, 0) for f in self._output)
        return out, errors

    def __del__(self) -> None:
        for file in self._output:
            file.close()
        super().__del__()


def run(
    *arguments: str, cwd: Path, given: bytes = b"", env: dict[str, str] | None = None, stdout: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, with a pipe as its standard input; return what it wrote, and its exit status."""
    reads, writes = os.pipe()
    command = Kept(*arguments, cwd=cwd, env=env, stdin=reads, stdout=stdout)
    os.close(reads)
    with contextlib.suppress(BrokenPipeError), open(writes, "wb") as pipe:
        pipe.write(given)
    told = [text.decode() for text in command.communicate()]
    return subprocess.CompletedProcess(arguments, command.wait(), *told)


@cache
def server() -> Forking | None:
    """Return the process that forks, started where there is none yet."""
    return None if SOCKET in os.environ else Forking(SOCKET, __file__)


def end() -> None:
    """End the process that forks, where this one has started it."""
    if server.cache_info().currsize and (started := server()):
        started.end()
        server.cache_clear()


def take() -> None:
    """Let batches in this process, and in those forked from it, take case workers that are forked, where some are."""
    from estimator.batches import worker_pool

    names = {name: getattr(subprocess, name) for name in ("PIPE", "DEVNULL")}
    worker_pool.subprocess = types.SimpleNamespace(Popen=_case_worker, **names)  # type: ignore[assignment]


def _case_worker(arguments: Sequence[str], *, env: dict[str, str], **how: Any) -> Warm | subprocess.Popen[bytes]:
    if SOCKET in os.environ:
        return Warm((), env, name=SOCKET)
    return subprocess.Popen(arguments, env=env, **how)


def main() -> int:
    """Load the package, and fork a process for every order until they end; return the exit status of this process."""
    import importlib

    for name in LOADED:
        importlib.import_module(name)
    with contextlib.suppress(ImportError):
        for name in OF_AN_EXTRA:
            importlib.import_module(name)
    import compiled
    import warm_workers
    from drawing import draw_here

    from estimator.fmus.fmu import describe
    from estimator.results.plots import warm_up

    warm_up()
    describe("dc_motor")
    draw_here()
    compiled.keep()
    warm_workers.take()
    take()
    own, answers = os.getpid(), tempfile.mkdtemp()
    with contextlib.suppress(ImportError):
        _fork_of_the_app()
        _keep_answers(Path(answers))
    status = serve(int(sys.argv[1]), lambda order, fds: _ended((_become if "keep" in order else _serve)(order, fds)))
    if os.getpid() == own:
        shutil.rmtree(answers)
    return status


def _fork_of_the_app() -> None:
    """Let the app have its commands forked, but for one that is told to start them."""
    from estimator.app import program

    def started(arguments: Sequence[str], **how: Any) -> Any:
        if ANEW in os.environ:
            return subprocess.Popen(arguments, **how)
        command, errors = arguments[len(program.INTERPRETER) :], how.get("stderr", subprocess.PIPE)
        errors = None if errors == subprocess.PIPE else errors
        return Kept(*command, cwd=how["cwd"], env=how["env"], stderr=errors, keep=how.get("pass_fds", ()))

    names = {name: getattr(subprocess, name) for name in ("PIPE", "DEVNULL", "TimeoutExpired")}
    program.subprocess = types.SimpleNamespace(Popen=started, **names)  # type: ignore[assignment]


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


def _serve(order: dict[str, Any], fds: Sequence[int]) -> int:
    """Make this forked process a case worker that was just started."""
    from estimator.batches import case_worker

    for number, fd in enumerate((*fds, os.open(os.devnull, os.O_WRONLY))):
        os.dup2(fd, number)
        os.close(fd)
    os.chdir(order["cwd"])
    os.environ.clear()
    os.environ.update(order["env"])
    case_worker.main()
    return 0


def _become(order: dict[str, Any], fds: Sequence[int]) -> int:
    """Make this forked process one that was just started, and run the command in it."""
    high = [fcntl.fcntl(fd, fcntl.F_DUPFD, 64 + max(order["keep"], default=0)) for fd in fds]
    for fd in fds:
        os.close(fd)
    for number, fd in zip((0, 1, 2, *order["keep"]), high, strict=True):
        os.dup2(fd, number)
        os.close(fd)
    os.chdir(order["cwd"])
    os.environ.clear()
    os.environ.update(order["env"])
    sys.path[:0] = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if folder]
    sys.argv = ["fmu-estimator", *order["arguments"]]
    sys.stdin = os.fdopen(0, closefd=False, encoding="utf-8")
    sys.stdout = os.fdopen(1, "w", buffering=1 if os.isatty(1) else -1, closefd=False, encoding="utf-8")
    sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False, encoding="utf-8", errors="backslashreplace")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from estimator import door

    if order["terminal"]:
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


if __name__ == "__main__":
    sys.exit(main())
