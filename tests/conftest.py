"""What the tests share, which of them run by default, and in which order."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as on the command line; one worker of pytest-xdist a core

import pytest  # noqa: E402
from open_points import OPEN  # noqa: E402

from estimator.cases.case import Case, case_for_recording  # noqa: E402

LONG = ("test_app_browser.py", "test_trust.py", "test_estimate.py", "test_effects.py", "test_terminal.py")
TOGETHER = (  # parts of names: a browser; searches of 80 000 simulations; one recording, and the same twice
    "test_app_browser.py",
    "test_estimate.py::test_the_paper_",
    "test_sources.py::test_of_one_recording_twice_",
)


@pytest.hookimpl(tryfirst=True, optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Deal out to one worker of pytest-xdist the tests that share something costly, all others one by one."""
    if config.getvalue("dist") != "load":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return next((part for part in TOGETHER if part in nodeid), nodeid)

    return Together(config, log)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not load for the smoke tests what has none: loading all modules takes longer than they do."""
    if config.option.markexpr != "smoke" or collection_path.suffix != ".py":
        return None
    return "mark.smoke" not in collection_path.read_text(encoding="utf-8") or None


def pytest_report_header() -> str:
    """Say what is left out though it is wanted."""
    return f"open points (expected failures, pytest -m open): {len(OPEN)}"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out long tests and open points unless -m asks for them; begin with what takes long, to end together."""
    for item in items:
        name = f"{item.path.name}::{item.name}"
        reason = OPEN.get(name) or OPEN.get(name.partition("[")[0])
        if reason is not None:
            item.add_marker(pytest.mark.open)
            item.add_marker(pytest.mark.xfail(reason=f"open: {reason}", strict=False))
    items.sort(key=lambda item: LONG.index(item.path.name) if item.path.name in LONG else len(LONG))
    if config.option.markexpr:
        return
    left = [item for item in items if item.get_closest_marker("full") or item.get_closest_marker("open")]
    config.hook.pytest_deselected(items=left)
    items[:] = [item for item in items if item not in left]


@pytest.fixture(scope="session")
def case_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Case]:
    """Return a maker of cases for recordings in memory: method, seed and bounds as asked."""
    placeholder = tmp_path_factory.mktemp("case") / "recording.csv"
    placeholder.write_text("")

    def make(method: str = "cuckoo", *, seed: int = 1, fmu: str | Path = "dc_motor", **search: int) -> Case:
        case = case_for_recording(placeholder, fmu=str(fmu))
        return dataclasses.replace(case, search=dataclasses.replace(case.search, method=method, seed=seed, **search))

    return make
