"""The effects of an emulated bench, one entry a kind, with sizes that benches have. Knows nothing of the estimator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from emulated_bench import EXCITATIONS, MODES, ROWS, Bench, Noise, Recording, Story, physics

SHARES = (0.2, 0.16, 0.14, 0.14, 0.15, 0.13, 0.08)  # of the excitations
Log = Callable[[float, float], float]
Put = Callable[[Bench, np.random.Generator, Log], Bench]


@dataclass(frozen=True)
class EmulatedEffect:
    """How a kind of effect changes a bench; the names it adds that a fit has to find; what it cannot go with."""

    put: Put
    free: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()


EMULATED_EFFECTS: dict[str, EmulatedEffect] = {}


def emulated_effect(*free: str, excludes: Sequence[str] = ()) -> Callable[[Put], Put]:
    def register(put: Put) -> Put:
        EMULATED_EFFECTS[put.__name__] = EmulatedEffect(put, free, tuple(excludes))
        return put

    return register


def told(bench: Bench, **values: float) -> Bench:
    return replace(bench, story=bench.story | {(name, -1): float(value) for name, value in values.items()})


def told_each(bench: Bench, values: Callable[[int, Recording], dict[str, float]]) -> Bench:
    more: Story = {}
    for k, rec in enumerate(bench.recordings):
        more |= {(name, k): float(value) for name, value in values(k, rec).items()}
    return replace(bench, story=bench.story | more)


def with_noise(bench: Bench, change: Callable[[Noise], Noise]) -> Bench:
    return replace(bench, recordings=tuple(replace(r, noise=change(r.noise)) for r in bench.recordings))


def with_rows(bench: Bench, change: Callable[[Recording], Recording]) -> Bench:
    return replace(bench, recordings=tuple(change(r) for r in bench.recordings))


def either(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def pair(rng: np.random.Generator, name: str, size: float) -> dict[str, float]:
    phase = rng.uniform(0.0, 2.0 * np.pi)
    return {f"{name}_c": size * np.cos(phase), f"{name}_s": size * np.sin(phase)}


# Sensors


@emulated_effect("tau_i")
def current_lag(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, tau_i=log(0.3, 5.0) * b.recordings[0].h)


@emulated_effect("tau_w", excludes=["encoder"])
def speed_filter(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, tau_w=max(1.0 / (2.0 * np.pi * log(20.0, 300.0)), 0.5 * b.recordings[0].h))


@emulated_effect("delay", excludes=["command_latency", "measured_voltage"])
def recording_delay(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    h = b.recordings[0].h
    return told_each(b, lambda k, r: {"delay": log(0.3 * h, max(20.0 * h, 0.03))})


@emulated_effect("delay_i")
def current_delay(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, delay_i=log(0.3, 5.0) * b.recordings[0].h)


@emulated_effect("delay_w")
def speed_delay(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, delay_w=log(0.3, 5.0) * b.recordings[0].h)


@emulated_effect(excludes=["held_current"])
def mean_of_n(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, mean_i=float(rng.integers(2, 7)))


@emulated_effect("offset_i")
def current_offset(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told_each(b, lambda k, r: {"offset_i": either(rng) * log(0.01, 0.2) * b.i_run})


@emulated_effect("gain_i")
def current_gain(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, gain_i=either(rng) * log(0.003, 0.02))


@emulated_effect("gain_v", excludes=["measured_voltage"])
def voltage_gain(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, gain_v=either(rng) * log(0.002, 0.015))


@emulated_effect(excludes=["speed_filter", "coloured_noise", "jitter"])
def encoder(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    counts = float(rng.choice([500, 512, 1000, 1024, 2000, 2048, 4096, 8192]))
    slow = b.w_top * b.recordings[0].h * counts / (2.0 * np.pi) < 5.0  # counts a row
    return told(b, counts=8192.0 if slow else counts)


@emulated_effect()
def float32(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return with_rows(b, lambda r: replace(r, float32=True))


@emulated_effect(excludes=["mean_of_n", "coloured_noise"])
def held_current(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, hold_i=float(rng.integers(2, 6)))


@emulated_effect(excludes=["current_limit"])
def saturation(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    level = rng.uniform(0.6, 0.95) * b.i_peak
    return with_noise(b, lambda n: replace(n, saturation=max(level, 2.0 * b.i_run)))


@emulated_effect()
def adc_steps(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    steps = log(0.5, 4.0)
    return with_noise(b, lambda n: replace(n, quantum=steps * n.i))


@emulated_effect()
def growing_noise(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    growth = rng.uniform(0.5, 4.0) * min(1.0, 5.0 * b.i_run / b.i_peak)
    return with_noise(b, lambda n: replace(n, growth=growth))


@emulated_effect(excludes=["heavy_tails"])
def outliers(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    share = log(1e-3, 0.02)
    return with_noise(b, lambda n: replace(n, outliers=share))


@emulated_effect(excludes=["outliers"])
def heavy_tails(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return with_noise(b, lambda n: replace(n, student=True))


@emulated_effect(excludes=["encoder", "held_current"])
def coloured_noise(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    i, w = rng.uniform(0.3, 0.95, 2)
    return with_noise(b, lambda n: replace(n, colour_i=i, colour_w=w))


@emulated_effect("ripple_c", "ripple_s")
def commutation(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, ripple_n=rng.choice([6, 8, 10, 12, 14, 22, 26]), **pair(rng, "ripple", log(0.02, 0.15)))


@emulated_effect("eccentric_c", "eccentric_s")
def eccentricity(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, **pair(rng, "eccentric", log(0.003, 0.02)))


# Machine


@emulated_effect("Tc", excludes=["break_away"])
def dry_friction(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    share, B = rng.uniform(0.2, 0.9), b.story["B", -1]  # of all friction at the top speed
    return told(b, Tc=share * B * b.w_top, B=(1.0 - share) * B)


@emulated_effect("Tc", "stick", excludes=["dry_friction"])
def break_away(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(dry_friction(b, rng, log), stick=rng.uniform(1.2, 2.0))


@emulated_effect("Vb")
def brush_drop(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, Vb=min(log(0.01, 0.08) * b.supply, 2.0))


@emulated_effect()
def friction_wander(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    size, time = log(0.02, 0.1), log(0.05, 0.5)
    b = with_noise(b, lambda n: replace(n, wander=size, wander_time=time))
    return with_rows(b, lambda r: replace(r, wander=rng.standard_normal(MODES)))


@emulated_effect("drift")
def friction_drift(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told_each(b, lambda k, r: {"drift": rng.uniform(0.03, 0.2)})


@emulated_effect("heat")
def winding_warms(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    most = max(physics(b, b.story, k)[0][-1, 4] for k in range(len(b.recordings)))
    return told(b, heat=log(0.005, 0.06) / most)


@emulated_effect("B_run", "K_run")
def runs_differ(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told_each(b, lambda k, r: {"B_run": 0.05 * rng.standard_normal(), "K_run": 0.003 * rng.standard_normal()})


# Supply and command


@emulated_effect("Rsag", "ts", excludes=["source_resistance"])
def sag(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, Rsag=log(0.01, 0.15) * b.story["R", -1], ts=log(1e-3, 0.03))


@emulated_effect("Rs", excludes=["sag"])
def source_resistance(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, Rs=log(0.01, 0.1) * b.story["R", -1])


@emulated_effect("limit", excludes=["saturation"])
def current_limit(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, limit=max(rng.uniform(0.4, 0.85) * b.i_peak, 2.5 * b.i_run))


@emulated_effect(excludes=["recording_delay", "measured_voltage"])
def command_latency(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    def late(k: int, r: Recording) -> dict[str, float]:
        spans = np.diff([*r.edges, r.rows]) * r.h
        first = 0 if r.volts[0] else 1
        return {f"latency{e}": min(log(r.h, 0.1), 0.3 * spans[e]) for e in range(first, len(r.edges))}

    return told_each(b, late)


@emulated_effect(excludes=["recording_delay", "command_latency", "pwm", "voltage_gain"])
def measured_voltage(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    size = log(0.001, 0.02) * b.supply
    return with_noise(b, lambda n: replace(n, v=size))


@emulated_effect(excludes=["measured_voltage", "current_limit"])
def pwm(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, pwm=log(30.0, 160.0) if rng.uniform() < 0.25 else log(400.0, 2e4))


@emulated_effect()
def open_circuit(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told_each(b, lambda k, r: {"open": 1.0} if r.excitation in ("coasting", "zero") else {})


@emulated_effect("dead", excludes=["measured_voltage"])
def dead_band(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told(b, dead=log(0.01, 0.08) * b.supply)


# Clock and ends


@emulated_effect(excludes=["repeated_rows"])
def lost_rows(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    def lose(r: Recording) -> Recording:
        starts = rng.integers(5, r.rows - 30, rng.integers(1, 4))
        return replace(r, lost=np.unique(np.concatenate([s + np.arange(rng.integers(1, 9)) for s in starts])))

    return with_rows(b, lose)


@emulated_effect(excludes=["lost_rows"])
def repeated_rows(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return with_rows(b, lambda r: replace(r, repeated=rng.integers(5, r.rows - 5, rng.integers(1, 6))))


@emulated_effect(excludes=["encoder"])
def jitter(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    size = log(0.02, 0.2)
    return with_rows(b, lambda r: replace(r, noise=replace(r.noise, jitter=size * r.h)))


@emulated_effect("w0", excludes=["on_from_row_0"])
def moving_start(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return told_each(b, lambda k, r: {"w0": either(rng) * rng.uniform(0.05, 0.5) * b.w_top})


@emulated_effect(excludes=["moving_start"])
def on_from_row_0(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return b  # the command has no rest: `emulated_bench.draw`


@emulated_effect()
def last_row_zero(b: Bench, rng: np.random.Generator, log: Log) -> Bench:
    return with_rows(b, lambda r: replace(r, last_zero=True))


def chosen(rng: np.random.Generator, kinds: Sequence[str]) -> tuple[str, ...]:
    """Return zero to four kinds that go together and can be in recordings of such excitations."""
    wanted = int(rng.choice(5, p=[0.12, 0.2, 0.26, 0.24, 0.18]))
    names: list[str] = []
    impossible = set() if {"zero", "coasting"} & set(kinds) else {"open_circuit"}
    impossible |= {"runs_differ"} if len(kinds) == 1 else set()
    impossible |= {"command_latency"} if "prbs" in kinds else set()
    for name in map(str, rng.permutation(sorted(EMULATED_EFFECTS))):
        out = set(EMULATED_EFFECTS[name].excludes) | {n for n, t in EMULATED_EFFECTS.items() if name in t.excludes}
        if len(names) < wanted and name not in impossible and not out & set(names):
            names.append(name)
    return tuple(names)


def lasting(rng: np.random.Generator, rows: int) -> int:
    return int(rows * rng.uniform(0.9, 1.2))


def command(rng: np.random.Generator, excitation: str, top: float, settle: Callable[[], int], rest: int,
            mechanical: float) -> tuple[tuple[int, ...], tuple[float, ...], int]:  # fmt: skip
    """Return the rows of the edges, the voltages from there on, and the number of rows."""
    sign = rng.choice([-1.0, 1.0], p=[0.15, 0.85])
    if excitation == "prbs":
        clock = max(2, int(mechanical * rng.uniform(0.15, 1.0)))
        bits = rng.integers(0, 2, max(24, 4 * settle() // clock))
        low = rng.choice([-1.0, 0.3])
        levels, lengths = [top * (1.0 if bit else low) for bit in bits], [clock] * len(bits)
    else:
        part = {
            "step": [1.0],
            "two levels": [rng.uniform(0.35, 0.7), 1.0],
            "zero": [1.0, 0.0],
            "coasting": [1.0, 0.0],
            "reversal": [1.0, -rng.uniform(0.5, 1.0)],
        }.get(excitation) or list(np.linspace(0.25, 1.0, rng.integers(3, 6)))
        levels, lengths = [top * p for p in part], [settle() for _ in part]
    if rest:
        levels, lengths = [0.0, *levels], [rest, *lengths]
    edges = np.r_[0, np.cumsum(lengths)].astype(int)
    keep = [k for k in range(len(levels)) if k == 0 or levels[k] != levels[k - 1]]
    edge_rows = tuple(int(edges[k]) for k in keep)
    return edge_rows, tuple(float(sign * levels[k]) for k in keep), int(edges[-1])


def draw(seed: int, effects: tuple[str, ...] | None = None, excitation: str | None = None,
         sizes: Mapping[str, float] | None = None) -> Bench:  # fmt: skip
    """Return the bench of a seed; effects, excitation and sizes (of names, in rows) are drawn where not given."""
    rng = np.random.default_rng([seed, 13])

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    designed = effects is not None
    supply = float(rng.choice([6.0, 9.0, 12.0, 18.0, 24.0, 36.0, 48.0]))
    mechanical, electrical = log(5e-3, 0.3), log(1e-4, 5e-3)
    electrical = min(electrical, 0.5 * mechanical)
    R, idle = log(0.3, 20.0), log(0.02, 0.12)  # Ohm; no-load current over stall current
    w_top = rng.uniform(150.0, 700.0)  # rad/s at the full supply
    K = supply * (1.0 - idle) / w_top
    story: Story = {("R", -1): R, ("K", -1): K, ("L", -1): R * electrical}
    story |= {("J", -1): mechanical * K * K / R, ("B", -1): K * idle * supply / R / w_top}
    count = 1 if excitation else int(rng.choice([1, 2, 3, 4], p=[0.6, 0.2, 0.1, 0.1]))
    kinds = [excitation or str(rng.choice(EXCITATIONS, p=SHARES)) for _ in range(count)]
    names = effects if effects is not None else chosen(rng, kinds)
    if any(kind == "coasting" for kind in kinds) and "open_circuit" not in names:
        names = (*names, "open_circuit")
    at_once = "on_from_row_0" in names
    rate = float(rng.choice([1e3, 2e3, 5e3, 1e4]))
    recordings = []
    for kind in kinds:
        settled = rng.uniform(4.0, 8.0) * (mechanical + electrical)
        rest = 0 if at_once else rng.uniform(0.05, 0.3)
        parts = {"step": 1, "prbs": 3, "staircase": 4.5}.get(kind, 2)
        while rate > 1e3 and (parts * settled + rest) * rate > ROWS:
            rate = max(r for r in (1e3, 2e3, 5e3) if r < rate)
        length = int(np.clip(settled * rate, 40, (ROWS - 300) / parts))
        edges, volts, rows = command(rng, kind, supply * rng.uniform(0.5, 1.0),
                                     partial(lasting, rng, length),
                                     int(rest * rate), mechanical * rate)  # fmt: skip
        recordings.append((kind, edges, volts, rows))
    h = 1.0 / rate
    sub = int(np.clip(np.ceil(10.0 * h / electrical), 10, 40))
    top = max(abs(v) for _, _, volts, _ in recordings for v in volts)
    i_run, w_run = idle * top / R, w_top * top / supply
    quiet = Noise(i=0.0, w=log(2e-3, 0.02) * w_run)
    bench = Bench(seed, supply, tuple(Recording(kind, h, sub, rows, edges, volts, quiet)
                                      for kind, edges, volts, rows in recordings),
                  story, {}, (), i_run, i_run, w_run)  # fmt: skip
    i_peak = max(float(np.abs(physics(bench, story, k)[0][:, 0]).max()) for k in range(count))
    quiet = replace(quiet, i=log(2e-3, 0.02) * i_peak)
    bench = replace(bench, i_peak=i_peak, recordings=tuple(replace(r, noise=quiet) for r in bench.recordings))
    for name in names:
        before = set(bench.story)
        bench = EMULATED_EFFECTS[name].put(bench, rng, log)
        if sizes and designed:
            changed = {key: sizes[key[0]] * h for key in bench.story if key[0] in sizes}
            bench = replace(bench, story=bench.story | changed)
        added = tuple(key for key in bench.story if key not in before)
        found = tuple(key for key in added if key[0] in EMULATED_EFFECTS[name].free or key[0].startswith("latency"))
        bench = replace(bench, effects={**bench.effects, name: added}, free=bench.free + found)
    done = []
    for k, rec in enumerate(bench.recordings):
        fine, _ = physics(bench, bench.story, k)
        done.append(replace(rec, angle=fine[:: rec.sub, 2]))
    return replace(bench, recordings=tuple(done))
