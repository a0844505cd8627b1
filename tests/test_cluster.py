"""A batch on a real Dask cluster on this machine: the same table as here, also when a worker is lost (cluster.py)."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest
from interrupts import takes_interrupts
from test_batch import ROOT, TABLES, line_of, tables_of

from estimator.batches import cluster as cluster_module
from estimator.batches.batch import gather, run_batch
from estimator.batches.case_worker import Task
from estimator.batches.cluster import ClusterError, _outcome, run_there
from estimator.batches.worker_pool import run_here
from estimator.cases.case import Case
from estimator.cli import main
from estimator.errors import InputError

pytestmark = [
    pytest.mark.filterwarnings("default"),  # Dask's own
    pytest.mark.skipif(  # found, not imported: only the worker of pytest-xdist that has these tests shall load it
        find_spec("distributed") is None, reason="Dask is not installed: pip install 'fmu-estimator[cluster]'"
    ),
]


def started(*arguments, folder):
    log = os.open(folder / f"{arguments[0]}-{time.monotonic_ns()}.log", os.O_WRONLY | os.O_CREAT)
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]],
        stdout=subprocess.DEVNULL,
        stderr=log,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


class Cluster:
    """A scheduler and its workers, each a process without a nanny, so that a killed one stays dead."""

    def __init__(self, folder, workers, *, threads=1):
        self.scheduler = started("scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1", folder=folder)
        self.address = ""
        self.workers = []
        deadline = time.monotonic() + 60
        while not self.address:
            assert time.monotonic() < deadline, "the scheduler did not start"
            time.sleep(0.1)
            for log in folder.glob("scheduler-*.log"):
                if found := re.search(r"tcp://127\.0\.0\.1:\d+", log.read_text()):
                    self.address = found[0]
        self.folder, self.threads = folder, threads
        for _ in range(workers):
            self.one_more()

    def one_more(self):
        arguments = ("worker", self.address, "--no-nanny", "--nthreads", str(self.threads), "--no-dashboard")
        self.workers.append(started(*arguments, folder=self.folder))

    def wait(self):
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(len(self.workers), timeout=60)

    def close(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """Return a scheduler that has no workers before `cluster` was asked for."""
    made = Cluster(tmp_path_factory.mktemp("cluster"), 0)
    yield made
    made.close()


@pytest.fixture
def cluster(scheduler):
    """Return a cluster of two workers that live."""
    for lost in [w for w in scheduler.workers if w.poll() is not None]:
        scheduler.workers.remove(lost)
    while len(scheduler.workers) < 2:
        scheduler.one_more()
    return scheduler


@pytest.fixture
def own_cluster(tmp_path):
    """Return a cluster that a test may end."""
    made = Cluster(tmp_path, 2)
    yield made
    made.close()


def test_a_scheduler_without_workers_is_said(scheduler):  # the first of this file: later it has some
    with pytest.raises(InputError, match=r"the scheduler has no workers; start some with: dask worker tcp://"):
        run_there(scheduler.address)


@pytest.mark.full  # a killed worker is asked below
def test_a_case_that_the_scheduler_cancels_is_sent_again(cluster, tmp_path):
    from distributed import Client

    cases = gather([line_of(tmp_path / "line", 4)])
    cluster.wait()
    cancelled = []

    def cancel(dask_scheduler):
        """Tell every client that its running cases are cancelled, as a scheduler does that has lost what they need."""
        names = [k for k, t in dask_scheduler.tasks.items() if t.state == "processing" and k.startswith("_run")]
        for client in dask_scheduler.clients:
            dask_scheduler.report({"op": "cancelled-keys", "keys": names, "reason": "lost dependencies"}, client=client)
            dask_scheduler.client_releases_keys(keys=names, client=client, stimulus_id="test")
        return names

    def run(tasks):
        for answer in run_there(cluster.address)(tasks):
            if not cancelled:
                with Client(cluster.address, set_as_default=False) as other:
                    cancelled.extend(other.run_on_scheduler(cancel))
            yield answer

    run_batch(cases, tmp_path / "there", run)
    assert cancelled and "the cluster" not in (tmp_path / "there" / TABLES[0]).read_text()
    assert len((tmp_path / "there" / "results.csv").read_text().splitlines()) == 1 + 4


def test_a_worker_killed_in_the_middle_loses_nothing_and_the_table_is_as_here(cluster, tmp_path):
    cases = gather([line_of(tmp_path / "line", 5)])
    run_batch(cases, tmp_path / "here", lambda tasks: run_here(tasks, processes=2))
    cluster.wait()
    done = []

    def run(tasks):
        for k, answer in enumerate(run_there(cluster.address)(tasks)):
            if k == 2:
                cluster.workers[0].send_signal(signal.SIGKILL)
            done.append(answer[0].name)
            yield answer

    run_batch(cases, tmp_path / "there", run)
    assert sorted(done) == [task.name for task in cases.tasks]
    assert tables_of(tmp_path / "there") == tables_of(tmp_path / "here")
    for name in TABLES:
        assert "cluster" not in (tmp_path / "there" / name).read_text()


def batch_there(address, folder):
    """Start the batch of `line` on the cluster and return its process once the first case is on disk."""
    process = subprocess.Popen(
        [sys.executable, "-m", "estimator", "batch", "line", "-o", "out", "--dask", address],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        preexec_fn=takes_interrupts,
    )
    while not list((folder / "out" / "cases").glob("line*")):
        time.sleep(0.05)
        assert process.poll() is None
    return process


@pytest.mark.full
def test_ctrl_c_cancels_what_is_left_there_and_the_batch_goes_on_here(cluster, tmp_path, monkeypatch):
    from distributed import Client

    line_of(tmp_path / "line", 12)
    cluster.wait()
    process = batch_there(cluster.address, tmp_path)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"interrupted; what is done is in out, go on with --resume" in said
    deadline = time.monotonic() + 30
    with Client(cluster.address, set_as_default=False) as client:
        while client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)):
            assert time.monotonic() < deadline, "tasks are left on the cluster"
            time.sleep(0.2)
    monkeypatch.chdir(tmp_path)
    assert main(["batch", "line", "-o", "out", "--resume"]) == 0


@pytest.mark.full
def test_a_cluster_that_goes_away_is_said_and_the_batch_goes_on_here(own_cluster, tmp_path, monkeypatch):
    line_of(tmp_path / "line", 12)
    own_cluster.wait()
    process = batch_there(own_cluster.address, tmp_path)
    for lost in (own_cluster.scheduler, *own_cluster.workers):
        lost.kill()
    _, said = process.communicate(timeout=120)
    assert process.returncode == 1
    assert b"the cluster is gone; start it again, then go on with --resume" in said
    assert b"Traceback" not in said
    monkeypatch.chdir(tmp_path)
    assert main(["batch", "line", "-o", "out", "--resume"]) == 0


@pytest.mark.full
def test_a_worker_may_have_several_threads(tmp_path):
    cases = gather([line_of(tmp_path / "line", 6)])
    run_batch(cases, tmp_path / "here", lambda tasks: run_here(tasks, processes=2))
    made = Cluster(tmp_path, 1, threads=3)
    try:
        made.wait()
        run_batch(cases, tmp_path / "there", run_there(made.address))
    finally:
        made.close()
    assert tables_of(tmp_path / "there") == tables_of(tmp_path / "here")


def test_no_scheduler_is_said(monkeypatch):
    monkeypatch.setattr("estimator.batches.cluster.CONNECT", 0.2)
    with pytest.raises(
        InputError, match=r"^--dask tcp://127\.0\.0\.1:9: no scheduler answers there .* dask scheduler$"
    ):
        run_there("tcp://127.0.0.1:9")
    with pytest.raises(InputError, match=r"no scheduler answers there"):
        run_there("nonsense")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (b"", "no scheduler answers there (nothing came for 0.5 s)"),
        (b"HTTP/1.1 400 Bad Request\r\n", "is no scheduler"),
    ],
)
def test_what_answers_and_is_no_scheduler_is_told_at_once(monkeypatch, words, sentence):
    monkeypatch.setattr("estimator.batches.cluster.CONNECT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            kept.append(server.accept()[0])
            kept[0].sendall(words)

        kept: list[socket.socket] = []
        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(InputError, match=re.escape(sentence)):
            run_there(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        thread.join()
        kept[0].close()


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        InputError, match=r"^--dask needs Dask; install it with: pip install 'fmu-estimator\[cluster\]'$"
    ):
        run_there("tcp://127.0.0.1:9")


def test_a_thread_of_a_worker_keeps_what_runs_its_cases_and_its_files_lie_in_the_workers_folder(tmp_path, monkeypatch):
    """It started the processes of a case anew for every case, and left its files where a worker was killed."""
    distributed = pytest.importorskip("distributed")
    made = []

    class Fake:
        def __init__(self):
            made.append(self)

        def run(self, task):
            return task.case.recordings

        def close(self):
            pass

    monkeypatch.setattr(cluster_module, "CaseWorker", Fake)
    monkeypatch.setattr(cluster_module, "_local", threading.local())
    monkeypatch.setattr(cluster_module, "_here", None)
    monkeypatch.setattr(cluster_module.atexit, "register", lambda close: None)
    monkeypatch.setattr(distributed, "get_worker", lambda: SimpleNamespace(local_directory=str(tmp_path)))
    task = Task("a", Case(recordings=(Path("digest/run.csv"),)))
    for _ in range(2):
        (there,) = cluster_module._run(task, ["digest/run.csv"], b"t,v")
        assert there.is_relative_to(tmp_path) and there.read_bytes() == b"t,v"
    assert len(made) == 1


def test_a_connection_that_closes_as_an_outcome_is_fetched_is_a_cluster_that_is_gone():
    """Depending on the instant it was "Stream is closed"."""

    def closed():
        raise OSError("Stream is closed")

    with pytest.raises(ClusterError, match="the cluster is gone; start it again"):
        _outcome(None, SimpleNamespace(status="finished", result=closed))
