"""A folder in which recordings appear → the cases that can be estimated. Knows no batch and no FMU; moves nothing.

A file counts once neither its size nor its time has changed for a while: a logger may still be writing. Times are
compared with each other only, never with this machine's clock, so that a network share may have its own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from estimator.batches.case_worker import Task
from estimator.cases.case import Case, case_for_recording, read_cases
from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.errors import CaseError, InputError, is_text
from estimator.recordings.suffixes import is_recording

Stamp = tuple[int, int]  # ns, bytes


@dataclass(frozen=True)
class Arrival:
    """A case whose files have come to rest, and how they were then."""

    task: Task
    stamps: tuple[tuple[Path, Stamp], ...]

    @property
    def is_unchanged(self) -> bool:
        """Whether the files are still as they were."""
        return all(_stamp(path) == stamp for path, stamp in self.stamps)


@dataclass
class Incoming:
    """A folder that is looked at again and again.

    Attributes
    ----------
    folder : with those below it; files and folders that begin with a dot, a tilde or an underscore do not count
    case_files : what is done with the recordings; none: each is a case of its own, or as a case file there says
    output : a folder that does not count, for it is the batch's own
    report : as in Task
    settled : s that a file must have been at rest

    Raises
    ------
    InputError
        The folder is none, or what is to be a case file.
    """

    folder: Path
    case_files: Sequence[Path]
    output: Path
    report: bool = False
    settled: float = 2.0
    clock: Callable[[], float] = time.monotonic
    _since: dict[Path, tuple[Stamp, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check what cannot come right later."""
        self.folder, self.output = self.folder.absolute(), self.output.absolute()
        self.case_files = [file.absolute() for file in self.case_files]
        if not self.folder.is_dir():
            raise InputError(f"there is no folder {self.folder} to watch; make it, or give another")
        for file in self.case_files:
            if not file.name.endswith(CASE_SUFFIX):
                raise InputError(f"{file} is no case file; with --watch give files *{CASE_SUFFIX}, or none")
            read_cases(file, recordings=self.folder, there_only=True)

    def arrivals(self) -> Iterator[Arrival | CaseError]:
        """Yield every case that is at rest, and what is wrong in case files that are."""
        present = list(self._files())
        for path in (*present, *self.case_files):
            self._is_at_rest(path)  # the time of rest begins for all at once
        taken: set[Path] = set()
        for file in self.case_files or [path for path in present if path.name.endswith(CASE_SUFFIX)]:
            if not self._is_at_rest(file):
                continue
            where = self.folder if self.case_files else None
            try:
                cases = read_cases(file, recordings=where, there_only=True)
            except CaseError as error:
                yield error
                continue
            for case in cases:
                taken.update(case.recordings)
                yield from self._arrived(case, name=self._name(file, case))
        if self.case_files:
            return
        for path in present:
            if not path.name.endswith(CASE_SUFFIX) and path not in taken and is_recording(path):
                yield from self._arrived(case_for_recording(path), name=path.relative_to(self.folder).as_posix())

    def _arrived(self, case: Case, *, name: str) -> Iterator[Arrival]:
        files = [*case.recordings, *([case.path] if case.path else [])]
        at_rest = [self._is_at_rest(file) for file in files]
        if all(at_rest):
            stamps = tuple((file, self._since[file][0]) for file in files)
            yield Arrival(Task(name, case, report=self.report), stamps)

    def _name(self, file: Path, case: Case) -> str:
        if self.case_files:
            return case.name
        return (file.relative_to(self.folder).parent / case.name).as_posix()

    def _is_at_rest(self, path: Path) -> bool:
        stamp, now = _stamp(path), self.clock()
        if stamp is None or stamp[1] == 0:
            self._since.pop(path, None)
            return False
        known = self._since.get(path)
        if known is None or known[0] != stamp:
            self._since[path] = (stamp, now)
            return False
        return now - known[1] >= self.settled

    def _files(self) -> Iterator[Path]:
        for folder, names, files in os.walk(self.folder):
            names[:] = sorted(n for n in names if _is_shown(n) and Path(folder, n) != self.output)
            yield from (Path(folder, name) for name in sorted(files) if _is_shown(name))


def _is_shown(name: str) -> bool:
    return name[0] not in "._~" and is_text(name)


def _stamp(path: Path) -> Stamp | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
