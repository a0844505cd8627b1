"""What a DC motor does more for a voltage or a torque more, to first order. Knows R, K, L, J, B; no FMU, no noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.results.linear import is_motor, matrices

FloatArray = NDArray[np.float64]

SEATS = {"i": 0, "w": 1, "angle": 2}


def motor_values(fit: Fit) -> Mapping[str, float] | None:
    """Return R, K, L, J, B where the fit is a DC motor's and its sensors show current or speed; else None."""
    s = fit.simulator
    values = {**s.plan.fixed, **dict(zip(s.names, fit.values.tolist(), strict=True))}
    if not is_motor(values) or "v" not in s.observed[0].inputs or not set(s.outputs) <= set(SEATS):
        return None
    return values


def machine_of(fit: Fit) -> tuple[tuple[FloatArray, FloatArray] | None, tuple[int, ...]]:
    """Return A (2, 2) and b (2,) of d[i, w]/dt = A x + b torque, torque against the motion, and the channels' states."""
    values = motor_values(fit)
    if values is None:
        return None, tuple(-1 for _ in fit.simulator.outputs)
    a, b, _, _ = matrices(values)
    return (a, b[:, 1]), tuple(SEATS[y] if y != "angle" else -1 for y in fit.simulator.outputs)


def response(fit: Fit, *, voltage: FloatArray | None = None, torque: FloatArray | None = None) -> FloatArray:
    """Return what the sensors would show more, (rows, q), for inputs that are held over each row.

    Parameters
    ----------
    voltage, torque : (rows,) arrays
        V; N.m against positive speed.
    """
    from scipy.linalg import expm
    from scipy.signal import lfilter

    s = fit.simulator
    values = motor_values(fit)
    assert values is not None
    a, b, _, _ = matrices(values)
    whole = np.zeros((5, 5))
    whole[:2, :2], whole[2, 1], whole[:2, 3:] = a, 1.0, b
    result = np.zeros((s.rows, len(s.outputs)))
    for clock in s.clocks:
        step = expm(whole * clock.step)
        f, g = step[:2, :2], step[:2, 3:]
        u = np.zeros((clock.rows.stop - clock.rows.start, 2))
        for j, signal in enumerate((voltage, torque)):
            if signal is not None:
                u[:, j] = signal[clock.rows]
        # x[k+1] = F x[k] + G u[k]  =>  D(z) x = z^-1 (G + z^-1 (F - tr F) G) u,  D = 1 - tr F z^-1 + det F z^-2
        denominator = [1.0, -np.trace(f), np.linalg.det(f)]
        second = (f - np.trace(f) * np.eye(2)) @ g
        states = [
            sum(lfilter([0.0, g[row, j], second[row, j]], denominator, u[:, j]) for j in range(2)) for row in range(2)
        ]
        states.append(np.cumsum(states[1]) * clock.step)
        for j, y in enumerate(s.outputs):
            shown = np.asarray(states[SEATS[y]])
            for nuisance in s.nuisances:
                value = fit.values[s.index[nuisance.name]]
                if nuisance.output == y and nuisance.act is not None and value != nuisance.neutral:
                    shown = nuisance.act(shown, float(value), clock.step)
            result[clock.rows, j] = shown
    return result
