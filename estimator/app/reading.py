"""What was read from a recording's file, for the page: columns, units, clock, gaps, samples that stand alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.app.series import Series, gaps, outliers
from estimator.recordings.headers import ROLE_TITLE, parse_header, rank_in_role
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import Recording


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


def facts(recording: Recording) -> dict[str, Any]:
    """Return what was read, as plain data."""
    series = series_of(recording)
    return {
        "title": recording.title,
        "samples": len(recording.time),
        "begin": float(recording.time[0]),
        "end": float(recording.time[-1]),
        "step": recording.step,
        "even": recording.even,
        "missing_rows": recording.missing_rows,
        "columns": [_column(recording, series, name) for name in recording.headers],
    }


def _column(recording: Recording, series: Series, name: str) -> dict[str, Any]:
    header = parse_header(recording.headers[name])
    told: dict[str, Any] = {
        "name": name,
        "header": header.text,
        "plain": header.name,
        "unit": recording.units[name],
        "written": header.unit_text,
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
