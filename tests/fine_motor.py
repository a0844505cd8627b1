"""A motor stepped exactly at parts of a sample by any voltage, and a bench's recording of it. Knows no effect."""

import numpy as np
from scipy.linalg import expm

from estimator import recording_from_arrays

MOTOR = {"R": 1.6, "K": 0.04, "L": 2.4e-3, "J": 2.5e-5, "B": 4e-5}
STEP, FINE = 1e-3, 50  # s; parts of it
NOISE = np.array([0.01, 0.3])  # A, rad/s


def instants(rows):
    """Return when each part of each row begins, (rows FINE,), s."""
    return np.arange(rows * FINE) * STEP / FINE


def bench(command, voltage, seed, *, more=0.0, name="b"):
    """Return the recording of a command, (rows,), of a motor that gets a voltage, (rows FINE,), held over each part.

    Parameters
    ----------
    more : (rows,) array
        A that the sensor of the current shows besides.
    """
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after = expm(whole * STEP / FINE)[:2]
    x, shown = np.zeros(2), np.empty((len(command), 2))
    for row in range(len(command)):
        shown[row] = x
        for v in voltage[row * FINE : (row + 1) * FINE]:
            x = after @ np.array([*x, v])
    shown += np.random.default_rng(seed).standard_normal(shown.shape) * NOISE
    columns = {"voltage [V]": command, "current [A]": shown[:, 0] + more, "speed [rad/s]": shown[:, 1]}
    return recording_from_arrays(name, np.arange(len(command)) * STEP, columns)


def off(result):
    """Return by how many standard errors each parameter is off, (5,)."""
    found = ((result.parameters[name], value) for name, value in MOTOR.items())
    return np.array([abs(p.value - value) / p.standard_error for p, value in found])
