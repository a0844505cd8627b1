"""What the commands of one step each do: one function a command, from parsed arguments to an exit status."""

from __future__ import annotations

import argparse
import json
import shlex
import time
from pathlib import Path

from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.commands.terminal import FAILED, OK, PROGRAM, columns, complain, say, say_lines
from estimator.errors import InputError
from estimator.output import OutputFolder, check_not_read, write_files

INSPECTION_LIMIT = 45.0  # s of describing and probing


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
    from estimator.cases.init_case import MARK, case_text
    from estimator.commands.options import reading_of
    from estimator.fmus.fmu import describe
    from estimator.recordings.files import recordings_in

    _check_order(args.fmu, args.recording)
    output = Path(args.output) if args.output else None
    if output is not None and not output.name.endswith(CASE_SUFFIX):
        raise InputError(f"{output}: the name of a case file ends in {CASE_SUFFIX}; give -o {output.stem}{CASE_SUFFIX}")
    if output is not None and output.exists():
        raise InputError(f"{output} is there already; give another name with -o, or remove it")
    folder = Path.cwd() if output is None else output.absolute().parent
    read_as = reading_of(args)
    recording = recordings_in(Path(args.recording), read_as)[0]  # of several tests: their columns are alike
    text = case_text(describe(args.fmu), recording, fmu=args.fmu, folder=folder, read_as=read_as)
    if output is None:
        say(text)
        return OK
    write_files({output: text.encode()})
    marks = text.count(MARK) - 1  # its first lines say what the mark means
    say(f"{output}" + (f": {marks} thing{'s' if marks != 1 else ''} to fill in, marked TODO\n" if marks else "\n"))
    return OK


def _check_order(fmu: str, recording: str) -> None:
    """Refuse a recording in the place of the FMU, and an FMU in that of the recording."""
    from fmu_build import bundled_names

    if recording.endswith(".fmu") or (recording in bundled_names() and not Path(recording).exists()):
        raise InputError(f"{recording} is an FMU; init takes it first: {shlex.join([PROGRAM, 'init', recording, fmu])}")


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
    check_not_read(output, [args.model], option="-o")
    say(f"{fmu_build.build(args.model, output=output, fmi=args.fmi, platforms=args.platforms)}\n")
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
        say_lines(changes_text(found, width=columns()))
    return FAILED if found.differing else OK


def export(args: argparse.Namespace) -> int:
    """Write an estimate's files for other tools."""
    from estimator.results.handover import without_units
    from estimator.results.handover_files import handover_files, read_result

    source = Path(args.result)
    result = read_result(source)
    if result.verdict != "ok":
        complain(f"the estimate is {result.verdict}: {'; '.join(result.reasons)}")
    if sentence := without_units(result):
        complain(sentence)
    files, left_out = handover_files(result, formats=args.formats, fmu=args.fmu)
    with OutputFolder(args.output or (source if source.is_dir() else source.parent)) as folder:
        folder.write(files)
        say_lines(f"Written to {folder.path}: {', '.join(sorted(files))}\n")
    for sentence in left_out:
        say_lines(f"Left out, {sentence}\n")
    return OK


def app(args: argparse.Namespace) -> int:
    """Serve the bench to this machine's browser until Ctrl-C."""
    try:
        from estimator.app.server import serve
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        raise InputError("the app needs starlette and uvicorn; pip install 'fmu-estimator[app]'") from None
    return serve(args.folder, port=args.port, browser=not args.no_browser, say=say)


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
