"""A motor stepped exactly at parts of a sample by any voltage, and a bench's recording of it. Knows no effect."""

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from estimator import recording_from_arrays

MOTOR = {"R": 1.6, "K": 0.04, "L": 2.4e-3, "J": 2.5e-5, "B": 4e-5}
STEP, FINE = 1e-3, 50  # s; parts of it
NOISE = np.array([0.01, 0.3])  # A, rad/s


def instants(rows):
    """Return when each part of each row begins, (rows FINE,), s."""
    return np.arange(rows * FINE) * STEP / FINE


def bench(command, voltage, seed, *, more=0.0, late=0, noise=0.0, name="b"):
    """Return the recording of a command, (rows,), of a motor that gets a voltage, (rows FINE,), held over each part.

    Parameters
    ----------
    more : (rows,) array
        A that the sensor of the current shows besides.
    late : int
        Parts of a row by which the current is shown late.
    noise : float
        V, of the sensor of a voltage that is logged in the command's place.
    """
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after = expm(whole * STEP / FINE)[:2]
    factors, modes = np.linalg.eig(after[:, :2])
    driven = np.linalg.solve(modes, after[:, 2])
    each = [lfilter([0.0, by], [1.0, -a], np.append(voltage, 0.0)) for a, by in zip(factors, driven, strict=True)]
    fine = (modes @ np.array(each)).real.T
    at, rng = np.arange(len(command)) * FINE, np.random.default_rng(seed)
    shown = np.column_stack([fine[np.maximum(at - late, 0), 0], fine[at, 1]])
    shown += rng.standard_normal(shown.shape) * NOISE
    logged = command + noise * rng.standard_normal(len(command)) if noise else command
    columns = {"voltage [V]": logged, "current [A]": shown[:, 0] + more, "speed [rad/s]": shown[:, 1]}
    return recording_from_arrays(name, np.arange(len(command)) * STEP, columns)


def off(result):
    """Return by how many standard errors each parameter is off, (5,)."""
    found = ((result.parameters[name], value) for name, value in MOTOR.items())
    return np.array([abs(p.value - value) / p.standard_error for p, value in found])
