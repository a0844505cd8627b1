"""How often `check` is wrong on good recordings, and how often it finds what it is for: random motors, random drives.

    python benchmarks/plausibility.py [COUNT]

Motors of tests/motors.csv up to 48 V, each value times a random factor (25 %), two in five with a flywheel of up to 20
times the inertia, two in five behind a gear of up to 100, driven by steps, levels, reversals, pseudo-random signals and
ramps at 50 Hz to 10 kHz, some with dry friction; noise of 0.2 to 3 % of the current's peak and 0.1 to 2 % of the
speed's, or an encoder of 48 to 8192 counts, or a tachometer behind a converter. Simulated by exact discretisation.
"""

from __future__ import annotations

import csv
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from estimator.recordings.measured_signals import MeasuredSignals
from estimator.recordings.plausibility import implausible

FloatArray = NDArray[np.float64]
Signals = dict[str, FloatArray]

DRIVES = ("step", "step", "step", "first", "levels", "reverse", "prbs", "ramp", "back")
NOBODY = frozenset({"v", "i", "w", "time"})
RPM, DEGREES = 30 / np.pi, 180 / np.pi


def motors() -> list[dict[str, float]]:
    """Return the motors up to 48 V."""
    lines = (Path(__file__).parent.parent / "tests" / "motors.csv").read_text().splitlines()
    found = []
    for row in csv.DictReader(line for line in lines if line[0] != "#"):
        motor = {name: float(row[name]) for name in ("R", "L", "K", "J")}
        motor["B"] = float(row["B"] or 0.02 * motor["K"] ** 2 / motor["R"])
        motor["V"] = float(row["voltage"] or 12)
        found += [motor] if motor["V"] <= 48 else []
    return found


def drive(rng: np.random.Generator, n: int, volts: float, kind: str) -> FloatArray:
    """Return a voltage, (n,)."""
    k = n // 6
    v: NDArray[np.floating] = np.zeros(n)
    if kind == "step":
        v[k:] = volts
    elif kind == "first":
        v[:] = volts
    elif kind == "levels":
        v[:] = np.repeat(np.array([0, 0.4, 0.8, 1, 0.5, 0]) * volts, k + 1)[:n]
    elif kind == "reverse":
        v[k : 3 * k], v[3 * k : 5 * k] = volts, -volts
    elif kind == "prbs":
        width = max(2, n // 60)
        v[:] = np.repeat(rng.integers(0, 2, n // width + 1) * 2 - 1, width)[:n] * volts
    elif kind == "ramp":
        v[:] = np.linspace(0, volts, n)
    else:
        v[k : n // 2] = volts
    return np.asarray(v, dtype=np.float64)


def recording(rng: np.random.Generator, known: list[dict[str, float]]) -> tuple[Signals, bool]:
    """Return the signals of one random bench, and whether its friction is dry in part."""
    motor = dict(known[rng.integers(len(known))])
    for name in ("R", "L", "K", "J", "B"):
        motor[name] *= float(np.exp(rng.normal(0, 0.25)))
    if rng.random() < 0.4:
        motor["J"] *= float(np.exp(rng.uniform(0, 3)))
    if rng.random() < 0.4:
        gear = float(np.exp(rng.uniform(0, np.log(100))))
        motor["K"], motor["J"], motor["B"] = motor["K"] * gear, motor["J"] * gear**2, motor["B"] * gear**2
    R, L, K, J, B = (motor[name] for name in ("R", "L", "K", "J", "B"))
    volts = motor["V"] * float(rng.uniform(0.25, 1))
    constant = R * J / (K * K + R * B)
    h = float(rng.choice([1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2]))
    while h > constant:
        h /= 2
    kind = str(rng.choice(DRIVES))
    n = int(np.clip(12 * constant / h * (1.2 if kind in ("step", "first") else 6), 400, 20_000))
    v = drive(rng, n, volts, kind)
    dry = float(rng.uniform(0, 0.15)) * K * volts / R if rng.random() < 0.4 else 0.0
    block = np.zeros((4, 4))
    block[:2] = [[-R / L, -K / L, 1 / L, 0], [K / J, -B / J, 0, -1 / J]]
    step = expm(block * h)
    x, shown, angle, turned = np.zeros(2), np.zeros((n, 2)), np.zeros(n), 0.0
    for k in range(n):
        shown[k], angle[k] = x, turned
        free = step[:2, :2] @ x + step[:2, 2] * v[k]
        if dry:
            sign = np.sign(x[1]) if abs(x[1]) > 1e-9 else np.sign(x[0]) * (abs(K * x[0]) > dry)
            held = free + step[:2, 3] * dry * sign
            held[1] = held[1] if held[1] * sign > 0 else 0.0
            free = held
        turned += h * (x[1] + free[1]) / 2
        x = free
    i, w = shown.T
    top = np.abs(shown).max(axis=0)
    i = i + rng.normal(0, np.exp(rng.uniform(np.log(0.002), np.log(0.03))) * top[0], n) + rng.normal(0, 0.005) * top[0]
    sensor = rng.random()
    if sensor < 0.3:
        count = 2 * np.pi / int(rng.choice([48, 64, 400, 1024, 2000, 4096, 8192]))
        angle = np.round(angle / count) * count
        w = np.diff(angle, prepend=angle[0]) / h
    else:
        w = w + rng.normal(0, np.exp(rng.uniform(np.log(0.001), np.log(0.02))) * top[1], n)
        if sensor < 0.4:
            quantum = top[1] / float(rng.uniform(300, 4000))
            w = np.round(w / quantum) * quantum
    found = {"time": np.arange(n) * h, "v": v, "i": i, "w": w}
    if rng.random() < 0.15:
        del found["i"]
    if rng.random() < 0.2:
        found["angle"] = angle
    return found, dry > 0


def scaled(name: str, factor: float) -> Callable[[Signals], Signals | None]:
    """Return what multiplies one signal, and leaves the angle out."""

    def wrong(good: Signals) -> Signals | None:
        if name not in good:
            return None
        return {n: factor * y if n == name else y for n, y in good.items() if n != "angle"}

    return wrong


def beside_angle(good: Signals) -> Signals | None:
    """Return rpm read as rad/s where an angle was logged, too."""
    return {**good, "w": RPM * good["w"]} if "angle" in good else None


def exchanged(good: Signals) -> Signals | None:
    """Return current and speed exchanged, behind a voltage that jumps."""
    if "i" not in good or np.max(np.abs(np.diff(good["v"]))) < 0.3 * np.ptp(good["v"]) or np.ptp(good["v"]) == 0:
        return None
    return {"time": good["time"], "v": good["v"], "i": good["w"], "w": good["i"]}


def duty(full: float, *, reach: float = 0.6) -> Callable[[Signals], Signals | None]:
    """Return what gives the voltage as a duty cycle of up to a part of a full scale."""

    def wrong(good: Signals) -> Signals | None:
        v = good["v"] / np.max(np.abs(good["v"])) * full * reach
        return {**{n: y for n, y in good.items() if n != "angle"}, "v": v}

    return wrong


TROUBLES: dict[str, tuple[str, Callable[[Signals], Signals | None]]] = {
    "nothing": ("", lambda good: good),
    "current and speed exchanged": ("exchanged", exchanged),
    "sign of the current": ("sign", scaled("i", -1)),
    "sign of the speed": ("sign", scaled("w", -1)),
    "nothing, in mV and mA": ("", lambda good: good),
    "mA as A": ("unit i", scaled("i", 1e3)),
    "A as mA": ("unit i", scaled("i", 1e-3)),
    "mV as V": ("unit v", scaled("v", 1e3)),
    "V as mV": ("unit v", scaled("v", 1e-3)),
    "rpm as rad/s": ("unit w", scaled("w", RPM)),
    "rpm as rad/s, angle beside": ("unit w", beside_angle),
    "deg/s as rad/s": ("unit w", scaled("w", DEGREES)),
    "ms as s": ("unit time", scaled("time", 1e3)),
    "us as s": ("unit time", scaled("time", 1e6)),
    "duty 0 … 1 as V": ("unit v", duty(1.0)),
    "duty in percent as V": ("unit v", duty(100.0)),
    "duty of 0 … 255 as V": ("unit v", duty(255.0)),
    "duty to exactly 1 as V": ("unit v", duty(1.0, reach=1.0)),
    "duty to exactly 100 as V": ("unit v", duty(100.0, reach=1.0)),
    "duty to exactly 255 as V": ("unit v", duty(255.0, reach=1.0)),
}
UNITS = {  # trouble → units that the header says, where they are not SI
    "nothing, in mV and mA": {"v": "mV", "i": "mA"},
    "A as mA": {"i": "mA"},
    "V as mV": {"v": "mV"},
}


def main(count: int) -> None:
    """Print a line for each trouble: how often it is named, and how often another is."""
    known = motors()
    print("| trouble | recordings | named, unit said | another named | named, unit not said | another named |")
    print("|---|---|---|---|---|---|")
    for title, (kind, spoil) in TROUBLES.items():
        rng = np.random.default_rng(1)
        tally: Counter[str] = Counter()
        for _ in range(count if title == "nothing" else count // 4):
            good, is_dry = recording(rng, known)
            spoiled = spoil(good)
            if spoiled is None:
                continue
            tally["all"] += 1
            time = spoiled.pop("time")
            for case, guessed in (("said", frozenset[str]()), ("not said", NOBODY)):
                units = {} if guessed else UNITS.get(title, {})
                measured = MeasuredSignals("recording", time, spoiled, guessed=guessed, units=units)
                kinds = {f.kind for f in implausible(measured)}
                kinds -= {"dead band"} if is_dry else set()  # which it has
                named = {k for k in kinds if kind and k.startswith(kind)}
                tally[case] += bool(named)
                tally[f"{case}, other"] += bool(kinds - named)
        cells = (
            f"{100 * tally[c] / tally['all']:.3g} %" for c in ("said", "said, other", "not said", "not said, other")
        )
        print(f"| {title} | {tally['all']} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2000)
