"""The tests of one case stay on one worker of pytest-xdist. Knows test names only.

Which tests there are is known only when the workers have collected them, so the choice between xdist's own scheduler
and one that keeps cases together is made then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from xdist.scheduler import LoadScheduling, LoadScopeScheduling


class CaseScheduling(LoadScopeScheduling):
    """A case is dealt out as a whole, every other test alone."""

    suffix = ""

    def _split_scope(self, nodeid: str) -> str:
        return nodeid.rsplit("::", 1)[0] if f"{self.suffix}::" in nodeid else nodeid

    def remove_node(self, node: Any) -> str | None:
        """Let a worker go; return the test that it was running: it is not given to the next one."""
        work = self.assigned_work[node]
        running: tuple[Any, str] | None = next(
            ((unit, test) for unit in work.values() for test, done in unit.items() if not done), None
        )
        if running is None:
            super().remove_node(node)
            return None
        unit, crashed = running
        unit[crashed] = True
        for scope in [scope for scope, unit in work.items() if all(unit.values())]:
            del work[scope]
        super().remove_node(node)
        return crashed


class SchedulerChoice:
    """xdist's own ``load`` scheduler, or, once case files have been collected, one that keeps cases together."""

    def __init__(self, config: Any, log: Any, *, suffix: str) -> None:
        self._suffix = suffix
        self._plain: Any = LoadScheduling(config, log)
        self._cases: Any = CaseScheduling(config, log)
        self._cases.suffix = suffix
        self._chosen: Any = None
        self._has_cases = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chosen or self._plain, name)

    def add_node(self, node: Any) -> None:
        """Take a worker."""
        for scheduler in self._asked:
            scheduler.add_node(node)

    def add_node_collection(self, node: Any, collection: Sequence[str]) -> None:
        """Take what a worker has collected."""
        self._has_cases |= any(f"{self._suffix}::" in nodeid for nodeid in collection)
        for scheduler in self._asked:
            scheduler.add_node_collection(node, collection)

    def remove_node(self, node: Any) -> str | None:
        """Let a worker go; return the test that it was running."""
        running: list[str | None] = [scheduler.remove_node(node) for scheduler in self._asked]
        return running[0]

    def schedule(self) -> None:
        """Deal out tests."""
        if self._chosen is None:
            self._chosen = self._cases if self._has_cases else self._plain
        self._chosen.schedule()

    @property
    def _asked(self) -> list[Any]:
        return [self._chosen] if self._chosen is not None else [self._plain, self._cases]
