"""Whether a step response has reached its final value, and whether its transient is there at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.excitation import TREND_SIGMAS, Excitation
from estimator.recordings.samples import filled, mean_of_known, running_mean
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

TREND = 0.005  # of the response: a larger trend over the last tenth is not settled
TAIL = 0.1  # of the samples after the step, over which the trend is judged
BAND = 0.02  # of the response: the steady state of the paper
SETTLED_MARGIN = 2.5  # times the time to enter the band: an exponential is then within 6e-5
LOST_JUMP = 0.2  # of the response in one interval, alone: the transient lies between two samples
LOST_RATIO = 5.0


@dataclass(frozen=True)
class Settling:
    """Whether a step response reached its final value.

    Attributes
    ----------
    settled : bool
    start : int
        First sample of the settled part (of the last tenth, if not settled).
    reason : str
        Why it counts as not settled.
    """

    settled: bool
    start: int
    reason: str = ""


def find_settling(step: Excitation, outputs: Mapping[str, FloatArray], *, interval: float) -> Settling:
    """Judge, on each output's trend against its own noise, whether the response to a step has settled.

    Parameters
    ----------
    step : Excitation
        Of kind "step".
    outputs : name → (n,) array
    interval : float
        s, sampling interval.
    """
    n = len(next(iter(outputs.values())))
    after = n - step.index
    tail = max(5, int(TAIL * after))
    start = step.index
    if after < 20:
        return Settling(False, n - min(tail, after), "fewer than 20 samples follow the step")
    for name, y in outputs.items():
        response = y[step.index :]
        final = mean_of_known(response[-tail:])
        if np.isnan(final):
            continue  # what was not recorded tells nothing
        swing = float(np.nanmax(response) - np.nanmin(response))
        if swing == 0:
            continue
        slope, error = _trend(response[-tail:])
        error = max(error, noise_deviation(response) / np.sqrt(tail**3 / 12))  # a few samples' own scatter may be small
        change = abs(slope) * tail
        if change > max(TREND * swing, TREND_SIGMAS * error * tail):
            return Settling(
                False,
                n - tail,
                f"{name} still changed by {100 * change / swing:.2g} % of its response"
                f" in the last {tail * interval:.3g} s",
            )
        outside = np.abs(running_mean(response) - final) > max(BAND * swing, TREND_SIGMAS * noise_deviation(response))
        inside = int(np.flatnonzero(outside)[-1]) + 1 if outside.any() else 0
        start = max(start, step.index + int(SETTLED_MARGIN * inside))
    return Settling(True, min(start, n - tail))


def lost_transient(step: Excitation, y: FloatArray) -> tuple[int, float] | None:
    """Return sample and size (part of the response) of a jump that no neighbour shares, or None."""
    difference = np.abs(np.diff(filled(y)))
    response = float(np.nanmax(y) - np.nanmin(y))
    if response == 0 or len(difference) < 5:
        return None
    k = int(np.argmax(difference))
    neighbours = max(
        float(np.max(difference[max(0, k - 2) : k], initial=0.0)),
        float(np.max(difference[k + 1 : k + 3], initial=0.0)),
    )
    noise = noise_deviation(y)
    beyond = difference[k] > LOST_RATIO * neighbours + 6 * noise
    if difference[k] > LOST_JUMP * response and beyond and k >= step.index - 1:
        return k + 1, float(difference[k]) / response
    return None


def _trend(y: FloatArray) -> tuple[float, float]:
    """Return slope a sample, and its standard error, of a straight line through the samples."""
    k = np.flatnonzero(~np.isnan(y)).astype(float)
    values = y[~np.isnan(y)]
    if len(values) < 3:
        return 0.0, np.inf
    k -= k.mean()
    slope = float(k @ (values - values.mean()) / (k @ k))
    residual = values - values.mean() - slope * k
    power = float(residual @ residual)
    alike = float(np.clip(residual[1:] @ residual[:-1] / power, 0.0, 0.95)) if power > 0 else 0.0  # of a mean: much
    return slope, float(np.sqrt(power / (len(k) - 2) / (k @ k) * (1 + alike) / (1 - alike)))
