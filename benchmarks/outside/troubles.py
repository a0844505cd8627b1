"""The catalogue of troubles: what each one means, how large it gets, and where it can occur."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Setting:
    """What a draw of troubles must know about the case."""

    tau_m: float
    tau_e: float
    dt: float
    duration: float
    volts: float
    recordings: int
    signs: bool  # the current becomes negative
    zero: bool  # the command returns to zero
    mixed_columns: bool  # one voltage column is measured, another is the command
    levels: bool  # more than one magnitude of voltage
    command: bool  # at least one voltage column is the command


@dataclass(frozen=True)
class Kind:
    """A trouble: group, smallest and largest size, unit, meaning."""

    group: str
    low: float
    high: float
    unit: str
    text: str
    needs: str = ""


KINDS: dict[str, Kind] = {
    # sensors; "of i" = of the reference current, "of w" = of the largest steady speed
    "current_offset": Kind("sensor", 0.005, 0.15, "of i", "constant offset of the current, another in each run"),
    "current_drift": Kind("sensor", 0.01, 0.2, "of i", "offset of the current that grows during a run"),
    "speed_offset": Kind("sensor", 0.001, 0.02, "of w", "constant offset of the speed"),
    "current_lag": Kind("sensor", 2e-4, 5e-3, "s", "first-order filter of the current"),
    "speed_lag": Kind("sensor", 0.02, 0.3, "of tau_m", "first-order filter of the speed"),
    "current_mean": Kind("sensor", 2, 10, "samples", "mean of the last samples of the current", "fast"),
    "speed_mean": Kind("sensor", 2, 20, "samples", "mean of the last samples of the speed", "fast"),
    "encoder_difference": Kind("sensor", 100, 8192, "counts/turn", "speed as difference of counts over one row"),
    "current_clip": Kind("sensor", 0.4, 0.95, "of peak", "the current's range ends below its peak"),
    "speed_dead_zone": Kind("sensor", 0.01, 0.1, "of w", "speeds below it read zero"),
    "current_steps": Kind("sensor", 0.02, 0.4, "of i", "coarse converter of the current"),
    "current_ripple": Kind("sensor", 0.02, 0.3, "of i(t)", "commutator ripple of the current, and its fundamental"),
    "speed_ripple": Kind("sensor", 0.002, 0.03, "of w(t)", "encoder off centre: orders 1 and 2"),
    "current_spikes": Kind("sensor", 5e-4, 0.02, "of rows", "outliers of the current"),
    "speed_spikes": Kind("sensor", 5e-4, 0.02, "of rows", "outliers of the speed"),
    "current_unsigned": Kind("sensor", 1, 1, "", "the current is stored without its sign", "signs"),
    "current_curve": Kind("sensor", 0.01, 0.1, "at peak", "the current's sensor compresses large values"),
    "speed_delay": Kind("sensor", 0.02, 0.3, "of tau_m", "the speed arrives late"),
    "current_delay": Kind("sensor", 0.5, 5, "samples", "the current arrives late"),
    "mains_hum": Kind("sensor", 0.02, 0.3, "of i", "50 Hz on the current"),
    # supply and command
    "latency": Kind(
        "supply", 1e-3, 0.15, "s", "the command reaches the motor late, another time in each run", "command"
    ),
    "latency_per_edge": Kind("supply", 2e-3, 0.1, "s", "the command is late, by another time at each edge", "command"),
    "command_tick": Kind("supply", 5e-3, 0.3, "s", "the board takes the command only at its ticks", "command"),
    "slew": Kind("supply", 0.02, 0.6, "of tau_m", "the voltage ramps to its level", "command"),
    "supply_dip": Kind(
        "supply", 0.02, 0.25, "of V at peak", "the supply gives way to the inrush and recovers", "command"
    ),
    "supply_ripple": Kind("supply", 0.005, 0.08, "of V", "100 Hz on the supply", "command"),
    "current_limit": Kind("supply", 0.3, 0.9, "of peak", "the supply limits the current", "command"),
    "slow_pwm": Kind("supply", 30, 500, "Hz", "a PWM slow enough to be seen; the column is its mean", "command"),
    "supply_drift": Kind("supply", 0.005, 0.06, "of V", "the supply falls during a run", "command"),
    "driver_drop": Kind("supply", 0.01, 0.1, "of V rated", "constant drop of the bridge's transistors", "levels"),
    "voltage_offset": Kind("supply", 0.002, 0.03, "of V rated", "offset of the voltage column"),
    "source_resistance": Kind(
        "supply", 0.03, 0.3, "of R", "leads and supply; one run is measured at the terminals", "mixed"
    ),
    "open_at_zero": Kind("supply", 1, 1, "", "at command zero the bridge is open instead of short", "zero"),
    # clock
    "hidden_jitter": Kind("clock", 0.05, 0.5, "of dt", "samples are not taken when the time column says"),
    "irregular_clock": Kind("clock", 0.05, 0.5, "of dt", "rows come irregularly; the time column is right"),
    "lost_rows": Kind("clock", 0.001, 0.05, "of rows", "rows are missing; the time column shows it"),
    "hidden_loss": Kind("clock", 1, 30, "rows", "rows are missing; the time column was numbered afterwards"),
    "stale_speed": Kind("clock", 2, 20, "rows", "the speed is refreshed only every n-th row", "fast"),
    "coarse_time": Kind("clock", 1.5, 10, "of dt", "the time column has too few digits", "fast"),
    "pause": Kind("clock", 0.01, 0.15, "s", "the logger pauses once"),
    "voltage_shift": Kind("clock", 1, 5, "rows", "the voltage column is stored late or early"),
    # machine
    "dry_friction": Kind("machine", 0.2, 0.9, "of friction", "Coulomb friction"),
    "stiction": Kind("machine", 0.1, 1, "of dry", "Coulomb friction that is larger at rest"),
    "brush_drop": Kind("machine", 0.01, 0.1, "of V rated", "voltage drop of the brushes", "levels"),
    "fan_drag": Kind("machine", 0.05, 0.6, "of friction", "torque with the square of the speed, in addition"),
    "heating": Kind("machine", 0.01, 0.1, "of R", "R grows with the energy lost"),
    "l_saturation": Kind("machine", 0.05, 0.5, "at peak", "L falls with the current"),
    "k_saturation": Kind("machine", 0.01, 0.12, "at peak", "K falls with the current"),
    "load_pulse": Kind("machine", 0.05, 0.8, "of friction", "somebody touches the shaft"),
    "cogging": Kind("machine", 0.05, 1, "of friction", "torque that depends on the angle"),
    "friction_wander": Kind("machine", 0.05, 0.25, "of friction", "friction that wanders far"),
    "warming": Kind("machine", 0.02, 0.2, "of friction", "friction falls during and between runs"),
    "run_spread": Kind(
        "machine", 0.02, 0.12, "of friction", "friction differs between runs, K by a tenth of it", "runs"
    ),
    "initial_speed": Kind("machine", 0.03, 0.7, "of w", "the motor turns already in the first row"),
    # logging
    "no_rest": Kind("logging", 1, 1, "", "the step is in the first row"),
    "early_command": Kind(
        "logging", 5e-3, 0.1, "s", "voltage on from the first row, the motor starts later", "command"
    ),
    "few_digits": Kind("logging", 0.02, 0.3, "of i", "values stored with few digits"),
    "last_row_zero": Kind("logging", 1, 1, "", "the last row is written after switching off"),
    "missing_cells": Kind("logging", 0.001, 0.02, "of rows", "empty cells"),
    "repeated_rows": Kind("logging", 0.001, 0.02, "of rows", "rows stored twice"),
    "short_recording": Kind("logging", 1, 3, "tau_m", "ends so long after the last edge"),
}

WEIGHT = {"dry_friction": 4.0, "latency": 1.5, "current_lag": 1.5, "current_offset": 1.5}

#: at most one of each set in a case
RIVALS = (
    {"latency", "latency_per_edge", "command_tick", "early_command"},
    {"no_rest", "early_command", "initial_speed"},
    {"encoder_difference", "speed_mean", "stale_speed"},
    {"hidden_jitter", "irregular_clock", "coarse_time"},
    {"dry_friction", "stiction"},
    {"heating", "l_saturation"},
    {"current_steps", "few_digits"},
    {"slow_pwm", "supply_ripple", "current_limit"},
    {"friction_wander", "warming", "run_spread"},
)


def possible(name: str, s: Setting) -> bool:
    """Tell whether the trouble can occur, and can be seen, in this setting."""
    kind = KINDS[name]
    checks = {
        "fast": s.dt * kind.low * 2 <= 0.3 * s.tau_m,
        "signs": s.signs,
        "command": s.command,
        "mixed": s.mixed_columns,
        "zero": s.zero and s.command,
        "levels": s.levels,  # a constant drop at one level is a gain, which nobody can tell
        "runs": s.recordings > 1,
        "": True,
    }
    if name == "driver_drop" and not s.command:
        return False
    if name == "current_lag" and s.dt > 2e-3:
        return False
    if name in ("slow_pwm", "mains_hum") and s.dt > 5e-3:
        return False
    if name == "encoder_difference" and s.dt < 4e-4:
        return False
    return checks[kind.needs]


def size(name: str, s: Setting, rng: np.random.Generator) -> float:
    """Draw a size, log-uniform, bounded by what the recording's time scales allow."""
    kind = KINDS[name]
    low, high = kind.low, kind.high
    if name in ("speed_mean", "stale_speed", "current_mean", "coarse_time"):
        high = max(low, min(high, 0.3 * s.tau_m / s.dt))
    elif name in ("latency", "latency_per_edge", "command_tick", "early_command", "pause"):
        high = max(2 * low, min(high, 0.1 * s.duration))
    elif name == "slow_pwm":  # the speed hardly follows
        low = min(high / 1.5, max(low, 1.5 / s.tau_m))
    elif name == "encoder_difference":  # the quantum stays below a tenth of a typical speed
        low = min(high / 2, max(low, 2 * math.pi / s.dt / 40.0))
    value = float(np.exp(rng.uniform(math.log(low), math.log(high)))) if high > low else low
    whole = kind.unit in ("samples", "rows", "counts/turn") and name != "current_delay"
    return float(max(kind.low, round(value))) if whole else float(f"{value:.4g}")


def draw(s: Setting, rng: np.random.Generator) -> dict[str, float]:
    """Draw two to four troubles with their sizes; none in about six cases of a hundred."""
    if rng.random() < 0.06:
        return {}
    count = int(rng.integers(2, 5))
    names = [n for n in KINDS if possible(n, s)]
    chosen: dict[str, float] = {}
    while len(chosen) < count:
        weights = np.array([WEIGHT.get(n, 1.0) for n in names])
        name = names[int(rng.choice(len(names), p=weights / weights.sum()))]
        chosen[name] = size(name, s, rng)
        taken = {name}.union(*(r for r in RIVALS if name in r))
        names = [n for n in names if n not in taken]
    return chosen
