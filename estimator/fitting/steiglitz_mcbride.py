"""Steiglitz-McBride on the recording: the paper's other method. Knows transfer functions of two outputs, no FMU.

Both discrete transfer functions share their denominator, and both have a delay of one sample (held input):

    i(z) / v(z) = (b₁ z⁻¹ + b₂ z⁻²) / a(z)      w(z) / v(z) = (c₁ z⁻¹ + c₂ z⁻²) / a(z)      a = 1 + a₁ z⁻¹ + a₂ z⁻²

Each pass filters v, i and w by 1 / a of the pass before and solves one linear least-squares problem for all six
coefficients (Steiglitz & McBride 1965). motor/transfer_functions.py makes a motor of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.recursion import recursion
from estimator.motor.transfer_functions import NoMotorError, motor_of
from estimator.recordings.samples import filled

FloatArray = NDArray[np.float64]

PASSES = 60
CONVERGED = 1e-10  # relative change of the denominator


def steiglitz_mcbride(
    v: FloatArray, i: FloatArray, w: FloatArray, *, step: float, sigma: tuple[float, float]
) -> dict[str, float]:
    """Return R, K, L, J, B [SI] from voltage, current and speed of a motor that starts from rest.

    Parameters
    ----------
    v, i, w : (n,) arrays
        V, A, rad/s; NaN where a sample is missing (interpolated). v[k] holds from sample k to k + 1.
    step : float
        s, sampling interval.
    sigma : (float, float)
        Deviations of the noise of i and w, which weigh them.

    Raises
    ------
    NoMotorError
        One sentence: no motor has these transfer functions.
    """
    i, w = filled(i), filled(w)
    a = np.zeros(2)
    coefficients = np.zeros(6)
    best, best_error = None, np.inf
    for _ in range(PASSES):
        vf, i_f, wf = (_all_pole(x, a) for x in (v, i, w))
        top = np.column_stack([-_late(i_f, 1), -_late(i_f, 2), _late(vf, 1), _late(vf, 2), *2 * [np.zeros(len(v))]])
        low = np.column_stack([-_late(wf, 1), -_late(wf, 2), *2 * [np.zeros(len(v))], _late(vf, 1), _late(vf, 2)])
        matrix = np.concatenate([top / sigma[0], low / sigma[1]])
        right = np.concatenate([i_f / sigma[0], wf / sigma[1]])
        scale = np.linalg.norm(matrix, axis=0)
        scale[scale == 0] = 1.0
        coefficients = np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale
        change = float(np.max(np.abs(coefficients[:2] - a)))
        a = _stable(coefficients[:2])
        error = _output_error(coefficients, a, v=v, i=i, w=w, sigma=sigma)
        if error < best_error:
            best, best_error = np.concatenate([a, coefficients[2:]]), error
        if change < CONVERGED:
            break
    if best is None:
        raise NoMotorError("Steiglitz-McBride finds no stable transfer function")
    return motor_of(best, step)


def _output_error(
    coefficients: FloatArray,
    a: FloatArray,
    *,
    v: FloatArray,
    i: FloatArray,
    w: FloatArray,
    sigma: tuple[float, float],
) -> float:
    """Return the weighted square error of the simulated transfer functions: the pass to keep is the best one."""
    b, c = coefficients[2:4], coefficients[4:6]
    vf = _all_pole(v, a)
    error_i = b[0] * _late(vf, 1) + b[1] * _late(vf, 2) - i
    error_w = c[0] * _late(vf, 1) + c[1] * _late(vf, 2) - w
    return float(error_i @ error_i / sigma[0] ** 2 + error_w @ error_w / sigma[1] ** 2)


def _all_pole(x: FloatArray, a: FloatArray) -> FloatArray:
    """Return x filtered by 1 / (1 + a₁ z⁻¹ + a₂ z⁻²)."""
    return recursion([1.0], a, x)


def _late(x: FloatArray, k: int) -> FloatArray:
    return np.concatenate([np.zeros(k), x[:-k]])


def _stable(a: FloatArray) -> FloatArray:
    """Mirror poles outside the unit circle into it."""
    poles = np.roots([1.0, *a])
    poles = np.where(np.abs(poles) > 1, 1 / np.conj(np.where(poles == 0, 1.0, poles)), poles)
    return np.real(np.poly(poles))[1:]
