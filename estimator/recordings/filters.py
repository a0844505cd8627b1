"""Digital filters of measurement chains: the usual low-pass families, or coefficients → second-order sections.

Knows neither FMU nor recording. A family is designed for the recording's own sampling rate by the bilinear transform
with its cutoff prewarped, as scipy.signal and MATLAB do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from estimator.recordings.sensors import Section, chebyshev1_sections, transfer_sections

# Of each family: what it needs beside order and cutoff.
FAMILIES = {
    "butterworth": (),
    "bessel": (),
    "chebyshev1": ("ripple",),
    "chebyshev2": ("attenuation",),
    "elliptic": ("ripple", "attenuation"),
}
MAX_ORDER = 20
MAX_SECTIONS = 16  # of second order, of all filters of an output: as in sensors.h; more in a row lose their digits
MAX_COEFFICIENTS = 2 * MAX_SECTIONS + 1  # of b, and of a


@dataclass(frozen=True)
class Chebyshev1:
    """A causal Chebyshev type I low-pass filter, as on the measured signal."""

    order: int
    ripple: float  # dB
    cutoff: float  # Hz, end of the pass band

    family = "chebyshev1"

    @property
    def limit(self) -> float:
        """Hz, that has to lie below half the sampling rate."""
        return self.cutoff


@dataclass(frozen=True)
class LowPass:
    """A causal low-pass filter of another family: "butterworth", "bessel", "chebyshev2" or "elliptic"."""

    family: str
    order: int
    cutoff: float  # Hz: −3 dB (butterworth), end of pass (elliptic) or begin of stop band (chebyshev2), bessel: phase
    ripple: float | None = None  # dB, in the pass band
    attenuation: float | None = None  # dB, in the stop band

    @property
    def limit(self) -> float:
        """Hz, that has to lie below half the sampling rate."""
        return self.cutoff


@dataclass(frozen=True)
class Coefficients:
    """A causal filter b(z⁻¹) / a(z⁻¹) at the recording's sampling rate."""

    b: tuple[float, ...]
    a: tuple[float, ...]

    family = "coefficients"
    limit = 0.0


Filter = Chebyshev1 | LowPass | Coefficients


def filter_sections(spec: Filter, *, step: float) -> tuple[Section, ...]:
    """Return a filter's sections at a sampling interval in s.

    Raises
    ------
    ValueError
        The cutoff is not below half the sampling rate, or the coefficients are no stable filter.
    """
    if isinstance(spec, Coefficients):
        return transfer_sections(spec.b, spec.a)
    if isinstance(spec, Chebyshev1):
        return chebyshev1_sections(order=spec.order, ripple=spec.ripple, cutoff=spec.cutoff, step=step)
    from scipy import signal

    if not 0 < spec.cutoff * step < 0.5:
        half = 0.5 / step
        raise ValueError(f"the filter's cutoff {spec.cutoff:g} Hz is not below half the sampling rate, {half:g} Hz")
    names: dict[str, Any] = {"butterworth": "butter", "bessel": "bessel", "chebyshev2": "cheby2", "elliptic": "ellip"}
    sections = signal.iirfilter(
        spec.order,
        2 * spec.cutoff * step,
        rp=spec.ripple,
        rs=spec.attenuation,
        btype="lowpass",
        ftype=names[spec.family],
        output="sos",
    )
    return tuple((float(b0), float(b1), float(b2), float(a1), float(a2)) for b0, b1, b2, _, a1, a2 in sections)
