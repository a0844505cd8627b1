"""What each command does: one function a command, from parsed arguments to an exit status."""

from __future__ import annotations

import argparse
import contextlib
import csv
import dataclasses
import functools
import io
import json
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator.commands.options import reading, unique, with_corrections, with_held_out, with_options, with_tolerances
from estimator.commands.sources import CASE_SUFFIX, STDIN, case_of
from estimator.commands.terminal import FAILED, INTERRUPTED, OK, PROGRAM, complain, say, say_lines
from estimator.errors import FmuError, InputError, SimulationError
from estimator.estimating.progress import LiveLine, Progress, batch_line, is_live, is_terminal
from estimator.output import OutputFolder, write_files

if TYPE_CHECKING:
    from estimator.batches.batch import Run
    from estimator.batches.resample import Kind
    from estimator.cases.case import Case
    from estimator.fmus.fmu import FmuDescription
    from estimator.results.export import Begin
    from estimator.results.result import Estimate, FloatArray

READING = ("column", "unit", "rate", "test", "motor", "per_turn", "counts", "supply")
DEFAULT_STOP, DEFAULT_STEP = 2.8, 1e-3  # s
SCREEN = 39  # lines that an answer may take of a terminal of 40: below it stands the prompt
INSPECTION_LIMIT = 45.0  # s of describing and probing


def demo(args: argparse.Namespace) -> int:
    """Emulate the paper's bench, estimate its motor from the recording, and write everything to a folder."""
    if args.paper_figures:
        return _paper_figures(args)
    if args.nests or args.iterations:
        raise InputError("--nests and --iterations are those of --paper-figures; give that too, or leave them out")
    from estimator.results.export import RESULT_FILES

    with OutputFolder(args.output, own=("recording.csv", *RESULT_FILES)) as folder:
        from estimator.cases.case import ParameterSpec, case_for_recording
        from estimator.commands import demo as bench

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
        result = _estimated(case, workers=None, quiet=args.quiet, profile=True)
        try:
            say(_text(result, folder=args.output))
        finally:
            _write_results(folder, result, case, command=f"fmu-estimator estimate {recording}")
        say_lines(f"\nWritten to {folder.path}: {', '.join(sorted(p.name for p in folder.path.iterdir()))}\n")
    return _status(result)


def estimate(args: argparse.Namespace) -> int:
    """Estimate parameters from a case file or recordings; print them, and write them with ``-o``."""
    with case_of(args.sources) as case:
        return _estimate(args, _with_arguments(case, args))


def _estimate(args: argparse.Namespace, case: Case) -> int:
    args.method, args.seed = case.search.method, case.search.seed
    if args.save_case:
        from estimator.cases.case import write_case

        if STDIN in args.sources:
            raise InputError("--save-case names the recording's file, and stdin is none; save it to a file first")
        if Path(args.save_case).exists():
            raise InputError(f"{args.save_case} is there already; give another name with --save-case, or remove it")
        write_case(case, Path(args.save_case))
    if args.figures and not args.output:
        raise InputError("--figures needs a folder to write to; give one with -o")
    if args.signals and not args.output:
        raise InputError("--signals needs a folder to write to; give one with -o")
    with OutputFolder(args.output) if args.output else contextlib.nullcontext() as folder, _drawing(folder) as begin:
        result = _estimated(
            case,
            workers=args.workers,
            quiet=args.quiet,
            profile=folder is not None,
            checkpoint=args.checkpoint,
            progress_json=args.progress_json,
        )
        text = _json(result) if args.json else _text(result, folder=args.output)
        try:
            say(text)  # before the files: a disk that is full, or Ctrl-C while figures are drawn, cannot lose it
        finally:
            if folder is not None:
                try:
                    _write_results(
                        folder,
                        result,
                        case,
                        command=args.command_line,
                        figures=args.figures,
                        signals=args.signals,
                        begin=begin,
                    )
                except InputError:
                    _say_whole(result, unless=text)  # the report, which has the rest of it, is not there
                    raise
    return _status(result)


def check(args: argparse.Namespace) -> int:
    """Show what is read of recordings, before any FMU."""
    from estimator.commands.checking import check_files

    return check_files(args, reading(**reading_arguments(args)))


def simulate(args: argparse.Namespace) -> int:
    """Simulate an FMU once and give what comes out as CSV, in SI units."""
    from estimator.cases.si_units import in_si_units
    from estimator.commands.drive import settable
    from estimator.fmus.fmu import describe, with_kind
    from estimator.fmus.probe import driven

    read = with_kind(describe(args.fmu), args.kind)
    description = in_si_units(read)
    settings = unique(args.settings, option="--set")
    parameters = {name: value for name, value in settings.items() if settable(description, name) == "parameter"}
    times, inputs = _drive(description, args)
    for name, value in settings.items():
        if name not in parameters:
            if name in inputs:
                raise InputError(f"the input {name!r} is given twice, by --set and by the drive; leave one out")
            inputs[name] = times * 0 + value
    from estimator.fmus.simulate import simulate as simulate_fmu

    try:
        outputs = simulate_fmu(in_si_units(driven(read)), parameters=parameters, inputs=inputs, times=times)
    except SimulationError as error:
        raise FmuError(str(error)) from error
    units = {variable.name: variable.unit for variable in description.variables}
    columns = {"time [s]": times}
    for signals in (inputs, outputs):
        columns |= {f"{n} [{units[n]}]" if units.get(n) else n: signal for n, signal in signals.items()}
    if args.output:
        write_files({Path(args.output): csv_bytes(columns)})
    else:
        say(csv_bytes(columns).decode())
    return OK


def inspect(args: argparse.Namespace) -> int:
    """Show what an FMU is, and within a minute how it behaves, whatever it does."""
    began = time.monotonic()
    from estimator.commands.inspection import inspection_mapping, inspection_text
    from estimator.fmus.fmu import describe, with_kind

    description = with_kind(describe(args.fmu, validate=True), args.kind)
    found = {}
    if not args.static:
        from estimator.fmus.probe import probe_kinds

        kinds = (args.kind,) if args.kind else description.kinds or (description.kind,)
        found = probe_kinds(description, kinds, limit=INSPECTION_LIMIT - (time.monotonic() - began))
    if args.json:
        say(json.dumps(inspection_mapping(description, found), indent=2, allow_nan=False) + "\n")
    else:
        say_lines(inspection_text(description, found))
    return OK


def init(args: argparse.Namespace) -> int:
    """Guess a case file and give its text."""
    from estimator.cases.init_case import case_text
    from estimator.fmus.fmu import describe
    from estimator.recordings.files import recordings_in

    output = Path(args.output) if args.output else None
    if output is not None and not output.name.endswith(CASE_SUFFIX):
        raise InputError(f"{output}: the name of a case file ends in {CASE_SUFFIX}; give -o {output.stem}{CASE_SUFFIX}")
    if output is not None and output.exists():
        raise InputError(f"{output} is there already; give another name with -o, or remove it")
    folder = Path.cwd() if output is None else output.absolute().parent
    recording = recordings_in(Path(args.recording))[0]  # of several tests: their columns are alike
    text = case_text(describe(args.fmu), recording, fmu=args.fmu, folder=folder)
    if output is None:
        say(text)
        return OK
    write_files({output: text.encode()})
    marks = text.count("TODO") - 1
    say(f"{output}" + (f": {marks} thing{'s' if marks != 1 else ''} to fill in, marked TODO\n" if marks else "\n"))
    return OK


def new_model(args: argparse.Namespace) -> int:
    """Write a model file to start from and print its path."""
    import fmu_build

    say(f"{fmu_build.new_model(args.name, folder=Path())}\n")
    return OK


def build(args: argparse.Namespace) -> int:
    """Compile a model into an FMU and print its path."""
    import fmu_build

    output = Path(args.output) if args.output else Path(Path(args.model).stem + ".fmu")
    if output.is_dir() or str(args.output or "").endswith("/"):
        raise InputError(f"{output} is a folder; give -o the name of a file, such as {output / 'model.fmu'}")
    say(f"{fmu_build.build(args.model, output=output, fmi=args.fmi, platforms=args.platforms)}\n")
    return OK


def batch(args: argparse.Namespace) -> int:
    """Estimate many cases and write their table."""
    if args.watch is not None:
        return _watch(args)
    if args.then is not None or args.settled is not None:
        raise InputError("--then and --settled are those of --watch; give that too, or leave them out")
    if not args.sources:
        raise InputError("no case is given; give case files, folders of them, or recordings")
    from estimator.batches.batch import BatchProgress, gather, last_line, repeated, run_batch, with_reports

    cases = gather([Path(source) for source in args.sources], report=args.report)
    for _, outcome in cases.unread:
        complain(outcome.row["reasons"][0])
    kind: Kind | None = "monte-carlo" if args.monte_carlo else "bootstrap" if args.bootstrap else None
    if kind is not None:
        cases = repeated(cases, kind=kind, count=args.monte_carlo or args.bootstrap)
    cases = with_reports(cases, args.report_of)
    folder = Path(args.output)
    live = LiveLine(sys.stderr) if is_live(sys.stderr) and not args.quiet else None

    def show(p: BatchProgress) -> None:
        if live is not None:
            live.draw(lambda s: batch_line(done=p.done, total=p.total, kept=p.kept, verdicts=p.verdicts, seconds=s))

    try:
        with live or contextlib.nullcontext():
            how: dict[str, Any] = {"resume": args.resume, "parquet": args.parquet, "command": _batch_command(args)}
            result = run_batch(cases, folder, _runner(args), progress=show, **how)
    except KeyboardInterrupt:
        complain(f"interrupted; what is done is in {folder}, go on with --resume")
        return INTERRUPTED
    from estimator.batches.gauge import statistics_text

    statistics = statistics_text(result.rows)
    say("\n".join([*statistics, *([""] if statistics else []), last_line(result, table=folder / "results.csv")]) + "\n")
    return FAILED if result.verdicts.keys() - {"ok", "doubtful"} else OK


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
    sources = [Path(source) for source in args.sources]
    incoming = Incoming(Path(args.watch), sources, Path(args.output), report=args.report, **settled)
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


def compare(args: argparse.Namespace) -> int:
    """Say what differs between results; write it as files with ``-o``."""
    if len(args.results) < 2:
        raise InputError("one result alone cannot be compared; give two or more, the reference first")
    from estimator.results.changes import changes
    from estimator.results.changes_shown import changes_mapping, changes_page, changes_svg, changes_text
    from estimator.results.handover_files import read_result, told_results

    sources = [Path(source) for source in args.results]
    results = dict(zip(told_results(sources), map(read_result, sources), strict=True))
    found = changes(results, false_alarm=args.false_alarm, within=args.within)
    text = json.dumps(changes_mapping(found), indent=2, allow_nan=False) + "\n"
    if args.output:
        files = {
            "compare.html": changes_page(found, command=args.command_line).encode(),
            "compare.svg": changes_svg(found),
            "compare.json": text.encode(),
        }
        with OutputFolder(args.output) as folder:
            folder.write(files)
    if args.json:
        say(text)
    else:
        say_lines(changes_text(found))
    return FAILED if found.differing else OK


def export(args: argparse.Namespace) -> int:
    """Write an estimate's files for other tools."""
    from estimator.results.handover_files import handover_files, read_result

    source = Path(args.result)
    result = read_result(source)
    if result.verdict != "ok":
        complain(f"the estimate is {result.verdict}: {'; '.join(result.reasons)}")
    files, left_out = handover_files(result, formats=args.formats, fmu=args.fmu)
    with OutputFolder(args.output or (source if source.is_dir() else source.parent)) as folder:
        folder.write(files)
        say_lines(f"Written to {folder.path}: {', '.join(sorted(files))}\n")
    for sentence in left_out:
        say_lines(f"Left out, {sentence}\n")
    return OK


def completion(args: argparse.Namespace) -> int:
    """Print a shell's completion script."""
    from estimator.commands.completion import completion as script

    say(script(args.whole(), args.shell))
    return OK


def schema(args: argparse.Namespace) -> int:
    """Give the JSON Schema of case files."""
    from estimator.cases.schema import schema as case_schema

    text = json.dumps(case_schema(), indent=2) + "\n"
    if args.output:
        write_files({Path(args.output): text.encode()})
    else:
        say(text)
    return OK


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


def csv_bytes(columns: Mapping[str, FloatArray]) -> bytes:
    """Return columns of equal length as CSV, exact to the bit; a missing sample (NaN) is an empty cell."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    writer.writerows(["" if value != value else repr(value) for value in row] for row in rows)
    return stream.getvalue().encode()


def _runner(args: argparse.Namespace) -> Run:
    """Return what runs the cases of `batch`: processes here, or a Dask cluster."""
    if args.dask is not None:
        from estimator.batches.cluster import run_there

        return run_there(args.dask)
    from estimator.batches.worker_pool import run_here
    from estimator.estimating.estimate import available_cores

    return functools.partial(run_here, processes=args.workers or available_cores())


def _drive(description: FmuDescription, args: argparse.Namespace) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the times and the inputs over them that the arguments of `simulate` mean."""
    from estimator.commands.drive import inputs_from, instants, stepped_voltage, voltage_input

    if args.input is not None:
        if args.stop is not None or args.step is not None:
            raise InputError("--stop and --step come from the file of --input; leave them out")
        return inputs_from(Path(args.input), description)
    stop, step = args.stop or DEFAULT_STOP, args.step or DEFAULT_STEP
    if step > stop:
        raise InputError(f"--step {step:g} is longer than --stop {stop:g}; give a smaller step")
    times = instants(stop=stop, step=step)
    if args.voltage_step is None:
        return times, {}
    level, at = args.voltage_step
    return times, {voltage_input(description): stepped_voltage(times, level=level, at=at)}


def reading_arguments(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options that say how a file is to be read."""
    return {name: getattr(args, name) for name in READING}


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
        read_as=reading(**reading_arguments(args)),
    )
    case = with_tolerances(case, args.tolerance)
    case = dataclasses.replace(case, about={**case.about, **unique(args.about, option="--about")})
    return with_held_out(case, args.validate, fitted=len(case.recordings))


def _estimated(
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


@contextlib.contextmanager
def _drawing(folder: OutputFolder | None) -> Iterator[Begin | None]:
    """Load what draws while the estimation runs, if there is a folder to draw for."""
    if folder is None:
        yield None
        return
    from estimator.results.figure_process import FigureProcess

    with FigureProcess() as process:
        yield process.begin


def _write_results(
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


def app(args: argparse.Namespace) -> int:
    """Serve the bench to this machine's browser until Ctrl-C."""
    try:
        from estimator.app.server import serve
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        raise InputError("the app needs starlette and uvicorn; pip install 'fmu-estimator[app]'") from None
    return serve(args.folder, port=args.port, browser=not args.no_browser, say=say)


def _json(result: Estimate) -> str:
    from estimator.results.report import to_json

    return to_json(result)


def _text(result: Estimate, *, folder: str | None = None) -> str:
    """Return the result as text: whole into a file or a pipe, a screen of it on a terminal."""
    from estimator.results.report import REST, text_report

    if not is_terminal(sys.stdout):
        return text_report(result)
    columns = shutil.get_terminal_size().columns
    rest = REST if folder is None else f"in {Path(folder) / 'report.html'}"
    return text_report(result, width=columns, lines=SCREEN, rest=rest)


def _say_whole(result: Estimate, *, unless: str) -> None:
    """Give a person all of a result whose files could not be written, where a screen of it was given before."""
    from estimator.results.report import text_report

    if not is_terminal(sys.stdout):
        return
    whole = text_report(result, width=shutil.get_terminal_size().columns)
    if whole != unless:
        say(f"\nNot all could be written, so here is the whole answer:\n\n{whole}")


def _status(result: Estimate) -> int:
    return FAILED if result.verdict == "refused" else OK
