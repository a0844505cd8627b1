"""A recording at first sight: what was read, its clock, steps, levels, noise, and what is implausible. Knows no FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.errors import RecordingError
from estimator.recordings.clipping import clipped, limit
from estimator.recordings.corrected import corrected
from estimator.recordings.excitation import LEVEL, Excitation, find_delay, find_excitation
from estimator.recordings.finding import Finding
from estimator.recordings.headers import ROLE_QUANTITY
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.plausibility import implausible_as_read
from estimator.recordings.quantum import quantum
from estimator.recordings.recording import Recording
from estimator.recordings.repeated_rows import repeated_rows
from estimator.recordings.samples import filled
from estimator.recordings.settling import find_settling, lost_transient
from estimator.recordings.signal_noise import input_noise, noise_deviation
from estimator.recordings.understood import Understood, not_used, understood

FloatArray = NDArray[np.float64]

LEAST_LEVEL = 20  # samples: a shorter one is no level
MOST_LEVELS = 24  # that are shown
LATE_PART = 0.3  # of a level, its end, whose means are shown
LATE = 2  # samples, as in observing.py: a response that starts this much later is delayed


@dataclass(frozen=True)
class Level:
    """A stretch of constant voltage: from and to in s, and the mean of each signal over its last third."""

    start: float
    end: float
    means: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Preview:
    """A recording at first sight.

    Attributes
    ----------
    signals : "v", "i", "w", "angle", "load" → (n,) array, SI; those that there are
    read : what was read, the time last
    repeated : rows that are the row before once more, noise and all
    unused : headers of the other columns, of which no signal was made
    """

    recording: Recording
    signals: Mapping[str, FloatArray]
    read: tuple[Understood, ...]
    unused: tuple[str, ...]
    excitation: Excitation | None
    delay: float  # s, of the response behind the step; 0 for none
    settled: str | None  # None: no step; "": it settled; else why not
    levels: tuple[Level, ...]
    noise: Mapping[str, float]
    quanta: Mapping[str, float]
    found: tuple[str, ...]  # damage that shows: a signal that is clipped, a transient that is lost
    findings: tuple[Finding, ...]
    repeated: int = 0


def preview(
    recording: Recording, *, scale: Mapping[str, float] | None = None, offset: Mapping[str, float] | None = None
) -> Preview:
    """Look at a motor's recording.

    Parameters
    ----------
    scale, offset : signal or column → factor on its samples, and what is added to them after it

    Raises
    ------
    RecordingError
        There is neither a voltage nor anything that moves, two columns could be one signal, a unit does not fit, or
        nothing measures what is corrected.
    """
    columns = motor_columns(recording, required=("v",), either=("i", "w"))
    factors, added = dict(scale or {}), dict(offset or {})
    signals = {}
    for name, column in columns.items():
        if not {name, column} & factors.keys() and (fault := recording.fault(column, ROLE_QUANTITY[name])):
            raise RecordingError(fault)
        factor = factors.pop(name, factors.pop(column, 1.0))
        offset_of = added.pop(name, added.pop(column, 0.0))
        signals[name] = corrected(recording.signals[column], factor, offset_of, what=f"{name} of {recording.title}")
    for what, unused in (("scale", factors), ("offset", added)):
        if unused:
            raise RecordingError(
                f"{what} is given for {next(iter(unused))!r}, which is no signal of {recording.title} that is used"
                f" ({', '.join(columns)})"
            )
    read = understood(recording, columns)
    in_file = [r for r in read if not {columns.get(r.signal)} & recording.made.keys() & set(recording.given_units)]
    measured: dict[str, FloatArray] = {name: signals[name] for name in ("i", "w") if name in signals}
    if "angle" in signals and "w" not in signals:
        measured["w"] = np.gradient(filled(signals["angle"]), recording.time)
    v = filled(signals["v"]) if not np.isnan(signals["v"]).all() else None
    excitation = None if v is None else find_excitation(v, measured)
    noise = {name: noise_deviation(y) for name, y in signals.items()}
    quanta = {name: q for name, y in signals.items() if (q := quantum(y)) > 0}
    if v is not None:
        noise["v"] = input_noise(v)
        if noise["v"] == 0 and quanta.get("v", 0.0) > LEVEL * float(np.ptp(v)):
            del quanta["v"]  # the distance of levels that were set
    step = excitation if excitation is not None and excitation.kind == "step" else None
    late = 0 if excitation is None else find_delay(excitation, measured)
    settling = None if step is None else find_settling(step, measured, interval=recording.step)
    return Preview(
        recording=recording,
        signals=signals,
        read=read,
        unused=not_used(recording, columns.values()),
        excitation=excitation,
        delay=late * recording.step if late >= LATE else 0.0,
        settled=None if settling is None else settling.reason,
        levels=_levels(recording, signals, noise["v"]),
        noise=noise,
        quanta=quanta,
        found=_damage(recording, measured, step),
        findings=implausible_as_read(recording.title, recording.time, signals, in_file),
        repeated=len(_repeated(signals)),
    )


def preview_mapping(p: Preview) -> dict[str, Any]:
    """Return a preview for JSON: numbers in SI units."""
    recording, e = p.recording, p.excitation
    return {
        "recording": recording.title,
        "read": {
            "signals": {r.signal: {k: x for k, x in r.mapping().items() if k != "signal"} for r in p.read},
            "text": " · ".join(r.text() for r in p.read),
            "unused": list(p.unused),
            "left_out": list(recording.not_read),
        },
        "clock": {
            "samples": len(recording.time),
            "first": float(recording.time[0]),
            "last": float(recording.time[-1]),
            "interval": recording.step,
            "rate": 1 / recording.step,
            "even": recording.even,
            "missing_rows": recording.missing_rows,
            "repeated_rows": p.repeated,
        },
        "excitation": None
        if e is None
        else {
            "kind": e.kind,
            "at": float(recording.time[e.index]) if e.kind == "step" else None,
            "before": e.before if e.kind == "step" else None,
            "after": e.after if e.kind == "step" else None,
            "runs_already": e.running,
            "delay": p.delay,
        },
        "settled": None if p.settled is None else not p.settled,
        "levels": [{"from": level.start, "to": level.end, "means": dict(level.means)} for level in p.levels],
        "signals": {
            name: {
                "least": float(np.nanmin(y)),
                "largest": float(np.nanmax(y)),
                "missing": int(np.isnan(y).sum()),
                "noise": p.noise[name],
                "quantum": p.quanta.get(name),
            }
            for name, y in p.signals.items()
        },
        "damage": list(p.found),
        "implausible": [
            {
                "kind": f.kind,
                "sentence": f.sentence,
                "refused": f.is_fatal,
                "places": [e._asdict() for e in f.evidence],
            }
            for f in p.findings
        ],
    }


def _repeated(signals: Mapping[str, FloatArray]) -> NDArray[np.int64]:
    """Return the rows that are the row before once more."""
    driven = {name: y for name, y in signals.items() if name in ("v", "load")}
    return repeated_rows(driven, {name: y for name, y in signals.items() if name not in driven})


def _levels(recording: Recording, signals: Mapping[str, FloatArray], noise: float) -> tuple[Level, ...]:
    """Return the stretches of constant voltage, and where the other signals are at their ends."""
    v = filled(signals["v"]) if not np.isnan(signals["v"]).all() else np.zeros(len(recording.time))
    threshold = max(LEVEL * float(np.ptp(v)), 6 * noise, 1e-9)
    edges = [0, *(np.flatnonzero(np.abs(np.diff(v)) > threshold) + 1), len(v)]
    levels = []
    for first, last in zip(edges, edges[1:], strict=False):
        if last - first < LEAST_LEVEL or float(np.ptp(v[first:last])) > 2 * threshold:
            continue
        late = slice(last - max(5, int(LATE_PART * (last - first))), last)
        means = {
            n: float(np.nanmean(y[late])) for n, y in signals.items() if n != "angle" and not np.isnan(y[late]).all()
        }
        levels.append(Level(float(recording.time[first]), float(recording.time[last - 1]), means))
    return tuple(levels)


def _damage(recording: Recording, measured: Mapping[str, FloatArray], step: Excitation | None) -> tuple[str, ...]:
    """Say what of the samples is lost."""
    still = []
    names = {"i": ("current", "A"), "w": ("speed", "rad/s")}
    for name, y in measured.items():
        title, unit = names[name]
        if np.isnan(y).all():
            continue
        if np.nanmax(y) == np.nanmin(y):
            still.append(f"the {title} is {float(np.nanmax(y)):.4g} {unit} from the first to the last sample")
        if (rows := clipped(y)).any():
            since, count = f"{recording.time[int(np.argmax(rows))]:.6g} s", int(rows.sum())
            still.append(
                f"the {title} is saturated at {limit(y, rows):.4g} {unit}, first at t = {since}: {count} samples"
            )
    if step is not None and "w" in measured and (lost := lost_transient(step, measured["w"])) is not None:
        k, part = lost
        still.append(
            f"the speed jumps by {100 * part:.0f} % of its response within one sample at t = {recording.time[k]:.6g} s"
        )
    return tuple(still)
