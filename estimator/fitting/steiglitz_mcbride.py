"""Steiglitz-McBride on the recording: the paper's other method. Knows transfer functions of two outputs, no FMU.

Both discrete transfer functions share their denominator, and both have a delay of one sample (held input):

    i(z) / v(z) = (b₁ z⁻¹ + b₂ z⁻²) / a(z)      w(z) / v(z) = (c₁ z⁻¹ + c₂ z⁻²) / a(z)      a = 1 + a₁ z⁻¹ + a₂ z⁻²

Each pass filters v, i and w by 1 / a of the pass before and solves one linear least-squares problem for all six
coefficients (Steiglitz & McBride 1965). motor/transfer_functions.py makes a motor of them.
"""

from __future__ import annotations

import cmath

import numpy as np
from numpy.typing import NDArray

from estimator.motor.transfer_functions import NoMotorError, motor_of
from estimator.noise.recursion import recursion
from estimator.recordings.samples import filled

FloatArray = NDArray[np.float64]

PASSES = 60
CONVERGED = 1e-10  # change of the denominator


def steiglitz_mcbride(
    v: FloatArray,
    i: FloatArray,
    w: FloatArray,
    *,
    step: float,
    sigma: tuple[float, float],
    converged: float = CONVERGED,
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
    converged : float
        Change of the denominator by a pass that is the last one.

    Raises
    ------
    NoMotorError
        One sentence: no motor has these transfer functions.
    """
    signals, weights = np.column_stack([v, filled(i), filled(w)]), 1 / np.array([1.0, *sigma])
    a, shown = np.zeros(2), (signals * weights)[:, 1:]
    best, best_error = None, np.inf
    filtered = _all_pole(signals, a) * weights
    for _ in range(PASSES):
        matrix = np.zeros((2, 6, len(v)))  # of current and speed, each over its deviation
        for k in (1, 2):
            for y in (0, 1):
                matrix[y, k - 1, k:] = -filtered[:-k, 1 + y]
                matrix[y, 2 * y + k + 1, k:] = filtered[:-k, 0] * weights[1 + y]
        rows, right = np.concatenate(list(matrix), axis=1), filtered[:, 1:].T.ravel()
        scale = np.linalg.norm(rows, axis=1)
        scale[scale == 0] = 1.0
        coefficients = np.linalg.lstsq((rows / scale[:, None]).T, right, rcond=None)[0] / scale
        change = float(np.max(np.abs(coefficients[:2] - a)))
        a = _stable(coefficients[:2])
        filtered = _all_pole(signals, a) * weights
        # The square error of the simulated transfer functions: the pass to keep is the best one.
        late = np.column_stack([np.concatenate([np.zeros(k), filtered[:-k, 0]]) for k in (1, 2)])
        error = float(np.sum((late @ coefficients[2:].reshape(2, 2).T * weights[1:] - shown) ** 2))
        if error < best_error:
            best, best_error = np.concatenate([a, coefficients[2:]]), error
        if change < converged:
            break
    if best is None:
        raise NoMotorError("Steiglitz-McBride finds no stable transfer function")
    return motor_of(best, step)


def _all_pole(x: FloatArray, a: FloatArray) -> FloatArray:
    """Return x filtered by 1 / (1 + a₁ z⁻¹ + a₂ z⁻²)."""
    return recursion([1.0], a, x)


def _stable(a: FloatArray) -> FloatArray:
    """Mirror poles outside the unit circle into it."""
    root = cmath.sqrt(0.25 * a[0] ** 2 - a[1])
    p, q = (1 / z.conjugate() if abs(z) > 1 else z for z in (root - 0.5 * a[0], -root - 0.5 * a[0]))
    return np.array([-(p + q).real, (p * q).real])
