"""A worker process: one loaded FMU, candidates from shared memory. Started by ``process_pool.py``; knows no search.

Speaks lines of JSON: orders on what was standard input when it started, answers on what was standard output; the FMU's
own reads and prints go nowhere. When the orders end, the owner is gone: the run's folder is removed and the process
ends, whatever the FMU is doing.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import mmap
import os
import queue
import select
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NoReturn

from estimator.stepping.descendants import MARK, adopt, end_all
from estimator.stepping.fmu_instance import FmuInstance, stepper
from estimator.stepping.folder import remove
from estimator.stepping.layout import CRASHED, FINISHED, DescentLayout, ExperimentLayout, FitsLayout, JobLayout
from estimator.stepping.reference import reference_trajectories
from estimator.stepping.shared_memory import ENTRY, SharedMemory
from estimator.stepping.slow_path import fmu_class
from estimator.stepping.structures import BatchStruct

UNFINISHED, NOT_LOADED = 9, 7  # exit codes of a process of one simulation
KEPT_JOBS = 4  # that stay loaded
QUOTA = 32  # candidates between two looks at the own memory
MEMORY_CHECK = 0.02  # s between two looks at the own memory; a look takes some 30 µs


def main() -> None:
    """Serve until told to quit."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the owner's business
    adopt()
    answers = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    given = os.fdopen(os.dup(0), encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1):  # an FMU that reads or prints does so there
        os.dup2(nowhere, standard)
    orders = _orders(given, Path(sys.argv[1]))
    answers.write(json.dumps({"started": True, "number": 0}) + "\n")  # from here on it is the FMU's time
    worker: Worker | None = None
    kept: dict[int, Worker] = {}  # of late, the last one last
    prober: Any = None
    number = 0  # of the job that was loaded last
    for order in orders:
        if "quit" in order or "forget" in order:
            worker = None
            _give_up(kept)
        if "forget" in order:
            continue
        if "quit" in order:
            answers.flush()
            _end_group()
        try:
            if "load" in order:
                number = order["load"]["number"]
                worker = None
                worker = taken_up(kept, order["load"])
                answer: dict[str, Any] = {"ready": True}
            elif "prepare" in order:
                from estimator.stepping.probing import Prober

                prober = Prober(order["prepare"])
                continue
            elif "probe" in order:
                answer = {"stage": _stage(prober, order["probe"])}
            elif worker is None:
                answer = {"error": "no FMU loaded"}
            elif "fit" in order or "descend" in order:
                answer = worker.fit(order)
            else:
                answer = worker.run(order["run"])
        except Exception as error:
            answer = {"error": " ".join(str(error).split()) or type(error).__name__}
        answers.write(json.dumps({**answer, "number": number}) + "\n")


def taken_up(kept: dict[int, Worker], order: dict[str, Any]) -> Worker:
    """Return the FMU of a job, as it was left or loaded now; of one FMU there is one instance at a time."""
    key, folder = int(order["key"]), order["job"]["folder"]
    if key not in kept:
        rivals = [k for k, worker in kept.items() if worker.layout.folder == folder]
        for old in rivals or list(kept)[: max(0, len(kept) + 1 - KEPT_JOBS)]:
            kept.pop(old).close()
        kept[key] = Worker(order)
    kept[key] = worker = kept.pop(key)
    return worker


def _give_up(kept: dict[int, Worker]) -> None:
    """Free the FMUs that are loaded, and the memory that is shared with the owner."""
    while kept:
        kept.popitem()[1].close()


def _stage(prober: Any, name: str) -> dict[str, Any]:
    """Run a stage of the probe; a refusal is an answer."""
    from estimator.stepping.probing import Refused

    if prober is None:
        raise RuntimeError("its library cannot be loaded")
    try:
        return dict(prober.stage(name))
    except Refused as refusal:
        return {"refused": str(refusal)}


class Worker:
    """The FMU of one job, the shared memory, and the numbers."""

    def __init__(self, order: dict[str, Any]) -> None:
        job = dict(order["job"])
        job["experiments"] = tuple(ExperimentLayout(**e) for e in job["experiments"])
        for name in ("settings", "scale", "types", "counts"):
            job[name] = tuple(tuple(x) if isinstance(x, list) else x for x in job[name])
        self.index = int(order["index"])
        self.memory_limit = int(order["memory_limit"])
        self.shared = SharedMemory(**order["shared"])
        self._shared_map, self._shared_address = _map(order["shared_file"], write=True)
        self._numbers_map, self._numbers_address = _map(order["numbers_file"], write=False)
        self.layout = JobLayout(**job)
        self.forks = self.layout.fresh_process and hasattr(os, "fork")
        self._loaded = None if self.forks else FmuInstance(self.layout, self._numbers_address)
        self._looked = time.monotonic()
        self._process: Any = None

    def run(self, order: dict[str, Any]) -> dict[str, Any]:
        """Simulate candidates until none is left, or until this process has grown too large."""
        if order.get("reference"):
            return {"rows": self._reference(order)}
        shared, base = self.shared, self._shared_address
        batch = BatchStruct(
            next=base + shared.next,
            claim=base + shared.claims + self.index * ENTRY,
            candidates=int(order["candidates"]),
            quota=QUOTA,
            refine=int(order["refine"]),
            values=base + shared.values,
            bounds=base + shared.bounds,
            costs=base + shared.costs,
            steps=base + shared.steps,
            outcomes=base + shared.outcomes,
            shown=base + shared.shown if order["record"] else None,
        )
        if self.layout.fresh_process:
            return self._run_apart(batch)
        full = False
        while self.loaded.run(batch) == QUOTA and not full:
            full = self._too_large()
        full = full or self._too_large()
        return self._answer(recycle=full)

    def fit(self, order: dict[str, Any]) -> dict[str, Any]:
        """Do whole fits, or a descent."""
        claim = self._shared_address + self.shared.claims + self.index * ENTRY
        if "fit" in order:
            done = self.loaded.fit(FitsLayout(**order["fit"]), claim=claim)
        else:
            samples = self._shared_address + self.shared.shown
            done = self.loaded.descend(DescentLayout(**order["descend"]), claim=claim, samples=samples)
        return {**self._answer(recycle=self._too_large()), **done}

    @property
    def loaded(self) -> FmuInstance:
        """The FMU, loaded into this process when it is asked for."""
        if self._loaded is None:
            self._loaded = FmuInstance(self.layout, self._numbers_address)
        return self._loaded

    def close(self) -> None:
        """Free the FMU's instance."""
        if self._loaded is not None:
            self._loaded.close()

    def _run_apart(self, batch: BatchStruct) -> dict[str, Any]:
        """Simulate candidates, each simulation in a process of its own, which is forked from this one.

        Where there is no fork this process does one candidate of one recording and asks to be replaced.
        """
        if not self.forks:
            candidate = self.loaded.take(batch)
            if candidate >= 0:
                for e in range(len(self.layout.experiments)):
                    if self.loaded.run_one(batch, candidate=candidate, experiment=e) != FINISHED:
                        break
            return self._answer(recycle=candidate >= 0)
        if self.layout.needs_fmpy:
            fmu_class(self.layout.version, self.layout.kind)  # imported before the fork, so that no child need do it
        taker = stepper()
        ended = []
        while (candidate := int(taker.stepper_take(batch))) >= 0:
            for e in range(len(self.layout.experiments)):
                child = os.fork()
                if child == 0:
                    self._only(batch, candidate, e)
                _, status = os.waitpid(child, 0)
                code = os.waitstatus_to_exitcode(status)
                if code == NOT_LOADED:
                    raise RuntimeError("its library cannot be loaded in a process of its own")
                if code not in (0, UNFINISHED):
                    outcomes = (ctypes.c_int64 * batch.candidates).from_address(batch.outcomes)
                    outcomes[candidate] = CRASHED
                    ended.append((candidate, code))
                if code != 0:
                    break
        return {"done": True, "recycle": False, "words": "", "messages": 0, "ended": ended}

    def _only(self, batch: BatchStruct, candidate: int, experiment: int) -> NoReturn:
        """Simulate one experiment in this forked process, and end it."""
        code = NOT_LOADED
        try:
            _end_with_parent()
            loaded = self.loaded
            outcome = loaded.run_one(batch, candidate=candidate, experiment=experiment)
            code = 0 if outcome == FINISHED else UNFINISHED
        finally:
            os._exit(code)

    def _answer(self, *, recycle: bool) -> dict[str, Any]:
        log = self.loaded.log
        words = log.last.decode("utf-8", "replace")
        return {"done": True, "recycle": recycle, "words": words, "messages": log.messages}

    def _reference(self, order: dict[str, Any]) -> list[list[float]]:
        experiment = self.loaded.layout.experiments[order["experiment"]]
        columns = len(self.loaded.layout.input_references)

        def numbers(offset: int, count: int) -> list[float]:
            return list((ctypes.c_double * count).from_address(self._numbers_address + offset))

        def rows(offset: int) -> list[list[float]]:
            flat = numbers(offset, experiment.samples * columns)
            return [flat[k * columns : (k + 1) * columns] for k in range(experiment.samples)]

        times = None if experiment.times is None else numbers(experiment.times, experiment.samples)
        return reference_trajectories(
            self.loaded,
            values=order["values"],
            experiment=order["experiment"],
            inputs=rows(experiment.inputs),
            ends=None if experiment.ends is None else rows(experiment.ends),
            times=times,
            refine=order["refine"],
        )

    def _too_large(self) -> bool:
        now = time.monotonic()
        if now - self._looked < MEMORY_CHECK:
            return False
        self._looked = now
        if self._process is None:
            import psutil

            self._process = psutil.Process()
        return bool(self._process.memory_info().rss > self.memory_limit)


def _end_with_parent() -> None:
    """End this forked child when its parent ends; Linux only."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _orders(given: IO[str], folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the orders; when they end, the owner is gone: so does this process then, whatever it does."""
    if sys.platform == "linux":  # a pipe tells of its end by itself: no thread has to hand on each order
        threading.Thread(target=_wait_for_end, args=(given.fileno(), folder), daemon=True).start()
        for line in given:
            yield json.loads(line)
        _end_with_owner(folder)
    orders: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(given, orders, folder), daemon=True).start()
    while True:
        yield orders.get()


def _wait_for_end(place: int, folder: Path) -> None:
    waiting = select.poll()
    waiting.register(place, 0)  # that nobody writes any more is always told
    waiting.poll()
    _end_with_owner(folder)


def _listen(given: IO[str], orders: queue.SimpleQueue[dict[str, Any]], folder: Path) -> None:
    for line in given:
        orders.put(json.loads(line))
    _end_with_owner(folder)


def _end_with_owner(folder: Path) -> NoReturn:
    remove(folder)
    _end_group()


def _end_group() -> NoReturn:
    """End this process, and those that the FMU has started."""
    if MARK in os.environ:
        end_all(os.environ[MARK])
    if os.name == "posix" and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _map(path: str, *, write: bool) -> tuple[mmap.mmap, int]:
    file: IO[bytes]
    with open(path, "r+b") as file:
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_WRITE if write else mmap.ACCESS_COPY)
    return mapped, ctypes.addressof(ctypes.c_char.from_buffer(mapped))
