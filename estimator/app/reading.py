"""What was read from a recording's file, for the page: columns, units, clock, gaps, samples that stand alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator.app.series import Series, gaps, outliers
from estimator.errors import RecordingError
from estimator.recordings.headers import ROLE_TITLE, parse_header, rank_in_role
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import Recording

FIRST = 4  # samples that are shown of a column without a name


def series_of(recording: Recording) -> Series:
    """Return a recording's columns, SI."""
    return Series(recording.time, recording.signals)


def reading_options(read_as: ReadAs) -> list[str]:
    """Return how a file is read as options of the command line."""
    said = [f"--column={role}={column}" for role, column in read_as.columns.items()]
    said += [f"--unit={name}={unit}" for name, unit in read_as.units.items()]
    for key in ("test", "motor", "supply"):
        said += [f"--{key}={text}"] if (text := getattr(read_as, key)) is not None else []
    for key in ("counts", "per_turn", "rate"):
        said += [f"--{key.replace('_', '-')}={value:.12g}"] if (value := getattr(read_as, key)) is not None else []
    return said


def bare_facts(recording: Recording, lacks: Sequence[str]) -> dict[str, Any]:
    """Return what a file without a header or a time holds, so that a person can say what is what.

    Parameters
    ----------
    recording : Recording
        As read with its columns numbered, if need be, and a row a second.
    lacks : "header", "time"
    """
    first = {name: recording.signals[name][:FIRST].tolist() for name in recording.headers if name in recording.signals}
    return {
        "lacks": list(lacks),
        "samples": len(recording.time),
        "columns": [
            {"header": header, "first": [v if np.isfinite(v) else None for v in first.get(name, [])]}
            for name, header in recording.headers.items()
        ],
    }


def facts(recording: Recording, *, written: Mapping[str, str]) -> dict[str, Any]:
    """Return what was read, as plain data.

    Parameters
    ----------
    written : column → its header in the file, where a unit was said that may be another
    """
    series, own = series_of(recording), _usual_targets(recording)
    return {
        "title": recording.title,
        "samples": len(recording.time),
        "begin": float(recording.time[0]),
        "end": float(recording.time[-1]),
        "step": recording.step,
        "even": recording.even,
        "missing_rows": recording.missing_rows,
        "columns": [
            _column(recording, series, name, written.get(name)) | {"own": own.get(name, "")}
            for name in recording.headers
        ],
    }


def _usual_targets(recording: Recording) -> dict[str, str]:
    """Return what each column is put on where the case does not say it: column → "inputs v"."""
    try:
        found = motor_columns(recording, required=[])
    except RecordingError:
        return {}
    return {column: f"{'inputs' if role in ('v', 'load') else 'outputs'} {role}" for role, column in found.items()}


def _column(recording: Recording, series: Series, name: str, written: str | None) -> dict[str, Any]:
    own = None if written is None else parse_header(written).unit_text
    given = name in recording.given_units
    header = parse_header(recording.headers[name])
    told: dict[str, Any] = {
        "name": name,
        "header": header.text,
        "plain": header.name,
        "unit": recording.units[name],
        "written": header.unit_text,
        "given": given,
        "overruled": own if given and own != header.unit_text else None,
        "assumed": name in recording.assumed_units,
        "usual": next((role for role in ROLE_TITLE if rank_in_role(header.name, role) is not None), None),
        "unreadable": recording.unreadable.get(name),
    }
    if name in series.signals:
        signal = series.signals[name]
        known = signal[np.isfinite(signal)]
        told |= {
            "least": float(known.min()) if len(known) else None,
            "greatest": float(known.max()) if len(known) else None,
            "missing": int(len(signal) - len(known)),
            "gaps": gaps(series, name) if len(known) else [],
            "outliers": outliers(series, name),
        }
    return told
