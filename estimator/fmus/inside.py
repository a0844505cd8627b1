"""What a worker process does, done in the process that asks, which may crash itself. Knows orders and answers only."""

from __future__ import annotations

from typing import Any

from estimator.stepping.worker import Worker, taken_up


class Inside:
    """FMUs that are loaded into this process, the last one asked."""

    def __init__(self) -> None:
        self._kept: dict[int, Worker] = {}
        self._worker: Worker | None = None

    def load(self, order: dict[str, Any]) -> None:
        """Take up a job, as a worker process is ordered to."""
        self._worker = None
        self._worker = taken_up(self._kept, order)

    def answer(self, order: dict[str, Any]) -> dict[str, Any]:
        """Do an order, and return what a worker process answers."""
        assert self._worker is not None
        return self._worker.run(order["run"]) if "run" in order else self._worker.fit(order)

    def close(self) -> None:
        """Free the FMUs' instances."""
        for worker in self._kept.values():
            worker.close()
        self._kept.clear()
        self._worker = None
