"""Recordings of DC motors as real test benches make them, with the truth kept beside.

``case(seed)`` draws a motor, one to four recordings of it and two to four troubles; the same seed
gives the same case. ``write(case, folder)`` stores the recordings as a logger would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import troubles
from measure import Noise, Reference, digitise, drive, log_rows, ornstein_uhlenbeck, sense_current, sense_speed
from numpy.typing import NDArray
from plant import Array, Motor, Run, simulate, steady_state

Stage = tuple[float, float, bool]  # seconds, volts, open circuit
RAD_TO_RPM = 30 / math.pi


@dataclass
class Recording:
    """One file: header and columns as stored, in the units of the header."""

    name: str
    header: tuple[str, str, str, str]
    table: Array
    decimals: tuple[int, int, int, int]
    excitation: str
    measured: bool  # the voltage column is measured at the terminals


@dataclass(frozen=True)
class Bench:
    """What all recordings of a case share."""

    motor: Motor  # with dry friction, without the other troubles
    real: Motor
    friction: float  # N m at rated speed
    ref: Reference
    noise: Noise
    troubles: dict[str, float]
    ideal: bool
    dt: float
    h: float  # s, width of a fine cell
    board: bool  # the clock is a small board's
    measures: bool  # every voltage column is measured
    spread: Array  # friction of each run, relative to the mean
    rpm: bool
    milli: bool


@dataclass
class Case:
    """Recordings of one motor, the truth, and what is wrong with them.

    ``apparent`` is the truth in the units of the sensors: what a perfect estimator finds where the
    gains listed in ``untellable`` are not one.
    """

    seed: int
    recordings: list[Recording]
    truth: dict[str, float]
    apparent: dict[str, float]
    troubles: dict[str, float]
    untellable: dict[str, float] = field(default_factory=dict)
    story: str = ""


def draw_motor(rng: np.random.Generator) -> tuple[float, float, Motor]:
    """Draw rated voltage, friction torque at rated speed, and a plausible motor without dry friction."""
    volts = float(rng.choice([6, 9, 12, 18, 24, 36, 48]))
    tau_m = math.exp(rng.uniform(math.log(5e-3), math.log(0.3)))
    tau_e = math.exp(rng.uniform(math.log(1e-4), math.log(min(5e-3, tau_m / 2.5))))
    speed = math.exp(rng.uniform(math.log(120), math.log(800)))
    stall = math.exp(rng.uniform(math.log(0.8), math.log(min(40, 4 * volts))))
    idle = math.exp(rng.uniform(math.log(0.02), math.log(0.15)))  # no-load over stall current
    R, K = volts / stall, volts * (1 - idle) / speed
    friction = K * idle * stall
    motor = Motor(R=R, K=K, L=tau_e * R, J=tau_m * K * K / R, B=friction / speed)
    rounded: dict[str, Any] = {n: float(f"{getattr(motor, n):.4g}") for n in ("R", "K", "L", "J", "B")}
    return volts, friction, Motor(**rounded)


def excitation(kind: str, volts: float, tau: float, longest: float, dt: float, rng: np.random.Generator) -> list[Stage]:
    """Draw the stages after the rest."""
    hold = float(np.clip(rng.uniform(4, 10) * tau, 0.1, 1.5))
    level = volts * float(np.round(rng.uniform(0.4, 1.0), 2))
    other = float(np.round(level * rng.uniform(0.3, 0.75), 2))
    plans: dict[str, list[Stage]] = {
        "step": [(2 * hold, level, False)],
        "two levels": [(hold, other, False), (hold, level, False)],
        "step and zero": [(hold, level, False), (hold, 0.0, False)],
        "reversal": [(hold, level, False), (hold, -level, False)],
        "coast, open": [(hold, level, False), (hold, 0.0, True)],
    }
    if kind == "staircase":
        n = int(rng.integers(3, 7))
        ups = [(0.6 * hold, float(np.round(level * (k + 1) / n, 2)), False) for k in range(n)]
        plan = ups + ups[-2::-1] if rng.random() < 0.4 else ups
    elif kind == "prbs":
        bit = max(4 * dt, rng.uniform(0.4, 2.0) * tau, 0.01)
        low = float(rng.choice([-level, other]))
        bits = rng.integers(0, 2, int(rng.integers(15, 40)))
        bits[0] = 1
        plan = [(bit, level if b else low, False) for b in bits]
    else:
        plan = plans[kind]
    total = sum(s[0] for s in plan)
    shrink = min(1.0, longest / total) if kind != "prbs" else 1.0
    stretch = max(shrink, min(0.4, longest) / total) if kind != "prbs" else 1.0
    if kind == "prbs":
        while sum(s[0] for s in plan) > longest and len(plan) > 6:
            plan.pop()
    return [(s * stretch, v, o) for s, v, o in plan]


def sampling(tau_m: float, rows: int, rng: np.random.Generator) -> tuple[float, bool]:
    """Draw the interval and whether the clock is a small board's; ``rows`` of them hold eight time constants."""
    if tau_m > 0.15 and rng.random() < 0.12:
        return 0.02, True
    if tau_m > 0.05 and rng.random() < 0.12:
        return 5e-3, False
    dt = float(rng.choice([1e-3, 5e-4, 2e-4, 1e-4, 2e-3], p=[0.5, 0.2, 0.15, 0.1, 0.05]))
    return (dt if rows * dt >= 8 * tau_m else 1e-3), False


def row_cells(
    duration: float, dt: float, h: float, board: bool, t: dict[str, float], rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw the fine cells at which the rows are taken."""
    n = int(duration / dt) + 1
    steps = np.full(n, dt)
    if board:
        steps = np.clip(rng.gamma(6, dt / 6, n), 0.25 * dt, 2.4 * dt)
    if "irregular_clock" in t:
        steps = steps * np.clip(1 + t["irregular_clock"] * rng.standard_normal(n), 0.3, 3)
    cells = np.maximum(1, np.round(steps / h)).astype(np.int64)
    return np.concatenate([[0], np.cumsum(cells)[:-1]])


def draw_noise(rng: np.random.Generator, t: dict[str, float]) -> Noise:
    """Draw the noise of the bench; one in five has sensors with a gain that nobody can tell."""
    gains = {}
    if t and rng.random() < 0.2:
        name = str(rng.choice(["i", "w", "v", "t"]))
        gains[name] = 1 + float(rng.choice([-1, 1])) * round(math.exp(rng.uniform(math.log(1e-3), math.log(1e-2))), 5)
    wander = math.exp(rng.uniform(math.log(0.003), math.log(0.03)))
    return Noise(
        current=math.exp(rng.uniform(math.log(0.005), math.log(0.03))),
        rest=rng.uniform(0.1, 1.0),
        speed=math.exp(rng.uniform(math.log(0.001), math.log(0.01))),
        quantised=bool(rng.random() < 0.35),
        colour=float(rng.uniform(0, 0.5)) if rng.random() < 0.5 else 0.0,
        colour_rows=float(rng.uniform(1, 8)),
        wander=t.get("friction_wander", wander),
        wander_time=math.exp(rng.uniform(math.log(0.05), math.log(0.5))),
        voltage=math.exp(rng.uniform(math.log(3e-4), math.log(3e-3))),
        gains=gains,
    )


def with_troubles(m: Motor, t: dict[str, float], friction: float, ref: Reference) -> Motor:
    """Add the troubles of the machine and its supply; ``dry_friction`` is in ``m`` already."""
    extra: dict[str, Any] = {}
    if "stiction" in t:
        extra |= {"stiction": t["stiction"], "stribeck": 0.03 * ref.speed}
    if "fan_drag" in t:
        extra["drag"] = t["fan_drag"] * friction / ref.speed**2
    if "brush_drop" in t:
        drop = t["brush_drop"] * ref.volts
        extra |= {"brush": drop, "brush_current": max(0.2 * ref.current, drop / (3 * m.R))}
    if "l_saturation" in t:
        extra["l_saturation"] = t["l_saturation"] / (1 - t["l_saturation"]) / ref.peak**2
    if "k_saturation" in t:
        extra["k_saturation"] = t["k_saturation"] / ref.peak**2
    if "cogging" in t:
        extra["cogging"] = t["cogging"] * friction
    if "source_resistance" in t:
        extra["source"] = t["source_resistance"] * m.R
    if "supply_dip" in t:
        extra |= {"dip": t["supply_dip"] * ref.level / ref.peak, "dip_time": max(5e-3, 0.3 * ref.tau_m)}
    if "current_limit" in t:
        extra["limit"] = max(t["current_limit"] * ref.peak, 1.5 * ref.current)
    return replace(m, **extra)


def draw_plans(
    count: int, volts: float, tau_m: float, longest: float, dt: float, rng: np.random.Generator
) -> tuple[list[str], list[list[Stage]]]:
    """Draw kind of excitation and stages of each recording."""
    kinds = ["step", "two levels", "step and zero", "reversal", "staircase", "prbs", "coast, open"]
    odds = [0.26, 0.16, 0.14, 0.12, 0.12, 0.1, 0.1]
    drawn = [str(k) for k in rng.choice(kinds, count, p=odds)]
    if rng.random() < 0.4:
        drawn = [drawn[0]] * count
    return drawn, [excitation(k, volts, tau_m, longest, dt, rng) for k in drawn]


def draw_measured(drawn: list[str], rng: np.random.Generator) -> tuple[bool, list[bool]]:
    """Draw whether the bench measures its voltage, and which voltage columns are measured."""
    bench_measures = rng.random() < 0.3
    measured = [bench_measures or k == "coast, open" for k in drawn]
    if len(drawn) > 1 and not any(measured) and rng.random() < 0.2:
        measured[int(rng.integers(len(drawn)))] = True
    return bench_measures, measured


def draw_troubles(setting: troubles.Setting, rng: np.random.Generator) -> dict[str, float]:
    """Draw troubles with their sizes; stiction brings dry friction with it."""
    t = troubles.draw(setting, rng)
    if "stiction" in t:
        t["dry_friction"] = float(np.round(rng.uniform(0.3, 0.9), 3))
    return t


def with_dry_friction(motor: Motor, t: dict[str, float], friction: float) -> Motor:
    """Move a share of the viscous friction to dry friction."""
    if "dry_friction" not in t:
        return motor
    share = t["dry_friction"]
    return replace(motor, dry=float(f"{share * friction:.4g}"), B=float(f"{(1 - share) * motor.B:.4g}"))


def reference(motor: Motor, plans: list[list[Stage]], h: float, volts: float, tau_m: float, tau_e: float) -> Reference:
    """Run the nominal motor at the largest level; the peak is that of the largest jump."""
    level = max(abs(v) for plan in plans for _, v, _ in plan)
    i_ss, w_ss = steady_state(motor, level)
    jump = max(
        abs(b[1] - a[1]) for plan in plans for a, b in zip([(0.0, 0.0, False), *plan], plan, strict=False) if not b[2]
    )
    first = simulate(motor, h, np.full(round(6 * (tau_e + min(tau_m, 6 * tau_e)) / h), level))
    peak = float(first.current.max()) * jump / level
    return Reference(volts, level, max(i_ss, 0.03 * level / motor.R), w_ss, peak, tau_m)


def with_rest(bench: Bench, plan: list[Stage], rng: np.random.Generator) -> list[Stage]:
    """Put a rest before the plan, and cut the last stage where the recording is short."""
    t, dt = bench.troubles, bench.dt
    rest = float(rng.uniform(0.05, 0.25)) if rng.random() < 0.9 else float(rng.uniform(0.3, 0.6))
    if {"no_rest", "early_command", "initial_speed"} & t.keys():
        rest = 0.0 if "initial_speed" not in t else 2 * dt
    stages = [(rest, 0.0, False), *plan]
    if "short_recording" in t:
        stages[-1] = (min(stages[-1][0], t["short_recording"] * bench.ref.tau_m + 5 * dt), *stages[-1][1:])
    return stages


def friction_scale(bench: Bench, r: int, n: int, rng: np.random.Generator) -> Array | None:
    """Draw the factor of the friction on the fine grid: it differs between runs, wanders, falls with warming."""
    if bench.ideal:
        return None
    t, noise = bench.troubles, bench.noise
    scale: Array = bench.spread[r] * (1 + noise.wander * ornstein_uhlenbeck(n, bench.h, noise.wander_time, rng))
    if "warming" in t:
        scale = scale * (1 + t["warming"] * (0.5 - (r + np.linspace(0, 1, n)) / len(bench.spread)))
    return scale


def load_torque(bench: Bench, n: int, rng: np.random.Generator) -> Array | None:
    """Draw the torque of the hand that touches the shaft, on the fine grid."""
    if "load_pulse" not in bench.troubles:
        return None
    load = np.zeros(n)
    a = rng.uniform(0.3, 0.75) * n
    load[int(a) : int(a + rng.uniform(0.05, 0.25) * n)] = bench.troubles["load_pulse"] * bench.friction
    return load


def resistance_rise(bench: Bench, r: int, v: Array, opened: NDArray[np.bool_]) -> Array | None:
    """Return the relative growth of R with the energy lost, on the fine grid."""
    if "heating" not in bench.troubles:
        return None
    energy = np.cumsum(simulate(bench.motor, bench.h, v, is_open=opened).current ** 2)
    rise: Array = bench.troubles["heating"] * energy / max(energy[-1], 1e-30) * (r + 1) / len(bench.spread)
    return rise


def run_machine(
    bench: Bench, r: int, v: Array, opened: NDArray[np.bool_], measured: bool, rng: np.random.Generator
) -> Run:
    """Simulate run ``r`` of the real machine on the fine grid."""
    t, real = bench.troubles, bench.real
    scale = friction_scale(bench, r, len(v), rng)
    load = load_torque(bench, len(v), rng)
    rise = resistance_rise(bench, r, v, opened)
    this = replace(real, K=real.K * (1 + 0.1 * (bench.spread[r] - 1))) if "run_spread" in t else real
    start = (0.0, t.get("initial_speed", 0.0) * bench.ref.speed, 0.0)
    source = replace(this, source=0.0) if measured and bench.measures else this
    return simulate(source, bench.h, v, is_open=opened, load=load, friction_scale=scale, r_rise=rise, start=start)


def read_sensors(
    bench: Bench, run: Run, cells: NDArray[np.int64], at: NDArray[np.int64], rng: np.random.Generator
) -> tuple[Array, Array]:
    """Read current and speed of the rows, in SI units; ``at`` are the cells where the samples are really taken."""
    if bench.ideal:
        return run.current[at], run.speed[at]
    h, dt, t, ref = bench.h, bench.dt, bench.troubles, bench.ref
    return digitise(
        sense_current(run, h, dt, t, ref, rng)[at],
        sense_speed(run, h, dt, t, ref, rng)[at],
        run.angle[at],
        (run.current[at], run.speed[at]),
        np.diff(cells, prepend=-round(dt / h)) * h,
        t,
        ref,
        bench.noise,
        rng,
    )


def stored(bench: Bench, table: Array, name: str, kind: str, measured: bool) -> Recording:
    """Round the rows where few digits are kept, and convert them to the units of the header."""
    t, ref, noise = bench.troubles, bench.ref, bench.noise
    if "few_digits" in t:
        for column, step in ((2, t["few_digits"] * ref.current), (3, 0.03 * t["few_digits"] * ref.speed)):
            table[:, column] = step * np.round(table[:, column] / step)
    amps, turns = 1e3 if bench.milli else 1.0, RAD_TO_RPM if bench.rpm else 1.0
    table[:, 2] *= amps
    table[:, 3] *= turns
    fineness = (ref.volts * 1e-3, noise.current * noise.rest * ref.current * amps, noise.speed * ref.speed / 3 * turns)
    places = [max(0, math.ceil(-math.log10(x / 5))) for x in fineness]
    header = (
        "time [s]",
        "voltage [V]",
        "current [mA]" if bench.milli else "current [A]",
        "speed [rpm]" if bench.rpm else "speed [rad/s]",
    )
    return Recording(name, header, table, (6, places[0], places[1], places[2]), kind, measured)


def record(bench: Bench, r: int, kind: str, plan: list[Stage], measured: bool, rng: np.random.Generator) -> Recording:
    """Take recording ``r`` of the case."""
    dt, h, t, ref = bench.dt, bench.h, bench.troubles, bench.ref
    stages = with_rest(bench, plan, rng)
    ends = np.cumsum([s[0] for s in stages])
    cells = row_cells(float(ends[-1]), dt, h, bench.board, t, rng)
    stage_of = np.minimum(np.searchsorted(ends, cells * h + 1e-9, side="right"), len(stages) - 1)
    widths = np.diff(np.append(cells, cells[-1] + round(dt / h)))
    command = np.array([s[1] for s in stages])[stage_of]
    circuit_open = np.repeat(np.array([s[2] for s in stages])[stage_of], widths)
    v, opened = drive(np.repeat(command, widths), h, t, ref, circuit_open, measured, rng)
    run = run_machine(bench, r, v, opened, measured, rng)

    at = cells
    if "hidden_jitter" in t:
        moved = np.round(t["hidden_jitter"] * dt / h * rng.uniform(-1, 1, len(cells)))
        at = np.clip(cells + moved.astype(np.int64), 0, len(v) - 1)
    i, w = read_sensors(bench, run, cells, at, rng)
    u = command.astype(float)
    if measured:
        u = run.terminal[at] + (0.0 if bench.ideal else bench.noise.voltage * ref.volts * rng.standard_normal(len(at)))
    gain = bench.noise.gains
    table = np.column_stack([x * gain.get(n, 1.0) for n, x in (("t", cells * h), ("v", u), ("i", i), ("w", w))])
    return stored(bench, log_rows(table, dt, t, ref, rng), f"run_{r + 1}.csv", kind, measured)


def as_sensors_see(truth: dict[str, float], gains: dict[str, float]) -> dict[str, float]:
    """Convert the parameters to the units of the sensors."""
    i, w, v, clock = (gains.get(n, 1.0) for n in "iwvt")
    seen = {"R": v / i, "K": v / w, "L": v / i * clock, "J": v * i / w**2 * clock, "B": v * i / w**2, "Tc": v * i / w}
    # torque K' i' against K i sets J, B and Tc
    return {n: truth[n] * seen[n] for n in truth}


def tell(bench: Bench, recordings: list[Recording], tau_e: float) -> str:
    """Describe the case in words."""
    columns = ", ".join(
        f"{r.excitation} ({'measured' if r.measured else 'command'}, {len(r.table)} rows)" for r in recordings
    )
    wrong = "; ".join(
        f"{n} {x:g} {troubles.KINDS[n].unit}: {troubles.KINDS[n].text}" for n, x in bench.troubles.items()
    )
    return (
        f"{bench.ref.volts:g} V motor, tau_m {1e3 * bench.ref.tau_m:.1f} ms, L/R {1e3 * tau_e:.2f} ms, "
        f"{1 / bench.dt:g} Hz{' irregular' if bench.board else ''}: {columns}. Wrong: {wrong or 'nothing'}."
    )


def case(seed: int, *, ideal: bool = False, only: str | None = None) -> Case:
    """Draw the case of this seed.

    Parameters
    ----------
    ideal : bool
        Leave out troubles, noise and wandering friction.
    only : str, optional
        The one trouble that is there, where it can be; "none": there is none.
    """
    rng = np.random.default_rng([20240611, seed])
    volts, friction, motor = draw_motor(rng)
    tau_m, tau_e = motor.J * motor.R / motor.K**2, motor.L / motor.R
    count = int(rng.choice([1, 2, 3, 4], p=[0.4, 0.25, 0.2, 0.15]))
    rows = 9000 if count < 3 else 5000
    dt, board = sampling(tau_m, rows, rng)
    longest = min(5.5 if count < 3 else 3.0, rows * dt)
    drawn, plans = draw_plans(count, volts, tau_m, longest, dt, rng)
    bench_measures, measured = draw_measured(drawn, rng)
    setting = troubles.Setting(
        tau_m,
        tau_e,
        dt,
        sum(s[0] for s in plans[0]),
        volts,
        count,
        signs=any(k in ("step and zero", "reversal") for k in drawn),
        zero="step and zero" in drawn,
        mixed_columns=any(measured) and not all(measured),
        command=not all(measured),
        levels=len({abs(v) for plan in plans for _, v, o in plan if v and not o}) > 1,
    )
    t = draw_troubles(setting, rng)
    if ideal or only is not None:
        possible = only in troubles.KINDS and troubles.possible(only, setting) and not ideal
        t = {only: troubles.size(only, setting, rng)} if only and possible else {}
    noise = draw_noise(rng, t)
    motor = with_dry_friction(motor, t, friction)
    h = dt / max(1, math.ceil(dt / max(1e-5, min(tau_e / 8, 1e-4))))
    ref = reference(motor, plans, h, volts, tau_m, tau_e)
    spread = 1 + t.get("run_spread", 0.0) * rng.uniform(-1, 1, count)
    spread /= spread.mean()
    bench = Bench(
        motor=motor,
        real=with_troubles(motor, t, friction, ref),
        friction=friction,
        ref=ref,
        noise=noise,
        troubles=t,
        ideal=ideal,
        dt=dt,
        h=h,
        board=board,
        measures=bench_measures,
        spread=spread,
        rpm=bool(rng.random() < 0.4),
        milli=bool(rng.random() < 0.1),
    )
    runs = enumerate(zip(drawn, plans, measured, strict=True))
    recordings = [record(bench, r, kind, plan, m, rng) for r, (kind, plan, m) in runs]
    truth = {n: getattr(motor, n) for n in ("R", "K", "L", "J", "B")} | {"Tc": motor.dry}
    untellable = {f"gain of {n}": g for n, g in noise.gains.items()}
    apparent = as_sensors_see(truth, noise.gains)
    return Case(seed, recordings, truth, apparent, t, untellable, tell(bench, recordings, tau_e))


def write(this: Case, folder: str | Path) -> list[Path]:
    """Store the recordings and return the files. The truth is not written."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for recording in this.recordings:
        lines = [",".join(recording.header)]
        for row in recording.table.tolist():
            lines.append(
                ",".join("" if math.isnan(x) else f"{x:.{d}f}" for x, d in zip(row, recording.decimals, strict=True))
            )
        files.append(folder / recording.name)
        files[-1].write_text("\n".join(lines) + "\n", encoding="utf-8")
    return files
