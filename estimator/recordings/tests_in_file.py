"""Which rows of a file are of which test, and of which motor. Knows the file as written, makes no recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.errors import RecordingError, SeveralMotorsError, suggestion
from estimator.recordings.headers import parse_header, plain
from estimator.recordings.parts import Part, arrival_rate, names_motors, names_tests, parts
from estimator.recordings.raw_table import RawTable
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import MIN_SAMPLES
from estimator.recordings.time_column import time_column


def labels_of(raw: RawTable) -> dict[str, list[str]]:
    """Return the columns that name tests, as texts."""
    return _labels(raw, names_tests)


def of_motor(raw: RawTable, read_as: ReadAs) -> RawTable:
    """Return the rows of the motor that is asked for, of a file whose rows say which motor's they are.

    Where the times of all rows rise, a column so called tells what drives the motor, or whether it is on.

    Raises
    ------
    RecordingError
        No motor is asked for, or one that the file has not.
    """
    labels = _labels(raw, names_motors)
    for header, texts in labels.items() if labels and not _rises(raw, read_as) else ():
        if plain(header) == "motor" and raw.texts.index(header) not in raw.bad:
            continue  # numbers: what drives it
        motors = tuple(sorted(set(texts)))
        if read_as.motor is None:
            choices = ", ".join(f"--motor {motor}" for motor in motors)
            raise SeveralMotorsError(f"{raw.file} holds several motors; say which: {choices}", motors)
        if read_as.motor not in motors:
            raise RecordingError(f"{raw.file} has no motor {read_as.motor!r}{suggestion(read_as.motor, motors)}")
        others = np.flatnonzero([text != read_as.motor for text in texts])
        return replace(raw.without(others), name=f"{raw.name} {read_as.motor}", motor=read_as.motor)
    return raw


def _rises(raw: RawTable, read_as: ReadAs) -> bool:
    """Return whether the times of all rows are one clock's."""
    if read_as.rate is not None:
        return True
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    clock, _ = time_column(headers, raw.where, read_as)
    return not bool(np.any(np.diff(raw.columns[clock]) <= 0))


def _labels(raw: RawTable, are_named: Callable[[str], bool]) -> dict[str, list[str]]:
    """Return the columns of such a name as texts, where each text stands in rows enough."""
    found = {}
    for j, text in enumerate(raw.texts):
        if not are_named(parse_header(text).name):
            continue
        if j in raw.bad and raw.text is not None:
            found[text] = list(raw.text(j))
        elif j not in raw.texts_in and j not in raw.bad:
            found[text] = [f"{value:g}" for value in raw.columns[j].tolist()]
    return {name: texts for name, texts in found.items() if 1 < len(set(texts)) <= len(texts) // MIN_SAMPLES}


def tests_of(raw: RawTable, read_as: ReadAs, labels: Mapping[str, Sequence[str]]) -> list[Part]:
    """Return the tests that a file holds; none where even its time is not known."""
    headers, _ = read_as.headers(raw.texts, where=raw.where)
    clock, unit = time_column(headers, raw.where, read_as)
    time = raw.columns[clock]
    if clock in raw.bad or clock in raw.texts_in or np.isnan(time).any():
        return []
    si = unit.to_si(time)
    if not labels and (rate := arrival_rate(si)) is not None:
        raise RecordingError(
            f"{raw.file}: rows arrive in blocks, as over USB, and the times are those of arrival, or too coarse;"
            f" say with --rate HZ how often the rows were taken: some {rate:.4g} Hz, if none was lost"
        )
    return parts(si, labels, least=MIN_SAMPLES)


def asked_test(raw: RawTable, read_as: ReadAs) -> RawTable:
    """Return the rows of the test that is asked for."""
    found = tests_of(raw, read_as, labels_of(raw))
    chosen = next((part for part in found if part.name == read_as.test), None)
    if chosen is None:
        known = ", ".join(part.name for part in found[:20]) or "one test"
        raise RecordingError(f"{raw.file} has no test {read_as.test!r}; it holds {known}; take one of these")
    return raw.rows(chosen.first, chosen.last)
