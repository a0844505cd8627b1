"""Motors and their exact step responses, from the closed form: the truth that the tests compare with.

The response of the 2×2 system to a held voltage is formed with mpmath at 40 digits from the eigenvalues, so it shares
no code and no algorithm with the FMU.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mpmath
import numpy as np
from numpy.typing import NDArray

from estimator.recordings.headers import assumed_unit
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording
from estimator.recordings.units import parse_unit

FloatArray = NDArray[np.float64]
NAMES = ("R", "K", "L", "J", "B")
DIGITS = 40


@dataclass(frozen=True)
class Motor:
    """A motor and its test voltage, SI units."""

    name: str
    voltage: float
    R: float
    K: float
    L: float
    J: float
    B: float

    @property
    def parameters(self) -> dict[str, float]:
        return {name: getattr(self, name) for name in NAMES}


RMCS2004 = Motor("RMCS2004", 10.5, 0.921042, 0.073472, 0.007759, 0.000136, 0.000678)
CML050 = Motor("CML-050", 10.5, 3.1363, 0.048774, 0.01307, 9.0e-6, 1.690e-4)


def all_motors() -> list[Motor]:
    """Return the motors of motors.csv; 12 V where none is given, B = 0.02 K²/R where it is missing."""
    lines = [line for line in (Path(__file__).parent / "motors.csv").read_text().splitlines() if line[0] != "#"]
    motors = []
    for row in csv.DictReader(lines):
        R, K = float(row["R"]), float(row["K"])
        motors.append(
            Motor(
                name=row["motor"],
                voltage=float(row["voltage"] or 12),
                R=R,
                K=K,
                L=float(row["L"]),
                J=float(row["J"]),
                B=float(row["B"] or 0.02 * K * K / R),
            )
        )
    return motors


def held_response(motor: Motor, voltages: FloatArray, *, step: float) -> FloatArray:
    """Return current and speed, (n, 2), from rest; voltages[k] holds from sample k to k + 1."""
    return _held_response(motor, tuple(voltages.tolist()), step).copy()


@lru_cache(maxsize=256)
def _held_response(motor: Motor, voltages: tuple[float, ...], step: float) -> FloatArray:
    with mpmath.workdps(DIGITS):
        transition, gain = _discrete(motor, step)
        x = [mpmath.mpf(0), mpmath.mpf(0)]
        rows = np.zeros((len(voltages), 2))
        for k, v in enumerate(voltages):
            rows[k] = float(x[0]), float(x[1])
            if v == 0 and x[0] == 0 and x[1] == 0:
                continue
            u = mpmath.mpf(float(v))
            x = [transition[r, 0] * x[0] + transition[r, 1] * x[1] + gain[r] * u for r in range(2)]
    return rows


def _discrete(motor: Motor, step: float) -> tuple[mpmath.matrix, mpmath.matrix]:
    R, K, L, J, B = (mpmath.mpf(motor.parameters[name]) for name in NAMES)
    h = mpmath.mpf(step)
    A = mpmath.matrix([[-R / L, -K / L], [K / J, -B / J]])
    half_trace, det = (A[0, 0] + A[1, 1]) / 2, A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    root = mpmath.sqrt(mpmath.mpc(half_trace**2 - det))
    first, second = half_trace + root, half_trace - root
    e1, e2 = mpmath.exp(first * h), mpmath.exp(second * h)
    slope = mpmath.re((e1 - e2) / (first - second))
    offset = mpmath.re((first * e2 - second * e1) / (first - second))
    transition = A * slope + mpmath.eye(2) * offset
    gain = mpmath.lu_solve(A, (transition - mpmath.eye(2)) * mpmath.matrix([1 / L, 0]))
    return transition, gain


def step_recording(
    motor: Motor,
    *,
    noise: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
    lead: float = 0.5,
    duration: float = 2.8,
    interval: float = 1e-3,
    levels: tuple[float, float] | None = None,
    start: float = 0.0,
) -> Recording:
    """Return the paper's bench as a recording: a step after `lead` seconds, sampled every `interval` seconds.

    `noise` is the standard deviation of white noise on current [A] and speed [rad/s].
    """
    n = round(duration / interval) + 1
    k = np.arange(n)
    before, after = (0.0, motor.voltage) if levels is None else levels
    voltage = np.where(k >= round(lead / interval), after, before)
    if before != 0:  # the motor has been running for long
        settle = np.full(n, before)
        shown = held_response(motor, np.concatenate([settle, voltage]), step=interval)[n:]
    else:
        shown = held_response(motor, voltage, step=interval)
    return recording_of(motor.name, start + k * interval, voltage, shown, noise=noise, seed=seed)


def recording_of(
    name: str,
    time: FloatArray,
    voltage: FloatArray,
    shown: FloatArray,
    *,
    noise: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
) -> Recording:
    """Return a recording of voltage, current and speed, with white noise added."""
    noisy = shown + np.random.default_rng(seed).standard_normal(shown.shape) * np.array(noise)
    return recording_from_arrays(
        name, time, {"voltage [V]": voltage, "current [A]": noisy[:, 0], "speed [rad/s]": noisy[:, 1]}
    )


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording as CSV in SI units, exact to the bit."""

    def quoted(cell: str) -> str:
        return '"' + cell.replace('"', '""') + '"' if set(cell) & set('",;\t') else cell

    def header(column: str) -> str:
        unit = recording.units[column]
        if unit == "?":
            return recording.headers[column]
        bare = not unit or (column in recording.assumed_units and assumed_unit(column) == parse_unit(unit))
        return column if bare else f"{column} [{unit}]"

    columns = list(recording.signals)
    lines = [",".join(["time [s]", *(quoted(header(column)) for column in columns)])]
    samples = [recording.time.tolist(), *(recording.signals[column].tolist() for column in columns)]
    for row in zip(*samples, strict=True):
        lines.append(",".join("" if value != value else repr(value) for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
