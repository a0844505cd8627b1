"""What a sensor shows of a model output, and the filters in between. Knows no FMU and no recording.

    output ──(mean over the interval)──▶ mean of the last n samples ──▶ filter ──▶ gain · x + offset ──▶ shown

``sensors.h`` does the same on the fast path; this is its reference, sample by sample in plain Python. Before the first
sample everything is as in the first sample, and a filter's state is zero. Delays are the stepping loop's: inputs act
late and outputs are read early enough, exactly, also by a part of a sample.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

Section = tuple[float, float, float, float, float]  # b0 b1 b2 a1 a2, of second order


def chebyshev1_sections(*, order: int, ripple: float, cutoff: float, step: float) -> tuple[Section, ...]:
    """Return the second-order sections of a digital Chebyshev type I low-pass filter (bilinear, prewarped).

    Parameters
    ----------
    ripple : float
        dB, in the pass band. An even order has a gain of −ripple at rest, an odd one of 1.
    cutoff, step : float
        Hz; s.

    Raises
    ------
    ValueError
        The cutoff is not below half the sampling rate.
    """
    if not 0 < cutoff * step < 0.5:
        raise ValueError(f"the filter's cutoff {cutoff:g} Hz is not below half the sampling rate, {0.5 / step:g} Hz")
    epsilon = math.sqrt(10 ** (ripple / 10) - 1)
    width = math.asinh(1 / epsilon) / order
    warped = math.tan(math.pi * cutoff * step)  # with the bilinear transform s = (z − 1) / (z + 1)
    sections: list[Section] = []
    for m in range((order + 1) // 2):
        angle = math.pi * (2 * m + 1) / (2 * order)
        pole = warped * complex(-math.sinh(width) * math.sin(angle), math.cosh(width) * math.cos(angle))
        if order % 2 and m == order // 2:  # the real pole
            a = (1 + pole.real) / (1 - pole.real)
            gain = (1 - a) / 2
            sections.append((gain, gain, 0.0, -a, 0.0))
        else:
            z = (1 + pole) / (1 - pole)
            a1, a2 = -2 * z.real, abs(z) ** 2
            gain = (1 + a1 + a2) / 4
            sections.append((gain, 2 * gain, gain, a1, a2))
    if order % 2 == 0:
        scale = 10 ** (-ripple / 20)
        b0, b1, b2, a1, a2 = sections[0]
        sections[0] = (scale * b0, scale * b1, scale * b2, a1, a2)
    return tuple(sections)


def transfer_sections(b: Sequence[float], a: Sequence[float]) -> tuple[Section, ...]:
    """Return the sections of a filter given by its coefficients b(z⁻¹) / a(z⁻¹).

    Raises
    ------
    ValueError
        No filter has these coefficients, or it is not stable.
    """
    import numpy as np

    if not len(a) or a[0] == 0 or not len(b) or not any(b):
        raise ValueError("a filter needs coefficients b and a, with a[0] not zero")
    poles, zeros = np.roots(a), np.roots(b)
    if np.any(np.abs(poles) >= 1):
        raise ValueError("the filter's coefficients a make it unstable")
    lead = next(k for k, x in enumerate(b) if x != 0)
    pole_pairs, zero_pairs = _pairs(poles.tolist()), _pairs(zeros.tolist())
    delayed = lead
    count = max(len(pole_pairs), len(zero_pairs) + (lead + 1) // 2, 1)
    pole_pairs += [(0.0, 0.0)] * (count - len(pole_pairs))
    numerators: list[tuple[float, float, float]] = [(1.0, *pair) for pair in zero_pairs]
    while delayed > 0:
        numerators.append((0.0, 1.0, 0.0) if delayed == 1 else (0.0, 0.0, 1.0))
        delayed -= 2
    numerators += [(1.0, 0.0, 0.0)] * (count - len(numerators))
    gain = b[lead] / a[0]
    sections = []
    for (n0, n1, n2), (a1, a2) in zip(numerators, pole_pairs, strict=True):
        sections.append((gain * n0, gain * n1, gain * n2, a1, a2))
        gain = 1.0
    return tuple(sections)


def _pairs(roots: Sequence[complex]) -> list[tuple[float, float]]:
    """Return quadratic factors 1 + c₁ z⁻¹ + c₂ z⁻² of the roots of a real polynomial."""
    upper = [complex(r) for r in roots if complex(r).imag > 0]
    real = sorted(complex(r).real for r in roots if complex(r).imag == 0)
    pairs = [(-2 * r.real, abs(r) ** 2) for r in upper]
    while real:
        first = real.pop()
        second = real.pop() if real else 0.0
        pairs.append((-(first + second), first * second))
    return pairs


def response(sections: Sequence[Section], *, frequency: float, step: float) -> complex:
    """Return a filter's complex gain at a frequency in Hz."""
    z = cmath.exp(-2j * math.pi * frequency * step)
    gain = 1.0 + 0j
    for b0, b1, b2, a1, a2 in sections:
        gain *= (b0 + b1 * z + b2 * z * z) / (1 + a1 * z + a2 * z * z)
    return gain


class Sensor:
    """One output's sensor: feed it samples in their order.

    Parameters
    ----------
    mean : bool
        The output is an integral (an angle); its mean derivative over the last interval is shown.
    interval : float
        s, sampling interval.
    average : int
        Samples of the running mean; 1: none.
    """

    def __init__(
        self,
        *,
        mean: bool = False,
        interval: float = 1.0,
        average: int = 1,
        sections: Sequence[Section] = (),
        gain: float = 1.0,
        offset: float = 0.0,
    ) -> None:
        self._mean, self._interval, self._average = mean, interval, average
        self._sections, self._gain, self._offset = sections, gain, offset
        self._state = [[0.0, 0.0] for _ in sections]
        self._before: float | None = None
        self._last: list[float] = []

    def show(self, read: float, interval: float | None = None) -> float:
        """Return what the sensor shows of the next sample of the output, an interval after the one before."""
        x = read
        if self._mean:
            x = 0.0 if self._before is None else (read - self._before) / (interval or self._interval)
            self._before = read
        self._last = [x] * self._average if not self._last else [*self._last[1:], x]
        x = sum(self._last) / self._average if self._average > 1 else x
        for (b0, b1, b2, a1, a2), state in zip(self._sections, self._state, strict=True):
            y = b0 * x + state[0]
            state[0] = b1 * x - a1 * y + state[1]
            state[1] = b2 * x - a2 * y
            x = y
        return self._gain * x + self._offset
