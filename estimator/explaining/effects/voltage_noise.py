"""The logged voltage has a sensor's noise that the motor's voltage does not have: no input of the model."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.coarse_levels import MOST_VALUES, level_error
from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import edges_of
from estimator.fitting.motor_response import late_response, motor_values
from estimator.plans.part import LONG
from estimator.plans.plan import Plan
from estimator.recordings.quantum import quantum
from estimator.recordings.signal_noise import input_noise
from estimator.recordings.smooth_inputs import moves_smoothly, smoothed

FloatArray = NDArray[np.float64]

LEAST_PART, MOST_PART = 0.3, 2.0  # of all of it: a quiet voltage tells the part by its noise, to a third or so
LEAST_NOISE = 1e-6  # of the largest voltage: less is rounding
LEAST_ROWS = 20  # of a level for each signal that its voltage may follow
ALL_OF_IT, FAR = 0.05, 4.0  # from 1, absolute and in standard errors: all of the noise is the sensor's
MOST_CHANGES = 3000  # levels, at most: more are a signal
MOST_LEVELS = 60  # of all recordings, whose voltages have errors of their own: of more levels they average out
MOST_HATS = 100  # errors of a recording's smooth voltage: of more the slow part is told
MOVES = 3e-3  # of a signal's largest: what moves less in a level is the response to the voltage's noise
A_SIGNAL = 10.0  # times the noise from row to row: what moves so far in a level is a signal, such as a wave's crest
DEPENDENT = 1e-6  # of the largest singular value: the current does not differ from the speed


@dataclass(frozen=True)
class VoltageNoise(Effect):
    """The part of the voltage's noise that the motor does not see, 0 to 1."""

    name: str = "voltage noise"
    prior: float = 0.1
    sharp: bool = True  # delays and lags would explain a part of it
    sentence: str = "the logged voltage's noise does not reach the motor ({percent:.0f} % of it is the sensor's)"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the response, with opposite sign, to what is noise in the logged voltage."""
        around = fit.once(around_of)
        if not around.any():
            return ()
        columns = late_response(fit, -around)[:, :, None]
        return [Linear(self.name, columns, ("",), least=LEAST_PART, most=MOST_PART)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say which part is the sensor's: all of it, at most, where the estimate is above that."""
        return super().tell(name, min(value, 1.0), plan)


def without_noise(fit: Fit, plan: Plan) -> Plan | None:
    """Return a plan with the voltages that the motor sees; None where their noise reaches it, or a part of it.

    The column of `VoltageNoise` takes the noise out of what is simulated, but not out of its derivatives: of these a
    response that is not there would tell L, as it is noise that changes in every row.
    """
    if VoltageNoise.name not in fit.names:
        return None
    k = fit.names.index(VoltageNoise.name)
    off, deviation = fit.estimates[k] - 1.0, float(np.sqrt(fit.covariance()[k, k]))
    if off < -max(ALL_OF_IT, FAR * deviation):  # more than all of it is all of it
        return None
    s = fit.simulator
    around, shown = around_of(fit), np.nan_to_num(fit.explained)
    return quieted(plan, [around[c.rows] for c in s.clocks], [shown[c.rows] for c in s.clocks])


def quieted(plan: Plan, around: Sequence[FloatArray], shown: Sequence[FloatArray]) -> Plan:
    """Return a plan whose voltages are without their noise, (n,) each, V, and what is not known of them then.

    Parameters
    ----------
    shown : (n, q) arrays
        As for `noise_of`.
    """
    smooth = [moves_smoothly(o.inputs["v"]) for o in plan.observed]
    followed = [
        [] if is_smooth else list(_followed(o.inputs["v"], own))
        for o, own, is_smooth in zip(plan.observed, shown, smooth, strict=True)
    ]
    is_told = sum(map(len, shown)) <= LONG and sum(len(parts) for parts in followed) <= MOST_LEVELS
    observed = []
    for o, own, parts, is_smooth in zip(plan.observed, around, followed, smooth, strict=True):
        quiet, uncertain = o.inputs["v"] - own, o.uncertain  # that of a command is of its digits
        if is_told and (own.any() or uncertain is None):
            of_levels = () if is_smooth else (_uncertain(o.inputs["v"], own, parts), _between_rows(quiet, parts))
            uncertain = np.column_stack(of_levels) if of_levels else _left_of_noise(o.inputs["v"])
        inputs, was = {**o.inputs, "v": quiet}, o.is_measured
        observed.append(dataclasses.replace(o, inputs=inputs, uncertain=uncertain, is_quiet=was))
    return dataclasses.replace(plan, observed=tuple(observed))


def _uncertain(u: FloatArray, around: FloatArray, parts: Sequence[tuple[slice, FloatArray]]) -> FloatArray:
    """Return the errors in V of what a voltage follows, (n, k), as it is told from noisy samples, (n,).

    Samples of a converter whose steps are no smaller than the noise share an error (`level_error`). Where it shows
    none at all there is none.
    """
    columns, k = np.zeros((len(around), sum(basis.shape[1] for _, basis in parts))), 0
    shared = _of_converter(u, [level for level, _ in parts]) if around.any() else [0.0] * len(parts)
    for (level, basis), error in zip(parts, shared, strict=True):
        columns[level, k : k + basis.shape[1]] = np.std(around) * basis
        columns[level, k] = np.hypot(columns[level, k], error)
        k += basis.shape[1]
    return columns


def with_errors_of_converters(plan: Plan) -> Plan:
    """Return a plan that knows what of its measured voltages' levels a coarse converter leaves open."""
    observed = []
    for o in plan.observed:
        if o.uncertain is None and o.is_measured and not moves_smoothly(u := o.inputs["v"]):
            levels = levels_of(u)
            errors = _of_converter(u, levels) if len(levels) <= MOST_LEVELS else []
            columns = np.zeros((len(u), np.count_nonzero(errors)))
            for k, (level, error) in enumerate((a, b) for a, b in zip(levels, errors, strict=False) if b > 0):
                columns[level, k] = error
            o = dataclasses.replace(o, uncertain=columns if columns.size else None)
        observed.append(o)
    return dataclasses.replace(plan, observed=tuple(observed))


def _of_converter(u: FloatArray, levels: Sequence[slice]) -> list[float]:
    """Return what the samples of each level of a voltage, (n,), share as an error, V: by a converter's steps."""
    step = max((_apart(u[level]) for level in levels), default=0.0) or quantum(u)
    return [level_error(u[level], step) if step > 0 and u[level].any() else 0.0 for level in levels]


def _apart(shown: FloatArray) -> float:
    """Return the distance of the few values that a level shows; 0: it shows one, or many."""
    values = np.unique(shown)
    return float(np.min(np.diff(values))) if 2 <= len(values) <= MOST_VALUES else 0.0


def _left_of_noise(v: FloatArray) -> FloatArray:
    """Return the errors in V of a smooth voltage that is told by its noisy samples, (n, k): hats beside each other.

    Each is as wide as the rows that tell a row: the mean of all of them is then known as the mean of the noise is.
    """
    n, told = len(v), smoothed(v)
    if told.errors is not None:
        return np.asarray(told.noise * told.errors)
    width = max(told.rows, n / MOST_HATS)
    tops = np.arange(0.0, n + width, width)
    hats = np.maximum(1 - np.abs(np.arange(n)[:, None] - tops) / width, 0.0)
    return np.asarray(told.noise / np.sqrt(width) * hats)


def _between_rows(quiet: FloatArray, parts: Sequence[tuple[slice, FloatArray]]) -> FloatArray:
    """Return the errors in V, (n, 2), of a voltage that follows the current within the intervals of its levels.

    In the first one it falls as fast as the current rises, of which few samples show the course; all edges err alike.
    In all of them it moves by half of what it does from row to row, where the log holds samples and no means: as much
    as an inductance that is larger by half of an interval times the source's resistance.
    """
    columns = np.zeros((len(quiet), 2))
    for level, basis in parts:
        if basis.shape[1] > 1:
            moves = np.diff(quiet[level])
            columns[level.start, 0] = moves[0]
            columns[level.start : level.stop - 1, 1] = 0.5 * moves
    return columns


def around_of(fit: Fit) -> FloatArray:
    """Return the noise of the voltages, (rows,); zero where there is none, or the fit is no motor's."""
    s = fit.simulator
    around = np.zeros(s.rows)
    if motor_values(fit) is None:
        return around
    v = s.inputs("v")
    for clock in s.clocks:
        around[clock.rows] = noise_of(v[clock.rows], fit.explained[clock.rows])
    return around if np.max(np.abs(around)) > LEAST_NOISE * np.max(np.abs(v)) else np.zeros(s.rows)


def noise_of(u: FloatArray, shown: FloatArray) -> FloatArray:
    """Return the noise of a voltage, (n,): what of each level is no constant, and no part of current or speed.

    A source sags in proportion to the current, and the voltage of a motor that coasts to its speed. Zero where it has
    too many levels to have any, and where a signal moves within them.

    Parameters
    ----------
    shown : (n, q) array
        What the sensors show without noise.
    """
    if moves_smoothly(u):
        return np.asarray(u - smoothed(u).signal)
    if len(levels_of(u)) > MOST_CHANGES:
        return np.zeros(len(u))
    result = u.copy()
    for level, basis in _followed(u, shown):
        result[level] -= basis @ (basis.T @ u[level])
    return np.zeros(len(u)) if float(np.std(result)) > A_SIGNAL * input_noise(u) else result


def levels_of(u: FloatArray) -> list[slice]:
    """Return the rows of each level of a voltage, (n,): a source that sags in the next row makes no other.

    Rows of exactly none are a level of their own: those in which it is the motor's.
    """
    jumps = edges_of(u)
    change = np.diff(u)[jumps - 1]
    sags = (np.diff(jumps) == 1) & (change[1:] * change[:-1] < 0) & (2 * np.abs(change[1:]) < np.abs(change[:-1]))
    jumps = jumps[~np.concatenate([[False], sags])[: len(jumps)]]
    none = np.flatnonzero(np.diff(u == 0, prepend=False, append=False)).reshape(-1, 2)
    none = none[none[:, 1] - none[:, 0] >= LEAST_ROWS]
    ends = [0, *np.union1d(jumps, none[(none > 0) & (none < len(u))]).tolist(), len(u)]
    return [slice(first, last) for first, last in itertools.pairwise(ends)]


def _followed(u: FloatArray, shown: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the rows of each level of a voltage, and what it may follow there, orthonormal: (rows, k)."""
    largest = np.max(np.abs(np.nan_to_num(shown)), axis=0, initial=0.0)
    for level in levels_of(u):
        rows = level.stop - level.start
        columns = np.ones((rows, 1)) / np.sqrt(rows)
        if rows >= LEAST_ROWS * (1 + shown.shape[1]):
            own = np.nan_to_num(shown[level])
            away = own - np.mean(own, axis=0)
            moving = away[:, np.sqrt(np.mean(away * away, axis=0)) > MOVES * largest]
            basis, sizes, _ = np.linalg.svd(moving / np.maximum(np.linalg.norm(moving, axis=0), 1e-300), False)
            columns = np.column_stack([columns, basis[:, sizes > DEPENDENT]])
        yield level, columns
