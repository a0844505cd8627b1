"""Integral least squares: a first guess of the five parameters straight from the recording. Knows the motor, no FMU.

Both equations of the motor, integrated once from the first row that shows both signals, are linear in the parameters:

    ∫v = R ∫i + L (i − i₀) + K ∫w             ∫load = K ∫i − J (w − w₀) − B ∫w

The first gives R, L, K; with K known the second gives J, B. No derivative of a noisy signal is taken. The integrals
of i and w are trapezoids, that of v is exact for a held voltage, so the guess is off by terms of (h/τ)².

Speed alone tells two numbers, a and b of w' = a v − b w (and a constant, of the load), the current being left out as
settled: with R known elsewhere and most of the braking electrical, they give K and J.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.samples import filled

FloatArray = NDArray[np.float64]

MECHANICAL = 0.02  # of the braking by K²/R: what a motor's own friction brakes, usually


def integral_estimate(
    v: FloatArray, i: FloatArray, w: FloatArray, *, step: float, load: float = 0.0
) -> dict[str, float]:
    """Return R, K, L, J, B [SI] from voltage, current and speed.

    Parameters
    ----------
    v, i, w : (n,) arrays
        V, A, rad/s; NaN where a sample is missing. v[k] holds from sample k to k + 1.
    step : float
        s, sampling interval.
    load : float
        N·m, constant load torque.

    Returns
    -------
    dict
        Values as they come out of the linear equations: with much noise they may be negative.
    """
    rows = _shown(i, w)
    v, i, w = v[rows], filled(i)[rows], filled(w)[rows]
    zero = np.zeros(1)
    integral_v = np.concatenate([zero, np.cumsum(v[:-1])]) * step
    integral_i = np.concatenate([zero, np.cumsum((i[1:] + i[:-1]) / 2)]) * step
    integral_w = np.concatenate([zero, np.cumsum((w[1:] + w[:-1]) / 2)]) * step
    R, L, K = _solve(np.column_stack([integral_i, i - i[0], integral_w]), integral_v)
    torque = K * integral_i - load * step * np.arange(len(v))
    J, B = _solve(np.column_stack([w - w[0], integral_w]), torque)
    return {"R": R, "K": K, "L": L, "J": J, "B": B}


def sane(guess: Mapping[str, float], v: FloatArray, i: FloatArray, w: FloatArray, *, step: float) -> dict[str, float]:
    """Replace what noise has driven out of reason by orders of magnitude that the signals allow."""
    peak_v, peak_i, peak_w = (max(float(np.nanmax(np.abs(x))), 1e-12) for x in (v, i, w))
    R = guess["R"] if 0 < guess["R"] < 1e3 * peak_v / peak_i else 0.5 * peak_v / peak_i
    K = guess["K"] if 0 < guess["K"] < 1e2 * peak_v / peak_w else 0.9 * peak_v / peak_w
    least_L = 0.05 * step * R
    L = guess["L"] if guess["L"] > least_L else 5 * step * R if guess["L"] <= 0 else least_L
    usual_J = K * K / R * 10 * step
    J = guess["J"] if guess["J"] > 1e-3 * usual_J else usual_J
    B = guess["B"] if guess["B"] > 1e-6 * K * K / R else 1e-2 * K * K / R
    return {"R": R, "K": K, "L": L, "J": J, "B": B}


def speed_estimate(v: FloatArray, w: FloatArray, *, step: float, R: float, L: float | None = None) -> dict[str, float]:
    """Return R, K, J, B [SI], and L where it is given, from voltage and speed, with a known or assumed resistance.

    Parameters
    ----------
    v, w : (n,) arrays
        V, rad/s; NaN where a sample is missing.
    step : float
        s, sampling interval.
    R, L : float
        Ohm, H; an inductance is made small enough for the speed to be settled electrically.

    Returns
    -------
    dict
        Empty where the signals do not follow each other as a motor's do.
    """
    rows = _shown(w)
    v, w = v[rows], filled(w)[rows]
    zero = np.zeros(1)
    integral_v = np.concatenate([zero, np.cumsum(v[:-1])]) * step
    integral_w = np.concatenate([zero, np.cumsum((w[1:] + w[:-1]) / 2)]) * step
    time = step * np.arange(len(v))
    a, b, _ = _solve(np.column_stack([integral_v, -integral_w, time]), w - w[0])
    if not (a > 0 and b > 0):
        return {}
    K = b / a / (1 + MECHANICAL)
    found = {"R": R, "K": K, "J": K / (R * a), "B": MECHANICAL * K * K / R}
    if L is not None:
        slow = R * found["J"] / found["K"] ** 2
        found["L"] = min(L, R * slow / 10)
    return found


def _shown(*signals: FloatArray) -> slice:
    """Return the rows, two at least, in which signals, (n,), have samples or stand between samples; else all rows.

    Before the first sample and behind the last a signal may be anything, and its integral with it.
    """
    known = [np.flatnonzero(~np.isnan(y)) for y in signals]
    first, last = max(int(k[0]) for k in known), min(int(k[-1]) for k in known)
    return slice(first, last + 1) if last > first else slice(None)


def _solve(columns: FloatArray, right: FloatArray) -> list[float]:
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq(columns / scale, right, rcond=None)[0] / scale
    return [float(x) for x in solution]
