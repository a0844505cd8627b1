"""What of a motor's recording cannot be as it was read: columns exchanged, a sign, a unit. Knows no FMU.

Everything here is found from the samples alone, before any search. Nothing is corrected: what it looks like is named,
with the option that puts it right. Two things no recording can show, because a motor of another size does the same: the
scale of the speed within the range of real motors, and the scale of the current likewise. So a unit is doubted only
where the motor that follows does not exist: limits are those of brushed motors on 3 to 100 V, of bare shafts and with
gears. Where nobody said the unit, the limits are narrower.

How often a detector is wrong on good recordings, and how often it finds what it is for, is in docs/reading.md.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.finding import Finding
from estimator.recordings.implausible_angle import angle_unit
from estimator.recordings.implausible_columns import exchanged_columns, lone_samples, wrong_signs
from estimator.recordings.implausible_units import (
    clock_unit,
    converter_counts,
    current_unit,
    size,
    speed_unit,
    voltage_unit,
)
from estimator.recordings.measured_signals import MeasuredSignals
from estimator.recordings.odd_drives import coasts, dead_band, is_held, waits
from estimator.recordings.understood import Understood

FloatArray = NDArray[np.float64]


def implausible_as_read(
    title: str,
    time: FloatArray,
    signals: Mapping[str, FloatArray],
    read: Sequence[Understood],
    *,
    turned: frozenset[str] = frozenset(),
) -> tuple[Finding, ...]:
    """Find what of a motor's signals cannot be as it was read, by what is known of how.

    Parameters
    ----------
    title, time, signals, turned : as `MeasuredSignals`
    """
    measured = MeasuredSignals(
        title,
        time,
        signals,
        guessed=frozenset(r.signal for r in read if r.is_guess),
        columns={r.signal: r.column for r in read},
        units={r.signal: r.unit for r in read},
        turned=turned,
    )
    said = {r.signal for r in read if r.unit_from == "user"}
    held = signals.keys() - {r.signal for r in read}  # such as a voltage of --fix
    return implausible(measured, sure=frozenset(said | held))


def implausible(as_read: MeasuredSignals, *, sure: frozenset[str] = frozenset()) -> tuple[Finding, ...]:
    """Find what of a motor's signals cannot be as it was read.

    Parameters
    ----------
    sure : signals whose unit the user said again, so that it is not doubted
    """
    title, time, signals = as_read.title, as_read.time, as_read.signals
    known = {
        name: y for name, y in signals.items() if np.count_nonzero(~np.isnan(y)) > 2 and np.nanmax(y) != np.nanmin(y)
    }
    if not {"i", "w", "angle"} & known.keys():
        return ()
    voltage = {n: y for n, y in signals.items() if n == "v"}
    measured = dataclasses.replace(as_read, signals={**known, **voltage})
    signs = wrong_signs(measured)
    exchanged = None if signs else exchanged_columns(measured)
    if exchanged is not None:
        return (exchanged,)  # of columns that are others, nothing else is true
    held = is_held(title, time, known)
    doubted = size(measured, "v") or voltage_unit(measured)
    found = [
        *signs,
        size(measured, "i"),
        size(measured, "w") if held is None else None,
        *lone_samples(measured),
        *converter_counts(measured),
        doubted,
        speed_unit(measured, is_volts=doubted is None),
        current_unit(measured, is_volts=doubted is None),
        angle_unit(measured),
        clock_unit(measured),
    ]
    found += [
        held,
        coasts(title, time, known),
        waits(title, time, measured.signals),
        dead_band(title, time, known),
    ]
    first: dict[str, Finding] = {}  # of what is a converter's counts, or of no motor's size, no other unit is told
    for f in found:
        if f is not None and (f.is_sure or f.kind not in {f"unit {name}" for name in sure}):
            first.setdefault(f.kind, f)
    return tuple(first.values())
