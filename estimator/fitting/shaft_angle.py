"""The shaft's angle, as a recording's angle or speed tells it, and the orders of it that the sampling folds. No fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.noise.clock import Clock
from estimator.recordings.samples import filled
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

HIGHEST_ORDER, AT_ONCE = 64, 16_000  # of the angle; numbers that are made at once
LINE_CYCLES, FOLDED = 10.0, 0.05  # in a recording; of its rows: an order that is aliased below may be a drift
SPIKE, TURNING = 8.0, 0.2  # standard deviations of a speed's noise; of the largest speed: where it is turning


def shaft_angle(measured: FloatArray, outputs: Sequence[str], clocks: Sequence[Clock]) -> FloatArray | None:
    """Return the shaft's angle, rad, (rows,), integrated from the measured speed; None where there is none.

    Of the measured speed: a simulated one with an error of half a percent loses whole periods of a high order.

    Parameters
    ----------
    measured : (rows, q) array
        Of the outputs; NaN where a sample is missing.
    """
    if "angle" in outputs:
        return filled(measured[:, outputs.index("angle")])
    if "w" not in outputs:
        return None
    w, result = measured[:, outputs.index("w")], np.zeros(len(measured))
    for clock in clocks:
        part, t = _without_spikes(filled(w[clock.rows])), clock.time
        result[clock.rows] = np.concatenate([[0.0], np.cumsum(0.5 * (part[1:] + part[:-1]) * np.diff(t))])
    return result


def unfolded_orders(theta: FloatArray) -> NDArray[np.bool_]:
    """Return which orders, from 1, of a recording's angle, (n,), the sampling does not alias to a slow change."""
    turn = np.diff(theta, prepend=theta[0])
    turn = turn[np.abs(turn) > TURNING * np.max(np.abs(turn))]
    if not len(turn):  # it stands
        return np.zeros(HIGHEST_ORDER, dtype=bool)
    orders, at_once = np.arange(1, HIGHEST_ORDER + 1) / (2 * np.pi), max(1, AT_ONCE // len(turn))
    slow = []
    for some in (orders[k : k + at_once] for k in range(0, HIGHEST_ORDER, at_once)):
        turns = some[:, None] * turn
        folded = np.abs(turns - np.round(turns))
        slow.append(np.count_nonzero(folded < LINE_CYCLES / len(turn), axis=1))
    return np.asarray(np.concatenate(slow) <= FOLDED * len(turn))


def _without_spikes(w: FloatArray) -> FloatArray:
    """Return a speed, (n,), with lone samples far off replaced: each would turn the shaft on for good."""
    if len(w) < 3:
        return w
    before, after = np.concatenate([w[:1], w[:-1]]), np.concatenate([w[1:], w[-1:]])
    beside = np.maximum(np.minimum(before, w), np.minimum(np.maximum(before, w), after))  # the median of three
    turns = np.abs(beside) > TURNING * float(np.max(np.abs(beside)))  # at rest there is less noise
    return np.where(turns & (np.abs(w - beside) > SPIKE * noise_deviation(w[turns])), beside, w)
