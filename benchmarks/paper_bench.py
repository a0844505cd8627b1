"""The paper's bench, emulated: a motor, a step, a Hall sensor with ADC, an encoder, and what goes wrong on real ones.

Truth is the closed form (or solve_ivp at tight tolerance where friction is not linear), sampled by emulated sensors.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording
from estimator.recordings.sensors import chebyshev1_sections

FloatArray = NDArray[np.float64]
NAMES = ("R", "K", "L", "J", "B")
CML050 = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}
RMCS2004 = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}
MOTORS = {"CML-050": CML050, "RMCS2004": RMCS2004}


@dataclass(frozen=True)
class Bench:
    """An emulated bench; the defaults are ideal but for white noise.

    Attributes
    ----------
    current_noise, speed_noise : A, rad/s
    adc : A, one step of the current's converter; 0: none
    lines : encoder lines (four counts each), differenced to a speed; 0: the speed itself with `speed_noise`
    counts : record the encoder's angle, not the speed
    beside : record the encoder's angle (of 1 000 lines) beside the speed, which has `speed_gain`
    chebyshev : (order, ripple dB, cutoff Hz) on the recorded speed
    average : samples that the current is averaged over
    current_ripple, speed_ripple : amplitudes, A, rad/s, with their orders of the angle
    drift : relative change of B over the record, centred on it
    coulomb : N·m
    delay, speed_delay : s, of both signals behind the voltage; of the speed behind the current, too
    sag : part of the voltage that is missing at first; sag_time : s in which it comes back
    clock_loss : (sample after the step, lost samples)
    """

    voltage: float = 10.5
    lead: float = 0.5
    duration: float = 2.8
    step: float = 1e-3
    current_noise: float = 0.02
    speed_noise: float = 1.0
    adc: float = 0.0
    lines: int = 0
    counts: bool = False
    beside: bool = False
    chebyshev: tuple[int, float, float] | None = None
    average: int = 1
    current_ripple: float = 0.0
    current_order: int = 14
    speed_ripple: float = 0.0
    speed_order: int = 1
    drift: float = 0.0
    coulomb: float = 0.0
    delay: float = 0.0
    speed_delay: float = 0.0
    current_offset: float = 0.0
    speed_offset: float = 0.0
    current_gain: float = 1.0
    speed_gain: float = 1.0
    outliers: float = 0.0
    missing: float = 0.0
    jitter: float = 0.0
    sag: float = 0.0
    sag_time: float = 0.03
    clock_loss: tuple[int, int] | None = None
    motor: dict[str, float] = field(default_factory=lambda: dict(CML050))

    def record(self, seed: int, *, name: str = "bench") -> Recording:
        """Return one recording."""
        rng = np.random.default_rng(seed)
        n = round(self.duration / self.step) + 1
        k = np.arange(n)
        time = k * self.step
        taken = time + self.jitter * rng.standard_normal(n)
        if self.clock_loss is not None:
            at, lost = self.clock_loss
            taken = np.where(k >= round(self.lead / self.step) + at, taken + lost * self.step, taken)
        on = round(self.lead / self.step) * self.step + self.delay
        i, w, angle = self.response(taken - on)
        if self.speed_delay:
            _, w, angle = self.response(taken - on - self.speed_delay)
        i = i + self.current_ripple * np.cos(self.current_order * angle + rng.uniform(0, 2 * np.pi)) * (taken > on)
        phase = rng.uniform(0, 2 * np.pi)
        if self.speed_ripple:
            turned = self.speed_order * angle + phase
            w = w + self.speed_ripple * np.cos(turned) * (taken > on)
            per_speed = self.speed_ripple / max(float(np.max(np.abs(w))), 1e-9)
            angle = angle + per_speed * (np.sin(turned) - np.sin(phase)) / self.speed_order
        i = self.current_gain * i + self.current_offset + self.current_noise * rng.standard_normal(n)
        if self.average > 1:
            padded = np.concatenate([np.full(self.average - 1, i[0]), i])
            i = np.convolve(padded, np.ones(self.average) / self.average, mode="valid")
        if self.adc:
            i = np.round(i / self.adc) * self.adc
        if self.lines:
            count = np.floor(4 * self.lines * angle / (2 * np.pi) + rng.random())
            angle = count * 2 * np.pi / (4 * self.lines)
            w = np.concatenate([[0.0], np.diff(angle)]) / self.step
        else:
            w = w + self.speed_noise * rng.standard_normal(n)
        w = self.speed_gain * w + self.speed_offset
        if self.chebyshev is not None:
            w = filtered(w, self.chebyshev, self.step)
        signals = [i, angle if self.counts else w]
        for signal, size in zip(signals, (self.current_noise, self.speed_noise), strict=True):
            if self.outliers:
                hit = rng.random(n) < self.outliers
                signal[hit] += rng.choice([-1, 1], hit.sum()) * rng.uniform(10, 50, hit.sum()) * max(size, 1e-6)
            if self.missing:
                signal[rng.random(n) < self.missing] = np.nan
        voltage = np.where(k >= round(self.lead / self.step), self.voltage, 0.0)
        second = "angle [rad]" if self.counts else "speed [rad/s]"
        columns = {"voltage [V]": voltage, "current [A]": signals[0], second: signals[1]}
        if self.beside:
            count = 2 * np.pi / 4000
            columns["angle [rad]"] = count * np.floor(angle / count + rng.random())
        return recording_from_arrays(name, time, columns)

    def response(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return current, speed and angle at t s after the voltage has come on, (n,) each; zero before."""
        if self.drift or self.coulomb:
            return self._integrated(t)
        R, K, L, J, B = (self.motor[name] for name in NAMES)
        modes = np.array([[-R / L, -K / L, 1 / L], [K / J, -B / J, 0.0], [0.0, 0.0, -1 / self.sag_time]])
        after = np.maximum(t, 0.0)
        total = _step(modes[:2, :2], np.array([self.voltage / L, 0.0]), after)
        if self.sag:
            total = total - self.sag * self.voltage * _decaying(modes, after)
        return total[0], total[1], total[2]

    def _integrated(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        from scipy.integrate import solve_ivp

        R, K, L, J, B = (self.motor[name] for name in NAMES)
        length = self.duration - self.lead - self.delay

        def slope(now: float, x: FloatArray) -> list[float]:
            friction = B * (1 + self.drift * (0.5 - now / length))
            torque = K * x[0] - friction * x[1]
            torque = torque - self.coulomb if x[1] > 0 or torque > self.coulomb else 0.0
            return [(self.voltage - R * x[0] - K * x[1]) / L, torque / J, x[1]]

        after = np.maximum(t, 0.0)
        end = float(np.max(after))
        times, place = np.unique(after, return_inverse=True)
        found = solve_ivp(slope, (0, end), [0.0, 0.0, 0.0], rtol=1e-8, atol=1e-10, t_eval=times, method="LSODA")
        rows = found.y[:, place]
        return rows[0], rows[1], rows[2]


def filtered(x: FloatArray, chebyshev: tuple[int, float, float], step: float) -> FloatArray:
    """Return a signal behind a causal Chebyshev I filter."""
    from scipy.signal import sosfilt

    order, ripple, cutoff = chebyshev
    sections = chebyshev1_sections(order=order, ripple=ripple, cutoff=cutoff, step=step)
    return np.asarray(sosfilt([[b0, b1, b2, 1.0, a1, a2] for b0, b1, b2, a1, a2 in sections], x))


def _step(A: FloatArray, g: FloatArray, t: FloatArray) -> FloatArray:
    """Return x and the integral of x₂ for dx/dt = A x + g from rest, (3, n)."""
    values, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, g.astype(complex))
    grown = np.expm1(np.outer(values, t)) / values[:, None]
    x = np.real(vectors @ (weights[:, None] * grown))
    turned = np.real(vectors[1] * weights @ ((grown - t) / values[:, None]))
    return np.vstack([x, turned])


def _decaying(modes: FloatArray, t: FloatArray) -> FloatArray:
    """Return the response to a unit voltage that decays, as states of the extended system, (3, n)."""
    values, vectors = np.linalg.eig(modes)
    weights = np.linalg.solve(vectors, np.array([0, 0, 1.0], dtype=complex))
    waves = np.exp(np.outer(values, t)) * (t > 0)
    x = np.real(vectors @ (weights[:, None] * waves))
    turned = np.real(vectors[1] * weights @ (np.expm1(np.outer(values, t)) / values[:, None]))
    return np.vstack([x[:2], turned])


PAPER_BENCH = Bench(adc=10 / 4096, lines=1000)


def real_bench(seed: int, motor: dict[str, float]) -> Bench:
    """Return a bench with all that real ones have: averages, ripple, friction that drifts, a delay."""
    rng = np.random.default_rng([seed, 7])
    B, K, R = motor["B"], motor["K"], motor["R"]
    steady = 10.5 * B / (R * B + K * K)
    return replace(
        PAPER_BENCH,
        motor=motor,
        average=int(rng.integers(1, 6)),
        current_ripple=0.15 * steady,
        current_order=int(rng.choice([6, 10, 14, 22, 26])),
        speed_ripple=3.0,
        speed_order=int(rng.choice([1, 2, 4])),
        drift=0.05,
        delay=float(rng.uniform(0.005, 0.25)),
    )


RANGES = {"R": (0.1, 20.0), "K": (0.005, 0.5), "L": (5e-5, 20e-3), "J": (1e-7, 1e-2), "B": (1e-7, 1e-3)}


def random_motor(seed: int) -> dict[str, float]:
    """Return a motor drawn log-uniformly; of these a quarter do not settle in 2.3 s, a tenth are aliased at 1 kHz."""
    rng = np.random.default_rng([seed, 11])
    return {name: float(np.exp(rng.uniform(*np.log(ends)))) for name, ends in RANGES.items()}
