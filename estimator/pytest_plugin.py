"""A case file is a test: ``pytest cases/`` collects every ``*.case.toml``, one test for each thing it expects.

Imports nothing of the estimator until there is a case file, so that other projects pay nothing for it. An estimate
is made once for each case and process, however many tests it feeds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from estimator.batches.case_worker import CaseWorker
    from estimator.cases.case import Case
    from estimator.cases.expectation import Check
    from estimator.results.result import Estimate

SUFFIX = ".case.toml"
OUTCOMES = {"fail": "not met", "undecided": "undecided"}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --fmu and --recordings."""
    group = parser.getgroup("fmu-estimator", "case files (*.case.toml)")
    group.addoption("--fmu", metavar="FMU", help="estimate with this FMU, a file or a bundled name, in all case files")
    group.addoption("--recordings", metavar="DIR", help="take the recordings of all case files from this folder")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> CaseFile | None:
    """Take every case file."""
    return CaseFile.from_parent(parent, path=file_path) if file_path.name.endswith(SUFFIX) else None


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the FMU processes."""
    if _KEY in config.stash:
        config.stash[_KEY].close()
        del config.stash[_KEY]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the tests of a case on one worker; leave everything to pytest-xdist where there are no case files."""
    if config.getvalue("dist") != "load":
        return None
    from estimator.pytest_xdist import SchedulerChoice

    return SchedulerChoice(config, log, suffix=SUFFIX)


@pytest.fixture(scope="session")
def estimate(pytestconfig: pytest.Config) -> Any:
    """Return a function from a case (a path or a Case) to its Estimate; each is made once for each process."""

    def estimate_case(case: str | Path | Case) -> Estimate:
        if isinstance(case, (str, Path)):
            (case,) = _cases(Path(case), pytestconfig, single=True)
        return _estimates(pytestconfig).of(case)

    return estimate_case


class CaseFile(pytest.File):
    """A case file: its cases."""

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        """Yield a collector for each case, or the tests of the only one."""
        from estimator.errors import InputError

        try:
            cases = _cases(self.path, self.config)
        except InputError as error:
            raise self.CollectError(str(error)) from None
        for case in cases:
            name = ",".join(part for part in (case.motor, case.recording_of) if part)
            if name:
                yield CaseCollector.from_parent(self, name=name, case=case)
            else:
                yield from _tests(self, case)


class CaseCollector(pytest.Collector):
    """One of several cases of a case file."""

    def __init__(self, *, case: Case, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.case = case

    def collect(self) -> Iterator[pytest.Item]:
        """Yield its tests."""
        yield from _tests(self, self.case)


class CaseTest(pytest.Item):
    """One thing that a case expects."""

    def __init__(self, *, case: Case, check: str, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.case, self.check = case, check

    def runtest(self) -> None:
        """Estimate, unless that has been done, and hold the estimate against this expectation."""
        from estimator.errors import EstimatorError

        estimates = _estimates(self.config)
        try:
            checks = estimates.checks(self.case)
        except EstimatorError as error:
            raise NotMet(f"{self.case.name} has no estimate: {error}") from None
        check = checks[self.check]
        if check.outcome != "pass":
            figure = estimates.figure(self.case)
            shown = f"\nsee {figure}" if figure else ""
            raise NotMet(f"{self.check} {OUTCOMES[check.outcome]}: {check.sentence}{shown}")

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return sentences where an expectation is not met, a traceback otherwise."""
        if isinstance(excinfo.value, NotMet):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return file and name."""
        return self.path, None, f"{self.case.name} {self.check}"


class NotMet(Exception):
    """An expectation is not met."""


class Estimates:
    """The estimates of this process: each case once."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._case_worker: CaseWorker | None = None
        self._done: dict[str, Estimate | Exception] = {}
        self._figures: dict[str, Path | None] = {}

    def of(self, case: Case) -> Estimate:
        """Return the estimate of a case, or raise again what went wrong."""
        from estimator.batches.case_worker import CaseWorker
        from estimator.errors import EstimatorError
        from estimator.estimating.estimate import available_cores

        key = repr(case) + str(case.path)
        if key not in self._done:
            if self._case_worker is None:
                self._case_worker = CaseWorker(
                    processes=1 if hasattr(self._config, "workerinput") else available_cores()
                )
            try:
                self._done[key] = self._case_worker.estimate(case)
            except EstimatorError as error:
                self._case_worker.close()
                self._done[key] = error
            except BaseException:
                self._case_worker.close()
                raise
        done = self._done[key]
        if isinstance(done, Exception):
            raise done.with_traceback(None)
        return done

    def checks(self, case: Case) -> dict[str, Check]:
        """Return how a case's estimate meets each expectation."""
        from estimator.batches.case_worker import case_checks

        return {check.name: check for check in case_checks(case, self.of(case))}

    def figure(self, case: Case) -> Path | None:
        """Write the estimate's files, once, and return the path of the figure, or of the report where there is none."""
        from estimator.batches.batch_folder import folder_name
        from estimator.results.export import result_files

        key = repr(case) + str(case.path)
        if key not in self._figures:
            cache = getattr(self._config, "cache", None)
            if cache is None:
                return None
            import hashlib

            folder = cache.mkdir("fmu-estimator") / folder_name(case.name)
            folder = folder.with_name(f"{folder.name}-{hashlib.sha256(str(case.path).encode()).hexdigest()[:6]}")
            folder.mkdir(exist_ok=True)
            files = result_files(self.of(case), sources=[s for s in (case.path, *case.recordings) if s])
            for name, content in files.items():
                (folder / name).write_bytes(content)
            self._figures[key] = folder / ("figure.png" if "figure.png" in files else "report.html")
        return self._figures[key]

    def close(self) -> None:
        """End the FMU processes."""
        if self._case_worker is not None:
            self._case_worker.close()


_KEY = pytest.StashKey[Estimates]()


def _estimates(config: pytest.Config) -> Estimates:
    if _KEY not in config.stash:
        config.stash[_KEY] = Estimates(config)
    return config.stash[_KEY]


def _cases(path: Path, config: pytest.Config, *, single: bool = False) -> tuple[Case, ...]:
    """Read a case file with --fmu and --recordings applied."""
    from estimator.cases.case import read_cases
    from estimator.commands.options import with_options
    from estimator.errors import CaseError

    folder = config.getoption("--recordings")
    cases = read_cases(path.absolute(), recordings=Path(folder).absolute() if folder else None)
    if single and len(cases) > 1:
        raise CaseError(
            f"{path.name} means {len(cases)} cases; take them one by one from estimator.cases.case.read_cases"
        )
    return tuple(with_options(case, fmu=config.getoption("--fmu")) for case in cases)


def _tests(parent: pytest.Collector, case: Case) -> Iterable[pytest.Item]:
    from estimator.cases.expectation import check_names
    from estimator.cases.nameplate import plate_check_names

    for check in (*check_names(case.expect, case.limits), *plate_check_names(case.nameplate)):
        yield CaseTest.from_parent(parent, name=check.replace(" ", "_"), case=case, check=check)
