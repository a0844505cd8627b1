"""What the residuals of a fit show: colour, outliers, ripple locked to the angle. Knows residuals only, no FMU.

Least squares with white weights stays consistent when the noise is coloured, but its standard errors do not. Here the
residuals of every output are taken for a stationary autoregressive process (order by BIC, Levinson recursion on their
autocovariances), and the covariance of the estimate is the sandwich

    (JᵀJ)⁻¹ Jᵀ Γ J (JᵀJ)⁻¹          Jᵀ Γ J = ∫ Φ(ω) Ĵ(ω)* Ĵ(ω) dω

with Γ the noise's autocovariance and Φ its spectrum. White residuals (order 0) give the usual (JᵀJ)⁻¹. Ripple at whole
orders of the shaft's angle is found in the residuals' spectrum over the angle and taken out by regression: residuals
and Jacobian are projected on what is left, so it neither biases the estimate nor counts as noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MAX_ORDER = 24  # of the autoregression
SIGNIFICANT = 5.0  # deviations of a chi-square of many degrees; with the term of few, 1 in 10 000
MIN_SAMPLES = 100  # fewer tell nothing of a colour
OUTLIER = 5.5  # robust deviations
NEIGHBOURS = 3.5  # robust deviations: an outlier's neighbours are below
MAX_OUTLIERS = 0.05  # of the samples; more is a bad model, not outliers
RIPPLE_ORDERS = 64  # whole orders of the angle that are looked at
RIPPLES = 8  # orders taken out at most, an output
RIPPLE_POWER = 40.0  # over the noise floor; exceeded by chance once in exp(20) orders
RIPPLE_LEAST = 0.1  # of the residuals' deviation: smaller ripples matter to nobody
NEAR = 40  # bins on either side of an order's frequency that tell its noise
MIN_TURNS = 5.0  # fewer turns of the shaft tell no orders apart


@dataclass(frozen=True)
class Colour:
    """Spectrum of one output's residuals.

    Attributes
    ----------
    coefficients : (order,) array
        a of x_k = Σ a_l x_{k−l} + e_k; empty: white.
    innovation : float
        Variance of e.
    variance : float
        Variance of x.
    samples : int
        From which it was found.
    neighbours : float
        Correlation of neighbours.
    """

    coefficients: FloatArray
    innovation: float
    variance: float
    samples: int = 0
    neighbours: float = 0.0

    @property
    def is_white(self) -> bool:
        """Whether no colour was found."""
        return len(self.coefficients) == 0

    @property
    def is_significant(self) -> bool:
        """Whether white noise shows such a colour by chance less than once in 10 000."""
        order = len(self.coefficients)
        if order == 0 or self.innovation <= 0:
            return order > 0
        gain = self.samples * np.log(self.variance / self.innovation)  # chi-square of `order` degrees if it is white
        return bool(gain > order + SIGNIFICANT * np.sqrt(2 * order) + 2 * SIGNIFICANT)

    def spectrum(self, size: int) -> FloatArray:
        """Return the power at the frequencies of an rfft of `size`; the mean over all frequencies is the variance."""
        if self.is_white:
            return np.full(size // 2 + 1, self.variance)
        transfer = np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), size)
        return np.asarray(self.innovation / np.abs(transfer) ** 2)


@dataclass(frozen=True)
class Differenced:
    """Noise of encoder counts, white, after differencing and filtering: nothing at rest, most at high frequencies."""

    variance: float
    sections: tuple[tuple[float, float, float, float, float], ...] = ()

    @property
    def is_white(self) -> bool:
        """Never."""
        return False

    def spectrum(self, size: int) -> FloatArray:
        """Return the power at the frequencies of an rfft of `size`; the mean over all frequencies is the variance."""
        z = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
        gain = 1 - z
        for b0, b1, b2, a1, a2 in self.sections:
            gain = gain * (b0 + b1 * z + b2 * z * z) / (1 + a1 * z + a2 * z * z)
        power = np.abs(gain) ** 2
        mean = (2 * np.sum(power) - power[0] - power[-1]) / size
        return np.asarray(self.variance * power / mean)


Spectrum = Colour | Differenced


def find_colour(series: list[FloatArray]) -> Colour:
    """Return the colour of one output's residuals, NaN where a sample is missing, one series a recording."""
    known = [~np.isnan(x) for x in series]
    total = sum(int(k.sum()) for k in known)
    variance = sum(float(np.nansum(x * x)) for x in series) / max(total, 1)
    if total < MIN_SAMPLES or variance == 0:
        return Colour(np.empty(0), variance, variance)
    products, counts = np.zeros(MAX_ORDER + 1), np.zeros(MAX_ORDER + 1)
    for x, k in zip(series, known, strict=True):
        size = 1 << (len(x) + MAX_ORDER).bit_length()
        products += np.fft.irfft(np.abs(np.fft.rfft(np.where(k, x, 0.0), size)) ** 2, size)[: MAX_ORDER + 1]
        counts += np.fft.irfft(np.abs(np.fft.rfft(k.astype(float), size)) ** 2, size)[: MAX_ORDER + 1]
    covariances = products / np.maximum(counts, 1.0) * (1 - np.arange(MAX_ORDER + 1) / total)
    best, best_score = Colour(np.empty(0), variance, variance), 0.0
    a, error = np.zeros(0), float(covariances[0])
    neighbours = float(covariances[1] / covariances[0])
    for order in range(1, MAX_ORDER + 1):  # Levinson
        reflection = float((covariances[order] - a @ covariances[order - 1 : 0 : -1]) / error)
        if not abs(reflection) < 1:
            break
        a = np.concatenate([a - reflection * a[::-1], [reflection]])
        error *= 1 - reflection**2
        score = total * np.log(error / covariances[0]) + order * np.log(total)
        if score < best_score:
            best, best_score = Colour(a.copy(), error, variance, total, neighbours), float(score)
    return best


def quadratic(columns: list[FloatArray], colour: Spectrum) -> FloatArray:
    """Return Jᵀ Γ J, (p, p), of one output's columns, (n, p) a recording, zero where a sample is missing."""
    p = columns[0].shape[1]
    total = np.zeros((p, p))
    for block in columns:
        if colour.is_white:
            total += colour.variance * (block.T @ block)
            continue
        size = 1 << (2 * len(block) - 1).bit_length()
        transformed = np.fft.rfft(block, size, axis=0)
        weight = np.full(size // 2 + 1, 2.0)
        weight[0] = weight[-1] = 1.0
        total += np.real(np.conj(transformed).T @ (transformed * (weight * colour.spectrum(size))[:, None])) / size
    return total


def find_outliers(residuals: FloatArray) -> BoolArray:
    """Return which residuals, (n,) with NaN where missing, stand alone and far out; none if there are too many."""
    finite = residuals[~np.isnan(residuals)]
    found = np.zeros(len(residuals), dtype=bool)
    if len(finite) < MIN_SAMPLES:
        return found
    centre = float(np.median(finite))
    deviation = float(np.median(np.abs(finite - centre))) / 0.6745
    if deviation == 0:
        return found
    size = np.nan_to_num(np.abs(residuals - centre) / deviation)
    far = size > OUTLIER
    before, after = np.concatenate([[0.0], size[:-1]]), np.concatenate([size[1:], [0.0]])
    quiet = np.minimum(before, after) < NEIGHBOURS  # two in a row may happen; three in a row are no outliers
    found = far & quiet
    return found if found.sum() <= MAX_OUTLIERS * len(finite) else np.zeros(len(residuals), dtype=bool)


def averaged(columns: FloatArray, samples: int) -> FloatArray:
    """Return the running mean of (n, c) columns over the last samples, the first repeated before the start."""
    if samples == 1:
        return columns
    padded = np.concatenate([np.repeat(columns[:1], samples - 1, axis=0), columns])
    sums = np.cumsum(np.concatenate([np.zeros((1, columns.shape[1])), padded]), axis=0)
    return np.asarray((sums[samples:] - sums[:-samples]) / samples)


def _floor(x: FloatArray, rate: float) -> FloatArray:
    """Return the noise power around each order's frequency, (orders,), from the median of its neighbourhood.

    `rate` is the shaft's mean turn a sample, in rad; orders beyond half the sampling rate are folded back.
    """
    power = np.abs(np.fft.rfft(x)) ** 2
    turns = np.arange(1, RIPPLE_ORDERS + 1) * rate / (2 * np.pi) % 1.0
    centre = np.round(np.minimum(turns, 1 - turns) * len(x)).astype(int)
    floor = [np.median(power[max(1, c - NEAR) : c + NEAR + 1]) / np.log(2) for c in centre]
    return np.asarray(np.maximum(np.array(floor), 1e-300))  # median of an exponential distribution to its mean


@dataclass(frozen=True)
class Ripple:
    """A ripple locked to the angle: order of the angle, and its amplitude in the output's unit."""

    order: int
    amplitude: float


def ripple_columns(angle: FloatArray, order: int, *, onset: int = 0) -> FloatArray:
    """Return cosine and sine of an order of the angle, (n, 2), zero up to the sample at which the input comes."""
    moving = np.arange(len(angle)) > onset
    return np.asarray(np.column_stack([np.cos(order * angle), np.sin(order * angle)]) * moving[:, None])


def find_ripple(
    residuals: FloatArray,
    angle: FloatArray,
    *,
    least: float = 0.0,
    onset: int = 0,
    envelope: FloatArray | None = None,
    average: int = 1,
) -> tuple[tuple[Ripple, ...], FloatArray]:
    """Return the ripples of one output's residuals, (n,) with NaN where missing, and their columns, (n, 2 r).

    `envelope` is the ripple's amplitude over time, 1 when running: an encoder's eccentricity shows a ripple of the
    speed in proportion to the speed. `average` samples are averaged by the sensor, the ripple too.
    Ripples smaller than `least` are left: quantisation makes such beats.
    """
    n = len(residuals)
    none: tuple[tuple[Ripple, ...], FloatArray] = ((), np.zeros((n, 0)))
    if np.ptp(angle) < 2 * np.pi * MIN_TURNS or n < MIN_SAMPLES:
        return none
    known = ~np.isnan(residuals)
    left = np.where(known, residuals, 0.0)
    shape = known if envelope is None else known * envelope
    orders: list[int] = []
    columns: FloatArray = np.zeros((n, 0))
    moving = known & (np.arange(n) > onset)
    base = np.exp(1j * np.where(moving, angle, 0.0))
    waves = np.cumprod(np.broadcast_to(base, (RIPPLE_ORDERS, n)), axis=0)[:, moving]
    coefficients: FloatArray = np.zeros(0)
    late = angle[len(angle) // 2 :]
    turn_rate = abs(float(late[-1] - late[0])) / max(len(late) - 1, 1)
    for _ in range(RIPPLES):
        moved = left[moving] - np.mean(left[moving])
        power = np.abs(waves @ moved) ** 2
        floor = _floor(moved, turn_rate)
        power[[o - 1 for o in orders]] = 0.0
        amplitude = 2 * np.sqrt(power) / len(moved)
        power[amplitude < max(least, RIPPLE_LEAST * float(np.std(moved)))] = 0.0  # where a mean hides the noise, too
        best = int(np.argmax(power / floor))
        if 2 * power[best] < RIPPLE_POWER * floor[best]:
            break
        orders.append(best + 1)
        columns = np.column_stack(
            [columns, averaged(ripple_columns(angle, best + 1, onset=onset), average) * shape[:, None]]
        )
        coefficients = np.asarray(np.linalg.lstsq(columns, np.where(known, residuals, 0.0), rcond=None)[0])
        left = np.where(known, residuals, 0.0) - columns @ coefficients
    ripples = tuple(Ripple(order, float(np.hypot(*coefficients[2 * j : 2 * j + 2]))) for j, order in enumerate(orders))
    return ripples, columns
