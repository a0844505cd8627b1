"""One file that holds several tests → which rows are which test. Knows times and columns, no file and no motor.

A test begins where a column that names tests changes, where the time goes back, and where a clock pauses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.recordings.headers import plain
from estimator.recordings.time_grid import PAUSE
from estimator.recordings.units import FloatArray

_NAMES = (
    "test run trial experiment exp test_id run_id trial_id test_name test_no run_no trial_no run_number test_number"
    " repeat repetition maneuver manoeuvre"
)
NAMES = frozenset(_NAMES.split())
MOTOR_NAMES = frozenset({"motor", "motor_id", "motor_name", "motor_no", "motor_number"})
FEWEST_BLOCKS, LEAST_ROWS, MOST_ROWS = 10, 3, 64  # blocks of rows that arrive together; rows of one: two are one, again
SHORT = 0.2  # a block's time over a pause
BACK = 5  # usual intervals: a time that falls by more begins anew
MOST = 200  # tests


@dataclass(frozen=True)
class Part:
    """The rows of one test, and what it is called."""

    name: str
    first: int
    last: int  # the row after its last


def names_tests(header: str) -> bool:
    """Return whether a column of that name says which test a row belongs to."""
    return plain(header) in NAMES


def names_motors(header: str) -> bool:
    """Return whether a column of that name says which motor a row belongs to."""
    return plain(header) in MOTOR_NAMES


def arrival_rate(time: FloatArray) -> float | None:
    """Return how often rows were taken, Hz, where blocks of them arrive together, as over USB; None where none do.

    The times, (n,) s, are then those of arrival: within a block they are one or say nothing, between blocks that many
    rows passed.
    """
    steps = np.diff(time)
    if len(steps) < FEWEST_BLOCKS or np.any(steps < 0):
        return None
    begins = np.flatnonzero(steps > PAUSE * float(np.median(steps))) + 1
    rows = np.diff(begins)
    if len(begins) < FEWEST_BLOCKS or np.max(rows) > MOST_ROWS or np.median(rows) < LEAST_ROWS:
        return None
    together = time[begins[1:] - 1] - time[begins[:-1]]
    if np.median(together) > SHORT * np.median(steps[begins - 1]):
        return None
    return float((begins[-1] - begins[0]) / (time[begins[-1]] - time[begins[0]]))


def parts(time: FloatArray, labels: Mapping[str, Sequence[str]], *, least: int) -> list[Part]:
    """Return the tests of a file; one that is too short is left out.

    Parameters
    ----------
    time : (n,) array, s
    labels : column that names tests → (n,) texts
    least : samples of a test
    """
    n = len(time)
    steps = np.diff(time)
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if len(forward) else 1.0
    begins = {0}
    begins |= {int(k) + 1 for k in np.flatnonzero((steps < -BACK * usual) | (steps > PAUSE * usual))}
    for texts in labels.values():
        begins |= {k for k in range(1, n) if texts[k] != texts[k - 1]}
    edges = [*sorted(begins), n]
    found = [(first, last) for first, last in zip(edges, edges[1:], strict=False) if last - first >= least]
    named = [next((texts[first] for texts in labels.values()), "") for first, _ in found]
    result = []
    for k, (first, last) in enumerate(found):
        name = named[k].strip() or str(k + 1)
        if named.count(named[k]) > 1 and named[k].strip():
            name = f"{name} {named[: k + 1].count(named[k])}"
        result.append(Part(name, first, last))
    return result[:MOST]
