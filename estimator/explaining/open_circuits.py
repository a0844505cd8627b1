"""Circuits that open: what is measured then is the motor's own voltage, and drives nothing. Knows plans, no fit.

A drive that lets go of its motor leaves it without a current, at once; the voltage at its terminals is then K w. Of
the linear motor, driven by this voltage, hardly a current would flow either, but the voltage's noise would make one,
and what flows before would fade with the winding's time constant. So these rows are read as those of a command are: no
voltage, and a circuit that is open (`Coasting`). At the end an estimate of K must agree with what the voltage tells.
"""

from __future__ import annotations

import bisect
import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.latency import edges_of
from estimator.plans.plan import Observed, Plan
from estimator.recordings.samples import filled, median
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_ROWS = 10  # of an open circuit, and of the current before it
DROPS = 0.3  # of the current before: what is left of it in an open circuit, at most, but for noise
NOISE = 4.0  # deviations
NONE = 0.1  # of the current before: the mean of none
OWN = 0.1  # of how far the motor's own voltage moves: it differs from K w by less, but for noise
FALLS = 0.02  # of its speed: a motor that coasts loses more, from one half to the other
SURE = 10.0  # standard errors of that fall, of speed and of voltage
AGREES, LEAST_APART = 4.0, 2e-3  # standard errors; parts: a smaller difference is within the sensors' gains
HELD = 0.2  # of the rows: a motor's own voltage does not stay where it was for longer
ON = 0.1  # of the largest voltage
SHOWN_ON = 3  # rows in which a sensor shows a current that has ended, at most
LEVEL_ROWS = 100  # before a jump that tell its current
JUMPS = 3.0  # times the largest change of the voltage in the rows behind: a jump


@dataclass(frozen=True)
class OwnVoltage:
    """What the voltage of a motor whose circuit is open tells: a sentence, the recording's number, and its rows.

    Attributes
    ----------
    time, voltage, speed : (n,) arrays
        s, V and rad/s, all of one recording; the voltage is NaN where the circuit is closed.
    """

    sentence: str
    recording: int
    time: FloatArray
    voltage: FloatArray
    speed: FloatArray

    def constant(self, late: float) -> tuple[float, float]:
        """Return the fall of the voltage over that of the speed, V.s/rad, and its standard error, whatever the offsets.

        Each opening of the circuit falls from its first half to its second; (nan, inf) where no speed does.

        Parameters
        ----------
        late : float
            s by which the speed is shown later than the voltage.
        """
        known = np.isfinite(self.speed)
        then = np.interp(self.time + late, self.time[known], self.speed[known], right=np.nan)
        open_rows = np.flatnonzero(np.isfinite(self.voltage))
        openings = []
        for rows in np.split(open_rows, np.flatnonzero(np.diff(open_rows) > 1) + 1):
            v, w = self.voltage[rows], then[rows]
            if np.count_nonzero(shown := np.isfinite(w)) > 1:
                openings.append((v[shown], w[shown]))
        falls = np.array([[_half_fall(v), _half_fall(w)] for v, w in openings]).reshape(-1, 2)
        rows_of = np.array([len(v) for v, _ in openings], dtype=float)
        power = float(rows_of @ falls[:, 1] ** 2)
        if not power:
            return np.nan, np.inf
        k = float(rows_of @ (falls[:, 0] * falls[:, 1])) / power
        left = np.concatenate([v - k * w - np.mean(v - k * w) for v, w in openings])
        return k, 2 * float(np.std(left)) / float(np.sqrt(power))

    def doubt(self, k: float, error: float, late: float) -> str:
        """Return why an estimate of K, of this standard error, is doubtful; "" where both agree."""
        own, own_error = self.constant(late)
        apart = abs(k - own)
        if not apart >= max(AGREES * float(np.hypot(error, own_error)), LEAST_APART * abs(own)):
            return ""
        return (
            f"the motor's own voltage, while its circuit is open, tells K = {own:.4g}, all else {k:.4g}: brushes or"
            " drive drop a voltage, or the motor is another at large currents"
        )


def _half_fall(signal: FloatArray) -> float:
    """Return by how much the mean of a signal's first half, (n,), is above that of its second."""
    half = len(signal) // 2
    return float(np.mean(signal[:half]) - np.mean(signal[half:]))


def with_open_circuits(plan: Plan) -> tuple[Plan, tuple[OwnVoltage, ...]]:
    """Return the plan without voltages that are the motor's own, and what was found."""
    observed, told = [], []
    for e, o in enumerate(plan.observed):
        opens = open_rows(o)
        if opens is None:
            observed.append(_without_openings(o))
            continue
        begins = np.flatnonzero(opens & ~np.append(False, opens[:-1]))
        current, jumps = o.outputs["i"].copy(), edges_of(o.inputs["v"]).tolist()
        for k in begins.tolist():  # it has fallen within the row, or is about to
            current[_first_of(jumps, k) : k + 1] = np.nan
        inputs = {**o.inputs, "v": np.where(opens, 0.0, o.inputs["v"])}
        observed.append(dataclasses.replace(o, inputs=inputs, outputs={**o.outputs, "i": current}))
        at = ", ".join(f"{o.recording.time[k]:.4g}" for k in begins.tolist())
        sentence = (
            f"{o.recording.title}: from t = {at} s no current flows while the voltage follows the speed: it is the"
            " motor's own, and the circuit is open"
        )
        own = np.where(opens, o.inputs["v"], np.nan)
        told.append(OwnVoltage(sentence, e, o.times, own, o.outputs["w"]))
    return dataclasses.replace(plan, observed=tuple(observed)), tuple(told)


def _without_openings(o: Observed) -> Observed:
    """Return a recording without the current's samples at the instants at which its command opens the circuit.

    A current that ends at once ends before or after the sample of the row in which the command does: no delay tells.
    """
    if not {"i", "w"} <= set(o.outputs) or "v" not in o.inputs:
        return o
    v, i, w = o.inputs["v"], filled(o.outputs["i"]), np.abs(filled(o.outputs["w"]))
    noise, current = NOISE * noise_deviation(o.outputs["i"]), o.outputs["i"].copy()
    for k in (np.flatnonzero((v[1:] == 0) & (v[:-1] != 0)) + 1).tolist():
        before, after = i[max(0, k - LEAST_ROWS) : k], i[k : k + LEAST_ROWS]
        none = max(noise, DROPS * abs(median(before)))
        if w[k] > ON * np.max(w) and abs(median(before)) > none and np.all(np.abs(after) < none):
            current[k] = np.nan
    return dataclasses.replace(o, outputs={**o.outputs, "i": current})


def open_rows(o: Observed) -> BoolArray | None:
    """Return the rows of a recording, (n,), in which its measured voltage is the motor's own; None: there are none."""
    if not {"i", "w"} <= set(o.outputs) or "v" not in o.inputs:
        return None
    v, i, w = o.inputs["v"], filled(o.outputs["i"]), filled(o.outputs["w"])
    driven = np.abs(v) > ON * np.max(np.abs(v), initial=0.0)
    rests = ~driven & (np.abs(w) < ON * np.max(np.abs(w), initial=0.0))
    first = int(np.argmax(driven))
    zero = median(i[:first][rests[:first]]) if np.count_nonzero(rests[:first]) >= LEAST_ROWS else 0.0
    noise = noise_deviation(o.outputs["i"])
    opens = np.zeros(len(v), dtype=bool)
    size = np.abs(i - zero)
    total = np.concatenate([[0.0], np.cumsum(size)])
    mean = np.zeros(len(v))  # of the rows before
    mean[LEAST_ROWS:] = (total[LEAST_ROWS:-1] - total[: -LEAST_ROWS - 1]) / LEAST_ROWS
    falls = (size < np.maximum(2 * DROPS * mean, NOISE * noise)) & (mean > 1.5 * NOISE * noise) & driven
    for k in np.flatnonzero(falls).tolist():
        usual = median(size[k - LEAST_ROWS : k])
        none = max(DROPS * usual, NOISE * noise)
        if opens[k] or usual < 2 * none or size[k - 1] < none or size[k] > none:
            continue
        flows = size[k:] > none
        twice = np.flatnonzero(flows[:-1] & flows[1:])  # one alone is an outlier
        end = k + (int(twice[0]) if len(twice) else len(flows))
        held = _held(v[k:end])
        if _is_open(v[k + held : end], i[k + held : end] - zero, w[k + held : end], usual):
            opens[_opened_at(v, k + held) : end] = True
    for k, end, usual in _behind_jumps(v, i - zero):
        if not opens[k:end].any() and not _held(v[k:end]) and _is_open(v[k:end], i[k:end] - zero, w[k:end], usual):
            opens[k:end] = True
    return opens if opens.any() else None


def _behind_jumps(v: FloatArray, i: FloatArray) -> Iterator[tuple[int, int, float]]:
    """Yield the first and last row behind each jump of a voltage, (n,), to the next, and the usual current before it.

    The current of a motor that runs without a load is soon below its noise: only its mean shows that it has ended. The
    winding drives it on through a diode meanwhile, and the voltage jumps twice.
    """
    jumps = edges_of(v).tolist()
    for k, end in itertools.pairwise([*jumps, len(v)]):
        if end - k < LEAST_ROWS:  # of a random signal most
            continue
        first = _first_of(jumps, k)
        before = i[max(0, first - LEVEL_ROWS) : first]
        usual = abs(float(np.mean(before))) if len(before) >= LEAST_ROWS else 0.0
        if usual > NOISE * float(np.std(before)) / float(np.sqrt(max(len(before), 1))):
            yield k, end, usual


def _first_of(jumps: Sequence[int], k: int) -> int:
    """Return the first of those jumps of a voltage that a winding makes before its circuit is open, in row k."""
    at, first = bisect.bisect_left(jumps, k), k
    while at > 0 and first - jumps[at - 1] <= SHOWN_ON:
        at -= 1
        first = jumps[at]
    return first


def _held(v: FloatArray) -> int:
    """Return for how many rows a voltage, (n,), is held at first: a motor's own falls at once.

    The current of a motor that runs up may have fallen below its noise long before the circuit opens.
    """
    near = np.abs(v - median(v[:LEAST_ROWS])) <= NOISE * noise_deviation(v)
    held = int(np.flatnonzero(near)[-1]) + 1 if near.any() else 0
    return held if held > max(LEAST_ROWS, HELD * len(v)) else 0


def _opened_at(v: FloatArray, k: int) -> int:
    """Return the row in which a circuit opened whose current has ended in row k: the voltage, (n,), jumps there.

    The winding drives its current on until it has ended, and a sensor may show it a little longer.
    """
    if v[k - 1] * v[k] < 0:
        return k - 1
    least = JUMPS * float(np.max(np.abs(np.diff(v[k : k + LEAST_ROWS])))) + NOISE * noise_deviation(v)
    rows = [row for row in range(k, k - SHOWN_ON - 1, -1) if abs(v[row] - v[row - 1]) > least]
    return rows[0] if rows else k


def _is_open(v: FloatArray, i: FloatArray, w: FloatArray, usual: float) -> bool:
    """Whether no current flows in some rows, (n,), while the motor loses speed and its voltage follows that."""
    if len(v) < LEAST_ROWS or abs(float(np.mean(i))) > NONE * usual or not np.any(w):
        return False
    k = float(v @ w) / float(w @ w)
    noise = noise_deviation(v) + abs(k) * noise_deviation(w)
    if float(np.std(v - k * w)) > OWN * float(np.std(v)) + NOISE * noise:
        return False
    (speed, speed_error), (voltage, voltage_error) = _fall(w), _fall(v)
    if min(speed - SURE * speed_error, voltage - SURE * voltage_error) < 0 or min(speed, voltage) < FALLS:
        return False
    return abs(voltage - speed) < OWN * speed + NOISE * float(np.hypot(speed_error, voltage_error))


def _fall(signal: FloatArray) -> tuple[float, float]:
    """Return the part of a signal, (n,), that its second half has lost against its first, and its standard error."""
    half = len(signal) // 2
    first, second = abs(float(np.mean(signal[:half]))), abs(float(np.mean(signal[half:])))
    if not first:
        return 0.0, 0.0
    return 1 - second / first, noise_deviation(signal) / first * 2 / float(np.sqrt(len(signal)))
