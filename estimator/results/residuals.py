"""The residuals of an estimate in numbers: by recording, autocorrelation, histogram. Knows only the result."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.results.result import Comparison, FloatArray

LAGS = 60
BINS = 41
REACH = 5.0  # standard deviations to each side of a histogram


@dataclass(frozen=True)
class RecordingFit:
    """How one output of one recording was fitted: RMSE in SI, fit in percent, samples compared, samples left out."""

    recording: str
    output: str
    unit: str
    rmse: float
    fit_percent: float
    samples: int
    left_out: int


@dataclass(frozen=True)
class Whiteness:
    """What the residuals of one output look like, over all recordings.

    Attributes
    ----------
    correlation : (lags + 1,) array
        Autocorrelation, 1 at lag 0.
    chance : float
        Of white noise 95 % of the correlations lie within ± this.
    edges, density : (bins + 1,), (bins,) arrays
        Histogram over standard deviations; its area is 1.
    """

    output: str
    correlation: FloatArray
    chance: float
    edges: FloatArray
    density: FloatArray


def recording_fits(comparisons: tuple[Comparison, ...]) -> list[RecordingFit]:
    """Return how each output of each recording was fitted."""
    found = []
    for c in comparisons:
        for name, simulated in c.simulated.items():
            measured = c.measured[name]
            known = ~np.isnan(measured)
            error = (measured - simulated)[known]
            spread = float(np.linalg.norm(measured[known] - measured[known].mean())) if known.any() else 0.0
            fit = 100 * (1 - float(np.linalg.norm(error)) / spread) if spread > 0 else math.nan
            rmse = float(np.sqrt(np.mean(error**2))) if known.any() else math.nan
            out = int(np.sum(c.left_out.get(name, np.zeros(0))))
            found.append(RecordingFit(c.name, name, c.units.get(name, ""), rmse, fit, int(known.sum()), out))
    return found


def whiteness(comparisons: tuple[Comparison, ...]) -> list[Whiteness]:
    """Return how white the residuals of each output are, without outliers and what was taken out of them."""
    found = []
    for name in dict.fromkeys(name for c in comparisons for name in c.simulated):
        series = [_treated(c, name) for c in comparisons if name in c.simulated]
        known = np.concatenate([s[~np.isnan(s)] for s in series]) if series else np.zeros(0)
        deviation = float(np.std(known)) if len(known) else 0.0
        if len(known) < 3 or deviation == 0:
            continue
        edges = np.linspace(-REACH, REACH, BINS + 1)
        density = np.histogram((known - known.mean()) / deviation, bins=edges, density=True)[0]
        mean = float(known.mean())
        correlation = _correlation([s - mean for s in series], lags=min(LAGS, max(len(s) for s in series) // 2))
        found.append(Whiteness(name, correlation, 1.96 / math.sqrt(len(known)), edges, density))
    return found


def _treated(c: Comparison, name: str) -> FloatArray:
    """Return measured minus simulated, (n,), NaN where it was not compared."""
    residual = c.measured[name] - c.simulated[name]
    if name in c.taken_out:
        residual = residual - c.taken_out[name]
    return np.where(c.left_out[name], np.nan, residual) if name in c.left_out else residual


def _correlation(series: list[FloatArray], *, lags: int) -> FloatArray:
    """Return the autocorrelation over all series, (lags + 1,); missing samples count nowhere."""
    products, counts = np.zeros(lags + 1), np.zeros(lags + 1)
    for s in series:
        known = ~np.isnan(s)
        size = 1 << int(len(s) + lags).bit_length()
        for values, total in ((np.where(known, s, 0.0), products), (known.astype(float), counts)):
            spectrum = np.fft.rfft(values, size)
            total += np.fft.irfft(np.abs(spectrum) ** 2, size)[: lags + 1]
    means = products / np.maximum(np.round(counts), 1)
    return np.asarray(means / means[0])
