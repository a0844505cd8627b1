"""What was read of a case's recording, and what of it cannot be so. Simulates nothing."""

from __future__ import annotations

import dataclasses

from estimator.cases.case import Case
from estimator.fmus.fmu import FmuDescription
from estimator.plans.observing import columns_used, is_motor_case
from estimator.plans.plan import Observed
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.plausibility import implausible
from estimator.recordings.understood import understood

MOTOR_SIGNALS = ("v", "i", "w", "angle")


def with_reading(case: Case, description: FmuDescription, observed: Observed) -> Observed:
    """Return what was observed with what was read of it, and of a motor with what is implausible."""
    recording = observed.recording
    inputs, outputs = columns_used(case, description, recording)
    read = understood(recording, {**inputs, **outputs})
    if not is_motor_case(case, description):
        return dataclasses.replace(observed, read=read)
    signals = {n: y for n, y in {**observed.inputs, **observed.outputs}.items() if n in MOTOR_SIGNALS}
    beside = motor_columns(recording, required=()).get("angle")
    if beside is not None and "angle" not in signals:
        signals["angle"] = recording.signals[beside]
    guessed = frozenset(r.signal for r in read if r.is_guess)
    sure = frozenset(r.signal for r in read if r.unit_from == "user")
    columns = {r.signal: r.column for r in read}
    findings = implausible(recording.title, recording.time, signals, guessed=guessed, sure=sure, columns=columns)
    if any(v.name == "friction" for v in description.of_causality("parameter")):
        findings = tuple(finding for finding in findings if finding.kind != "dead band")
    return dataclasses.replace(observed, read=read, findings=findings)
