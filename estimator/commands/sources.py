"""What `estimate` and `check` are given: a case file, recordings, a pattern, stdin. Reads no signal."""

from __future__ import annotations

import contextlib
import glob
import os
import stat
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.commands.terminal import PROGRAM
from estimator.errors import InputError, is_text
from estimator.recordings.suffixes import SUFFIXES

if TYPE_CHECKING:
    from estimator.cases.case import Case

STDIN = "-"
RUN = "run.csv"


@contextlib.contextmanager
def case_of(words: Sequence[str]) -> Iterator[Case]:
    """Give the case that words mean; what came through stdin is a file as long as the ``with`` statement lasts.

    Raises
    ------
    InputError
        A word is no recording, or does not go with the others.
    """
    from estimator.cases.case import Case, read_case

    files = expanded(words)
    if files[0].endswith(CASE_SUFFIX):
        yield read_case(Path(files[0]))
        return
    with _paths(files, command="estimate") as paths:
        yield Case(recordings=tuple(paths))


@contextlib.contextmanager
def recordings_of(words: Sequence[str], *, command: str) -> Iterator[list[Path]]:
    """Give the files that words mean, none of them a case file, to a command; stdin is one as long as this lasts.

    Raises
    ------
    InputError
        A word is no recording.
    """
    with _paths(expanded(words, command=command), command=command) as paths:
        yield paths


def expanded(words: Sequence[str], *, command: str = "estimate") -> list[str]:
    """Return the files that words mean, patterns filled in: recordings or "-", each once, or one case file.

    Raises
    ------
    InputError
        A pattern matches nothing, a word is a folder, an FMU or given twice, or a case file is not alone.
    """
    files = [file for word in words for file in filled_in(word)]
    for file in files:
        if file.endswith(CASE_SUFFIX) and len(files) > 1:
            others = "each by itself" if all(f.endswith(CASE_SUFFIX) for f in files) else "alone"
            with_batch = f", with {PROGRAM} batch" if others != "alone" else "; it names its own recordings"
            raise InputError(f"{file} is a case file; give it {others}{with_batch}")
        if file.endswith(".toml") and not file.endswith(CASE_SUFFIX):
            raise InputError(f"{file}: the name of a case file ends in {CASE_SUFFIX}; rename it")
        if file.endswith(".fmu"):
            raise InputError(f"{file} is an FMU; give a recording or a case file, and the FMU with --fmu {file}")
        if os.path.isdir(file):
            raise InputError(_folder(file, command))
    seen: dict[str, str] = {}
    for file in files:
        place = STDIN if file == STDIN else os.path.realpath(file)
        if place in seen:
            also = f" and as {seen[place]}" if seen[place] != file else ""
            raise InputError(f"{file} is given twice{also}; leave one out")
        seen[place] = file
    return files


def filled_in(word: str) -> list[str]:
    """Return the files that a pattern means; a word that is none, or a file's name, alone.

    Raises
    ------
    InputError
        Nothing matches.
    """
    if not glob.has_magic(word) or os.path.lexists(word):
        return [word]
    found = sorted(glob.glob(word))
    if not found:
        raise InputError(f"no file matches {word!r}; give the names of recordings, or put the pattern right")
    for name in found:
        if not is_text(name):
            raise InputError(f"{name!r} has a name that is no UTF-8 text; rename it")
    return found


def _folder(folder: str, command: str) -> str:
    names = sorted(os.listdir(folder))
    if command == "estimate" and any(name.endswith(CASE_SUFFIX) for name in names):
        return f"{folder} is a folder with case files; estimate each of them with {PROGRAM} batch {folder}"
    suffixes = [suffix for name in names if (suffix := os.path.splitext(name)[1]).lower() in SUFFIXES]
    if not suffixes:
        return f"{folder} is a folder without recordings; give one with its name, such as {os.path.join(folder, RUN)}"
    usual = max(suffixes, key=suffixes.count)
    pattern = os.path.join(folder, f"*{usual}")
    if command != "estimate":
        return f"{folder} is a folder; give its recordings with {PROGRAM} {command} '{pattern}'"
    return (
        f"{folder} is a folder; fit its recordings together with {PROGRAM} estimate '{pattern}',"
        f" or each by itself with {PROGRAM} batch {pattern}"
    )


def is_stream(file: str) -> bool:
    """Return whether a file can be read but once: stdin, a pipe with a name, what a shell's <(…) gives."""
    try:
        return file == STDIN or stat.S_ISFIFO(os.stat(file).st_mode)
    except OSError:
        return False  # its reader says what is wrong


@contextlib.contextmanager
def _paths(files: Sequence[str], *, command: str) -> Iterator[list[Path]]:
    with contextlib.ExitStack() as stack:
        yield [
            stack.enter_context(_kept(file, command)) if is_stream(file) else Path(os.path.abspath(file))
            for file in files
        ]


@contextlib.contextmanager
def _kept(file: str, command: str) -> Iterator[Path]:
    """Give a file with what comes through a stream."""
    if file == STDIN and (sys.stdin is None or sys.stdin.isatty()):
        raise InputError(f"- stands for stdin, but nothing is piped into it; write {PROGRAM} {command} - < {RUN}")
    with tempfile.TemporaryDirectory(prefix="fmu-estimator-") as folder:
        path = Path(folder) / ("stdin" if file == STDIN else os.path.basename(file))
        path.write_bytes(sys.stdin.buffer.read() if file == STDIN else Path(file).read_bytes())
        yield path
