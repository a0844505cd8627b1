"""The command `estimate`: from a case or recordings to a result on the terminal and in a folder. Knows no method."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.commands.answer import drawing, json_of, say_whole, status, text_of, write_results
from estimator.commands.options import (
    reading_of,
    unique,
    with_corrections,
    with_held_out,
    with_options,
    with_tolerances,
)
from estimator.commands.sources import STDIN, case_of, expanded, is_stream
from estimator.commands.terminal import complain, say
from estimator.errors import InputError
from estimator.estimating.progress import LiveLine, Progress, is_live
from estimator.output import OutputFolder, check_not_read

if TYPE_CHECKING:
    from estimator.cases.case import Case
    from estimator.results.result import Estimate


def estimate(args: argparse.Namespace) -> int:
    """Estimate parameters from a case file or recordings; print them, and write them with ``-o``."""
    with case_of(args.sources) as case:
        return _estimate(args, _with_arguments(case, args))


def _estimate(args: argparse.Namespace, case: Case) -> int:
    args.method, args.seed = case.search.method, case.search.seed
    if args.save_case:
        from estimator.cases.written_case import write_case

        if stream := next(filter(is_stream, args.sources), None):
            name = "stdin" if stream == STDIN else stream
            raise InputError(f"--save-case names the recording's file, and {name} is none; save it to a file first")
        if Path(args.save_case).exists():
            raise InputError(f"{args.save_case} is there already; give another name with --save-case, or remove it")
        write_case(case, Path(args.save_case))
    if args.progress_json is not None:
        check_not_read(Path(args.progress_json), [*case.recordings, *args.sources], option="--progress-json")
    if args.figures and not args.output:
        raise InputError("--figures needs a folder to write to; give one with -o")
    if args.signals and not args.output:
        raise InputError("--signals needs a folder to write to; give one with -o")
    with (
        OutputFolder(args.output) if args.output else contextlib.nullcontext() as folder,
        drawing(args.figures) as begin,
    ):
        result = estimated(
            case,
            workers=args.workers,
            quiet=args.quiet,
            profile=folder is not None,
            checkpoint=args.checkpoint,
            progress_json=args.progress_json,
        )
        text = json_of(result) if args.json else text_of(result, folder=args.output)
        try:
            say(text)  # before the files: a disk that is full, or Ctrl-C while figures are drawn, cannot lose it
        finally:
            if folder is not None:
                try:
                    write_results(
                        folder,
                        result,
                        case,
                        command=args.command_line,
                        figures=args.figures,
                        signals=args.signals,
                        begin=begin,
                    )
                except InputError:
                    say_whole(result, unless=text)  # the report, which has the rest of it, is not there
                    raise
    return status(result)


def _with_arguments(case: Case, args: argparse.Namespace) -> Case:
    """Return the case with what the other arguments of `estimate` say."""
    case = with_options(
        case,
        fmu=args.fmu,
        kind=args.kind,
        method=args.method,
        seed=args.seed,
        fix=args.fix,
        bounds=args.bounds,
        loss=args.loss,
        starts=args.start,
    )
    case = with_corrections(
        case,
        window=args.window,
        scale=args.scale,
        offset=args.offset,
        temperature=args.temperature,
        read_as=reading_of(args),
    )
    case = with_tolerances(case, args.tolerance)
    case = dataclasses.replace(case, about={**case.about, **unique(args.about, option="--about")})
    return with_held_out(case, expanded(args.validate), fitted=len(case.recordings))


def estimated(
    case: Case,
    *,
    workers: int | None,
    quiet: bool,
    profile: bool,
    checkpoint: str | None = None,
    progress_json: str | None = None,
) -> Estimate:
    """Run the estimation with its progress on the terminal, journalled if there is a checkpoint."""
    from estimator.estimating.estimate import estimate as run

    live = LiveLine(sys.stderr) if is_live(sys.stderr) and not quiet else None

    def announce(sentence: str) -> None:
        if live is not None:
            live.wipe()
        complain(sentence)

    tell = None if quiet else announce
    with live or contextlib.nullcontext() as line, _streamed(progress_json) as stream:
        progress = _both(line, stream)
        if checkpoint is None:
            return run(case, workers=workers, progress=progress, tell=tell, profile=profile)
        from estimator.batches.batch import Digests
        from estimator.batches.case_worker import Task
        from estimator.estimating.checkpoint import Journal, JournalledWorkers
        from estimator.estimating.estimate import available_cores, estimate_by

        digest = Digests().of(Task("", case))
        with (
            Journal(Path(checkpoint), digest=digest) as journal,
            JournalledWorkers(workers or available_cores(), journal=journal) as crew,
        ):
            result = estimate_by(crew, case, progress=progress, tell=tell, profile=profile)
            journal.remove()
            return result


def _streamed(path: str | None) -> contextlib.AbstractContextManager[Callable[[Progress], None] | None]:
    """Return what writes progress to a file; None for no file."""
    if path is None:
        return contextlib.nullcontext()
    from estimator.estimating.progress_stream import ProgressStream

    return ProgressStream(path)


def _both(
    one: Callable[[Progress], None] | None, other: Callable[[Progress], None] | None
) -> Callable[[Progress], None] | None:
    """Return what tells both, or the one that is there."""
    if one is None or other is None:
        return one or other

    def tell(event: Progress) -> None:
        one(event)
        other(event)

    return tell
