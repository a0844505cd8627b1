"""The command `demo`: the paper's bench emulated and its motor estimated, or the paper's figures drawn."""

from __future__ import annotations

import argparse
import dataclasses
import sys

from estimator.commands.answer import status, text_of, write_results
from estimator.commands.csv_text import csv_bytes
from estimator.commands.estimation import estimated
from estimator.commands.terminal import OK, say, say_lines
from estimator.errors import InputError
from estimator.output import OutputFolder


def demo(args: argparse.Namespace) -> int:
    """Emulate the paper's bench, estimate its motor from the recording, and write everything to a folder."""
    if args.paper_figures:
        return _paper_figures(args)
    if args.nests or args.iterations:
        raise InputError("--nests and --iterations are those of --paper-figures; give that too, or leave them out")
    from estimator.results.export import RESULT_FILES

    with OutputFolder(args.output, own=("recording.csv", *RESULT_FILES)) as folder:
        from estimator.cases.case import ParameterSpec, case_for_recording
        from estimator.commands import paper_bench as bench

        recording = folder.path / "recording.csv"
        columns = bench.emulated_recording()
        folder.write({recording.name: csv_bytes(columns)})
        say_lines(
            f"The paper's bench, emulated: {bench.MOTOR}, {bench.VOLTAGE} V at {bench.STEP_AT} s, "
            f"{bench.STOP} s at {1 / bench.STEP:.0f} Hz, with noise.\n\n"
        )
        case = case_for_recording(recording)
        nominal = {name: ParameterSpec(name, nominal=value) for name, value in bench.NOMINAL.items()}
        case = dataclasses.replace(case, parameters=nominal)
        result = estimated(case, workers=None, quiet=args.quiet, profile=True)
        try:
            say(text_of(result, folder=args.output))
        finally:
            write_results(folder, result, case, command=f"fmu-estimator estimate {recording}")
        say_lines(f"\nWritten to {folder.path}: {', '.join(sorted(p.name for p in folder.path.iterdir()))}\n")
    return status(result)


def _paper_figures(args: argparse.Namespace) -> int:
    """Draw the paper's figures and write them to a folder."""
    names = {f"figure{number}.{kind}" for number in range(3, 11) for kind in ("png", "svg", "pdf")}
    with OutputFolder(args.output, own=names) as folder:
        from estimator.commands.paper_figures import paper_figures
        from estimator.results.plots import rendered

        def tell(sentence: str) -> None:
            if not args.quiet:
                print(sentence, file=sys.stderr, flush=True)

        paper = paper_figures(nests=args.nests, iterations=args.iterations, tell=tell)
        for number, figure in paper.figures.items():
            folder.write({f"figure{number}.{kind}": rendered(figure, kind) for kind in ("png", "svg", "pdf")})
        say("\n".join(paper.lines) + f"\n\nWritten to {folder.path}: figures 3 to 10, each as PNG, SVG and PDF\n")
    return OK
