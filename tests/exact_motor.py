"""The exact response of a DC motor to held inputs, at 50 digits. Knows no FMU and no numerical integration.

L i' = v - R i - K w,  J w' = K i - B w - load,  angle' = w, from rest. With A the matrix of the first two, m half its
trace and q^2 = m^2 - det A:  exp(A h) = exp(m h) (cosh(q h) I + sinh(q h) / q (A - m I)).
"""

from __future__ import annotations

from collections.abc import Sequence

import mpmath
import numpy as np
from numpy.typing import NDArray

DIGITS = 50


def exact_response(
    parameters: dict[str, float], voltages: Sequence[float], *, step: float, load: float = 0.0
) -> NDArray[np.object_]:
    """Return i, w, angle after each step, [steps, 3], as mpmath numbers."""
    with mpmath.workdps(DIGITS):
        R, K, L, J, B = (mpmath.mpf(parameters[name]) for name in "RKLJB")
        h, torque = mpmath.mpf(step), mpmath.mpf(load)
        a, b, c, d = -R / L, -K / L, K / J, -B / J
        m, det = (a + d) / 2, a * d - b * c
        q = mpmath.sqrt(m * m - det)
        grown = mpmath.exp(m * h)
        even = mpmath.re(grown * mpmath.cosh(q * h))
        odd = mpmath.re(grown * mpmath.sinh(q * h) / q) if q != 0 else grown * h
        e = [[even + odd * (a - m), odd * b], [odd * c, even + odd * (d - m)]]
        # rows of A^-1 (exp(A h) - I): the integral of exp(A t) over the step
        g = [(-c * (e[0][0] - 1) + a * e[1][0]) / det, (-c * e[0][1] + a * (e[1][1] - 1)) / det]
        i = w = angle = mpmath.mpf(0)
        rows = []
        for voltage in map(mpmath.mpf, voltages):
            settled_i = (B * voltage + K * torque) / (R * B + K * K)
            settled_w = (K * voltage - R * torque) / (R * B + K * K)
            di, dw = i - settled_i, w - settled_w
            i, w = settled_i + e[0][0] * di + e[0][1] * dw, settled_w + e[1][0] * di + e[1][1] * dw
            angle += settled_w * h + g[0] * di + g[1] * dw
            rows.append((i, w, angle))
        return np.array(rows, dtype=object)


def worst_error(simulated: NDArray[np.float64], exact: NDArray[np.object_]) -> float:
    """Return the largest error of any signal, as a fraction of that signal's peak."""
    with mpmath.workdps(DIGITS):
        errors = [max(abs(exact[:, k] - simulated[:, k])) / max(abs(exact[:, k])) for k in range(exact.shape[1])]
        return float(max(errors))
