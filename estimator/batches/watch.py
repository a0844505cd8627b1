"""A batch without an end: what appears in a folder is estimated, shown and reported. Knows no FMU; moves no file.

All that it knows is on disk: outcomes as in any batch, and in `told.jsonl` which verdicts the command was given. Killed
and started again it goes on; a verdict is given once, or once more if it was killed while the command ran.
"""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from estimator.batches.batch import BatchResult, Digests, Run, without_files, write_tables
from estimator.batches.batch_folder import BatchFolder
from estimator.batches.case_worker import Outcome, Task
from estimator.batches.incoming import Arrival, Incoming
from estimator.batches.line_page import outcome_of
from estimator.cases.case import Case
from estimator.errors import CaseError, InputError

EVERY = 0.5  # s between two looks
RENEW = 10  # s after which the page reads itself again
PATIENCE = 60.0  # s that the command may take
TOLD = "told.jsonl"
PASSED = ("pass", "doubtful")
STATUS, NAME = "FMU_ESTIMATOR_STATUS", "FMU_ESTIMATOR_CASE"  # environment of the command

Known = tuple[Case, tuple[tuple[Path, tuple[int, int]], ...]]


class Teller:
    """The command that is given every verdict, and the journal of what it was given.

    Parameters
    ----------
    command : str
        As on a command line; no shell reads it.

    Raises
    ------
    InputError
        There is no such program.
    """

    def __init__(self, command: str) -> None:
        try:
            self._command = shlex.split(command)
        except ValueError as error:
            raise InputError(f"the command {command!r} cannot be read ({error}); close its quotes") from None
        program = shutil.which(self._command[0]) if self._command else None
        if program is None:
            raise InputError(f"there is no program {command!r} to be given the verdicts; give its path")
        self._command[0] = os.path.abspath(program)

    def tell(self, place: BatchFolder, outcome: Outcome, *, digest: str) -> str:
        """Give a verdict unless it was given; return what went wrong, "" if nothing did."""
        row = outcome.row
        entry = {"case": row["case"], "digest": digest, "verdict": row["verdict"]}
        if any(entry.items() <= known.items() for known in _lines(place.path / TOLD)):
            return ""
        status = exit_status(row)
        about = {**row, "outcome": outcome_of(row), "exit_status": status}
        folder = place.case(str(row["case"])).absolute()
        about["result"] = str(folder) if (folder / "result.json").exists() else None
        wrong, ended = "", None
        try:
            ended = subprocess.run(
                self._command,
                input=(json.dumps(about, allow_nan=False) + "\n").encode(),
                stdout=subprocess.DEVNULL,
                env={**os.environ, STATUS: str(status), NAME: str(row["case"])},
                timeout=PATIENCE,
                check=False,
            ).returncode
            if ended:
                wrong = f"{row['case']}: the command {self._command[0]} ended with status {ended}"
        except subprocess.TimeoutExpired:
            wrong = f"{row['case']}: the command {self._command[0]} took more than {PATIENCE:g} s and was ended"
        except OSError as error:
            wrong = f"{row['case']}: the command {self._command[0]} cannot be run ({error.strerror or error})"
        with open(place.path / TOLD, "a", encoding="utf-8") as stream:
            stream.write(json.dumps({**entry, "status": ended}) + "\n")
        return wrong


def exit_status(row: Mapping[str, Any]) -> int:
    """Return 0 for a case that passes: estimated, and no expectation missed or undecided; 1 otherwise."""
    return 0 if outcome_of(row) in PASSED else 1


def watch(
    incoming: Incoming,
    run: Run,
    *,
    teller: Teller | None = None,
    parquet: bool = False,
    say: Callable[[str], None] = lambda line: None,
    complain: Callable[[str], None] = lambda line: None,
    until: Callable[[], bool] = lambda: False,
) -> BatchResult:
    """Estimate what appears, until asked to stop or interrupted.

    Parameters
    ----------
    run : as in `run_batch`
    say : given a line for each case
    complain : given what is wrong with a case file or the command
    until : asked before each look at the folder

    Raises
    ------
    InputError, DiskError
        As `run_batch`.
    """
    if parquet:
        from estimator.batches.batch_table import check_parquet

        check_parquet()
    with BatchFolder(incoming.output, resume=True) as place:
        outcomes: dict[str, Outcome] = {}
        known: dict[str, Known] = {}
        complained: set[str] = set()

        def tell(outcome: Outcome, digest: str) -> None:
            if teller is not None and (wrong := teller.tell(place, outcome, digest=digest)):
                complain(wrong)

        for name, (outcome, digest) in place.all_kept().items():
            outcomes[name] = outcome
            tell(outcome, digest)
        try:
            if outcomes:
                write_tables(place, outcomes, parquet=parquet, renew=RENEW)
            while not until():
                found, wrong = _new(incoming, known)
                for sentence in sorted(wrong - complained):
                    complain(sentence)
                complained = wrong
                tasks: dict[str, tuple[Task, Arrival, str]] = {}
                for arrival in found:
                    digest = Digests().of(arrival.task)
                    name = arrival.task.name
                    kept = place.kept(name, digest=digest)
                    if kept is None:
                        tasks[name] = (arrival.task, arrival, digest)
                    else:
                        outcomes[name] = kept
                for task, outcome in run([task for task, _, _ in tasks.values()]) if tasks else ():
                    _, arrival, digest = tasks[task.name]
                    if not arrival.is_unchanged:
                        known.pop(task.name, None)  # it was still being written: wait until it is at rest again
                        continue
                    if outcome.final:
                        place.keep(task.name, outcome, digest=digest)
                    outcomes[task.name] = without_files(outcome)
                    write_tables(place, outcomes, parquet=parquet, renew=RENEW)
                    say(_line(outcome.row))
                    tell(outcomes[task.name], digest)
                time.sleep(EVERY)
        finally:
            rows = write_tables(place, outcomes, parquet=parquet)
        return BatchResult(rows)


def _new(incoming: Incoming, known: dict[str, Known]) -> tuple[list[Arrival], set[str]]:
    """Return what has not been seen in this state, and what is wrong with case files."""
    found, wrong = [], set()
    for arrival in incoming.arrivals():
        if isinstance(arrival, CaseError):
            wrong.add(str(arrival))
            continue
        state = (arrival.task.case, arrival.stamps)
        if known.get(arrival.task.name) != state:
            known[arrival.task.name] = state
            found.append(arrival)
    return found, wrong


def _line(row: Mapping[str, Any]) -> str:
    outcome = outcome_of(row)
    missed = [name for name, came in row["checks"].items() if came != "pass"]
    said = [f"not met or undecided: {', '.join(missed)}"] if missed else []
    return f"{row['case']}: {'; '.join([outcome, *said, *row['reasons']])}"


def _lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects of a file with one a line; a line that was cut off is left out."""
    found: list[dict[str, Any]] = []
    with contextlib.suppress(OSError):
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            with contextlib.suppress(ValueError):
                entry = json.loads(line)
                if isinstance(entry, dict):
                    found.append(entry)
    return found
