"""Levels of a command that reach the motor at delays of their own, found from the current or a speed alone.

A controller that reads its command periodically delays each change by another time. The current starts to change within
a sample of the voltage's change at the motor; the speed has done half of each change as long after it. The changes are
moved to these instants, relative to the first, so that one delay remains for all. Differences below a sample, or what
little a speed alone leaves, are estimated by the effect `latency of each edge`. Knows plans, no fit.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from estimator.plans.plan import Observed, Plan
from estimator.recordings.printed_digits import errors_of_digits
from estimator.recordings.samples import filled, median
from estimator.recordings.signal_noise import input_noise, noise_deviation

FloatArray = NDArray[np.float64]

EDGE = 0.05  # of an input's range: a larger change is an edge
ABOVE_NOISE = 8.0  # deviations of an input's noise, which a change of an edge exceeds, too
MOST_EDGES = 12  # in a recording; more are a signal, not levels
ONSET_NOISE = 6.0  # deviations of the noise: a larger change of the current is an onset
ONSET_PART = 0.1  # of the largest change of the current per volt: likewise
MEDIAN_OF = np.pi / 2  # variance of a median over that of a mean
MOVES = 3.0  # standard errors of its slope: a current is on a course
BEFORE = 5  # rows before a change, at least, in which the current has settled
SUDDEN, STEEPER = 3, 4.0  # rows in which an onset is seen beside a course, and by how many times it must be steeper
HALVES = 3  # times from a quarter of a speed's change to its half, by which changes must come later or earlier
ONSET_BEFORE = np.log(2) / np.log(1.5)  # of those times, of a first-order response, between its begin and its half
TOLD = 4.0  # standard errors by which it is later or earlier then
LEAST_SHIFT = 2  # rows by which a change must come later or earlier than the first
LEAST_ORDERED = 4  # changes of which larger ones come later: of fewer that may be chance


def edges_of(u: FloatArray, span: float | None = None) -> NDArray[np.int64]:
    """Return the rows at which an input, (n,), has changed by much of its span, its own if none is given.

    A controller passes a sensor's noise on to its output: rows that the noise itself selects are no edges.
    """
    span = float(np.ptp(u)) if span is None else span
    least = max(EDGE * span, ABOVE_NOISE * input_noise(u), 1e-300)
    return np.flatnonzero(np.abs(np.diff(u)) > least) + 1


def with_latencies(plan: Plan) -> tuple[Plan, tuple[str, ...]]:
    """Return the plan with the changes of its voltages where they reach the motor, and what was found."""
    observed, told = [], []
    for o in plan.observed:
        moved = _moved(o)
        observed.append(o if moved is None else moved[0])
        if moved is not None:
            told.append(moved[1])
    return dataclasses.replace(plan, observed=tuple(observed)), tuple(told)


def _moved(o: Observed) -> tuple[Observed, str] | None:
    if "v" not in o.inputs or o.lead or not {"i", "w"} & set(o.outputs):
        return None
    v = np.concatenate([np.zeros(o.rest), o.inputs["v"]])  # a voltage that is on from the first row begins there
    edges = edges_of(v)
    edges = edges[edges <= len(v) - 4 * LEAST_SHIFT]  # the response to later ones is not recorded
    if not 2 <= len(edges) <= MOST_EDGES or np.min(np.diff(edges)) < 4 * LEAST_SHIFT:
        return None
    told = _of_current(o, v, edges) if "i" in o.outputs else _of_speed(o, v, edges)
    if told is None:
        return None
    late, least = told
    shift = np.array(late) - late[0]
    changes = np.abs(v[edges] - v[edges - 1])
    if np.all(np.abs(shift) < np.maximum(LEAST_SHIFT, least)) or _grows_with_size(late, changes):
        return None
    bounds = [*edges, len(v)]
    command = np.full(len(v), v[0])
    for a, b, by in zip(bounds[:-1], bounds[1:], shift, strict=True):
        command[max(0, a + by) :] = v[a]
        command[max(0, a + by) : max(0, b + by)] = v[a:b][: len(command[max(0, a + by) : max(0, b + by)])]
    h = o.recording.step
    delays = ", ".join(f"{1e3 * k * h:.3g}" for k in late)
    note = f"{o.recording.title}: the changes of the voltage reach the motor {delays} ms late, each by its own"
    moved, delay = command[o.rest :], late[0] * h if late[0] else 0.0
    inputs = {**o.inputs, "v": moved}
    return dataclasses.replace(o, inputs=inputs, delay=delay, uncertain=errors_of_digits(moved)), note


def _of_current(o: Observed, v: FloatArray, edges: NDArray[np.int64]) -> tuple[list[int], FloatArray] | None:
    """Return by how many rows the current starts to change after each edge, and how many more or fewer tell."""
    rest, i = np.zeros(o.rest), filled(o.outputs["i"])
    i = np.concatenate([rest + i[0], i])
    around = np.concatenate([i[:1], i, i[-1:]])
    smooth = np.median([around[:-2], i, around[2:]], axis=0)  # a single sample that is off is no onset
    shown = np.concatenate([rest, o.outputs["i"]])
    bounds = [*edges, len(v)]
    changes = np.abs(v[edges] - v[edges - 1])
    largest = max(float(np.ptp(i[a:b])) / dv for a, b, dv in zip(bounds[:-1], bounds[1:], changes, strict=True))
    noise = noise_deviation(o.outputs["i"])
    level = max(ONSET_NOISE * noise / float(np.min(changes)), ONSET_PART * largest)  # A/V
    late, moves_on, sudden = [], False, True
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        before = i[max(0, a - BEFORE) : a]
        away = (smooth[a:b] - median(before)) / (v[a] - v[a - 1]) > level
        away |= np.isnan(shown[a:b])  # saturated, or missing
        lasting = away[:-1] & away[1:]
        if not lasting.any():
            return None
        rows = max(0, int(np.argmax(lasting)) - 1)
        settled, least = smooth[max(0, a - max(rows, BEFORE)) : a], level * abs(v[a] - v[a - 1])
        still_moves = abs(settled[-1] - settled[0]) > least
        moves_on, sudden = moves_on or still_moves, sudden and _is_sudden(smooth, a, a + rows, least)
        late.append(0 if not still_moves and _has_left(i[a : a + rows], before, v[a] - v[a - 1], noise) else rows)
    if moves_on and not sudden:  # what comes after an edge may be of the change before
        return None
    # Where a current takes many rows to its onset, noise moves that: by so many rows, of a rise that is even.
    moved = np.array(late) * noise / (level * changes)
    return late, TOLD * np.hypot(moved, moved[0])


def _is_sudden(i: FloatArray, edge: int, onset: int, least: float) -> bool:
    """Whether a current, (n,), leaves at an onset, by more than the least, a course that was far slower at the edge."""
    leaves = abs(i[min(onset + SUDDEN, len(i) - 1)] - i[onset])
    return bool(leaves > least + STEEPER * abs(i[edge - 1] - i[max(0, edge - 1 - SUDDEN)]))


def _of_speed(o: Observed, v: FloatArray, edges: NDArray[np.int64]) -> tuple[list[int], FloatArray] | None:
    """Return by how many rows the speed starts to change after each edge, and how many more or fewer tell.

    A linear motor takes as long to the half of each change, which is clear, and as long from its begin. One that
    coasts, or stops by its friction, takes longer to stand: by less than `HALVES` times what is between a quarter and a
    half of the slowest change.
    """
    w = filled(o.outputs["w"])
    w = np.concatenate([np.zeros(o.rest) + w[0], w])
    bounds = [*edges, len(v)]
    late, rises, before = [], [], median(w[max(0, edges[0] - BEFORE) : edges[0]])
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        after = median(w[b - max(BEFORE, (b - a) // 4) : b])
        done = (w[a:b] - before) / (after - before) if after != before else np.zeros(b - a)
        noise = float(np.std(w[b - max(BEFORE, (b - a) // 4) : b]))
        quarter, half = (done > part for part in (0.25, 0.5))
        if (after - before) * (v[a] - v[a - 1]) <= 0 or abs(after - before) < ABOVE_NOISE * noise:
            return None
        late.append(_first_lasting(half))
        rises.append(late[-1] - _first_lasting(quarter))
        before = after
    begun = round(ONSET_BEFORE * float(np.median(rises)))
    return [k - begun for k in late], np.full(len(late), float(HALVES * max(1, *rises)))


def _first_lasting(away: NDArray[np.bool_]) -> int:
    """Return the first of two rows that both are so: a single sample that is off is no onset."""
    return int(np.argmax(away[:-1] & away[1:]))


def _grows_with_size(late: list[int], changes: FloatArray) -> bool:
    """Whether larger changes of a voltage come later, each: it is one that follows its command at a limited rate.

    Of latencies that know nothing of the changes one in n! does so.
    """
    by_size = [rows for _, rows in sorted(zip(changes.round(9).tolist(), late, strict=True))]
    return len(late) >= LEAST_ORDERED and by_size == sorted(late)


def _has_left(i: FloatArray, before: FloatArray, change: float, noise: float) -> bool:
    """Whether a current has left its course at once already, by less than a single sample tells.

    As that of a motor whose circuit opens: it falls from little to nothing.
    """
    if len(i) <= LEAST_SHIFT or not len(before):
        return False
    noise = max(noise, float(np.std(i[1:])))  # of a machine that runs it may be larger: these samples show it
    away = (float(np.mean(i[1:])) - median(before) - _on_its_course(before, 0.5 * len(i), noise)) * np.sign(change)
    return bool(away > ONSET_NOISE * noise * np.sqrt(1 / (len(i) - 1) + MEDIAN_OF / len(before)))


def _on_its_course(before: FloatArray, rows: float, noise: float) -> float:
    """Return by how much a current, (n,), changes from its middle to rows after it if it goes on so; 0: it stays."""
    n = len(before)
    times = np.arange(n) - 0.5 * (n - 1)
    power = float(times @ times)
    slope = float(times @ before) / power if power > 0 else 0.0
    return slope * (0.5 * (n - 1) + rows) if abs(slope) * math.sqrt(power) > MOVES * noise else 0.0
