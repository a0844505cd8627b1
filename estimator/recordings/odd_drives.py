"""What a drive or a shaft did that v, i and w alone do not say: held, coasting, not connected yet. Knows no FMU.

None of these is a mistake of reading. Each makes a plain motor's model wrong for the recording, or blind to a part of
it, and shows in the samples before any search.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.finding import Evidence, Finding
from estimator.recordings.lag import lag_misfit
from estimator.recordings.samples import filled, median_of_known, quantile
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

NONE = 0.02  # of the largest voltage: less is none
TURNS = 0.2  # of the largest speed: more is a motor that turns
NO_CURRENT = 0.03  # of the largest current: less is none; a motor that is shorted at a fifth of its speed takes a fifth
LASTS = 20  # samples
WINDING = 0.15  # of the current's deviation: more is no winding that stands still
MOVES = 8.0  # deviations of the noise from end to end: less is no movement
BAND = 0.08  # of a ramp: a dead band
LEFT = 0.5  # of the largest voltage: one that is never less does not show what was switched
LONG, RISES = 0.05, 3  # of a recording, times the speed's own rise: so long no drive takes to answer
STOOD = 0.4  # of the speed of a motor that lags: less is one that stood


def is_held(title: str, time: FloatArray, signals: Mapping[str, FloatArray]) -> Finding | None:
    """Find a shaft that does not turn while current flows: a test with a locked rotor."""
    if not {"v", "i", "w"} <= signals.keys():
        return None
    i, w = _known(signals["i"]), _known(signals["w"])
    if np.ptp(w) == 0 or np.ptp(w) > MOVES * noise_deviation(w) or np.ptp(i) < 3 * MOVES * noise_deviation(i):
        return None
    if lag_misfit(time, filled(signals["v"]), signals["i"], enough=WINDING) > WINDING:
        return None
    return Finding(
        "held",
        f"{title}: the speed never leaves its noise while the current goes to {float(np.max(np.abs(i))):.3g} A: the"
        " shaft is held; that tells R and L alone: hold K, J and B with --fix, or let it turn",
        evidence=(Evidence("w", float(time[0]), float(time[-1])),),
    )


def coasts(title: str, time: FloatArray, signals: Mapping[str, FloatArray]) -> Finding | None:
    """Find a motor that coasts while 0 V are logged: shorted, it would brake by the current of its own voltage."""
    if not {"v", "i", "w"} <= signals.keys():
        return None
    v, i, w = (signals[name] for name in ("v", "i", "w"))
    i_max, w_max = (quantile(np.abs(y), 0.995) for y in (i, w))
    free = (np.abs(v) < NONE * np.nanmax(np.abs(v))) & (np.abs(w) > TURNS * w_max)
    if np.count_nonzero(free) < LASTS or noise_deviation(i) > NO_CURRENT * i_max:
        return None
    standing = np.abs(w) < NONE * w_max
    zero = median_of_known(i[standing]) if standing.any() else 0.0
    if not median_of_known(np.abs(i - zero)[free]) < NO_CURRENT * i_max:
        return None
    first = int(np.argmax(free))
    return Finding(
        "coasts",
        f"{title}: from t = {time[first]:.6g} s the motor turns at {abs(float(w[first])):.3g} rad/s without a current"
        " while 0 V are logged: its driver is open, and the voltage is the motor's own, or the current's sensor shows"
        " none that flows back; leave the coasting out with"
        f" --window, or put {time[first]:.6g} s as its end",
        evidence=(Evidence("i", float(time[first]), float(time[np.flatnonzero(free)[-1]])),),
    )


def waits(title: str, time: FloatArray, signals: Mapping[str, FloatArray]) -> Finding | None:
    """Find a motor that stands without a current at first, in a recording whose voltage is there from end to end."""
    answers = {name: signals[name] for name in ("i", "w") if name in signals}
    if "v" not in signals or not answers:
        return None
    v = _known(signals["v"])
    if len(v) < LASTS or np.min(np.abs(v)) <= LEFT * np.max(np.abs(v)):
        return None
    moved = np.zeros(len(time), dtype=bool)
    for name, y in answers.items():
        largest = quantile(np.abs(y), 0.995)
        zero = median_of_known(y[:LASTS]) if name == "i" else 0.0
        if not abs(zero) < STOOD * largest:
            return None
        moved |= np.abs(y - zero) > max(NONE * largest, MOVES * noise_deviation(y))
    first = int(np.argmax(moved))
    if first < LASTS or np.ptp(_known(signals["v"][:first])) > LEFT * np.max(np.abs(v)):
        return None  # what changes while the motor stands is a command that reaches it late
    waited = float(time[first] - time[0])
    if waited < min(LONG * float(time[-1] - time[0]), RISES * _rise(time, signals.get("w"), first)):
        return None
    return Finding(
        "unit v",
        f"{title}: {float(np.median(v)):.4g} V are logged from the first row on, and until t = {time[first]:.6g} s the"
        " motor stands without a current: this is the supply before a switch or a drive; say --unit v=V if the motor"
        " then got all of it, and --scale v=FACTOR beside it if it got a part",
        evidence=tuple(Evidence(name, float(time[0]), float(time[first])) for name in answers),
    )


def dead_band(title: str, time: FloatArray, signals: Mapping[str, FloatArray]) -> Finding | None:
    """Find a motor that stands until a voltage that rises from zero, on a line, has overcome its dry friction.

    Far behind its start the speed is on a line too, s (t − t0). A motor that only lags is at s T / e at t0, where T is
    from the voltage's start to t0; one that stood is at 0.
    """
    if not {"v", "w"} <= signals.keys() or np.isnan(signals["v"]).any():
        return None
    v, w = np.abs(signals["v"]), np.abs(filled(signals["w"]))
    top = int(np.argmax(v))
    first = int(np.argmax(v > NONE * v[top]))
    if top - first < 5 * LASTS:
        return None
    rise = slice(first, top + 1)
    t, v, w = time[rise], v[rise], w[rise]
    slope, start = np.polyfit(t, v, 1)
    from_zero = start + slope * t[0] < 2 * NONE * v[-1]  # not the noise of a step's level
    if slope <= 0 or not from_zero or np.max(np.abs(v - start - slope * t)) > NONE * v[-1]:
        return None
    late = slice(len(t) // 2, None)
    rate, offset = np.polyfit(t[late], w[late], 1)
    if rate <= 0:
        return None
    begins, zero = -offset / rate, -start / slope
    stood = begins - zero
    near = np.abs(t - begins) < stood / 10
    if stood < BAND * (t[-1] - zero) or np.count_nonzero(near) < 3:
        return None
    lagging = rate * stood / math.e
    noise = noise_deviation(signals["w"]) / np.sqrt(np.count_nonzero(near))
    if lagging < MOVES * noise or float(np.mean(w[near])) > STOOD * lagging + 2 * noise:
        return None
    return Finding(
        "dead band",
        f"{title}: the motor stands until the voltage has risen to {slope * stood:.2g} V: a dead band, of dry friction"
        " or of the driver, which the plain motor has not; estimate it with --fmu dc_motor_friction",
        evidence=(Evidence("w", float(t[0]), float(begins)),),
    )


def _rise(time: FloatArray, w: FloatArray | None, first: int) -> float:
    """Return how long after a row a speed takes to most of its largest, s; without end where it is not measured."""
    if w is None:
        return math.inf
    far = np.abs(w[first:]) > (1 - 1 / math.e) * quantile(np.abs(w), 0.995)
    return float(time[first + int(np.argmax(far))] - time[first]) if far.any() else math.inf


def _known(y: FloatArray) -> FloatArray:
    return y[~np.isnan(y)]
