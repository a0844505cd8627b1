"""From the command to the terminals, and from the machine's states to the rows of a logger."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from plant import Array, Run
from scipy.signal import lfilter

Sizes = dict[str, float]


@dataclass(frozen=True)
class Reference:
    """What sizes are relative to: the nominal motor at its largest level."""

    volts: float
    level: float
    current: float  # A, steady, or 3 % of the stall current where that is more
    speed: float  # rad/s, steady
    peak: float  # A
    tau_m: float


@dataclass(frozen=True)
class Noise:
    """Noise of one bench."""

    current: float  # of the reference current
    rest: float  # share of it while the motor stands
    speed: float  # of the reference speed
    quantised: bool  # the speed's noise is its quantum
    colour: float  # share of the variance that is coloured
    colour_rows: float
    wander: float  # of the friction
    wander_time: float  # s
    voltage: float  # of the rated voltage, measured columns only
    gains: dict[str, float] = field(default_factory=dict)  # i, w, v, t


def ornstein_uhlenbeck(n: int, step: float, time: float, rng: np.random.Generator) -> Array:
    """Draw coloured noise of unit variance and correlation time ``time``."""
    a = math.exp(-step / time)
    first = rng.standard_normal()
    drive = math.sqrt(1 - a * a) * rng.standard_normal(n)
    drive[0] = first
    return np.asarray(lfilter([1.0], [1.0, -a], drive))


def lag(x: Array, time: float, h: float) -> Array:
    """Apply a first-order filter that starts settled."""
    a = math.exp(-h / time)
    return np.asarray(lfilter([1 - a], [1.0, -a], x, zi=[a * x[0]])[0])


def late(x: Array, cells: int) -> Array:
    """Delay ``x`` by whole cells."""
    return x if cells <= 0 else np.concatenate([np.full(min(cells, len(x)), x[0]), x[:-cells]])


def trailing_mean(x: Array, cells: int) -> Array:
    """Return the mean of the last ``cells`` values."""
    padded = np.concatenate([np.full(cells, x[0]), x])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return np.asarray((total[cells + 1 :] - total[1:-cells])[: len(x)] / cells, dtype=np.float64)


def drive(
    command: Array,
    h: float,
    t: Sizes,
    ref: Reference,
    is_open: NDArray[np.bool_],
    measured: bool,
    rng: np.random.Generator,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the voltage of the source, and where the circuit is open, on the fine grid."""
    v, n = command.copy(), len(command)
    if "latency" in t:
        v = late(v, round(t["latency"] * rng.uniform(0.5, 1.5) / h))
    if "early_command" in t:
        cells = min(n, round(t["early_command"] * rng.uniform(0.6, 1.4) / h))
        v = np.concatenate([np.zeros(cells), v[: n - cells]])
    if "latency_per_edge" in t:
        edges = np.flatnonzero(np.diff(v)) + 1
        when = edges + np.round(t["latency_per_edge"] * rng.uniform(0.2, 1.8, len(edges)) / h).astype(int)
        when = np.maximum.accumulate(when) if len(when) else when
        levels = np.concatenate([v[:1], v[edges]])
        v = levels[np.searchsorted(when, np.arange(n), side="right")]
    if "command_tick" in t:
        period = max(1, round(t["command_tick"] / h))
        phase = int(rng.integers(period))
        taken = (np.arange(n) + phase) // period * period - phase
        v = v[np.maximum(taken, 0)]
    opened = is_open.copy()
    if "open_at_zero" in t and not measured:
        opened |= v == 0
    if "slew" in t:
        ramp = ref.volts / (t["slew"] * ref.tau_m) * h
        out, now = v.tolist(), 0.0
        for k, target in enumerate(out):
            now = min(target, now + ramp) if target > now else max(target, now - ramp)
            out[k] = now
        v = np.array(out)
    time = h * np.arange(n)
    if "driver_drop" in t:
        v = np.sign(v) * np.maximum(0.0, np.abs(v) - t["driver_drop"] * ref.volts)
    if "supply_ripple" in t:
        v = v * (1 + t["supply_ripple"] * np.sin(2 * np.pi * 100 * time + rng.uniform(0, 6.28)))
    if "supply_drift" in t:
        v = v * (1 - t["supply_drift"] * (1 - np.exp(-2 * time / time[-1])))
    if "slow_pwm" in t and not measured:
        saw = (time * t["slow_pwm"] + rng.random()) % 1.0
        v = np.where(saw < np.abs(v) / ref.volts, np.sign(v) * ref.volts, 0.0)
    return v, opened


def sense_current(run: Run, h: float, dt: float, t: Sizes, ref: Reference, rng: np.random.Generator) -> Array:
    """Return the output of the current's sensor before noise, on the fine grid."""
    i = run.current.copy()
    if "current_ripple" in t:
        bars = rng.choice([5, 7, 8, 10, 13])
        a, b = rng.uniform(0, 2 * np.pi, 2)
        i *= 1 + t["current_ripple"] * (np.sin(bars * run.angle + a) + 0.3 * np.sin(run.angle + b))
    if "current_lag" in t:
        i = lag(i, t["current_lag"], h)
    if "current_delay" in t:
        i = late(i, round(t["current_delay"] * dt / h))
    if "current_mean" in t:
        each = round(dt / h)
        i = np.mean([late(i, each * k) for k in range(int(t["current_mean"]))], axis=0)
    if "current_curve" in t:
        i = i * (1 - t["current_curve"] * (i / ref.peak) ** 2)
    if "mains_hum" in t:
        i = i + t["mains_hum"] * ref.current * np.sin(2 * np.pi * 50 * run.time + rng.uniform(0, 6.28))
    if "current_drift" in t:
        i = i + rng.choice([-1, 1]) * t["current_drift"] * ref.current * run.time / run.time[-1]
    if "current_offset" in t:
        i = i + rng.choice([-1, 1]) * rng.uniform(0.6, 1.4) * t["current_offset"] * ref.current
    return i


def sense_speed(run: Run, h: float, dt: float, t: Sizes, ref: Reference, rng: np.random.Generator) -> Array:
    """Return the output of the speed's sensor before noise, on the fine grid."""
    w = run.speed.copy()
    if "speed_ripple" in t:
        a, b = rng.uniform(0, 2 * np.pi, 2)
        w *= 1 + t["speed_ripple"] * (np.sin(run.angle + a) + 0.4 * np.sin(2 * run.angle + b))
    if "speed_lag" in t:
        w = lag(w, t["speed_lag"] * ref.tau_m, h)
    if "speed_delay" in t:
        w = late(w, round(t["speed_delay"] * ref.tau_m / h))
    if "speed_mean" in t:
        w = trailing_mean(w, max(1, round(t["speed_mean"] * dt / h)))
    if "speed_dead_zone" in t:
        w = np.where(np.abs(w) < t["speed_dead_zone"] * ref.speed, 0.0, w)
    if "speed_offset" in t:
        w = w + rng.choice([-1, 1]) * t["speed_offset"] * ref.speed
    return w


def digitise(
    i: Array,
    w: Array,
    angle: Array,
    truth: tuple[Array, Array],
    dt: Array,
    t: Sizes,
    ref: Reference,
    noise: Noise,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Apply noise, ranges and converters, at the rows; ``truth`` is the machine's current and speed."""
    n = len(i)

    def unit() -> Array:
        coloured = ornstein_uhlenbeck(n, 1.0, noise.colour_rows, rng)
        return math.sqrt(1 - noise.colour) * rng.standard_normal(n) + math.sqrt(noise.colour) * coloured

    turning = np.abs(truth[1]) > 0.02 * ref.speed
    scale = np.maximum(np.where(turning, 1.0, noise.rest), np.abs(truth[0]) / ref.current)
    i = i + noise.current * ref.current * scale * unit()
    sigma_w = noise.speed * ref.speed
    if "encoder_difference" in t:
        counts = np.floor(angle * t["encoder_difference"] / (2 * np.pi) + rng.random())
        w = np.diff(counts, prepend=counts[0]) * 2 * np.pi / t["encoder_difference"] / dt
    elif noise.quantised:
        quantum = sigma_w * math.sqrt(12)
        w = quantum * np.round(w / quantum)
    else:
        w = w + sigma_w * np.where(turning, 1.0, 0.3) * unit()
    for name, x, sigma in (("current_spikes", i, noise.current * ref.current), ("speed_spikes", w, sigma_w)):
        if name in t:
            hit = rng.random(n) < t[name]
            hit[rng.integers(n)] = True
            x[hit] += sigma * rng.choice([-1, 1], hit.sum()) * np.exp(rng.uniform(np.log(6), np.log(60), hit.sum()))
    if "current_clip" in t:
        i = np.clip(i, -t["current_clip"] * ref.peak, t["current_clip"] * ref.peak)
    if "current_steps" in t:
        step = t["current_steps"] * ref.current
        i = step * np.round(i / step)
    if "current_unsigned" in t:
        i = np.abs(i)
    if "stale_speed" in t:
        every = int(t["stale_speed"])
        w = w[np.maximum(0, (np.arange(n) + int(rng.integers(every))) // every * every - every)]
    return i, w


def log_rows(table: Array, dt: float, t: Sizes, ref: Reference, rng: np.random.Generator) -> Array:
    """Apply what the logger does to whole rows; columns time, voltage, current, speed."""
    n = len(table)
    if "voltage_shift" in t:
        shift = int(t["voltage_shift"]) * (1 if rng.random() < 0.6 else -1)
        table[:, 1] = table[np.clip(np.arange(n) - shift, 0, n - 1), 1]
    if "voltage_offset" in t:
        table[:, 1] += rng.choice([-1, 1]) * t["voltage_offset"] * ref.volts
    if "hidden_loss" in t:
        lost = min(int(t["hidden_loss"]), n // 10)
        at = int(rng.integers(n // 10, n - n // 10 - lost))
        table[at:-lost, 1:] = table[at + lost :, 1:]
        table = table[:-lost]
    if "coarse_time" in t:
        step = t["coarse_time"] * dt
        table[:, 0] = step * np.floor(table[:, 0] / step + 1e-9)
    if "lost_rows" in t:
        keep = rng.random(len(table)) >= t["lost_rows"]
        keep[[0, -1]] = True
        table = table[keep]
    if "pause" in t:
        start = rng.uniform(0.1, 0.85) * table[-1, 0]
        table = table[(table[:, 0] < start) | (table[:, 0] > start + t["pause"])]
    if "repeated_rows" in t:
        times = np.where(rng.random(len(table)) < t["repeated_rows"], 2, 1)
        table = np.repeat(table, times, axis=0)
    if "missing_cells" in t:
        hit = rng.random((len(table), 2)) < t["missing_cells"]
        table[:, 2:][hit] = np.nan
    if "last_row_zero" in t:
        last = table[-1] + [dt, 0, 0, 0]
        table = np.vstack([table, [last[0], 0.0, 0.0, last[3]]])
    return table
