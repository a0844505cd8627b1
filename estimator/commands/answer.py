"""How an estimate is given: text on the terminal, files in a folder, the exit status. Estimates nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.commands.terminal import FAILED, OK, columns, say
from estimator.errors import InputError
from estimator.output import OutputFolder

if TYPE_CHECKING:
    from estimator.cases.case import Case
    from estimator.results.export import Begin
    from estimator.results.result import Estimate

SCREEN = 39  # lines that an answer may take of a terminal of 40: below it stands the prompt


def json_of(result: Estimate) -> str:
    """Return the result as one JSON object."""
    from estimator.results.result_json import to_json

    return to_json(result)


def text_of(result: Estimate, *, folder: str | None = None) -> str:
    """Return the result as text: whole into a file or a pipe, a screen of it on a terminal."""
    from estimator.results.report_text import REST, text_report

    if (width := columns()) is None:
        return text_report(result)
    rest = REST if folder is None else f"in {Path(folder) / 'report.html'}"
    return text_report(result, width=width, lines=SCREEN, rest=rest)


def say_whole(result: Estimate, *, unless: str) -> None:
    """Give a person all of a result whose files could not be written, where a screen of it was given before."""
    from estimator.results.report_text import text_report

    if (width := columns()) is None:
        return
    whole = text_report(result, width=width)
    if whole != unless:
        say(f"\nNot all could be written, so here is the whole answer:\n\n{whole}")


@contextlib.contextmanager
def drawing(figures: Sequence[str]) -> Iterator[Begin | None]:
    """Load what draws figures for print while the estimation runs, if there are such."""
    if not figures:
        yield None
        return
    from estimator.results.figure_process import FigureProcess

    with FigureProcess() as process:
        yield process.begin


def write_results(
    folder: OutputFolder,
    result: Estimate,
    case: Case,
    *,
    command: str,
    figures: Sequence[str] = (),
    signals: bool = False,
    begin: Begin | None = None,
) -> None:
    """Write all result files, and remove those of an earlier run that this one does not have."""
    from estimator.results.export import RESULT_FILES, result_files
    from estimator.results.signals import SIGNALS_FILE, signals_file

    sources = [case.path, result.fmu.get("path"), *case.recordings]
    files = result_files(result, command=command, sources=[s for s in sources if s], figures=figures, begin=begin)
    if signals:
        files[SIGNALS_FILE] = signals_file(result)
    every = (*RESULT_FILES, SIGNALS_FILE)
    try:
        folder.write(files, stale=every)
    except InputError as error:  # a full disk may have room for the numbers
        try:
            folder.write({"result.json": files["result.json"]}, stale=every)
        except InputError:
            raise error from None
        raise InputError(f"{error}; result.json alone is there, so make room for the rest") from error


def status(result: Estimate) -> int:
    """Return the exit status."""
    return FAILED if result.verdict == "refused" else OK
