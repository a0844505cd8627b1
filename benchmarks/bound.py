"""What no unbiased estimate can beat: the Cramér–Rao bound of an emulated bench. Knows the closed form, no FMU.

    information = Σ over the outputs of Sᵀ S / σ²          bound = square roots of the diagonal of its inverse

S are central differences of the bench's closed form by ln R … ln B and, where they are free, by the delay, the offsets
and the encoder's phase. The noise model: white, of deviation `current_noise` and the converter's step / √12 on the
current, `speed_noise` on a speed that is measured itself, and one count / √12 on encoder counts from the first count
on, whose phase is unknown. A speed of differenced counts, filtered or not, holds the same information as the counts
(both steps can be undone), so its bound is that of the counts; least squares on a filtered speed cannot reach it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from paper_bench import NAMES, Bench

FloatArray = NDArray[np.float64]

STEP = 1e-5  # of ln θ, for differences
REWEIGHTINGS = 3  # of the maximum-likelihood fit
WIDEST = 10.0  # of ln θ around the truth


def cramer_rao(bench: Bench, *, nuisances: Sequence[str] = ()) -> FloatArray:
    """Return the least standard errors, (5,), of ln R … ln B.

    Parameters
    ----------
    nuisances : of "delay", "offset i", "offset w"
        Free besides the motor; the phase of an encoder always is.
    """
    rows = [_sensitivity(bench, name) for name in NAMES] + [_nuisance(bench, name) for name in nuisances]
    if bench.lines:
        rows.append(_nuisance(bench, "phase"))
    sensitivity = np.column_stack(rows)
    scale = np.linalg.norm(sensitivity, axis=0)
    covariance = np.linalg.inv((sensitivity / scale).T @ (sensitivity / scale)) / np.outer(scale, scale)
    return np.asarray(np.sqrt(np.diag(covariance))[: len(NAMES)])


def from_the_truth(bench: Bench, measured: FloatArray) -> tuple[FloatArray, float]:
    """Return the maximum-likelihood R … B reached from the bench's own, and −2 ln likelihood, for a plain bench.

    Parameters
    ----------
    measured : (n, 2) array
        Current and speed, with white noise of unknown deviations.
    """
    from scipy.optimize import least_squares

    truth = x = np.log([bench.motor[n] for n in NAMES])
    for _ in range(REWEIGHTINGS):
        deviations = np.sqrt(np.mean(_residuals(bench, x, measured) ** 2, axis=0))

        def weighted(point: FloatArray, scale: FloatArray = deviations) -> FloatArray:
            return (_residuals(bench, point, measured) / scale).ravel()

        box = (truth - WIDEST, truth + WIDEST)
        x = least_squares(weighted, x, bounds=box, x_scale="jac", xtol=1e-12, ftol=1e-13).x
    return np.exp(x), likelihood(bench, np.exp(x), measured)


def likelihood(bench: Bench, values: FloatArray, measured: FloatArray) -> float:
    """Return −2 ln likelihood, up to a constant, of R … B for white noise of unknown deviations."""
    mean = np.mean(_residuals(bench, np.log(values), measured) ** 2, axis=0)
    return float(len(measured) * np.sum(np.log(mean)))


def _residuals(bench: Bench, x: FloatArray, measured: FloatArray) -> FloatArray:
    motor = dict(zip(NAMES, np.exp(x).tolist(), strict=True))
    i, w, _ = replace(bench, motor=motor).response(_time(bench))
    return np.asarray(np.column_stack([i, w]) - measured)


def _time(bench: Bench) -> FloatArray:
    """Return the samples' times after the voltage has come on, in s."""
    n = round(bench.duration / bench.step) + 1
    return np.arange(n) * bench.step - round(bench.lead / bench.step) * bench.step - bench.delay


def _weighted(bench: Bench, time: FloatArray) -> FloatArray:
    """Return what the bench's sensors show without noise, over their noise, (2 n,)."""
    i, w, angle = bench.response(time)
    i = i / np.hypot(bench.current_noise, bench.adc / np.sqrt(12))
    if not bench.lines:
        return np.concatenate([i, w / bench.speed_noise])
    return np.concatenate([i, angle * _counting(bench) / _count(bench)])


def _count(bench: Bench) -> float:
    return 2 * np.pi / (4 * bench.lines) / np.sqrt(12)


def _counting(bench: Bench) -> FloatArray:
    """Return 1 from the first count on, else 0, (n,)."""
    angle = bench.response(_time(bench))[2]
    return (angle > 2 * np.pi / (4 * bench.lines)).astype(float)


def _sensitivity(bench: Bench, name: str) -> FloatArray:
    time = _time(bench)
    ends = [replace(bench, motor={**bench.motor, name: bench.motor[name] * np.exp(s)}) for s in (STEP, -STEP)]
    counting = np.concatenate([np.ones(len(time)), _counting(bench) if bench.lines else np.ones(len(time))])
    up, down = (_weighted(end, time) for end in ends)
    return np.asarray(np.where(counting > 0, up - down, 0.0) / (2 * STEP))


def _nuisance(bench: Bench, name: str) -> FloatArray:
    time = _time(bench)
    if name == "delay":
        late = STEP * bench.step
        return np.asarray((_weighted(bench, time - late) - _weighted(bench, time + late)) / (2 * late))
    zero, one = np.zeros(len(time)), np.ones(len(time))
    if name == "phase":
        return np.concatenate([zero, _counting(bench) / _count(bench)])
    return np.concatenate([one, zero] if name == "offset i" else [zero, one])
