"""A bench beside the estimator's own: a motor stepped exactly at a tenth of a sample, and what stands around it."""

from functools import cache

import numpy as np
from scipy.linalg import expm
from scipy.signal import cont2discrete, lfilter

from estimator.recordings.reading import recording_from_arrays

R, K, L, J, B = 3.1363, 0.048774, 0.01307, 9.0e-6, 1.69e-4
TRUE = {"R": R, "K": K, "L": L, "J": J, "B": B}
H, FINE = 1e-3, 10
NOISE = {"i": 0.02, "w": 1.0}
EXCITATIONS = {
    "step": lambda t: np.where(t < 0.1, 0.0, 10.5),
    "two levels": lambda t: np.where(t < 0.1, 0.0, np.where(t < 0.45, 5.0, 10.5)),
    "late second level": lambda t: np.where(t < 0.1, 0.0, np.where(t < 0.4537, 5.0, 10.5)),
    "reversal": lambda t: np.where(t < 0.1, 0.0, np.where(t < 0.45, 10.5, -10.5)),
}


@cache
def driven(excitation, friction=0.0, brush=0.0, source=0.0, slow=0.02, stiction=0.0, falls=1.0, round_at=1e-3):
    """Return time, voltage, current and speed at a tenth of a sample.

    friction in N.m, drop of the brushes in V, rounded off at so many A; resistance of the source in Ohm, and time
    constant of what it loses in s;
    stiction in N.m, which falls as exp(-|w| / falls), in rad/s (Stribeck's curve).
    """
    dt = H / FINE
    time = np.arange(round(0.8 / dt) + 1) * dt
    v = EXCITATIONS[excitation](time + 1e-9)
    whole = np.zeros((4, 4))
    whole[:2] = [[-R / L, -K / L, 1 / L, 0.0], [K / J, -B / J, 0.0, 1 / J]]
    step = expm(whole * dt)
    x, lost = np.zeros((len(time), 2)), 0.0
    for k in range(len(time) - 1):
        i, w = x[k]
        holds = friction + stiction * np.exp(-abs(w) / falls)
        stands = abs(w) < 1e-9 and abs(K * i) <= holds
        torque = -K * i if stands else -holds * np.sign(w if abs(w) >= 1e-9 else i)
        volt = v[k] - brush * np.tanh(i / round_at) - lost
        lost += (source * i - lost) * dt / slow
        x[k + 1] = step[:2, :2] @ x[k] + step[:2, 2:] @ (volt, torque)
        if (w != 0 and x[k + 1, 1] * w < 0) or stands:
            x[k + 1, 1] = 0.0
    return time, v, x[:, 0], x[:, 1]


def lagged(y, tau):
    """Return y behind tau x' + x = y, held at a tenth of a sample."""
    a = np.exp(-H / FINE / tau)
    return lfilter([0.0, 1 - a], [1.0, -a], y)


def butterworth(y, tau):
    """Return y behind tau^2 x'' + sqrt(2) tau x' + x = y, held at a tenth of a sample."""
    b, a, _ = cont2discrete(([1.0], [tau**2, np.sqrt(2) * tau, 1.0]), H / FINE)
    return lfilter(b.ravel(), a, y)


def late(y, by):
    """Return y later by so many s."""
    return np.interp(np.arange(len(y)) * H / FINE - by, np.arange(len(y)) * H / FINE, y)


def recording(
    excitation, seed=0, *, i=lambda y: y, w=lambda y: y, name="bench", logged=None, rows=slice(None), range_i=np.inf,
    step_i=0.0, noise_i=0.1, noise_v=0.0, held_i=1, held_w=1, step_w=0.0, **machine,
):  # fmt: skip
    """Return a recording; `i` and `w` are what the sensors make of current and speed at a tenth of a sample.

    `logged` is the excitation that the file says, `rows` are those that it has, `range_i` the current sensor's, A;
    `step_i` is its converter's, A, `noise_i` the noise before it, in its steps; `noise_v` is that of the voltage's
    sensor, V; `held_i` is for how many rows a sample of the current is shown, `held_w` of the speed, rounded to
    `step_w`.
    """
    time, v, current, speed = driven(excitation, **machine)
    v = EXCITATIONS[logged or excitation](time + 1e-9)
    rng = np.random.default_rng(seed)
    shown = {"current [A]": i(current)[::FINE], "speed [rad/s]": w(speed)[::FINE]}
    noise = dict(zip(shown, NOISE.values(), strict=True))
    shown = {k: y + noise[k] * rng.standard_normal(len(y)) for k, y in shown.items()}
    if step_i:  # a converter's, above the noise
        steps = i(current)[::FINE] / step_i + noise_i * rng.standard_normal(len(shown["current [A]"]))
        shown["current [A]"] = step_i * np.round(steps)
    shown["current [A]"] = np.clip(shown["current [A]"], -range_i, range_i)
    shown["current [A]"] = np.repeat(shown["current [A]"][::held_i], held_i)[: len(time[::FINE])]
    shown["speed [rad/s]"] = np.repeat(shown["speed [rad/s]"][::held_w], held_w)[: len(time[::FINE])]
    if step_w:
        shown["speed [rad/s]"] = step_w * np.round(shown["speed [rad/s]"] / step_w)
    logged_v = v[::FINE] + noise_v * rng.standard_normal(len(v[::FINE])) if noise_v else v[::FINE]
    columns = {"voltage [V]": logged_v, **shown}
    time = time[::FINE][rows]
    return recording_from_arrays(name, time - time[0], {k: y[rows] for k, y in columns.items()})


def worst(result):
    """Return the largest error of a parameter in standard errors."""
    return max(abs(result.parameters[n].value - x) / (result.parameters[n].standard_error or 1e-300)
               for n, x in TRUE.items())  # fmt: skip
