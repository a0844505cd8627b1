"""Long signals for a narrow screen: of every pixel the least and the greatest sample, gaps, samples that stand alone.

Knows arrays only. A view of a million samples is made in some milliseconds, so the page asks for one after every move.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE

FloatArray = NDArray[np.float64]

MOST_BUCKETS = 20_000
STANDS_ALONE = 12.0  # robust deviations from the median of five samples
RARE = 0.02  # of the samples: fewer that leave the median of five are no noise
MOST_MARKED = 500


@dataclass(frozen=True)
class Series:
    """Signals on one clock: time (n,) s, increasing; name → (n,) samples, NaN where one is missing."""

    time: FloatArray
    signals: Mapping[str, FloatArray]


def view(series: Series, *, start: float, end: float, buckets: int) -> bytes:
    """Return a stretch of signals as the page draws it.

    Where there are more samples than two a bucket, a signal is given by its least and its greatest sample of each
    bucket, so that no extreme is lost; else by its samples.

    Parameters
    ----------
    start, end : float
        s; one sample beyond each end is given too.
    buckets : int
        About one for each pixel.

    Returns
    -------
    bytes
        Length of the header (4 bytes, little endian), the header (JSON, filled up to a multiple of 8 bytes), then the
        times (float64) and, signal by signal, the samples or the least and the greatest (float32).
    """
    time, buckets = series.time, int(np.clip(buckets, 1, MOST_BUCKETS))
    first = max(int(np.searchsorted(time, start, side="left")) - 1, 0)
    last = min(int(np.searchsorted(time, end, side="right")) + 1, len(time))
    first, last = min(first, max(last - 1, 0)), max(last, first + 1)
    count = last - first
    enveloped = count > 2 * buckets
    edges = np.linspace(first, last, buckets + 1).astype(np.int64)[:-1] if enveloped else np.array([], dtype=np.int64)
    shown = time[edges] if enveloped else time[first:last]
    blocks = [np.ascontiguousarray(shown, dtype="<f8").tobytes()]
    for signal in series.signals.values():
        if enveloped:
            part = signal[first:last]
            blocks += [_reduced(np.fmin, part, edges - first), _reduced(np.fmax, part, edges - first)]
        else:
            blocks.append(signal[first:last].astype("<f4").tobytes())
    header = {
        "names": list(series.signals),
        "count": len(shown),
        "envelope": enveloped,
        "samples": len(time),
        "begin": float(time[0]),
        "end": float(time[-1]),
        "from": float(time[first]),
        "to": float(time[last - 1]),
    }
    text = json.dumps(header).encode()
    text += b" " * (-(len(text) + 4) % 8)
    return len(text).to_bytes(4, "little") + text + b"".join(blocks)


def nearest(series: Series, at: float) -> tuple[float, dict[str, float | None]]:
    """Return the sample next to a time: its time, and what each signal is there; None where it is missing."""
    k = int(np.clip(np.searchsorted(series.time, at), 1, len(series.time) - 1))
    k -= int(at - series.time[k - 1] < series.time[k] - at)
    values = {name: float(signal[k]) for name, signal in series.signals.items()}
    return float(series.time[k]), {name: value if np.isfinite(value) else None for name, value in values.items()}


def gaps(series: Series, name: str) -> list[tuple[float, float]]:
    """Return the stretches in which a signal has no samples: first and last missing time, the longest first."""
    missing = np.isnan(series.signals[name])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    found = [(float(series.time[a]), float(series.time[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return sorted(found, key=lambda gap: gap[0] - gap[1])[:MOST_MARKED]


def outliers(series: Series, name: str) -> list[float]:
    """Return the times of samples that stand alone: far from the median of the five around each, the farthest first.

    A step or a ramp has none: the median of five goes with it. The deviation is judged by the median of all that are
    not 0, so that the counts of an encoder, which are mostly equal, do not stand alone either.
    """
    signal = series.signals[name]
    known = np.flatnonzero(~np.isnan(signal))
    if len(known) < 5:
        return []
    values = signal[known]
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, mode="edge"), 5)
    off = np.abs(values - np.median(around, axis=1))
    moving = off[off > 0]
    usual = float(np.median(moving)) / MEDIAN_SIZE if len(moving) > RARE * len(off) else 0.0
    scale = max(usual, 1e-3 * float(np.ptp(values)))
    far = np.flatnonzero(off > STANDS_ALONE * scale) if scale > 0 else np.array([], dtype=np.int64)
    return [float(series.time[known[k]]) for k in far[np.argsort(-off[far], kind="stable")][:MOST_MARKED]]


def spectrum(time: FloatArray, residual: FloatArray, *, buckets: int = 1000) -> tuple[FloatArray, FloatArray]:
    """Return frequencies in Hz and amplitudes of a residual, for its ripple; of every bucket the greatest.

    Missing samples count as 0; a Hann window keeps the lines apart.
    """
    n = len(residual)
    if n < 8:
        return np.zeros(0), np.zeros(0)
    step = (time[-1] - time[0]) / (n - 1)
    window = np.hanning(n)
    known = np.nan_to_num(residual - np.nanmean(residual))
    amplitude = 2 * np.abs(np.fft.rfft(known * window)) / window.sum()
    frequency = np.fft.rfftfreq(n, step)
    if len(amplitude) <= buckets:
        return frequency, amplitude
    edges = np.linspace(0, len(amplitude), buckets + 1).astype(np.int64)[:-1]
    highest = np.maximum.reduceat(amplitude, edges)
    return frequency[edges], highest


def _reduced(of: np.ufunc, part: FloatArray, edges: NDArray[np.int64]) -> bytes:
    return np.asarray(of.reduceat(part, edges), dtype="<f4").tobytes()
