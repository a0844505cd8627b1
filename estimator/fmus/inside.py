"""What worker processes do, done in the process that asks, which may crash itself. Answers as a pool of one does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from estimator.fmus.loaded_job import LoadedJob
from estimator.fmus.process_pool import Answer, Order
from estimator.stepping.worker import Worker, taken_up


class Inside:
    """FMUs that are loaded into this process; the last job is asked.

    Parameters
    ----------
    memory_limit : int
        As a worker process is told.
    """

    def __init__(self, memory_limit: int) -> None:
        self.words = ""
        self._memory_limit = memory_limit
        self._kept: dict[int, Worker] = {}
        self._worker: Worker | None = None

    def load(self, loaded: LoadedJob) -> None:
        """Take up a job, as a worker process is ordered to."""
        self._worker, self.words = None, ""
        self._worker = taken_up(self._kept, {**loaded.order, "index": 0, "memory_limit": self._memory_limit})

    def idle(self) -> list[Inside]:
        """Return who may be asked."""
        return [self]

    def deal(self, order: Order, *, is_left: Callable[[], bool]) -> dict[int, tuple[int, str]]:
        """Do an order until no candidates are left; none is lost but with this process."""
        while is_left():
            self.words = self._loaded.run(order["run"])["words"] or self.words
        return {}

    def ask(self, orders: Mapping[Any, Order]) -> list[Answer | None]:
        """Do orders, and return the answers."""
        return [self._loaded.fit(order) for order in orders.values()]

    def ask_one(self, order: Order) -> Answer | None:
        """Do an order that claims no candidate, and return the answer."""
        return self._loaded.run(order["run"])

    def close(self) -> None:
        """Free the FMUs' instances."""
        for worker in self._kept.values():
            worker.close()
        self._kept.clear()
        self._worker = None

    @property
    def _loaded(self) -> Worker:
        assert self._worker is not None
        return self._worker
