"""Signals whose sign was lost, as behind a rectifier or a counter that tells no direction. Simulates nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.plans.plan import Observed
from estimator.recordings.samples import filled, median
from estimator.recordings.signal_noise import noise_deviation
from estimator.results.reason import Place, Reason

FloatArray = NDArray[np.float64]

BRAKES = 12  # samples before a voltage falls to none in which the current has settled, and in which it brakes
FOLDED = 2.5  # times the usual distance from the median is that of noise that was rectified, 1.7, at most
RECTIFIED = 50  # samples at rest that show a lost sign
MEAN_OF_FOLDED, BY_CHANCE = float(np.sqrt(2 / (np.pi - 2))), 4.0  # deviations: the mean of such noise; its own, at most
PLAINLY_DRIVEN = 0.2  # of the largest voltage
REVERSED = 10  # rows in each direction: fewer are a spike while a current decays, or a relay that bounces
PARTS, SETTLED, RUNS = 8, 0.05, 0.1  # of a level, two of which are alike; of the largest speed: a change, a motion


def lost_signs(o: Observed) -> list[str]:
    """Return why the signs of a recording's signals are lost; empty if they are not."""
    return _of_current(o) or _of_direction(o)


def place_of(o: Observed, signal: str, first: int, last: int) -> Place:
    """Return where some samples of a signal are, both ends included."""
    return Place(o.recording.name, signal, float(o.recording.time[first]), float(o.recording.time[last]))


def _of_direction(o: Observed) -> list[str]:
    """Find a speed or a voltage whose sign was lost: it has one, while the motor runs steadily by both of the other."""
    if "w" not in o.outputs or "v" not in o.inputs or any(np.any(u) for n, u in o.inputs.items() if n != "v"):
        return []
    v, w = o.inputs["v"], filled(o.outputs["w"])
    largest = float(np.max(np.abs(w)))
    least = -max(4 * noise_deviation(w), 0.02 * largest)
    if float(np.min(w)) >= least:
        steady = [rows for rows in _driven_backwards(v) if _runs_steadily(w[rows], largest)]
        name, signal, other = "w", "speed", f"the voltage goes down to {np.min(v):.4g} V"
    elif float(np.min(v)) >= 0:  # what lost its sign is no voltage of none
        driven = [rows for rows in _driven_backwards(w) if median(v[rows]) > PLAINLY_DRIVEN * float(np.max(v))]
        steady = [rows for rows in driven if _runs_steadily(-w[rows], largest)]
        name, signal, other = "v", "voltage", f"the speed goes down to {np.min(w):.4g} rad/s"
    else:
        return []
    if not steady:
        return []
    return [
        Reason(
            f"{o.recording.title}: {other}, and the motor runs steadily there, but the {signal} is never negative: its"
            " sign was lost; record the direction, too",
            place_of(o, name, steady[0].start, steady[0].stop - 1),
        )
    ]


def _driven_backwards(signal: FloatArray) -> list[slice]:
    """Return the rows in which a signal, (n,), is plainly negative, of each time it is so for long."""
    below = np.flatnonzero(signal < -PLAINLY_DRIVEN * float(np.max(np.abs(signal), initial=0.0)))
    runs = np.split(below, np.flatnonzero(np.diff(below) > 1) + 1)
    return [slice(int(run[0]), int(run[-1]) + 1) for run in runs if len(run) >= PARTS * REVERSED]


def _runs_steadily(w: FloatArray, largest: float) -> bool:
    """Whether a motor runs forwards in some rows, (n,), for a while at a speed that hardly changes."""
    part = len(w) // PARTS
    means = np.mean(w[: part * PARTS].reshape(PARTS, part), axis=1)
    steady = np.abs(np.diff(means)) < SETTLED * largest
    rose = np.minimum.accumulate(means)[:-1] < means[1:] - SETTLED * largest  # after it had stood
    all_along = float(np.ptp(means)) < SETTLED * largest  # and no slow fall of a heavy rotor
    return bool(np.any(steady & (rose | all_along) & (means[1:] > RUNS * largest)))


def _of_current(o: Observed) -> list[str]:
    """Find a current whose sign was lost: never negative where the voltage and the speed reverse, or at rest."""
    if "i" not in o.outputs or "v" not in o.inputs:
        return []
    v, i = o.inputs["v"], o.outputs["i"]
    known = i[~np.isnan(i)]
    noise = noise_deviation(known)
    lowest, highest = float(np.min(known)), float(np.max(known))
    plainly = PLAINLY_DRIVEN * float(np.max(np.abs(v)))
    if min(np.count_nonzero(v < -plainly), np.count_nonzero(v > plainly)) >= REVERSED:
        if lowest > -max(4 * noise, 0.02 * highest) and highest > 10 * noise:
            backwards = np.flatnonzero(v < 0)
            return [
                Reason(
                    f"{o.recording.title}: the voltage goes from {np.min(v):.4g} to {np.max(v):.4g} V, but the current"
                    f" never below {lowest:.3g} A: its sign was lost; record it with a sensor that tells the direction",
                    place_of(o, "i", int(backwards[0]), int(backwards[-1])),
                )
            ]
        return []
    if lowest > -max(4 * noise, 0.02 * highest) and (k := _rises_as_it_brakes(v, filled(i), plainly, noise)):
        return [
            Reason(
                f"{o.recording.title}: as the voltage falls to {v[k]:.3g} V the current rises to"
                f" {np.nanmax(i[k : k + BRAKES]):.3g} A, and that of a motor that brakes flows back: its sign was lost;"
                " record it with a sensor that tells the direction",
                place_of(o, "i", k, k + BRAKES - 1),
            )
        ]
    rest = i[: o.excitation.index] if o.excitation.kind == "step" and o.excitation.before == 0 else known[:0]
    rest = rest[~np.isnan(rest)]
    if len(rest) >= RECTIFIED and not o.excitation.running:
        above = rest[rest > 0]
        middle = median(above) if len(above) else 0.0
        is_folded = middle < FOLDED * median(np.abs(above - middle)) if len(above) else False
        if np.min(rest) >= 0 and len(above) > 0.9 * len(rest) and is_folded and not _is_offset(rest):
            return [
                Reason(
                    f"{o.recording.title}: the current at rest is never negative in {len(rest)} samples, with a mean of"
                    f" {np.mean(rest):.3g} A: its sign was lost; record it with a sensor that tells the direction",
                    place_of(o, "i", 0, o.excitation.index - 1),
                )
            ]
    return []


def _rises_as_it_brakes(v: FloatArray, i: FloatArray, plainly: float, noise: float) -> int:
    """Return the row in which a voltage above 0, (n,), ends and a settled current, (n,), then rises; 0: there is none.

    No motor's does, whatever its load: less voltage drives less current.
    """
    for k in (np.flatnonzero((np.abs(v[1:]) < 0.1 * plainly) & (v[:-1] > plainly)) + 1).tolist():
        before, after = i[max(0, k - BRAKES) : k], i[k : k + BRAKES]
        if min(len(before), len(after)) < BRAKES or np.ptp(v[k - BRAKES : k]) > 0.1 * plainly:
            continue
        rise = float(np.max(after) - np.max(before))
        if rise > max(8 * noise, float(np.max(before)), 4 * float(np.ptp(before))):
            return k
    return 0


def _is_offset(rest: FloatArray) -> bool:
    """Whether noise that is never negative, (n,), has a mean farther from zero than rectified noise would have.

    Of few digits the median's distances are whole steps, and tell less.
    """
    mean, deviation = float(np.mean(rest)), float(np.std(rest))
    error = np.sqrt((1 + MEAN_OF_FOLDED**2 / 2) / len(rest))  # of a mean in deviations
    return bool(mean > (MEAN_OF_FOLDED + BY_CHANCE * error) * deviation)
