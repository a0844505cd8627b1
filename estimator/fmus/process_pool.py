"""Worker processes together: started as there is work, heard, watched, replaced. Knows claims, no values and no costs.

The first process starts at once, so that it imports what it needs while the caller reads its recordings; the others
start when there has been enough work to pay for them. A process that dies or exceeds the time limit is replaced.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from estimator.errors import FmuError
from estimator.fmus.loaded_job import LoadedJob
from estimator.fmus.mailbox import Mailbox
from estimator.fmus.process import IDLE, RUNNING, STARTING, Process, how_it_ended
from estimator.stepping.layout import CRASHED, TIMED_OUT
from estimator.stepping.shared_memory import MAX_WORKERS, NO_CLAIM

BUSY_BEFORE_MORE = 0.3  # s of simulation before further workers are started
TICK = 0.05  # s between two looks at the clock
LOAD_LIMIT = 20.0  # s, at least, to start a process and load the FMU
MOST_LOADS_DIED = 3  # processes one after the other that end while they load the FMU

Order = dict[str, Any]
Answer = dict[str, Any]


@dataclass
class _Watch:
    """How long processes have been waited for, and which claim each had when."""

    started: float = field(default_factory=time.monotonic)
    looked: float = field(default_factory=time.monotonic)
    claims: dict[int, tuple[int, float]] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Since it was started."""
        return time.monotonic() - self.started


class ProcessPool:
    """The worker processes of one run, all of which have the same job.

    Parameters
    ----------
    count : int
        Processes at most.
    folder : Path
        Of the run; a process whose owner is gone removes it.
    time_limit : float
        s a candidate may take.
    memory_limit : int
        Bytes above which a process is replaced.
    begins : bool
        Whether the first process starts at once, not with the first job.
    """

    def __init__(self, count: int, folder: Path, *, time_limit: float, memory_limit: int, begins: bool = True) -> None:
        self.count = max(1, min(count, MAX_WORKERS))
        self.time_limit = time_limit
        self.memory_limit = memory_limit
        self.busy_before_more = BUSY_BEFORE_MORE
        self.on_tick: Callable[[], None] | None = None
        self.words = ""  # the FMU's last ones
        self._folder = folder
        self._messages: Mailbox[Process] = Mailbox()
        self._processes: dict[int, Process] = {}
        self._loaded: LoadedJob | None = None
        self._loads = 0
        self._busy = 0.0  # s of simulation
        self._loads_died = 0
        self._lost: dict[int, tuple[int, str]] = {}  # candidate → outcome, and how its process ended
        self._generation = 0
        if begins:
            self._spawn(0)

    @property
    def pids(self) -> tuple[int, ...]:
        """Process identifiers of the workers that live now."""
        return tuple(p.popen.pid for p in self._processes.values())

    def all_ready(self) -> bool:
        """Whether every process that was started has loaded the FMU."""
        return all(p.state != STARTING for p in self._processes.values())

    def load(self, loaded: LoadedJob) -> None:
        """Give every process a job, those that are started later too."""
        self._loads += 1
        self._loaded = loaded
        self.words = ""
        loaded.forget_claims()
        for process in self._processes.values():
            self._send_load(process)
        if not self._processes:
            self._spawn(0)

    def idle(self) -> list[Process]:
        """Wait for processes that may be asked; return them, at least one."""
        watch = _Watch()
        while not (idle := [p for p in self._processes.values() if p.state == IDLE]):
            self._hear(watch)
        return idle

    def deal(self, order: Order, *, is_left: Callable[[], bool]) -> dict[int, tuple[int, str]]:
        """Give an order to every process that is idle while candidates are left, until all are done.

        Returns
        -------
        The outcome of each candidate that ended its process, and how.
        """
        watch = _Watch()
        self._lost = {}
        while True:
            for process in list(self._processes.values()):
                if process.state == IDLE and is_left():
                    process.state = RUNNING
                    process.send(order)
            if not is_left() and not any(p.state == RUNNING for p in self._processes.values()):
                break
            self._hear(watch)
        self._worked(watch)
        return self._lost

    def ask(self, orders: Mapping[Process, Order]) -> list[Answer | None]:
        """Give orders, one an idle process, and return each one's answer; None: it has ended."""
        assert self._loaded is not None
        watch, answers = _Watch(), dict[Process, Answer | None]()
        self._loaded.forget_claims()
        for process, order in orders.items():
            process.state = RUNNING
            process.send(order)
        while len(answers) < len(orders):
            heard = self._hear(watch)
            if heard is not None and heard[0] in orders:
                answers[heard[0]] = heard[1]
        self._worked(watch)
        return [answers[process] for process in orders]

    def ask_one(self, order: Order) -> Answer | None:
        """Give an order that claims no candidate to one process and return its answer; None: it has ended."""
        process = self.idle()[0]
        process.send(order)
        while True:
            sender, answer = self._messages.get(timeout=max(self.time_limit, LOAD_LIMIT))
            if sender is process and answer is not None and ("rows" in answer or "error" in answer):
                return answer
            self._heed(sender, answer)
            if sender is process and answer is None:
                return None

    def rest(self) -> None:
        """Let every process give up its jobs; they stay, and wait for the next."""
        for process in self._processes.values():
            process.send({"forget": True})
        self._loaded, self.on_tick, self.words = None, None, ""

    def lives(self) -> bool:
        """Whether no process has ended."""
        return all(not process.has_ended() for process in self._processes.values())

    def close(self) -> None:
        """End all processes."""
        for process in self._processes.values():
            process.end(politely=process.state == IDLE)
        self._processes.clear()

    def _worked(self, watch: _Watch) -> None:
        self._busy += watch.seconds
        self._start_more(0.0)

    def _hear(self, watch: _Watch) -> tuple[Process, Answer | None] | None:
        """Wait a moment for an answer, heed and return it; None: there was none. Look at the clock now and then."""
        heard = None
        with contextlib.suppress(queue.Empty):
            heard = self._messages.get(timeout=TICK)
            self._heed(*heard)
        now = time.monotonic()
        if now - watch.looked >= TICK:
            watch.looked = now
            self._end_the_overdue(watch.claims, now)
            self._start_more(watch.seconds)
            if self.on_tick is not None:
                self.on_tick()
        return heard

    def _heed(self, process: Process, answer: Answer | None) -> None:
        if self._processes.get(process.slot) is not process:
            return  # the last words of a process that has been replaced
        if answer is None:
            self._replace_ended(process)
        elif answer.get("number") != self._loads:
            return  # about a job that has been replaced
        elif "ready" in answer:
            process.state = IDLE
            self._loads_died = 0
        elif "error" in answer:
            raise FmuError(f"{self._name} cannot be loaded: {answer['error']}")
        elif "done" in answer:
            process.state = IDLE
            self.words = answer["words"] or self.words
            self._lost |= {int(k): (CRASHED, how_it_ended(code)) for k, code in answer.get("ended", ())}
            if answer["recycle"]:
                process.end(politely=True)
                self._spawn(process.slot)

    def _replace_ended(self, process: Process) -> None:
        """Replace a process that has ended; the candidate that it simulated is lost."""
        claim = int(self._loaded.claims[process.slot]) if self._loaded is not None else NO_CLAIM
        code = process.reap()
        how = process.ended_because or how_it_ended(code)
        if process.state == RUNNING and claim != NO_CLAIM:
            self._lost[claim] = (TIMED_OUT if process.ended_because else CRASHED), how
        else:
            self._loads_died += 1
            if self._loads_died >= MOST_LOADS_DIED:
                raise FmuError(f"{self._name} cannot be loaded: {how}")
        if self._loaded is not None:
            self._loaded.claims[process.slot] = NO_CLAIM
        self._spawn(process.slot)

    def _end_the_overdue(self, seen: dict[int, tuple[int, float]], now: float) -> None:
        for slot, process in self._processes.items():
            if process.has_ended():
                continue  # the mailbox is about to say so
            waiting = process.state == STARTING
            claim = -2 - process.generation
            if process.state == RUNNING and self._loaded is not None:
                claim = int(self._loaded.claims[slot])
            if process.state == IDLE or (claim == NO_CLAIM and not waiting):
                seen.pop(slot, None)
                continue
            before = seen.get(slot)
            # A busy machine may take seconds to start an interpreter: that is not the FMU's time.
            limit = max(self.time_limit, LOAD_LIMIT) if waiting else self.time_limit
            if before is None or before[0] != claim:
                seen[slot] = (claim, now)
            elif now - before[1] > limit:
                what = "loading the FMU" if waiting else "the FMU"
                process.ended_because = f"{what} exceeded the time limit of {limit:g} s"
                process.kill()
                seen.pop(slot)

    def _start_more(self, running: float) -> None:
        if self._busy + running > self.busy_before_more and len(self._processes) < self.count:
            for slot in range(len(self._processes), self.count):
                self._spawn(slot)

    def _spawn(self, slot: int) -> None:
        self._generation += 1
        process = Process(slot, self._generation, self._folder, self._messages)
        self._processes[slot] = process
        if self._loaded is not None:
            self._send_load(process)

    def _send_load(self, process: Process) -> None:
        assert self._loaded is not None
        process.state = STARTING
        own = {"number": self._loads, "index": process.slot, "memory_limit": self.memory_limit}
        process.send({"load": {**self._loaded.order, **own}})

    @property
    def _name(self) -> str:
        return self._loaded.name if self._loaded is not None else "the FMU"
