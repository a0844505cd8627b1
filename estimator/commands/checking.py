"""The command `check`: what is read of recordings, as text, JSON and figures. Loads no FMU."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.cases.expansion import told_apart
from estimator.commands.options import reading_of, unique
from estimator.commands.sources import recordings_of
from estimator.commands.terminal import BAD_INPUT, OK, columns, complain, say, say_lines
from estimator.errors import InputError
from estimator.recordings.files import recordings_in
from estimator.recordings.made_columns import with_constant_voltage
from estimator.recordings.preview import MOST_LEVELS, Preview, preview, preview_mapping
from estimator.recordings.understood import how_to_overrule
from estimator.results.result_json import json_ready
from estimator.results.text_table import TextTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INDENT = "  "
UNITS = {"v": "V", "i": "A", "w": "rad/s", "angle": "rad", "load": "N.m"}


def check(args: argparse.Namespace) -> int:
    """Show what is read of recordings, before any FMU."""
    for file in args.files:
        if file.endswith((".fmu", ".toml")):
            raise InputError(f"{file} is no recording; check looks at recordings alone, inspect at FMUs")
    scale, offset = unique(args.scale, option="--scale"), unique(args.offset, option="--offset")
    read_as = reading_of(args)
    fixed = unique(args.fix, option="--fix")
    if other := next((name for name in fixed if name != "v"), None):
        raise InputError(f"--fix {other}: check knows no parameters; it takes --fix v=VOLTS, of a constant voltage")
    previews: list[Preview] = []
    faults: list[str] = []
    with recordings_of(args.files, command="check") as paths:
        alone = len(paths) == 1 or args.json or args.output or args.mend  # what is written is of all files, or is not
        for path, own in zip(paths, told_apart(paths), strict=True):
            try:
                read = [replace(r, name=own + r.name.removeprefix(path.stem)) for r in recordings_in(path, read_as)]
                read = [with_constant_voltage(r, fixed["v"]) for r in read] if fixed else read
                previews += [preview(recording, scale=scale, offset=offset) for recording in read]
            except InputError as error:
                if alone:
                    raise
                faults.append(str(error))
    if args.output:
        _write(args.output, previews)
    mended = []
    if args.mend:
        from estimator.commands.mending import mend

        mended = mend(previews, Path(args.mend), scale=scale, offset=offset)
    if args.json:
        say(_json(previews))
    else:
        say_lines("\n".join(preview_text(p, width=columns()) for p in previews) if previews else "")
        say_lines("".join(f"{line}\n" for line in ["", *mended] if mended))
    for fault in faults:
        complain(fault)
    return BAD_INPUT if faults else OK


def preview_text(p: Preview, *, width: int | None = None) -> str:
    """Return a preview as lines: what was read first, what is implausible last; its tables within a width."""
    recording = p.recording
    lines = [f"{recording.title}: {' · '.join(r.text() for r in p.read)}"]
    if p.unused:
        lines.append(f"  not used: {', '.join(p.unused)}")
    if guessed := [how_to_overrule(r) for r in p.read if r.unit_from == "name"]:
        lines.append(f"  another unit is said with {', '.join(guessed)}")
    lines += [f"  {sentence}" for sentence in recording.not_read]
    clock = "even" if recording.even else "with jitter, each time taken as printed"
    missing = f", {recording.missing_rows} rows missing" if recording.missing_rows else ""
    if p.repeated:
        missing += f", {p.repeated} rows are the row before once more: an estimate leaves them out"
    lines += [
        "",
        f"  clock    {len(recording.time)} samples from {recording.time[0]:.6g} to {recording.time[-1]:.6g} s, every"
        f" {recording.step:.6g} s ({1 / recording.step:.6g} Hz), {clock}{missing}",
        f"  input    {_excitation(p)}",
    ]
    if p.settled is not None:
        lines.append(f"  settled  {'no: ' + p.settled if p.settled else 'yes'}")
    header = ["", "least", "largest", "noise", "step", "missing"]
    rows = [
        [
            f"{name} [{UNITS[name]}]",
            f"{np.nanmin(y):.5g}" if not np.isnan(y).all() else "-",
            f"{np.nanmax(y):.5g}" if not np.isnan(y).all() else "-",
            f"{p.noise[name]:.2g}",
            f"{p.quanta[name]:.4g}" if name in p.quanta else "",
            str(int(np.isnan(y).sum())) if np.isnan(y).any() else "",
        ]
        for name, y in p.signals.items()
    ]
    lines += ["", *_table(header, rows, width)]
    if p.levels:
        names = [name for name in ("v", "i", "w", "load") if name in p.signals]
        header = ["level", "from [s]", "to [s]", *(f"{name} [{UNITS[name]}]" for name in names), "w [rpm]"]
        rows = [
            [
                str(k + 1),
                f"{level.start:.6g}",
                f"{level.end:.6g}",
                *(f"{level.means[name]:.4g}" if name in level.means else "" for name in names),
                f"{level.means['w'] * 30 / np.pi:.4g}" if "w" in level.means else "",
            ]
            for k, level in enumerate(p.levels[:MOST_LEVELS])
        ]
        lines += ["", *_table(header, rows, width)]
        if len(p.levels) > MOST_LEVELS:
            lines.append(f"  and {len(p.levels) - MOST_LEVELS} more levels")
    if p.found or p.findings:
        lines += [
            "",
            "Implausible:",
            *(f"  - {sentence}" for sentence in (*p.found, *(f.sentence for f in p.findings))),
            "Once the options are right, --mend OUT.csv writes a copy that needs none.",
        ]
    return "\n".join(lines) + "\n"


def _excitation(p: Preview) -> str:
    e = p.excitation
    if e is None:
        return "no voltage"
    running = "; the motor runs already in the first row" if e.running else ""
    if e.kind == "none":
        return f"stays at {e.after:.4g} V{running}"
    if e.kind == "several":
        return f"several levels or a signal that moves all the time{running}"
    late = f"; the response starts {p.delay:.4g} s later" if p.delay else ""
    return f"a step from {e.before:.4g} to {e.after:.4g} V at t = {p.recording.time[e.index]:.6g} s{late}{running}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], width: int | None) -> list[str]:
    inside = None if width is None else width - len(INDENT)
    found = TextTable(header, rows, range(len(header))).lines(inside)
    return [INDENT + line if line else "" for line in found]


def _json(previews: Sequence[Preview]) -> str:
    found = {"recordings": [preview_mapping(p) for p in previews]}
    return json.dumps(json_ready(found), indent=2, allow_nan=False) + "\n"


def _write(folder: str, previews: Sequence[Preview]) -> None:
    """Write check.json, and a figure of each recording."""
    from estimator.output import OutputFolder
    from estimator.results.plots import png

    names = [f"{p.recording.name.replace('/', '_')}.png" for p in previews]
    names = [name if names.count(name) == 1 else f"{k + 1}_{name}" for k, name in enumerate(names)]
    with OutputFolder(folder, own=("check.json", *names)) as output:
        figures = {name: png(preview_figure(p)) for name, p in zip(names, previews, strict=True)}
        output.write({"check.json": _json(previews).encode(), **figures})


def preview_figure(p: Preview) -> Figure:
    """Return a recording's signals below each other, in SI units."""
    from matplotlib.figure import Figure

    from estimator.results.panels import envelope
    from estimator.results.plots import finish

    fig = Figure(figsize=(9.0, 0.8 + 1.7 * len(p.signals)), layout="constrained")
    axes = fig.subplots(len(p.signals), 1, sharex=True, squeeze=False)[:, 0]
    read = {r.signal: r for r in p.read}
    for axis, (name, y) in zip(axes, p.signals.items(), strict=True):
        axis.plot(*envelope(p.recording.time, y), color="#0072b2", linewidth=1)
        axis.set_ylabel(f"{name} [{UNITS[name]}]")
        axis.set_title(read[name].text(), loc="left", fontsize="small")
        finish(axis)
    axes[-1].set_xlabel("time [s]")
    fig.suptitle(p.recording.title)
    return fig
