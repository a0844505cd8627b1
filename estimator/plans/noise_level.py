"""How much noise each output of a plan shows, before any simulation. Knows the recordings and the declared filters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE, SECOND_DIFFERENCE, STEP_DEVIATION
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.recordings.samples import median
from estimator.recordings.sensors import Sensor
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

REST_SAMPLES, REST_LIMIT = 50, 10.0  # before the step; times the noise of differences: more is no noise


def output_deviations(plan: Plan) -> dict[str, tuple[float, float]]:
    """Return, for each output, the deviation of its noise as the data show it, and of the signal itself.

    Of several recordings each counts as many times as it has samples.
    """
    result = {}
    for name in plan.outputs:
        chain = plan.chains.get(name, ChainSpec())
        least = chain.quantum / STEP_DEVIATION
        shown = [max(_noise(o, name), least) * _smoothing(chain, o.recording.step) for o in plan.observed]
        counts = np.maximum([np.count_nonzero(~np.isnan(o.outputs[name])) for o in plan.observed], 1)
        noise = np.sqrt(np.average(np.square(shown), weights=counts))
        spread = float(np.nanstd(np.concatenate([o.outputs[name] for o in plan.observed])))
        result[name] = (float(noise), spread)
    return result


def beside_means(plan: Plan, noise: FloatArray) -> FloatArray:
    """Return the noise, (q,), that differences show, corrected for running means that were found afterwards.

    Of white noise averaged over n > 1 samples second differences see a part of 1 / √(1.5 n) only.
    """
    averages = [plan.chains.get(name, ChainSpec()).average for name in plan.outputs]
    return np.asarray([x * (np.sqrt(1.5 * n) if n > 1 else 1.0) for x, n in zip(noise, averages, strict=True)])


def _smoothing(chain: ChainSpec, step: float) -> float:
    """Return how much larger filtered white noise is than its second differences make it seem."""
    if not chain.filters:
        return 1.0
    sensor = Sensor(sections=chain.sections(step))
    impulse = np.array([sensor.show(float(k == 2)) for k in range(2000)])
    second = impulse[2:] - 2 * impulse[1:-1] + impulse[:-2]
    return float(np.linalg.norm(impulse) / np.linalg.norm(second) * SECOND_DIFFERENCE)


def _noise(o: Observed, name: str) -> float:
    """Return the deviation of an output's noise: at rest before the step, where it is coloured, or differences."""
    known = o.resting(name)
    fast = noise_deviation(o.outputs[name])
    if len(known) < REST_SAMPLES:
        return fast
    slow = median(np.abs(known - median(known))) / MEDIAN_SIZE
    return slow if fast < slow < REST_LIMIT * fast else fast
