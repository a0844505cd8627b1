"""Columns with their own clocks → columns on one clock. Knows no file format, no unit and no motor.

A file may hold signals that were sampled at different rates: each clock's times are put on one common clock, the union
of all. A signal then has samples at its own times only, NaN between: nothing is interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.units import FloatArray

SAME = 0.05  # of the finest interval: times of two clocks that are nearer are one


@dataclass(frozen=True, eq=False)
class Signal:
    """One channel of a file: header, samples, and its own clock."""

    header: str
    values: FloatArray  # (n,)
    time: FloatArray  # (n,) s


@dataclass(frozen=True, eq=False)
class Columns:
    """What a file of numbers holds: headers and columns, the time first."""

    headers: tuple[str, ...]
    columns: tuple[FloatArray, ...]  # each (n,); NaN where there is no sample
    texts: dict[str, str] = field(default_factory=dict)  # columns that hold no numbers → what they hold
    not_read: tuple[str, ...] = ()  # what of the file is no row of it, in sentences


def on_one_clock(path: Path, signals: Sequence[Signal]) -> Columns:
    """Return signals on the union of their clocks; those of one clock as they are, whatever its times.

    Raises
    ------
    RecordingError
        Of several clocks one does not increase, or is no number.
    """
    if signals and all(np.array_equal(signal.time, signals[0].time, equal_nan=True) for signal in signals):
        headers = ("time [s]", *(signal.header for signal in signals))
        return Columns(headers, (signals[0].time, *(signal.values for signal in signals)))
    clocks: list[FloatArray] = []
    for signal in signals:
        if not np.isfinite(signal.time).all() or (np.diff(signal.time) <= 0).any():
            raise RecordingError(
                f"{path.name}: the time of {signal.header!r} does not increase; each sample needs a later time than"
                " the one before"
            )
        if not any(np.array_equal(signal.time, clock) for clock in clocks):
            clocks.append(signal.time)
    common = _union(clocks)
    columns = [common]
    for signal in signals:
        column = np.full(len(common), np.nan)
        column[_nearest(common, signal.time)] = signal.values
        columns.append(column)
    return Columns(("time [s]", *(signal.header for signal in signals)), tuple(columns))


def distinct(headers: Sequence[str], longer: Sequence[str]) -> list[str]:
    """Return headers, the longer form where two would be the same, and a number where those are too."""
    chosen = [header if headers.count(header) == 1 else long for header, long in zip(headers, longer, strict=True)]
    return [text if chosen.count(text) == 1 else f"{text} #{k + 1}" for k, text in enumerate(chosen)]


def _union(clocks: Sequence[FloatArray]) -> FloatArray:
    finest = min((float(np.median(np.diff(clock))) for clock in clocks if len(clock) > 1), default=0.0)
    result = max(clocks, key=len)
    for clock in clocks:
        at = _nearest(result, clock)
        new = clock[np.abs(result[at] - clock) > SAME * finest]
        result = np.sort(np.concatenate([result, new]))
    return result


def _nearest(times: FloatArray, wanted: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return, for each wanted time, the index of the nearest one."""
    right = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
    right = np.minimum(right, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(wanted - times[left] <= times[right] - wanted, left, right)
