"""A motor from its sampled transfer functions. Knows the linear motor, and how neither was found.

    i(z) / v(z) = (b₁ z⁻¹ + b₂ z⁻²) / a(z)      w(z) / v(z) = (c₁ z⁻¹ + c₂ z⁻²) / a(z)      a = 1 + a₁ z⁻¹ + a₂ z⁻²

The matrix logarithm of the discrete system gives the continuous one, and

    i(s) / v(s) = (s/L + B/(JL)) / d(s)         w(s) / v(s) = K/(JL) / d(s)
    d(s) = s² + (R/L + B/J) s + (R B + K²)/(JL)

gives R, K, L, J, B. The small s term that noise leaves in the numerator of w is dropped.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ALIKE = 1e-4  # difference of two poles' logarithms: below, a series is more exact than their ratio


class NoMotorError(ValueError):
    """The transfer functions found are not those of a motor."""


def motor_of(coefficients: FloatArray, step: float) -> dict[str, float]:
    """Return R, K, L, J, B [SI] of a₁, a₂, b₁, b₂, c₁, c₂ at a sampling interval in s.

    Raises
    ------
    NoMotorError
        One sentence: no motor has these transfer functions.
    """
    a1, a2, b1, b2, c1, c2 = coefficients
    discrete = np.array([[-a1, -a2], [1.0, 0.0]])
    poles = np.linalg.eigvals(discrete)
    if np.any((np.abs(poles.imag) < 1e-12 * np.abs(poles)) & (poles.real <= 0)):
        raise NoMotorError(
            "Steiglitz-McBride finds a pole at or below zero, which no continuous motor has: the sampling is too slow"
            " for this motor or the noise too strong; use method 'cuckoo'"
        )
    try:
        A, g = continuous(discrete, poles, step)
    except np.linalg.LinAlgError:
        raise NoMotorError("Steiglitz-McBride finds a pole at one: a motor whose speed never settles") from None
    d1, d0 = -float(np.trace(A)), float(np.linalg.det(A))
    adjugate = np.array([[-A[1, 1], A[0, 1]], [A[1, 0], -A[0, 0]]])
    n1, n0 = (float(x) for x in (np.array([b1, b2]) @ g, np.array([b1, b2]) @ adjugate @ g))
    k0 = float(np.array([c1, c2]) @ adjugate @ g)
    with np.errstate(divide="ignore", invalid="ignore"):
        L = np.float64(1.0) / n1
        friction = np.float64(n0) / n1  # B / J
        R = L * (d1 - friction)
        K = (d0 - R / L * friction) / k0
        J = K / (k0 * L)
        B = J * friction
    found = {"R": float(R), "K": float(K), "L": float(L), "J": float(J), "B": float(B)}
    wrong = [f"{name} = {value:.4g}" for name, value in found.items() if not (np.isfinite(value) and value > 0)]
    if wrong:
        raise NoMotorError(
            f"Steiglitz-McBride finds {', '.join(wrong)}, which no motor has: the noise is too strong for it, or the"
            " motor is not linear; use method 'cuckoo'"
        )
    return found


def continuous(discrete: FloatArray, poles: NDArray[Any], step: float) -> tuple[FloatArray, FloatArray]:
    """Return A, (2, 2), and g, (2,), of the dx/dt = A x + g u whose steps are x ← F x + [u, 0], by the poles of F.

    SciPy's ``logm`` gives the same, in a package whose import takes longer than a short estimate.
    """
    one, other = poles.astype(complex)
    difference = np.log(one) - np.log(other)
    if abs(difference) > ALIKE:
        slope = difference / (one - other)
    else:
        slope = 2 / (one + other) * (1 + ((one - other) / (one + other)) ** 2 / 3)
    A = np.real(slope * (discrete - other * np.eye(2)) + np.log(other) * np.eye(2)) / step
    return A, np.linalg.solve(discrete - np.eye(2), A[:, 0])
