"""What the tests share, which of them run by default, and in which order."""

from __future__ import annotations

import compileall
import contextlib
import dataclasses
import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as on the command line; one worker of pytest-xdist a core
sys.dont_write_bytecode = False  # tests whose asserts were rewritten are kept, for the next worker and the next run
for (
    finder
) in sys.meta_path:  # the package, a plugin of pytest, has no asserts that tests would show: it is left as it is
    getattr(finder, "_must_rewrite", set()).discard("estimator")

import compiled  # noqa: E402
import drawing  # noqa: E402
import forked  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402
import warm_workers  # noqa: E402
from forking import CAN_FORK, Forking  # noqa: E402
from motors import Motor, recording_of, step_recording  # noqa: E402
from open_points import OPEN  # noqa: E402

from estimator.cases.case import Case, case_for_recording  # noqa: E402
from estimator.estimating.estimate import estimate_recordings  # noqa: E402
from estimator.fmus.fmu import find_fmu  # noqa: E402
from estimator.fmus.workers import TIME_LIMIT, Workers  # noqa: E402
from estimator.results.result import Estimate  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent
LONG = (  # the longest first, so that all workers end together
    *("app_browser", "effects", "chain", "estimate", "quirks", "trust", "terminal", "nuisance", "containment"),
    *("long_recordings", "plots", "pytest_plugin", "fmu_build_errors", "drive_model", "mapping", "probe"),
    *("fmu_build_sanitizers", "fmu_build_importers", "check", "odd_recordings", "refusal", "fmu_build", "combined"),
    *("cluster", "batch", "end_to_end", "watch", "picture", "in_memory", "between_runs", "app", "paper_figures"),
    *("cli", "integrator", "figure_signals", "kinds", "figure_process", "api", "fmu_build_exchange", "case"),
    *("odd_drives", "stepper_sensors", "startup", "fmu_build_modes", "commutated_winding", "bounded", "archive"),
    *("starts", "noise_model", "resample", "begin", "docs", "validation", "starting_motion", "add_a_method"),
    *("recording", "architecture", "sources", "response_test", "kalman", "door", "python_fmu", "clean", "compare"),
    *("scaling", "export", "fmu_build_calls3", "quasi_newton", "baselines", "handover", "jumps", "app_security"),
    *("trust_region", "models", "simulate", "logs", "plausibility", "plain_noise", "budget", "messages"),
    *("line_page", "tolerance", "stepper", "fmu_build_calls_alike", "checkpoint", "report", "init"),
)
FORKING = pytest.StashKey[Forking | None]()
TOGETHER = {  # tests of several files that share estimates
    "test_derived.py::test_gains_and_time_": "test_estimate.py",
}


@pytest.hookimpl(tryfirst=True, optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Deal out whole files, so that what the tests of a file share is made once, in the order of `LONG`."""
    if config.getvalue("dist") != "load":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            known = (scope for part, scope in TOGETHER.items() if part in nodeid)
            return next(known, nodeid.partition("::")[0].rpartition("/")[2])

    config.option.loadscopereorder = False
    return Together(config, log)


def _rank(item: pytest.Item) -> int:
    name = item.path.stem.removeprefix("test_")
    return LONG.index(name) if name in LONG else len(LONG)


def pytest_configure(config: pytest.Config) -> None:
    """Compile the package once, as its installation does, for the hundreds of processes that the tests start."""
    if not hasattr(config, "workerinput"):
        for folder in ("estimator", "fmu_build"):
            compileall.compile_dir(ROOT / folder, quiet=2)
        if config.pluginmanager.hasplugin("cacheprovider"):  # else it is compiled where it is needed
            os.environ[compiled.FOLDER] = str(folder := config.cache.mkdir("compiled"))
            compiled.forget(folder)
        config.stash[FORKING] = warm_workers.forking()
        if getattr(config.option, "numprocesses", None) and CAN_FORK:
            forked.server()  # one for all workers of pytest-xdist; else it is started where it is needed
    compiled.keep()
    warm_workers.take()
    forked.take()
    drawing.draw_here()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not load for the smoke tests what has none: loading all modules takes longer than they do."""
    if config.option.markexpr != "smoke" or collection_path.suffix != ".py":
        return None
    return "mark.smoke" not in collection_path.read_text(encoding="utf-8") or None


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[Any]:
    """Let every other worker of pytest-xdist collect from the end: what one has rewritten the next one finds."""
    report = yield
    if isinstance(collector, pytest.Dir) and os.environ.get("PYTEST_XDIST_WORKER", "gw0")[-1] in "13579":
        report.result.reverse()
    return report


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
    items.sort(key=lambda item: (_rank(item), item.path))
    if config.option.markexpr:
        return
    left = [item for item in items if item.get_closest_marker("full") or item.get_closest_marker("open")]
    config.hook.pytest_deselected(items=left)
    items[:] = [item for item in items if item not in left]


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Let the collection of garbage pass over what was loaded and collected: it would take a tenth of the time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def case_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Case]:
    """Return a maker of cases for recordings in memory: method, seed and bounds as asked."""
    placeholder = tmp_path_factory.mktemp("case") / "recording.csv"
    placeholder.write_text("")

    def make(method: str = "cuckoo", *, seed: int = 1, fmu: str | Path = "dc_motor", **search: int) -> Case:
        case = case_for_recording(placeholder, fmu=str(fmu))
        return dataclasses.replace(case, search=dataclasses.replace(case.search, method=method, seed=seed, **search))

    return make


@pytest.fixture(scope="session")
def noisy_estimates(case_of: Callable[..., Case]) -> Callable[[Motor, int], list[Estimate]]:
    """Return what gives the estimates of a motor's step with noise, of so many seeds; none is estimated twice."""
    known: dict[str, list[Estimate]] = {}

    def estimated(motor: Motor, seeds: int) -> list[Estimate]:
        found = known.setdefault(motor.name, [])
        clean = step_recording(motor)
        shown = np.column_stack([clean.signals["current"], clean.signals["speed"]])
        more = [
            recording_of(motor.name, clean.time, clean.signals["voltage"], shown, noise=(0.02, 1.0), seed=seed)
            for seed in range(len(found), seeds)
        ]
        cases = [case_of(seed=seed) for seed in range(len(found), seeds)]
        found += estimate_recordings(cases, [[recording] for recording in more])
        return found[:seeds]

    return estimated


_crews: dict[int, Workers] = {}  # that wait for the next estimation, by their number of processes


@contextlib.contextmanager
def _lent(count: int, *, time_limit: float = TIME_LIMIT) -> Iterator[Workers]:
    """Lend workers that have served before; after an error, or another FMU than a bundled one, they end."""
    crew = _crews.pop(count, None) or Workers(count)
    crew.pool.time_limit, crew.pool.on_tick = time_limit, None
    try:
        yield crew
    except BaseException:
        crew.close()
        raise
    bundled = find_fmu("dc_motor").resolve().parent
    if count in _crews or any(path.parent != bundled for path in crew._folders):
        crew.close()
    else:
        _crews[count] = crew


@pytest.fixture(scope="module")
def shared_workers() -> Iterator[None]:
    """Let estimations take over the worker processes of earlier ones: for tests that ask what is estimated, not how."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("estimating.estimate", "judging.validation", "fmus.simulate"):
            patch.setattr(f"estimator.{module}.Workers", _lent)
        yield


@pytest.fixture(scope="module")
def compiled_quickly() -> Iterator[None]:
    """Let compilers not optimise, a quarter of the time: for tests that ask what is computed. The bits are the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(compiled.QUICKLY, "1")
        yield


@pytest.fixture
def started_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start the processes of workers anew: for tests that ask how they are started, marked and ended."""
    monkeypatch.setattr("estimator.fmus.process.subprocess", subprocess)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish() -> None:
    """End the processes that wait; what plugins load only now looks for its objects among those that are collected."""
    gc.unfreeze()
    if kept := sys.modules.get("estimator.estimating.kept_workers"):  # before those that started their processes
        kept.end_kept_workers()
    forked.end()
    for crew in _crews.values():
        crew.close()
    _crews.clear()


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the process that forks."""
    if (forking := config.stash.get(FORKING, None)) is not None:
        forking.end()
