"""A speed that swings after each edge of the voltage and settles: a second inertia on an elastic shaft, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.plans.plan import Observed
from estimator.recordings.signal_noise import noise_deviation
from estimator.results.reason import Place, Reason

if TYPE_CHECKING:
    from estimator.explaining.explained import Explained

FloatArray = NDArray[np.float64]

EDGE = 0.2  # of the largest change of a voltage
LEAST_ROWS, ROWS_A_PERIOD, PERIODS = 24, 5.0, 3.0  # in a window that shows a swing
SHARE = 0.8  # of the power in a window, at one frequency
FALLS = 0.5  # of the power in the first half of a window, left in the second
LOUD = 3.0  # times the noise from row to row
ALIKE, OFTEN = 0.1, 0.5  # of the frequency, from edge to edge; of the edges that show one
PADDED = 4  # times as long: a spectrum as fine as a part of its resolution


def swings(explained: Explained | None) -> list[str]:
    """Say at what frequency a speed swings after the edges, where tests of its residuals failed."""
    if explained is None or not any(failure.output == "w" for failure in explained.adequacy.doubts):
        return []
    s, fit = explained.fit.simulator, explained.fit
    if "w" not in s.outputs:
        return []
    j = s.outputs.index("w")
    left = (s.measured - fit.explained)[:, j]
    seen = [
        (o, k, _after(left[clock.rows], k, end, clock.step))
        for o, clock in zip(s.observed, s.clocks, strict=True)
        for k, end in _edges(o)
    ]
    found = [(o, k, f, seconds) for o, k, swing in seen if swing is not None for f, seconds in (swing,)]
    if not found or len(found) < OFTEN * len(seen):
        return []
    usual = float(np.median([f for _, _, f, _ in found]))
    alike = [(o, k, seconds) for o, k, f, seconds in found if abs(f - usual) < ALIKE * usual]
    if len(alike) < OFTEN * len(seen):
        return []
    places = [Place(o.recording.name, "w", float(o.times[k]), float(o.times[k]) + seconds) for o, k, seconds in alike]
    return [
        Reason(
            f"w swings at {usual:.3g} Hz after an edge of the voltage, and settles, as the model does not: a second"
            " inertia is on an elastic shaft, coupling or belt; record the motor without it, or estimate with a model"
            " that has it",
            *places,
        )
    ]


def _edges(o: Observed) -> list[tuple[int, int]]:
    """Return the row of each edge of a voltage, and that of the next."""
    if "v" not in o.inputs:
        return []
    size = np.abs(o.changes("v"))
    rows = np.flatnonzero(size > EDGE * float(np.max(size, initial=0.0)))
    return list(zip(rows.tolist(), [*rows[1:].tolist(), len(size)], strict=True))


def _after(left: FloatArray, begin: int, end: int, step: float) -> tuple[float, float] | None:
    """Return at what frequency, Hz, residuals, (n,), swing after an edge, and for how long, s; None: they do not."""
    n, loud = end - begin, LOUD * noise_deviation(left)
    while n >= LEAST_ROWS:
        x = left[begin : begin + n]
        x = np.where(np.isnan(x), 0.0, x - np.nanmean(x)) if not np.isnan(x).all() else np.zeros(n)
        first, second = float(np.mean(x[: n // 2] ** 2)), float(np.mean(x[n // 2 :] ** 2))
        power = np.abs(np.fft.rfft(x * np.hanning(n), PADDED * n)) ** 2
        peak = int(np.argmax(power))
        near = power[max(0, peak - 2 * PADDED) : peak + 2 * PADDED + 1]
        is_one = float(np.sum(near)) > SHARE * float(np.sum(power)) and peak > PERIODS * PADDED
        if first > loud**2 and second < FALLS * first and is_one and peak * ROWS_A_PERIOD < PADDED * n:
            return peak / (PADDED * n * step), n * step
        n = round(n / np.sqrt(2))
    return None
