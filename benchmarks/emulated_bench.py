"""Recordings of an emulated bench, its effects in them, the truth known. Knows nothing of the estimator.

`emulated_effects.py` draws them, `emulated_motor.c` simulates the motor. What a recording shows is told by a *story*:
(name, recording) → value, recording -1 for all. A name that the story does not have has its value of no effect, so a
effect is taken out of a story by taking its names out.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Story = dict[tuple[str, int], float]
MOTOR = ("R", "K", "L", "J", "B")
EXCITATIONS = ("step", "two levels", "zero", "reversal", "staircase", "prbs", "coasting")
ROWS = 5000  # of one recording, at most
MODES = 48  # cosines that make up a wandering friction

NONE = {  # what each name is worth where there is no effect
    "tau_i": 0.0,  # s, first-order lag of the current
    "tau_w": 0.0,  # s, 1 / (2 pi cutoff) of the second-order filter of the speed, damping 0.7071
    "delay": 0.0,  # s, of the response after the command
    "delay_i": 0.0,
    "delay_w": 0.0,
    "mean_i": 1.0,  # samples averaged
    "hold_i": 1.0,  # rows that the current's last value is repeated for
    "offset_i": 0.0,  # A
    "gain_i": 0.0,  # relative error
    "gain_v": 0.0,
    "counts": 0.0,  # a turn; 0: an analog speed
    "ripple_n": 0.0,  # order of the commutation, its share of the current
    "ripple_c": 0.0,
    "ripple_s": 0.0,
    "eccentric_c": 0.0,  # share of the speed, order 1
    "eccentric_s": 0.0,
    "Tc": 0.0,  # N.m
    "stick": 1.0,  # break-away torque over Tc
    "Vb": 0.0,  # V
    "drift": 0.0,  # share of the friction that is lost over the recording
    "heat": 0.0,  # 1/(A2 s)
    "B_run": 0.0,  # relative, of one recording
    "K_run": 0.0,
    "Rsag": 0.0,
    "ts": 0.0,
    "Rs": 0.0,
    "limit": np.inf,  # A
    "pwm": 0.0,  # Hz
    "open": 0.0,  # 1: the last level is an open circuit
    "dead": 0.0,  # V
    "w0": 0.0,  # rad/s
}


@dataclass(frozen=True)
class Noise:
    """What is random in one recording, with the sizes that the true story is told."""

    i: float  # A
    w: float  # rad/s
    v: float = 0.0  # V; above zero the terminal voltage is recorded
    quantum: float = 0.0  # A
    growth: float = 0.0  # sigma_i sqrt(1 + (growth i / i_run)^2)
    colour_i: float = 0.0  # of AR(1)
    colour_w: float = 0.0
    outliers: float = 0.0  # share
    student: bool = False
    jitter: float = 0.0  # s
    saturation: float = np.inf  # A
    wander: float = 0.0  # relative deviation of the friction
    wander_time: float = 0.1  # s


@dataclass(frozen=True)
class Recording:
    """One recording of a bench: its clock, its command, its noise."""

    excitation: str
    h: float  # s
    sub: int  # grid points of the simulation a row
    rows: int
    edges: tuple[int, ...]  # rows, the first is 0
    volts: tuple[float, ...]  # V, from each edge on
    noise: Noise
    wander: Array = field(default_factory=lambda: np.zeros(MODES))
    angle: Array = field(default_factory=lambda: np.zeros(0))  # rad, true angle of each row: the ripple's phase
    lost: Rows = field(default_factory=lambda: np.zeros(0, int))
    repeated: Rows = field(default_factory=lambda: np.zeros(0, int))
    last_zero: bool = False
    float32: bool = False


@dataclass(frozen=True)
class Bench:
    """One motor, its recordings, their effects, the truth."""

    seed: int
    supply: float  # V
    recordings: tuple[Recording, ...]
    story: Story
    effects: Mapping[str, tuple[tuple[str, int], ...]]  # kind → its names in the story
    free: tuple[tuple[str, int], ...]  # names that a fit told the true story has to find
    i_run: float  # A, running at the top level
    i_peak: float
    w_top: float


class _Motor(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_double)
        for name in ("R", "K", "L", "J", "B", "Tc", "Ts", "ws", "Vb", "ib", "limit", "Rs", "Rsag", "ts", "heat")
    ]


def _compiled() -> Callable[..., int]:
    source = Path(__file__).with_name("emulated_motor.c")
    name = f"emulated_motor_{os.getuid()}_{hashlib.sha256(source.read_bytes()).hexdigest()[:16]}.so"
    library = Path(tempfile.gettempdir()) / name
    if not library.exists():
        part = library.with_suffix(f".{os.getpid()}")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(part), str(source), "-lm"], check=True)
        part.replace(library)
    function = ctypes.CDLL(str(library)).simulate
    function.restype = ctypes.c_int
    return function


_simulate: Callable[..., int] | None = None


def motor_response(values: Mapping[str, float], from_: Array, volts: Array, open_: Rows,
                   n: int, dt: float, factor: Array, w0: float) -> Array:  # fmt: skip
    """Return current, speed, angle, terminal voltage and heat on a grid, shape (n, 5), SI units."""
    global _simulate
    if _simulate is None:
        _simulate = _compiled()
    out = np.empty((n, 5))
    pointers = [
        np.ascontiguousarray(a, t) for a, t in ((from_, float), (volts, float), (open_, np.int32), (factor, float))
    ]
    motor = _Motor(*(values[field[0]] for field in _Motor._fields_))
    a, b, c, d = (ctypes.c_void_p(x.ctypes.data) for x in pointers)
    _simulate(ctypes.byref(motor), len(from_), a, b, c, n, ctypes.c_double(dt), d, ctypes.c_double(w0),
              ctypes.c_void_p(out.ctypes.data))  # fmt: skip
    return out


def _teller(story: Story, index: int) -> Callable[[str], float]:
    def tell(name: str) -> float:
        return story.get((name, index), story.get((name, -1), NONE.get(name, 0.0)))

    return tell


def _segments(bench: Bench, rec: Recording, tell: Callable[[str], float]) -> tuple[Array, Array, Rows]:
    """Return what the motor's terminals are switched to: times s, voltages V, open circuit or not."""
    late = np.array([tell("delay") + tell(f"latency{k}") for k in range(len(rec.edges))])
    times = np.array(rec.edges) * rec.h + np.maximum(late, 0.0)
    volts = np.array(rec.volts)
    volts = np.sign(volts) * np.maximum(np.abs(volts) - tell("dead"), 0.0) * (1.0 + tell("gain_v"))
    opened = np.zeros(len(times), int)
    if tell("open"):
        opened[-1] = 1
    if late[0] > 0.0:  # nothing before the first command arrives
        times, volts, opened = np.r_[0.0, times], np.r_[0.0, volts], np.r_[0, opened]
    if frequency := tell("pwm"):
        pieces: list[tuple[float, float, int]] = []
        ends = np.minimum(np.r_[times[1:], np.inf], rec.rows * rec.h)  # a fit may try an edge far behind the last row
        for start, end, v, o in zip(times, ends, volts, opened, strict=True):
            duty = abs(v) / bench.supply
            pieces.append((float(start), 0.0 if 0 < duty < 1 else float(v), int(o)))
            if 0 < duty < 1:
                for k in range(int(start * frequency), int(end * frequency) + 2):
                    on, off = max(start, k / frequency), (k + duty) / frequency
                    if off > start and on < end:
                        pieces += [(on, np.sign(v) * bench.supply, 0)]
                        if off < end:
                            pieces += [(off, 0.0, 0)]
        pieces.sort(key=lambda p: p[0])
        times, volts, opened = (np.array(column) for column in zip(*pieces, strict=True))
    return times, volts, opened


def wandering(rec: Recording, coefficients: Array, t: Array) -> Array:
    """Return the relative change of the friction: nearly an Ornstein-Uhlenbeck process, by cosines."""
    order = np.arange(MODES)
    duration = rec.rows * rec.h
    power = 1.0 / (1.0 + (np.pi * order / duration * rec.noise.wander_time) ** 2)
    power[0] *= 0.5
    size = rec.noise.wander * np.sqrt(power / power.sum() * np.where(order, 2.0, 1.0))
    active = np.flatnonzero(size * coefficients)
    total = np.zeros(len(t))
    for m in active:
        total += size[m] * coefficients[m] * np.cos(np.pi * m * t / duration)
    return total


def physics(bench: Bench, story: Story, index: int, wander: Array | None = None) -> tuple[Array, float]:
    """Return what happens in the motor on the fine grid of a recording, shape (n, 5), and the grid's step in s."""
    rec, tell = bench.recordings[index], _teller(story, index)
    dt, n = rec.h / rec.sub, rec.rows * rec.sub
    t = np.asarray((np.arange(n) + 0.5) * dt, float)
    factor = 1.0 - tell("drift") * t / t[-1]
    coefficients = rec.wander if wander is None else wander
    if rec.noise.wander:
        factor = factor + wandering(rec, coefficients, t)
    values = {name: tell(name) for name in (*MOTOR, "Tc", "Vb", "limit", "Rs", "Rsag", "ts", "heat")}
    values["K"] *= 1.0 + tell("K_run")
    values["Tc"] = max(values["Tc"], 0.0)
    values["Ts"] = values["Tc"] * max(tell("stick"), 1.0)
    values["ws"], values["ib"] = 0.02 * bench.w_top, 0.1 * bench.i_run
    times, volts, opened = _segments(bench, rec, tell)
    factor = np.maximum(factor * (1.0 + tell("B_run")), 0.0)
    return motor_response(values, times, volts, opened, n, dt, factor, tell("w0")), dt


def _lagged(x: Array, tau: float, dt: float) -> Array:
    if tau < 1e-3 * dt:
        return x
    a = np.exp(-dt / tau)
    b = 1.0 - (1.0 - a) * tau / dt
    return np.asarray(lfilter([b, 1.0 - a - b], [1.0, -a], x, zi=[x[0] * (1.0 - b)])[0])


def _filtered(x: Array, tau: float, dt: float) -> Array:
    if tau < 1e-3 * dt:
        return x
    # x on straight lines between grid points: exact exponential of [y, y', x, x']
    a = np.zeros((4, 4))
    a[0, 1], a[2, 3] = dt, 1.0
    a[1, :3] = dt / tau**2 * np.array([-1.0, -np.sqrt(2.0) * tau, 1.0])
    e = expm(a)
    transition, now, rise = e[:2, :2], e[:2, 2], e[:2, 3]
    trace, det = float(np.trace(transition)), float(np.linalg.det(transition))
    # y[k+2] - trace y[k+1] + det y[k] = C (now x + rise dx) by Cayley-Hamilton
    first, then = now - rise, rise  # weights of x[k] and x[k+1] in the state's step
    b = [then[0], first[0] - trace * then[0] + (transition @ then)[0], (transition @ first)[0] - trace * first[0]]
    filtered: Array = x[0] + np.asarray(lfilter(b, [1.0, -trace, det], x - x[0]))
    return filtered


def shown(bench: Bench, story: Story, index: int, *, wander: Array | None = None,
          jitter: Array | float = 0.0, counted: float | None = None) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return current A, speed rad/s and terminal voltage V as the sensors show them, before noise, of all rows.

    `jitter` s moves the instants of the rows; `counted` is the phase of an encoder whose counts are whole numbers.
    """
    rec, tell = bench.recordings[index], _teller(story, index)
    fine, dt = physics(bench, story, index, wander)
    t, grid = np.arange(rec.rows) * rec.h + jitter, np.arange(len(fine)) * dt
    i = np.interp(t - tell("delay_i"), grid, _lagged(fine[:, 0], tell("tau_i"), dt))
    if (n := int(tell("mean_i"))) > 1:
        i = np.convolve(np.r_[np.full(n - 1, i[0]), i], np.full(n, 1.0 / n), "valid")
    angle = rec.angle if len(rec.angle) else np.zeros(rec.rows)
    if tell("ripple_n"):
        phase = tell("ripple_n") * angle
        i = i * (1.0 + tell("ripple_c") * np.cos(phase) + tell("ripple_s") * np.sin(phase))
    i = i * (1.0 + tell("gain_i")) + tell("offset_i")
    if (n := int(tell("hold_i"))) > 1:
        i = i[np.arange(rec.rows) // n * n]
    eccentric = 1.0 + tell("eccentric_c") * np.cos(angle) + tell("eccentric_s") * np.sin(angle)
    if tell("counts"):
        turned = np.interp(t - tell("delay_w"), grid, fine[:, 2])
        turned = np.r_[turned[0] - tell("w0") * rec.h, turned]
        if counted is not None:
            quantum = 2.0 * np.pi / tell("counts")
            bent = np.cumsum(np.r_[turned[0], np.diff(turned) * eccentric])
            w = np.diff(np.floor(bent / quantum + counted)) * quantum / rec.h
        else:
            w = np.diff(turned) / rec.h * eccentric
    else:
        w = np.interp(t - tell("delay_w"), grid, _filtered(fine[:, 1], tell("tau_w"), dt)) * eccentric
    return i, w, fine[:: rec.sub, 3]


@dataclass(frozen=True)
class Measured:
    """Rows of one recording before the file loses and repeats some, and which of them are plain."""

    i: Array
    w: Array
    v: Array
    plain_i: NDArray[np.bool_]
    plain_w: NDArray[np.bool_]
    true_i: Array
    true_w: Array
    moved_i: Array  # root mean square change by a clock's jitter
    moved_w: Array


def measure(bench: Bench, index: int) -> Measured:
    """Return what a logger stores of a recording; the same seed, the same noise."""
    rec, tell = bench.recordings[index], _teller(bench.story, index)
    rng = np.random.default_rng([bench.seed, 77, index])
    noise, rows = rec.noise, rec.rows
    jitter = np.clip(noise.jitter * rng.standard_normal(rows), -0.45 * rec.h, 0.45 * rec.h)
    true_i, true_w, terminal = shown(bench, bench.story, index)
    i, w, _ = shown(bench, bench.story, index, jitter=jitter, counted=rng.uniform() if tell("counts") else None)
    plain_i, plain_w = np.ones(rows, bool), np.ones(rows, bool)

    def coloured(colour: float, plain: NDArray[np.bool_]) -> Array:
        e = rng.standard_t(4, rows) / np.sqrt(2.0) if noise.student else rng.standard_normal(rows)
        e = np.asarray(lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], e))
        hit = rng.uniform(size=rows) < noise.outliers
        plain[hit] = False
        far: Array = rng.choice([-1.0, 1.0], rows) * np.exp(rng.uniform(np.log(5.0), np.log(50.0), rows))
        return e + np.where(hit, far, 0.0)

    i = i + coloured(noise.colour_i, plain_i) * current_noise(bench, noise, true_i)
    if not tell("counts"):
        w = w + coloured(noise.colour_w, plain_w) * noise.w
    hold = int(tell("hold_i"))
    if hold > 1:
        kept = np.arange(rows) // hold * hold
        i = i[kept]
        plain_i &= kept == np.arange(rows)
    sigma_i = current_noise(bench, noise, true_i)
    plain_i &= np.abs(true_i) + 4.0 * sigma_i < noise.saturation  # not by the noise itself: that would bias the rest
    i = np.clip(i, -noise.saturation, noise.saturation)
    if noise.quantum:
        i = np.round(i / noise.quantum) * noise.quantum
    v = np.repeat(rec.volts, np.diff([*rec.edges, rows]))
    if noise.v:
        v = terminal + noise.v * rng.standard_normal(rows)
    if rec.last_zero:
        v[-1] = 0.0
    early, late = (shown(bench, bench.story, index, jitter=sign * noise.jitter)[:2] for sign in (-1.0, 1.0))
    moved_i, moved_w = (np.sqrt(((a - x) ** 2 + (b - x) ** 2) / 2.0)
                        for a, b, x in zip(early, late, (true_i, true_w), strict=True))  # fmt: skip
    return Measured(i, w, v, plain_i, plain_w, true_i, true_w, moved_i, moved_w)


def current_noise(bench: Bench, noise: Noise, i: Array) -> Array:
    """Return the current's standard deviation in each row, A."""
    growth: Array = noise.growth * i / bench.i_run
    return np.sqrt(1.0 + growth * growth) * noise.i


def write(bench: Bench, folder: Path) -> list[Path]:
    """Write the recordings as files of the contract's format; return their paths."""
    paths = []
    for index, rec in enumerate(bench.recordings):
        m = measure(bench, index)
        rows = np.arange(rec.rows)
        if len(rec.lost):
            rows = np.setdiff1d(rows, rec.lost)
        if len(rec.repeated):
            rows = np.sort(np.r_[rows, rec.repeated])
        t = np.arange(len(rows)) * rec.h
        columns = [t, m.v[rows], m.i[rows], m.w[rows]]
        if rec.float32:
            columns = [t, *(c.astype(np.float32).astype(float) for c in columns[1:])]
        path = folder / f"run{index + 1}.csv"
        np.savetxt(path, np.column_stack(columns), "%.9g", ",",
                   header="time [s],voltage [V],current [A],speed [rad/s]", comments="")  # fmt: skip
        paths.append(path)
    return paths
