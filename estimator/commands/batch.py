"""The command `batch`: many cases, or what appears in a folder. Knows no estimation."""

from __future__ import annotations

import argparse
import contextlib
import functools
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator.commands.sources import filled_in
from estimator.commands.terminal import FAILED, INTERRUPTED, OK, PROGRAM, complain, say
from estimator.errors import InputError
from estimator.estimating.progress import LiveLine, batch_line, is_live, stage_line

if TYPE_CHECKING:
    from estimator.batches.batch import Run
    from estimator.batches.drawn import Kind


def batch(args: argparse.Namespace) -> int:
    """Estimate many cases and write their table."""
    if args.watch is not None:
        return _watch(args)
    if args.then is not None or args.settled is not None:
        raise InputError("--then and --settled are those of --watch; give that too, or leave them out")
    if not args.sources:
        raise InputError("no case is given; give case files, folders of them, or recordings")
    from estimator.batches.batch import BatchProgress, gather, last_line, repeated, run_batch, with_reports

    cases = gather(_sources(args), report=args.report)
    for _, outcome in cases.unread:
        complain(outcome.row["reasons"][0])
    kind: Kind | None = "monte-carlo" if args.monte_carlo else "bootstrap" if args.bootstrap else None
    folder = Path(args.output)
    live = LiveLine(sys.stderr) if is_live(sys.stderr) and not args.quiet else None

    def show(p: BatchProgress) -> None:
        if live is not None:
            live.draw(lambda s: batch_line(done=p.done, total=p.total, kept=p.kept, verdicts=p.verdicts, seconds=s))

    def begin(what: str) -> None:
        if live is not None:
            live.draw(lambda s: stage_line(what, seconds=s))

    try:
        with live or contextlib.nullcontext():
            if kind is not None:
                begin("fits to be repeated")
                cases = repeated(cases, kind=kind, count=args.monte_carlo or args.bootstrap)
            cases = with_reports(cases, args.report_of)
            if args.dask is not None:
                begin(f"connection with {args.dask}")
            how: dict[str, Any] = {"resume": args.resume, "parquet": args.parquet, "command": _batch_command(args)}
            result = run_batch(cases, folder, _runner(args), progress=show, **how)
    except KeyboardInterrupt:
        done = f"what is done is in {folder}, go on with --resume" if folder.is_dir() else "no case was begun"
        complain(f"interrupted; {done}")
        return INTERRUPTED
    from estimator.batches.gauge import statistics_text

    statistics = statistics_text(result.rows)
    say("\n".join([*statistics, *([""] if statistics else []), last_line(result, table=folder / "results.csv")]) + "\n")
    return FAILED if result.verdicts.keys() - {"ok", "doubtful"} else OK


def _sources(args: argparse.Namespace) -> list[Path]:
    """Return the files and folders that are given, patterns filled in, as `estimate` does."""
    return [Path(file) for word in args.sources for file in filled_in(word)]


def _batch_command(args: argparse.Namespace) -> str:
    """Return the command of a batch without what says how it runs."""
    many = ["--monte-carlo", str(args.monte_carlo)] if args.monte_carlo else []
    many = ["--bootstrap", str(args.bootstrap)] if args.bootstrap else many
    return shlex.join([PROGRAM, "batch", *args.sources, *many, "-o", args.output])


def _watch(args: argparse.Namespace) -> int:
    """Estimate what appears in a folder, until Ctrl-C."""
    if args.monte_carlo or args.bootstrap:
        raise InputError("--monte-carlo and --bootstrap repeat cases that are there; leave them out, or --watch")
    from estimator.batches.incoming import Incoming
    from estimator.batches.watch import Teller, watch

    settled = {} if args.settled is None else {"settled": args.settled}
    incoming = Incoming(Path(args.watch), _sources(args), Path(args.output), report=args.report, **settled)
    teller = None if args.then is None else Teller(args.then)
    if not args.quiet:
        complain(f"watching {incoming.folder}; the page is {incoming.output / 'index.html'}; Ctrl-C ends it")
    with contextlib.suppress(KeyboardInterrupt):  # that is how it is ended
        watch(
            incoming,
            _runner(args),
            teller=teller,
            parquet=args.parquet,
            say=lambda line: say(f"{line}\n"),
            complain=complain,
        )
    return OK


def _runner(args: argparse.Namespace) -> Run:
    """Return what runs the cases of `batch`: processes here, or a Dask cluster."""
    if args.dask is not None:
        from estimator.batches.cluster import run_there

        return run_there(args.dask)
    from estimator.batches.worker_pool import run_here
    from estimator.estimating.estimate import available_cores

    return functools.partial(run_here, processes=args.workers or available_cores())
