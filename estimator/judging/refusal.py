"""What cannot be estimated at all, from the recordings alone: each reason with its evidence. Simulates nothing.

Refused are only recordings without information: no excitation, a lost transient, a saturated or unsigned signal, a
steady state that no motor has. What the settled part of a refused step still determines is reported.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.judging.lost_signs import lost_signs, place_of
from estimator.motor.derived_quantities import largest_acceleration
from estimator.plans.plan import Observed, Plan
from estimator.recordings.finding import Finding
from estimator.recordings.samples import filled, mean_of_known
from estimator.recordings.settling import find_settling, lost_transient
from estimator.recordings.signal_noise import noise_deviation
from estimator.results.reason import Place, Reason, places_of

FloatArray = NDArray[np.float64]

INRUSH = 2.0  # times the last current: one of the right sign tells that the sign is right
PLAINLY_MOVES = 12.0  # deviations of the noise from end to end: more is a movement
IMPOSSIBLE = 1.5  # times the largest acceleration
WHOLE_RESPONSE = 0.8  # of the response in one sample: all of it
FASTEST = 6e-4  # s, a mechanical time constant: no motor is faster than 1 ms
CONTRADICTED = "an impossible acceleration"
JUMP_ROWS, LEFT_AFTER = 6, 0.1  # samples after a jump, part of the response: within both the jump was all there was
FASTER = 10  # samples advised in place of one
NO_DIFFERENCE = 3.0  # deviations of the noise: a smaller difference is none
ALIKE_SAMPLES = 10  # equal samples: fewer may be equal by chance


def refusal(plan: Plan) -> list[str]:
    """Return why nothing can be estimated from the recordings; empty if something can."""
    reasons: list[str] = []
    if all(o.excitation.kind == "none" for o in plan.observed):
        first = plan.observed[0]
        is_motor = "v" in first.inputs
        drive = "voltage" if is_motor else f"input {next(iter(first.inputs))!r}"
        level = first.excitation.after
        throughout = place_of(first, "v" if is_motor else next(iter(first.inputs)), 0, -1)
        moving = [n for n, y in first.outputs.items() if _moves(y)]
        if level == 0 and moving:
            remedy = "no voltage was logged; record the motor's voltage, too"
            said = remedy if is_motor else "it was not logged; record it, too"
            move = f"{' and '.join(moving)} move{'s' if len(moving) == 1 else ''}"
            return [Reason(f"the {drive} is zero throughout while {move}: {said}", throughout)]
        what = "is zero" if level == 0 else f"stays at {level:.4g}{' V' if is_motor else ''}"
        idle = "nothing changes" if first.excitation.running else "the motor does not start"
        sentence = (
            f"the {drive} {what} from the first to the last sample while {idle}, so nothing is"
            f" excited; record a {drive} step from standstill"
            if is_motor
            else f"the {drive} {what} from the first to the last sample, so nothing is excited; record a step of it"
        )
        reasons.append(Reason(sentence, throughout))
    if dead := _dead(plan):
        return [*reasons, *dead]
    reasons += [implausible_reason(o, finding) for o in plan.observed for finding in o.findings if finding.is_fatal]
    if reasons:
        return reasons
    reasons += cut_transients(plan)
    for o in plan.observed:
        reasons += lost_signs(o) + _contradicted(o)
    return reasons


def refused_notes(plan: Plan, reasons: Sequence[str]) -> tuple[str, ...]:
    """Return what refused recordings still determine: the others may be estimated, and each step's settled part.

    That gives B / K and a line between R and K. A reason without a place is one of the whole set: it spares none.
    """
    places, notes = [places_of((reason,)) for reason in reasons], list[str]()
    refused = {place.recording for of_reason in places for place in of_reason}
    others = [o.recording.title for o in plan.observed if o.recording.name not in refused]
    if others and places and all(places):
        notes.append(f"not refused by itself: {', '.join(others)}; leave the others out to estimate from what is left")
    for o in plan.observed:
        if o.excitation.kind != "step" or not {"i", "w"} <= set(o.outputs) or "v" not in o.inputs:
            continue
        if any(finding.is_fatal for finding in o.findings):
            continue
        if not find_settling(o.excitation, o.outputs, interval=o.recording.step).settled:
            continue
        tail = max(5, (len(o.recording.time) - o.excitation.index) // 10)
        v, i, w = (mean_of_known(x[-tail:]) for x in (o.inputs["v"], o.outputs["i"], o.outputs["w"]))
        if i * v > 0 and w * v > 0:
            notes.append(
                f"{o.recording.title}: the settled part still determines B/K = {i / w:.4g} A.s/rad and"
                f" R + K * {w / i:.5g} rad/(s.A) = {v / i:.5g} Ohm"
            )
    return tuple(notes)


def _moves(y: FloatArray) -> bool:
    """Whether an output changes by far more than its noise."""
    known = y[~np.isnan(y)]
    return float(np.ptp(known)) > PLAINLY_MOVES * noise_deviation(known) and float(np.ptp(known)) > 0


def _dead(plan: Plan) -> list[str]:
    """Find a current or a speed that is constant in all recordings, or in one of them, though the voltage changes."""
    driven = [o for o in plan.observed if "v" in o.inputs and np.ptp(o.inputs["v"]) > 0]
    reasons = list[str]()
    for name in (y for y in ("i", "w") if y in plan.outputs):
        dead = [o for o in driven if _stays(o.outputs[name])]
        every = len(dead) == len(plan.observed)
        for o in dead[:1] if every else dead:
            level, remedy = float(np.nanmax(o.outputs[name])), "column" if every else "recording"
            reasons.append(
                Reason(
                    f"{o.recording.title}: {name} is {level:.4g} {plan.unit(name)} from the first to the last sample"
                    " while the voltage moves: its sensor is dead, or the shaft is held; leave the"
                    f" {remedy} out, or record it again",
                    *(place_of(d, name, 0, -1) for d in (dead if every else [o])),
                )
            )
    return reasons


def _stays(y: FloatArray) -> bool:
    known = y[~np.isnan(y)]
    return len(known) > ALIKE_SAMPLES and float(np.ptp(known)) == 0


def _contradicted(o: Observed) -> list[str]:
    """Find a steady state that no motor has: against its voltage, or a source of power."""
    if o.excitation.kind != "step" or "v" not in o.inputs or o.excitation.after == 0:
        return []
    if any(np.any(u != 0) for name, u in o.inputs.items() if name != "v"):
        return []
    tail = max(5, (len(o.recording.time) - o.excitation.index) // 10)
    v = float(np.mean(o.inputs["v"][-tail:]))
    settled = find_settling(o.excitation, o.outputs, interval=o.recording.step).settled
    reasons: list[str] = []
    for name, what, unit in (("i", "current", "A"), ("w", "speed", "rad/s")):
        y = o.outputs.get(name)
        if y is None or np.isnan(y[-tail:]).all():
            continue
        rest = y[: o.excitation.index] if o.excitation.before == 0 and not o.excitation.running else y[:0]
        zero = float(np.nanmean(rest)) if np.count_nonzero(~np.isnan(rest)) >= ALIKE_SAMPLES else 0.0
        final, noise = float(np.nanmean(y[-tail:])) - zero, noise_deviation(y)
        after = y[o.excitation.index :] - zero
        swings = not settled and float(np.nansum(after)) * v > 0  # as a large motor's current beyond its speed's peak
        peak = float(after[np.nanargmax(np.abs(after))])
        swings |= name == "i" and peak * v > 0 and abs(peak) > INRUSH * abs(final)  # behind a sensor that shows changes
        if final * v < 0 and abs(final) > 6 * noise and abs(final) > 0.02 * float(np.nanmax(np.abs(y))) and not swings:
            reasons.append(
                Reason(
                    f"{o.recording.title}: at the end the {what} is {final:.4g} {unit} under {v:.4g} V, which no motor"
                    f" without load does; check the sign of the {what} and of the voltage",
                    place_of(o, name, -tail, -1),
                )
            )
    return reasons


def cut_transients(plan: Plan) -> list[str]:
    """Return which recordings lose a transient between two samples, from the data alone.

    No motor is so fast; or, if J is free, every sample of all recordings is at rest or settled.
    """
    cut, unseen = [], []
    for o, k, part in _jumps(plan):
        constant = o.recording.step / -np.log(max(1 - part, 1e-6))
        if part > WHOLE_RESPONSE and constant < FASTEST and _was_cut(o.outputs["w"], k):
            cut.append(o.recording.title)
        if part > WHOLE_RESPONSE and all(_settles_at(y, o.excitation.index, k) for y in o.outputs.values()):
            unseen.append(o.recording.title)
    if len(unseen) == len(plan.observed) and "J" in plan.names:
        cut = unseen
    return [reason for reason in lost_transients(plan) if reason.split(": ", 1)[0] in cut]


def _settles_at(y: FloatArray, step: int, k: int) -> bool:
    """Return whether an output is at rest in the row before k and settled from k on, within its noise."""
    y = filled(y)
    near = NO_DIFFERENCE * noise_deviation(y)
    rest, final = float(np.mean(y[: max(1, step)])), float(np.mean(y[-max(5, (len(y) - k) // 10) :]))
    over = y[k : k + JUMP_ROWS] - final
    return bool(abs(y[k - 1] - rest) <= near and np.all(np.abs(over) <= near))


def _was_cut(w: FloatArray, k: int) -> bool:
    """Return whether nothing moves any more after a jump, to sample k, or what is left moves far slower than it.

    A motor that is really so fast overshoots, or continues at its initial rate.
    """
    w = filled(w)
    final, noise = float(np.mean(w[-max(5, (len(w) - k) // 10) :])), noise_deviation(w)
    left = w[k : k + 6] - final
    still = LEFT_AFTER / 3 * float(np.ptp(w)) + PLAINLY_MOVES / 2 * noise
    if len(left) < 6 or np.all(np.abs(left) < still):
        return True
    return bool(abs(left[0]) > still and np.sign(left[0]) * np.mean(left[2:5]) > abs(left[0]) / 2)


def _jumps(plan: Plan) -> Iterator[tuple[Observed, int, float]]:
    """Yield recordings of a step with a jump of the speed: sample after it, size as a part of the response."""
    for o in plan.observed:
        if o.excitation.kind == "step" and "w" in o.outputs:
            lost = lost_transient(o.excitation, o.outputs["w"])
            if lost is not None:
                yield o, *lost


def lost_transients(plan: Plan, motor: Mapping[str, float] | None = None) -> list[str]:
    """Return which recordings lose the transient between two samples: a speed that jumps where no neighbour does.

    With R, K and J of an estimate the jump is held against the largest acceleration that the voltage allows, K v / R J.
    """
    reasons: list[str] = []
    for o, k, part in _jumps(plan):
        evidence = ""
        if motor is not None and {"R", "K", "J"} <= set(motor):
            jump = part * float(np.ptp(o.outputs["w"][~np.isnan(o.outputs["w"])]))
            step = abs(o.excitation.after - o.excitation.before)
            most = largest_acceleration(motor, step) * o.recording.step * _rows_to(o, k)
            if jump > IMPOSSIBLE * most:
                evidence = f", {CONTRADICTED}: {jump:.3g} rad/s where K v / (R J) allows {most:.3g} rad/s"
        reasons.append(
            Reason(
                f"{o.recording.title}: the speed jumps by {100 * part:.0f} % of its response within one sample at"
                f" t = {o.recording.time[k]:.6g} s{evidence}: the transient is lost, and R, L and J with it;"
                f" {_faster(o, k)}, without gaps",
                place_of(o, "w", k - 1, k),
            )
        )
    return reasons


def _rows_to(o: Observed, k: int) -> int:
    """Return for how many rows, up to row k, a speed may have risen unseen: since its last other value, or the step."""
    w = o.outputs["w"]
    last = k - 1
    while last > o.excitation.index and w[last - 1] == w[k - 1]:
        last -= 1
    return k - last


def slow_for_the_motor(plan: Plan) -> list[str]:
    """Return which recordings show most of the response within one sample though an estimate explains it."""
    return [
        f"{o.recording.title}: {100 * part:.0f} % of the speed's response lie within one sample, at"
        f" t = {o.recording.time[k]:.6g} s: the recording is slow for this motor, and R, L and J rest on few samples;"
        f" {_faster(o, k)}"
        for o, k, part in _jumps(plan)
    ]


def implausible_reason(o: Observed, finding: Finding) -> Reason:
    """Return what is implausible, with its place in the recording."""
    shown = {*o.inputs, *o.outputs}
    places = [Place(o.recording.name, e.signal, e.start, e.end) for e in finding.evidence if e.signal in shown]
    return Reason(finding.sentence, *places)


def _faster(o: Observed, k: int) -> str:
    """Return how to record what is lost before row k: all of a fast response, or a part of a slow one."""
    w = filled(o.outputs["w"])
    rest, final = float(np.mean(w[: max(1, o.excitation.index)])), float(np.mean(w[-max(5, (len(w) - k) // 10) :]))
    still, noise = LEFT_AFTER * float(np.ptp(w)), PLAINLY_MOVES / 2 * noise_deviation(o.outputs["w"])
    after = float(np.mean(w[k + 1 : k + 1 + JUMP_ROWS])) if k + 1 < len(w) else final
    if abs(w[k - 1] - rest) > still + noise or abs(after - final) > still + noise / np.sqrt(JUMP_ROWS):
        return "record at a higher rate"
    rate = 1 / o.recording.step
    return (
        f"an oscillation above half the sampling rate of {rate:g} Hz may be what is lost (aliasing);"
        f" record at {FASTER * rate:g} Hz or more"
    )
