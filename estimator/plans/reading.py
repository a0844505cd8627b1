"""What was read of a case's recording, and what of it cannot be so. Simulates nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.plans.binding import Binding, Channels
from estimator.plans.plan import Observed
from estimator.recordings.clipping import clipped, cut_at_zero, limit, shared_limits
from estimator.recordings.dead_zone import hidden_speeds, least_speed
from estimator.recordings.finding import Evidence, Finding
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.plausibility import implausible_as_read
from estimator.recordings.recording import Recording
from estimator.recordings.understood import Understood, understood
from estimator.recordings.units import parse_unit

FloatArray = NDArray[np.float64]

MOTOR_SIGNALS = ("v", "i", "w", "angle")
MOST_SATURATED = 0.3  # of a recording's samples: with more there is nothing to estimate from


def with_reading(binding: Binding, channels: Channels, observed: Observed, *, scale: Mapping[str, float]) -> Observed:
    """Return what was observed with what was read of it, and of a motor with what is implausible.

    Parameters
    ----------
    scale : channel or column → factor that its samples were multiplied with
    """
    recording = observed.recording
    columns = {**channels.inputs, **channels.outputs}
    read = tuple(_as_product(binding, recording, columns, r) for r in understood(recording, columns))
    if not binding.is_motor:
        observed = dataclasses.replace(observed, read=tuple(_in_the_fmus_unit(binding, r) for r in read))
        return observed
    signals = {n: y for n, y in {**observed.inputs, **observed.outputs}.items() if n in MOTOR_SIGNALS}
    beside = motor_columns(recording, required=()).get("angle")
    if beside is not None and "angle" not in signals:
        signals["angle"] = recording.signals[beside]
    turned = frozenset(n for n, column in columns.items() if scale.get(n, scale.get(column, 1.0)) < 0)
    findings = implausible_as_read(recording.title, recording.time, signals, read, turned=turned)
    if "friction" in binding.parameters:
        findings = tuple(finding for finding in findings if finding.kind != "dead band")
    return dataclasses.replace(observed, read=read, findings=findings)


def _as_product(binding: Binding, recording: Recording, columns: Mapping[str, str], read: Understood) -> Understood:
    """Return what was read of an input, two columns if the case multiplies them: a duty cycle and its supply."""
    if read.signal not in binding.case.products:
        return read
    both = [recording.column(c) for c in (columns[read.signal], binding.case.products[read.signal])]
    unit = next((recording.units[c] for c in both if recording.units[c] not in ("1", "", "?")), "1")
    return dataclasses.replace(read, column=" × ".join(recording.headers[c] for c in both), unit=unit, unit_from="made")


def _in_the_fmus_unit(binding: Binding, read: Understood) -> Understood:
    """Return what was read of a column without a unit, of an FMU that is no motor: T is no time there."""
    unit = parse_unit(read.unit)
    if read.signal == "time" or not read.is_guess or (unit is not None and unit.to_si(1.0) != 1.0):
        return read
    own = binding.signal(read.signal).unit
    return dataclasses.replace(read, unit=own, unit_from="name" if own else "nobody")


def without_hidden_speeds(observed: Sequence[Observed]) -> tuple[Observed, ...]:
    """Return recordings of a motor without the samples of no speed that their sensor shows of slow ones.

    It is the same in all of them; one that moves fast from the start may not tell.
    """
    signals = [(o.outputs["w"], o.inputs["v"]) if "w" in o.outputs and "v" in o.inputs else None for o in observed]
    least = max((least_speed(*own) for own in signals if own is not None), default=0.0)
    if least == 0:
        return tuple(observed)
    return tuple(
        o if own is None else _without_hidden(o, *own, least) for o, own in zip(observed, signals, strict=True)
    )


def _without_hidden(observed: Observed, w: FloatArray, v: FloatArray, least: float) -> Observed:
    rows = hidden_speeds(w, v, least)
    if not rows.any():
        return observed
    first, last = (float(t) for t in observed.recording.time[np.flatnonzero(rows)[[0, -1]]])
    finding = Finding(
        "hidden speeds",
        f"{observed.recording.title}: the sensor of w shows none below {least:.4g} rad/s: {int(rows.sum())} samples,"
        f" from t = {first:.6g} s on, are left out, as the machine may turn in them",
        is_harmless=True,
        evidence=(Evidence("w", first, last),),
    )
    outputs = {**observed.outputs, "w": np.where(rows, np.nan, w)}
    return dataclasses.replace(observed, outputs=outputs, findings=(*observed.findings, finding))


def without_clipped(binding: Binding, observed: Sequence[Observed]) -> tuple[Observed, ...]:
    """Return recordings without the samples at which a sensor is saturated, in any of them, and with a word on them."""
    known: dict[str, frozenset[float]] = {}
    for name in {name for o in observed for name in o.outputs}:
        known[name] = shared_limits([o.outputs[name] for o in observed if name in o.outputs])
    return tuple(_without_clipped(binding, o, known) for o in observed)


def _without_clipped(binding: Binding, observed: Observed, known: Mapping[str, frozenset[float]]) -> Observed:
    outputs, findings = dict(observed.outputs), [*observed.findings]
    for name in sorted(outputs.keys() - {"angle"}):  # which has its largest value in each turn, where it begins again
        if (around := cut_at_zero(outputs[name])).any():
            outputs[name] = np.where(around, np.nan, outputs[name])
            findings.append(
                Finding(
                    "saturated",
                    f"{observed.recording.title}: {name} is never below 0, where half of its noise is cut:"
                    f" {int(around.sum())} samples around 0 are left out",
                    is_harmless=True,
                )
            )
        rows = clipped(outputs[name], known[name])
        if not rows.any():
            continue
        first, last = (float(t) for t in observed.recording.time[np.flatnonzero(rows)[[0, -1]]])
        value = f"{limit(outputs[name], rows):.4g} {binding.signal(name).unit}"
        most = float(np.mean(rows)) > MOST_SATURATED
        what = f"{int(rows.sum())} samples" + (
            ", too many to estimate from; record again with a larger sensor range"
            if most
            else " are left out; a larger sensor range shows more"
        )
        outputs[name] = outputs[name] if most else np.where(rows, np.nan, outputs[name])
        findings.append(
            Finding(
                "saturated",
                f"{observed.recording.title}: {name} is saturated at {value}, first at t = {first:.6g} s: {what}",
                is_fatal=most,
                is_harmless=not most,
                evidence=(Evidence(name, first, last),),
            )
        )
    return dataclasses.replace(observed, outputs=outputs, findings=tuple(findings))
