"""Whether residuals are plain noise, for methods that model no measurement chain. Knows signals alone, no fit.

White noise has no line in its spectrum (Fisher 1929), no stretch with a mean other than zero, and no correlation of
neighbours (Ljung and Box 1978). Each is tested on each output of each recording; all together raise a false alarm in
1e-3 of results.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import FALSE_ALARM, NUMERICAL, RESOLVED, SMALL_CORRELATION
from estimator.distributions import chi_square_limit, normal_quantile
from estimator.recordings.quantum import quantum
from estimator.results.reason import Place, Reason
from estimator.results.result import Comparison

FloatArray = NDArray[np.float64]

TESTS = 3
FEWEST_SAMPLES = 40  # samples: fewer are not tested
FEWEST_PERIODS = 5  # in a recording: a slower line is tested as a stretch
SHORTEST_STRETCH = 4  # samples of a stretch
LJUNG_BOX_LAGS = 20
REMEDY = "this method leaves it; the default one, --method cuckoo, looks for what it is"


def structured(compared: Sequence[Comparison]) -> list[str]:
    """Return which residuals are not white noise: at most one sentence for each output, with its place."""
    every = [(c, name) for c in compared for name in c.simulated]
    found: list[str] = []
    for c, name in every:
        measured = c.measured[name]
        left = measured - c.simulated[name]
        known = ~np.isnan(left)
        deviation = float(np.std(left[known])) if known.any() else 0.0
        floor = max(NUMERICAL * float(np.nanstd(measured)), RESOLVED * quantum(measured)) if known.any() else 0.0
        if known.sum() < FEWEST_SAMPLES or deviation <= floor:
            continue
        level = FALSE_ALARM / (TESTS * len(every))
        said = _ripple(c, name, left, level) or _stretch(c, name, left, level) or _neighbours(c, name, left, level)
        if said is not None:
            found.append(said)
    return found


def _ripple(c: Comparison, name: str, left: FloatArray, level: float) -> Reason | None:
    """Find a line in the spectrum, by Fisher's g: the largest part of all power that one frequency has."""
    n = len(left)
    filled = np.nan_to_num(left - np.nanmean(left))
    transform = np.fft.rfft(filled)[1 : (n + 1) // 2]
    power = np.abs(transform) ** 2
    k = int(np.argmax(power))
    limit = 1 - (level / len(power)) ** (1 / max(len(power) - 1, 1))
    if k + 1 < FEWEST_PERIODS or power[k] < limit * float(np.sum(power)):
        return None
    amplitude = 2 * math.sqrt(float(np.sum(power[max(0, k - 1) : k + 2]))) / n
    frequency = (k + 1) / (c.time[-1] - c.time[0]) * (n - 1) / n
    return Reason(
        f"{c.name}: the residuals of {name} hold a ripple of {amplitude:.2g} {c.units.get(name, '')} at"
        f" {frequency:.4g} Hz; {REMEDY}",
        Place(c.name, name, float(c.time[0]), float(c.time[-1])),
    )


def _stretch(c: Comparison, name: str, left: FloatArray, level: float) -> Reason | None:
    """Find the stretch whose mean is farthest from zero in its own standard errors."""
    at = np.flatnonzero(~np.isnan(left))
    z = left[at] / float(np.std(left[at]))
    sums = np.concatenate([[0.0], np.cumsum(z)])
    lengths = [SHORTEST_STRETCH * 2**k for k in range(int(math.log2(len(z) / SHORTEST_STRETCH)))]
    if not lengths:
        return None
    limit = -normal_quantile(level / (2 * len(z) * len(lengths)))
    farthest, first, length = 0.0, 0, 0
    for m in lengths:
        far = np.abs(sums[m:] - sums[:-m]) / math.sqrt(m)
        k = int(np.argmax(far))
        if far[k] > farthest:
            farthest, first, length = float(far[k]), k, m
    if farthest <= limit:
        return None
    rows = at[first : first + length]
    mean = float(np.mean(left[rows]))
    return Reason(
        f"{c.name}: the residuals of {name} lie to one side, {mean:+.2g} {c.units.get(name, '')} on average, in"
        f" {length} samples from t = {c.time[rows[0]]:.6g} s, as noise does not; {REMEDY}",
        Place(c.name, name, float(c.time[rows[0]]), float(c.time[rows[-1]])),
    )


def _neighbours(c: Comparison, name: str, left: FloatArray, level: float) -> Reason | None:
    """Find residuals that are correlated with those before them."""
    z = np.nan_to_num(left - np.nanmean(left))
    n = int(np.sum(~np.isnan(left)))
    lags = np.arange(1, min(LJUNG_BOX_LAGS, n // 4) + 1)
    alike = np.array([float(np.sum(z[k:] * z[:-k])) for k in lags]) / float(np.sum(z**2))
    q = n * (n + 2) * float(np.sum(alike**2 / (n - lags)))
    k = int(np.argmax(np.abs(alike)))
    if q <= chi_square_limit(len(lags), level) or abs(alike[k]) < SMALL_CORRELATION:
        return None
    return Reason(
        f"{c.name}: the residuals of {name} are no plain noise: samples {lags[k]} apart are alike (correlation"
        f" {alike[k]:+.2f}); {REMEDY}",
        Place(c.name, name, float(c.time[0]), float(c.time[-1])),
    )
