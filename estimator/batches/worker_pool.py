"""The processes of a batch on this machine: tasks in, outcomes out as they come. Knows no case and no folder.

A process that dies takes nobody along: its task is tried once more by a new process, then it has failed.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

from estimator.batches.case_worker import DEBUG, Outcome, Task, failed
from estimator.fmus.process import signal_name

TRIES = 2
Answer = tuple[Task, Outcome] | BaseException | None  # None: this case worker has no more to do


def run_here(tasks: Iterable[Task], *, processes: int) -> Iterator[tuple[Task, Outcome]]:
    """Yield every task with its outcome, in the order in which they end.

    Closing the iterator, or an exception where it is used, ends all processes at once.
    """
    waiting = iter(tasks)
    lock = threading.Lock()
    answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
    case_workers = [_Owner(waiting, lock, answers) for _ in range(max(1, processes))]
    busy = len(case_workers)
    try:
        for case_worker in case_workers:
            case_worker.thread.start()
        while busy:
            answer = answers.get()
            if answer is None:
                busy -= 1
            elif isinstance(answer, BaseException):
                raise answer
            else:
                yield answer
    finally:
        for case_worker in case_workers:
            case_worker.stop()


class _Owner:
    """One case worker's process and the thread that feeds it."""

    def __init__(self, waiting: Iterator[Task], lock: threading.Lock, answers: queue.SimpleQueue[Answer]) -> None:
        self._waiting, self._lock, self._answers = waiting, lock, answers
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False
        self.thread = threading.Thread(target=self._feed, daemon=True)

    def stop(self) -> None:
        """End the process; its standard input ends with it, and so do its own processes."""
        self._stopped = True
        process = self._process
        if process is not None:
            process.kill()
        if self.thread.ident is not None:
            self.thread.join(timeout=5)

    def _feed(self) -> None:
        try:
            while not self._stopped:
                with self._lock:
                    task = next(self._waiting, None)
                if task is None:
                    break
                outcome = self._run(task)
                if not self._stopped:
                    self._answers.put((task, outcome))
        except BaseException as error:  # of the tasks' iterator: the batch must hear of it
            self._answers.put(error)
        finally:
            self._end()
            self._answers.put(None)

    def _run(self, task: Task) -> Outcome:
        how = ""
        for _ in range(TRIES):
            if self._stopped:
                break
            process = self._started()
            assert process.stdin is not None and process.stdout is not None
            try:
                pickle.dump(task, process.stdin)
                process.stdin.flush()
                outcome = pickle.load(process.stdout)
                assert isinstance(outcome, Outcome)
                return outcome
            except (OSError, EOFError, pickle.UnpicklingError):
                process.kill()
                code = process.wait()
                how = signal_name(-code) if code < 0 else f"exit status {code}"
                self._end()
        return failed(task, f"the process that estimated it ended {TRIES} times: {how}")

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            root = str(Path(__file__).resolve().parents[2])
            code = f"import sys; sys.path.insert(0, {root!r}); from estimator.batches.case_worker import main; main()"
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", code],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=None if os.environ.get(DEBUG) else subprocess.DEVNULL,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            )
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None and process.stdout is not None
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                stream.close()
