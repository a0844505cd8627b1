"""A recording written anew as the program reads it, and what is changed in it. Judges nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from estimator.commands.csv_text import csv_bytes
from estimator.errors import InputError
from estimator.output import check_not_read, write_files
from estimator.recordings.headers import ROLE_QUANTITY, ROLE_TITLE
from estimator.recordings.preview import Preview
from estimator.recordings.understood import Understood
from estimator.recordings.units import unit_of


def mend(
    previews: Sequence[Preview], out: Path, *, scale: Mapping[str, float], offset: Mapping[str, float]
) -> list[str]:
    """Write the one recording that was read as CSV in SI units; return lines that say what is changed.

    Raises
    ------
    InputError
        There are several recordings, or the file is the recording's own, or it cannot be written.
    """
    if len(previews) > 1:
        titles = ", ".join(p.recording.title for p in previews)
        raise InputError(
            f"--mend writes one recording, and these are {len(previews)} ({titles}); name one file, or one of its tests"
            " with --test"
        )
    (p,) = previews
    source = p.recording.path
    check_not_read(out, [] if source is None else [source], option="--mend")
    columns = {"time": p.recording.time, **p.signals}
    write_files({out: csv_bytes({_heading(name): column for name, column in columns.items()})})
    changed = [_change(read) for read in p.read if read.column != _heading(read.signal)]
    changed += [f"{name}: × {factor:g}, as you said" for name, factor in scale.items()]
    changed += [f"{name}: {added:+g}, as you said" for name, added in offset.items()]
    if p.unused:
        changed.append(f"left out, as the program does not use them: {', '.join(p.unused)}")
    changed += p.recording.not_read
    if p.recording.missing_rows:
        changed.append(f"{p.recording.missing_rows} rows that are missing are there, with empty cells")
    if p.recording.origin:
        changed.append("the time counts from the first row on")
    written = f"{out} holds {len(p.recording.time)} rows of {p.recording.title}, in SI units:"
    return [written, *(f"  - {line}" for line in changed or ["nothing is changed but how the numbers are printed"])]


def _heading(signal: str) -> str:
    return f"{ROLE_TITLE[signal]} [{unit_of(ROLE_QUANTITY[signal]).si}]"


def _change(read: Understood) -> str:
    """Say what a column of the new file was."""
    if read.unit_from == "made":
        return f"{_heading(read.signal)} ← made of {read.column}"
    si = unit_of(ROLE_QUANTITY[read.signal]).si
    unit = "" if read.unit in ("", si) else f", {read.unit} made {si}"
    guess = ", which nobody said: --unit says another" if read.is_guess else ""
    return f"{_heading(read.signal)} ← {read.column}{unit or (f', taken as {si}' if guess else '')}{guess}"
