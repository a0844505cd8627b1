"""Many cases: each estimated once, each on disk as soon as it is done, one table at the end. Prints nothing.

The outcome of a case depends on the case alone, so the table does not depend on the number of processes, on the order
in which they end, or on how often the batch was killed and resumed.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator.batches.batch_folder import BatchFolder
from estimator.batches.batch_table import check_parquet, table_files
from estimator.batches.case_worker import FAILED, Outcome, Task, failed
from estimator.cases.case import Case, RunSpec, case_for_recording, read_cases
from estimator.cases.expansion import told_apart
from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.errors import CaseError, InputError, suggestion
from estimator.recordings.files import motors_in
from estimator.recordings.read_as import ReadAs
from estimator.version import version

if TYPE_CHECKING:
    from estimator.batches.drawn import Kind

Run = Callable[[Iterable[Task]], Iterator[tuple[Task, Outcome]]]  # tasks → outcomes, in any order


@dataclass(frozen=True)
class BatchProgress:
    """Where a batch stands."""

    done: int  # cases on disk or failed, those of an earlier run included
    total: int
    kept: int  # of `done`, from an earlier run
    verdicts: Mapping[str, int]


@dataclass(frozen=True)
class BatchResult:
    """What became of a batch: its rows, sorted by case."""

    rows: tuple[dict[str, Any], ...]
    kept: int = 0

    @property
    def verdicts(self) -> dict[str, int]:
        """How many cases came to each verdict."""
        return dict(Counter(row["verdict"] for row in self.rows))


@dataclass(frozen=True)
class Cases:
    """The cases of a batch, and the case files that could not be read, as outcomes."""

    tasks: tuple[Task, ...]
    unread: tuple[tuple[Task, Outcome], ...] = field(default=())


def gather(sources: Sequence[Path], *, report: bool = False) -> Cases:
    """Return the cases that paths mean: case files, folders with case files, recordings.

    A case file with a mistake does not stop the others: it becomes a failed case.

    Raises
    ------
    InputError
        A path does not exist, or there is no case at all.
    """
    files = _files(sources)
    names = told_apart(files, stems=[_stem(file) for file in files])
    tasks: list[Task] = []
    unread: list[tuple[Task, Outcome]] = []
    for name, file in zip(names, files, strict=True):
        if not file.name.endswith(CASE_SUFFIX):
            case = case_for_recording(file)
            motors = motors_in(file)
            if not motors:
                tasks.append(Task(name, case, report=report))
            for motor in motors:  # each is a case of its own
                own = replace(case, runs=(RunSpec(read_as=ReadAs(motor=motor)),), motor=motor)
                tasks.append(Task(f"{name} {motor}", own, report=report))
            continue
        try:
            cases = read_cases(file)
        except CaseError as error:
            task = Task(name, Case(path=file))
            unread.append((task, failed(task, str(error))))
            continue
        tasks += [Task(name + case.name.removeprefix(_stem(file)), case, report=report) for case in cases]
    return Cases(tuple(tasks), tuple(unread))


def with_reports(cases: Cases, names: Sequence[str]) -> Cases:
    """Return the cases, some of them with a report.

    Raises
    ------
    InputError
        There is no case of such a name.
    """
    known = [task.name for task in cases.tasks]
    for name in names:
        if name not in known:
            raise InputError(f"there is no case {name!r} to report of{suggestion(name, known)}")
    return replace(cases, tasks=tuple(replace(t, report=t.report or t.name in names) for t in cases.tasks))


def repeated(cases: Cases, *, kind: Kind, count: int) -> Cases:
    """Return every case `count` times over, with other noise on its best fit (resample.py).

    Raises
    ------
    InputError, SimulationError
        A case cannot be estimated.
    """
    from estimator.batches.case_worker import CaseWorker
    from estimator.batches.resample import resampled

    tasks: list[Task] = []
    with CaseWorker() as case_worker:
        for task in cases.tasks:
            tasks += resampled(task, case_worker.estimate(task.case), kind=kind, count=count)
    return Cases(tuple(tasks), cases.unread)


def run_batch(
    cases: Cases,
    folder: Path,
    run: Run,
    *,
    resume: bool = False,
    parquet: bool = False,
    progress: Callable[[BatchProgress], None] | None = None,
    command: str = "",
) -> BatchResult:
    """Run a batch, or what is missing of it, and write its tables.

    Parameters
    ----------
    run : how to get from tasks to outcomes: `worker_pool.run_here`, `cluster.run_there`
    command : that does the same, for the page: how a report is made later

    Raises
    ------
    InputError
        The folder cannot be used.
    DiskError
        The disk is full. What is done is on disk.
    KeyboardInterrupt
        Ctrl-C. What is done is on disk, and the tables hold it.
    """
    if parquet:
        check_parquet()
    with BatchFolder(folder, resume=resume) as place:
        digests = Digests()
        outcomes: dict[str, Outcome] = {task.name: without_files(outcome) for task, outcome in cases.unread}
        verdicts = Counter(outcome.row["verdict"] for outcome in outcomes.values())
        total, from_before = len(cases.tasks) + len(cases.unread), 0

        def tell() -> None:
            if progress is not None:
                progress(BatchProgress(len(outcomes), total, from_before, dict(verdicts)))

        tell()  # of many cases it takes a while to see what is done
        waiting, digest_of = [], {}
        for task in cases.tasks:
            digest_of[task.name] = digests.of(task)
            kept = place.kept(task.name, digest=digest_of[task.name]) if resume else None
            if kept is None or (task.report and not place.has_report(task.name, kept)):
                waiting.append(replace(task, checkpoint=(place.journal(task.name), digest_of[task.name])))
            else:
                outcomes[task.name] = kept
                verdicts[kept.row["verdict"]] += 1
                from_before += 1

        try:
            tell()
            if waiting:
                for task, outcome in run(waiting):
                    if outcome.final:
                        place.keep(task.name, outcome, digest=digest_of[task.name])
                        place.journal(task.name).unlink(missing_ok=True)
                    outcomes[task.name] = without_files(outcome)
                    verdicts[outcome.row["verdict"]] += 1
                    tell()
        except BaseException:  # one may have come to the disk just before
            for task in waiting:
                if task.name not in outcomes and (late := place.kept(task.name, digest=digest_of[task.name])):
                    outcomes[task.name] = late
            raise
        finally:
            rows = write_tables(place, outcomes, parquet=parquet, command=command)
        return BatchResult(rows, from_before)


def write_tables(
    place: BatchFolder, outcomes: Mapping[str, Outcome], *, parquet: bool = False, renew: int = 0, command: str = ""
) -> tuple[dict[str, Any], ...]:
    """Write page and tables of the outcomes there are, and return their rows, sorted.

    Parameters
    ----------
    renew : s, after which the page reads itself again; 0: it does not
    command : as in `run_batch`

    Raises
    ------
    DiskError
        The disk is full.
    """
    rows = tuple(outcomes[name].row for name in sorted(outcomes))
    if rows:
        from estimator.batches.gauge import statistics_files  # imports numpy
        from estimator.batches.line_page import line_page

        title = f"Batch of {len(rows)} case{'' if len(rows) == 1 else 's'}"
        index = line_page(rows, title=title, links=place.links(outcomes), renew=renew, command=command).encode()
        timings = {name: outcome.timing for name, outcome in outcomes.items()}
        tables = table_files(rows, timings, parquet=parquet)
        place.write({**tables, **statistics_files(rows), "index.html": index})
    return rows


def last_line(result: BatchResult, *, table: Path) -> str:
    """Return the batch in one line."""
    counts = result.verdicts
    said = ", ".join(f"{counts[name]} {name}" for name in ("ok", "doubtful", "refused", FAILED) if name in counts)
    outcomes = Counter(outcome for row in result.rows for outcome in row["checks"].values())
    if outcomes["fail"] or outcomes["undecided"]:
        met = {"pass": "met", "fail": "not met", "undecided": "undecided"}
        said += "; expectations: " + ", ".join(f"{outcomes[o]} {word}" for o, word in met.items() if outcomes[o])
    before = f" ({result.kept} of them from before)" if result.kept else ""
    cases = "1 case" if len(result.rows) == 1 else f"{len(result.rows)} cases"
    return f"{cases}{before}: {said}; {table}"


class Digests:
    """What went into a case, as one number: the case, and the content of its files, not where they lie."""

    def __init__(self) -> None:
        self._of_file: dict[Path, str] = {}
        self._said: tuple[Case, str] | None = None  # of the last case: those of a Monte-Carlo share one

    def of(self, task: Task) -> str:
        """Return the digest of a task."""
        case = task.case
        if self._said is None or self._said[0] is not case:
            self._said = case, _said_by(case)
        content = [self._file(Path(case.fmu)) if Path(case.fmu).is_absolute() else case.fmu]
        content += [self._file(Path(start)) for start in case.search.starts if isinstance(start, str)]
        if task.drawn is None:
            content += [self._file(file) for file in case.recordings]
        else:
            content.append(task.drawn.digest)
        return hashlib.sha256(f"({version()!r}, {self._said[1]}, {content!r})".encode()).hexdigest()

    def _file(self, path: Path) -> str:
        if path not in self._of_file:
            try:
                self._of_file[path] = hashlib.sha256(path.read_bytes()).hexdigest()
            except OSError:
                self._of_file[path] = "unreadable"
        return self._of_file[path]


def _said_by(case: Case) -> str:
    """Return what a case says, and the names of its recordings and of its tables of starts."""
    named = tuple(Path(start).name if isinstance(start, str) else start for start in case.search.starts)
    case = replace(case, search=replace(case.search, starts=named))
    own = [f"{f.name}={getattr(case, f.name)!r}" for f in fields(case) if f.name not in ("path", "fmu", "recordings")]
    return f"{own!r}, {[file.name for file in case.recordings]!r}"


def without_files(outcome: Outcome) -> Outcome:
    """Return an outcome without the content of its files: a batch of thousands stays small."""
    return Outcome(outcome.row, timing=outcome.timing, final=outcome.final)


def _files(sources: Sequence[Path]) -> list[Path]:
    files: dict[Path, None] = {}
    for source in sources:
        path = Path(source).absolute()
        if path.is_dir():
            found = sorted(path.rglob(f"*{CASE_SUFFIX}"))
            if not found:
                raise InputError(f"there is no *{CASE_SUFFIX} in {source}; give case files, or a folder of them")
            files.update(dict.fromkeys(found))
        elif not path.exists():
            raise InputError(f"there is no case {source}; give case files, folders of them, or recordings")
        elif path.suffix == ".fmu" or (path.suffix == ".toml" and not path.name.endswith(CASE_SUFFIX)):
            raise InputError(f"{source} is no case; give files *{CASE_SUFFIX}, folders of them, or recordings")
        else:
            files[path] = None
    return list(files)


def _stem(file: Path) -> str:
    return file.name.removesuffix(CASE_SUFFIX) if file.name.endswith(CASE_SUFFIX) else file.stem
