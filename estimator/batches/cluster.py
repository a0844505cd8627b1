"""A batch on an existing Dask cluster: tasks in, outcomes out as they come. Knows no scheduler of its own.

What a case reads, the FMU and the recordings, travels as content and not as a path: each file is the result of a small
Dask task of its own, so a worker receives it once, and one that is lost can be made again. Cases of a lost worker
run again elsewhere; that is Dask's doing.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import hashlib
import logging
import os
import tempfile
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from estimator.batches.case_worker import CaseWorker, Outcome, Task, failed
from estimator.errors import EstimatorError, InputError, to_install

AHEAD = 3  # cases on their way for each that a cluster can run at a time
AGAIN = 3  # times that a case which the scheduler cancels is sent again
CONNECT = 10  # s
_local = threading.local()
_here: Path | None = None
_lock = threading.Lock()


class ClusterError(EstimatorError):
    """The cluster went away."""


def run_there(address: str) -> Callable[[Iterable[Task]], Iterator[tuple[Task, Outcome]]]:
    """Return what runs tasks on the cluster whose scheduler has this address.

    Raises
    ------
    InputError
        Dask is not installed, there is no scheduler, it has no workers, or these cannot run a case.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(f"--dask needs Dask; {to_install('cluster')}") from None
    try:  # a client that finds none waits for itself for 20 s, and for ever for what accepts and says nothing
        asyncio.run(asyncio.wait_for(_greet(address), CONNECT))
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        why = str(error) or f"nothing came for {CONNECT} s"
        raise InputError(
            f"--dask {address}: no scheduler answers there ({why}); start one with: dask scheduler"
        ) from None
    except Exception:  # whatever Dask's protocol makes of another's words
        raise InputError(
            f"--dask {address}: what answers there is no scheduler; give the address that dask scheduler prints, not"
            " that of its dashboard"
        ) from None
    try:
        _check_workers(client, address)
    except BaseException:
        client.close()
        raise
    return lambda tasks: _outcomes(client, tasks)


async def _greet(address: str) -> None:
    """Exchange the first words with a scheduler."""
    from distributed.comm.core import connect
    from distributed.security import Security

    with _without_tracebacks():
        comm = await connect(address, timeout=CONNECT, **Security().get_connection_args("client"))
    comm.abort()


def _check_workers(client: Any, address: str) -> None:
    from estimator.version import version

    workers = client.scheduler_info(n_workers=-1)["workers"]
    if not workers:
        raise InputError(f"--dask {address}: the scheduler has no workers; start some with: dask worker {address}")
    try:
        versions = client.run(_version)
    except Exception as error:
        raise InputError(
            f"--dask {address}: its workers cannot run a case ({type(error).__name__}: {error});"
            f" install fmu-estimator {version()} there"
        ) from None
    for worker, found in versions.items():
        if found != version():
            raise InputError(
                f"--dask {address}: the worker {worker} has fmu-estimator {found}, not {version()}; install the same"
            )


def _version() -> str:
    from estimator.version import version

    return version()


def _outcomes(client: Any, tasks: Iterable[Task]) -> Iterator[tuple[Task, Outcome]]:
    """Keep the cluster busy and yield outcomes as they come; cancel what is left when nobody wants them."""
    from distributed import as_completed

    slots = sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())
    waiting = iter(tasks)
    files: dict[str, Any] = {}  # digest → future of the content; FMUs stay, recordings go with their case
    under_way: dict[Any, tuple[Task, list[Any]]] = {}
    again: Counter[str] = Counter()  # task → how often the scheduler cancelled it, as it may where workers die

    def submit(task: Task | None = None) -> Any:
        task = task or next(waiting, None)
        if task is None:
            return None
        shipped, contents = _ship(client, task, files)
        future = client.submit(_run, shipped, [name for name, _ in contents], *(f for _, f in contents), pure=False)
        under_way[future] = (task, [f for _, f in contents])
        return future

    try:
        with _without_tracebacks(), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*[Ll]arge (object|graph).*")
            futures = [future for _ in range(AHEAD * slots) if (future := submit()) is not None]
            done = as_completed(futures, loop=client.loop)
            for future in done:
                task, _ = under_way.pop(future)
                if _is_cancelled(future) and client.status == "running" and again[task.name] < AGAIN:
                    again[task.name] += 1
                    following = submit(task)
                else:
                    yield task, _outcome(task, future)
                    following = submit()
                if following is not None:
                    done.add(following)
    finally:
        if under_way:
            client.cancel(list(under_way), force=True)
        with _without_tracebacks():
            client.close()


@contextlib.contextmanager
def _without_tracebacks() -> Iterator[None]:
    """Keep Dask's loggers silent: a lost connection is said once, by us."""
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _is_cancelled(future: Any) -> bool:
    return future.status in ("cancelled", "lost")


def _outcome(task: Task, future: Any) -> Outcome:
    gone = ClusterError("the cluster is gone; start it again, then go on with --resume")
    if future.status == "finished":
        try:
            outcome = future.result()
        except OSError:  # of the connection: what a case runs into is its outcome
            raise gone from None
        assert isinstance(outcome, Outcome)
        return outcome
    if _is_cancelled(future):
        raise gone
    error = future.exception()
    return failed(task, f"the cluster could not run it, {type(error).__name__}: {error}")


def _ship(client: Any, task: Task, files: dict[str, Any]) -> tuple[Task, list[tuple[str, Any]]]:
    """Return the task with its paths as digests, and (path on the worker, future of the content) of its files."""
    case = task.case
    contents = []

    def shipped(path: Path, *, keep: bool) -> Path:
        try:
            content = path.read_bytes()
        except OSError:
            return path  # the worker says what is wrong
        digest = hashlib.sha256(content).hexdigest()
        future = files.get(digest)
        if future is None or _is_cancelled(future):
            future = client.submit(_content, content, key=f"fmu-estimator-file-{digest}")
            if keep:
                files[digest] = future
        name = f"{digest}/{path.name}"
        contents.append((name, future))
        return Path(name)

    fmu = str(shipped(Path(case.fmu), keep=True)) if os.path.isabs(case.fmu) else case.fmu
    recordings = case.recordings
    if task.drawn is None:
        recordings = tuple(shipped(path, keep=False) for path in case.recordings)
    there = case.fmu if os.path.isabs(case.fmu) else None
    return replace(task, case=replace(case, fmu=fmu, recordings=recordings), checkpoint=None, fmu_path=there), contents


# On the worker


def _content(content: bytes) -> bytes:
    return content


def _run(task: Task, names: list[str], *contents: bytes) -> Outcome:
    """Write the files where they are not yet, and estimate."""
    folder = _folder()
    for name, content in zip(names, contents, strict=True):
        path = folder / name
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as stream:
                stream.write(content)
            os.replace(stream.name, path)
    case, given = task.case, set(names)
    here = replace(
        case,
        fmu=str(folder / case.fmu) if case.fmu in given else case.fmu,
        recordings=tuple(folder / path if path.as_posix() in given else path for path in case.recordings),
    )
    if not hasattr(_local, "case_worker"):
        _local.case_worker = CaseWorker()
        atexit.register(_local.case_worker.close)
    outcome: Outcome = _local.case_worker.run(replace(task, case=here))
    return outcome


def _folder() -> Path:
    """Return a folder of this process in the Dask worker's own, which goes with it, also where it is killed."""
    from distributed import get_worker

    global _here
    with _lock:
        if _here is None or not _here.is_dir():
            _here = Path(tempfile.mkdtemp(prefix="fmu-estimator-", dir=get_worker().local_directory))
        return _here
