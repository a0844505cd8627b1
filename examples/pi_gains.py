"""From a recording to the PI gains of current and speed loop, with their worst margins over what is not known exactly.

    python examples/pi_gains.py examples/cml050_step.csv

Current loop: K_p = ω_c L, K_i = ω_c R cancels the winding's pole and crosses 0 dB at ω_c. Speed loop: with the current
loop as a lag 1/ω_c, K_p = ω_s J/K puts the crossing at ω_s and K_i = K_p ω_s/5 the zero well below (symmetrical-optimum
style). Both see the converter's and the sampling's dead time. The margins are those of the whole motor, back-EMF and
friction included, at the estimate and at the worst of many motors on the ellipsoid that holds the true one with 95 %.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import estimator

FloatArray = NDArray[np.float64]
MOTOR = ("R", "K", "L", "J", "B")
CURRENT_BANDWIDTH, SPEED_BANDWIDTH = 2 * np.pi * 200, 2 * np.pi * 20  # rad/s, ω_c and ω_s
DEAD_TIME = 1.5e-4  # s: 1.5 samples at 10 kHz
CHI_SQUARE = 11.07  # 95 % of a χ² with five degrees of freedom
MOTORS = 2000


@dataclass(frozen=True)
class Gains:
    """PI gains of the current loop, V/A and V/(A.s), and of the speed loop, A.s/rad and A/rad."""

    current_p: float
    current_i: float
    speed_p: float
    speed_i: float


def gains(motor: FloatArray) -> Gains:
    """Return the gains for a motor, (5,) R, K, L, J, B."""
    R, K, L, J, _ = motor
    speed_p = SPEED_BANDWIDTH * J / K
    return Gains(CURRENT_BANDWIDTH * L, CURRENT_BANDWIDTH * R, speed_p, speed_p * SPEED_BANDWIDTH / 5)


def loops(motor: FloatArray, g: Gains, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the open current and speed loop, (n,) complex, at the frequencies w, (n,) rad/s."""
    R, K, L, J, B = motor
    s = 1j * w
    late = np.exp(-s * DEAD_TIME)
    winding = (J * s + B) / (L * J * s**2 + (R * J + L * B) * s + R * B + K * K)  # i/v
    current = (g.current_p + g.current_i / s) * late * winding
    closed = current / (1 + current)
    return current, (g.speed_p + g.speed_i / s) * closed * K / (J * s + B)


def margins(open_loop: FloatArray, w: FloatArray) -> tuple[float, float]:
    """Return phase margin, degrees, at the last crossing of 0 dB, and gain margin, dB; infinity where there is none."""
    size, phase = np.abs(open_loop), np.unwrap(np.angle(open_loop))
    phase -= 2 * np.pi * np.round(phase[0] / (2 * np.pi))
    down = np.flatnonzero((size[:-1] >= 1) & (size[1:] < 1))
    turned = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))
    phase_margin = float(180 + np.degrees(phase[down[-1]])) if len(down) else np.inf
    gain_margin = float(-20 * np.log10(size[turned[0]])) if len(turned) else np.inf
    return phase_margin, gain_margin


def possible_motors(result: estimator.Result, rng: np.random.Generator) -> FloatArray:
    """Return motors, (n, 5), on the ellipsoid that holds the true one with 95 %; R to J stay positive, B too."""
    values = np.array([result.values[name] for name in MOTOR])
    errors = np.array([result.standard_errors[name] or 0.0 for name in MOTOR])
    correlation = np.eye(5)
    if result.correlation is not None:
        order = [result.correlated.index(name) if name in result.correlated else None for name in MOTOR]
        for a, row in enumerate(order):
            for b, column in enumerate(order):
                if row is not None and column is not None:
                    correlation[a, b] = result.correlation[row, column]
    power, axes = np.linalg.eigh(correlation)
    directions = rng.standard_normal((MOTORS, 5))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    relative = (directions * np.sqrt(CHI_SQUARE * np.maximum(power, 0))) @ axes.T * (errors / values)
    return values * np.exp(relative)


def main(recording: str) -> None:
    """Print gains and margins."""
    result = estimator.estimate_parameters(recording)
    if result.verdict == "refused":
        sys.exit(repr(result))
    motor = np.array([result.values[name] for name in MOTOR])
    g = gains(motor)
    w = np.geomspace(1.0, 3e5, 6000)
    worst = [[margins(loop, w) for loop in loops(m, g, w)] for m in possible_motors(result, np.random.default_rng(1))]
    print(f"verdict {result.verdict}; " + ", ".join(f"{n} {v:.5g}" for n, v in zip(MOTOR, motor, strict=True)))
    print(f"current loop  Kp {g.current_p:.4g} V/A      Ki {g.current_i:.4g} V/(A.s)")
    print(f"speed loop    Kp {g.speed_p:.4g} A.s/rad  Ki {g.speed_i:.4g} A/rad")
    print("              phase margin, worst    gain margin, worst")
    for k, (name, loop) in enumerate(zip(("current", "speed"), loops(motor, g, w), strict=True)):
        phase, gain = margins(loop, w)
        low_phase, low_gain = min(m[k][0] for m in worst), min(m[k][1] for m in worst)
        print(f"{name + ' loop':12s}  {phase:8.1f}, {low_phase:5.1f} deg     {gain:8.1f}, {low_gain:5.1f} dB")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "examples/cml050_step.csv")
