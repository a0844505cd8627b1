"""The DC motor with these parameters as a linear system, continuous and sampled. Knows numbers only, no FMU.

x = [i, w], u = [v, load], y = [i, w]
L di/dt = v − R i − K w
J dw/dt = K i − B w − load

i/v = (J s + B)/D    w/v = K/D    w/load = −(L s + R)/D    i/load = K/D    D = L J s² + (R J + L B) s + R B + K²
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.motor.exponential import exponential
from estimator.motor.names import MOTOR, is_motor

if TYPE_CHECKING:
    from scipy.signal import StateSpace

FloatArray = NDArray[np.float64]


def matrices(values: Mapping[str, float]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A (2, 2), B (2, 2), C (2, 2) and D (2, 2) of dx/dt = A x + B u, y = C x + D u.

    Parameters
    ----------
    values : name → float
        R in Ohm, K in V.s/rad, L in H, J in kg.m2, B in N.m.s/rad.

    Raises
    ------
    InputError
        One of the five is missing, or L or J is not positive.
    """
    if not is_motor(values):
        raise InputError(
            f"a linear motor model needs R, K, L, J and B, with L and J positive; these are {', '.join(values)}"
        )
    R, K, L, J, B = (values[name] for name in MOTOR)
    return (
        np.array([[-R / L, -K / L], [K / J, -B / J]]),
        np.array([[1 / L, 0.0], [0.0, -1 / J]]),
        np.eye(2),
        np.zeros((2, 2)),
    )


def poles(values: Mapping[str, float]) -> NDArray[np.complex128]:
    """Return the eigenvalues, (2,), of A [1/s].

    Raises
    ------
    InputError
        As `matrices`.
    """
    return np.asarray(np.linalg.eigvals(matrices(values)[0]), dtype=np.complex128)


def sampled(values: Mapping[str, float], step: float) -> tuple[FloatArray, FloatArray]:
    """Return F (2, 2) and G (2, 2) of x[k+1] = F x[k] + G u[k], for inputs that are held over each step of `step` s.

    Raises
    ------
    InputError
        As `matrices`.
    """
    f, g = sampled_with_angle(values, step)
    return f[:2, :2], g[:2]


def sampled_with_angle(values: Mapping[str, float], step: float) -> tuple[FloatArray, FloatArray]:
    """Return F (3, 3) and G (3, 2) likewise, with the angle, whose derivative is the speed, as a third state.

    Raises
    ------
    InputError
        As `matrices`.
    """
    a, b, _, _ = matrices(values)
    whole = np.zeros((5, 5))
    whole[:2, :2], whole[2, 1], whole[:2, 3:] = a, 1.0, b
    over = exponential(whole * step)
    return over[:3, :3], over[:3, 3:]


def coasting(values: Mapping[str, float], step: float) -> tuple[float, float, float, float]:
    """Return what a motor without current does in a step, s, by its speed and by 1 N.m against it, held over the step.

    Returns
    -------
    How much of its speed is left, what the torque adds to that, and what both add to the angle.
    """
    rate = values["B"] / values["J"]
    whole = np.array([[-rate, 0.0, -1 / values["J"]], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # speed, angle, torque
    (left, _, added), (turned, _, turned_by), _ = exponential(whole * step).tolist()
    return left, added, turned, turned_by


def transfer_functions(values: Mapping[str, float]) -> dict[str, tuple[list[float], list[float]]]:
    """Return ``"w/v"`` and the like → numerator and denominator, highest power of s first.

    Raises
    ------
    InputError
        As `matrices`.
    """
    matrices(values)
    R, K, L, J, B = (float(values[name]) for name in MOTOR)
    denominator = [L * J, R * J + L * B, R * B + K * K]
    return {
        "i/v": ([J, B], denominator),
        "w/v": ([K], denominator),
        "i/load": ([K], denominator),
        "w/load": ([-L, -R], denominator),
    }


def state_space(values: Mapping[str, float]) -> StateSpace:
    """Return the motor as scipy's StateSpace: inputs v, load; states and outputs i, w.

    Raises
    ------
    InputError
        As `matrices`.
    """
    from scipy.signal import StateSpace

    return StateSpace(*matrices(values))
