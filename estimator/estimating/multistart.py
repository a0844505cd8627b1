"""Many starts for a motor whose transient few samples show, where one search may miss the best optimum. No FMU.

Between few samples of a fast transient several sets of parameters fit nearly as well, and the misfit of the wrong ones
drowns in the noise of the settled part. The steady state still holds: starts are drawn along its line between R and
K, with L / R and R J / K² from a fiftieth of the sampling interval to a hundred intervals.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.steiglitz_mcbride import steiglitz_mcbride
from estimator.motor.names import is_motor
from estimator.motor.state_space import poles
from estimator.motor.transfer_functions import NoMotorError
from estimator.plans.parameters import Box
from estimator.plans.plan import Plan
from estimator.plans.space import Steady
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

FAST = 0.5  # of 1 / sampling interval: a faster pole shows in few samples
UNSURE = 0.1  # relative standard error
LEAST, MOST = 0.005, 100.0  # sampling intervals of the time constants
OTHERS = 8  # inductances
NEAR = 1e-6  # of a transfer function's denominator: a start need be no nearer


def needs_many(plan: Plan, polish: LeastSquaresFit) -> bool:
    """Whether few samples show the transient, or a parameter is hardly identifiable."""
    values: Mapping[str, float] = dict(zip(plan.names, polish.values.tolist(), strict=True))
    if not is_motor(values):
        return False
    rates = poles(values)
    h = plan.observed[0].recording.step
    unsure = np.any(polish.at_bound != 0) or not np.all(polish.standard_errors < UNSURE * np.abs(polish.values))
    return bool(np.max(np.abs(rates)) * h > FAST or unsure)


def many_starts(
    plan: Plan, polish: LeastSquaresFit, steady: Steady, box: Box, *, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return starts, (n, p): around a first optimum, by Steiglitz-McBride, and `count` that keep the steady state."""
    starts = [*_inductances(plan, polish), *_direct(plan)]
    if steady.settling.settled and steady.state.is_usable:  # not so after a step down to rest
        drawn = steady.state.drawn(count, rng, step=plan.observed[0].recording.step, intervals=(LEAST, MOST))
        starts += list(np.column_stack([drawn[n] for n in plan.names]))
    return np.asarray(np.clip(np.array(starts), box.lower, box.upper))


def _inductances(plan: Plan, polish: LeastSquaresFit) -> list[FloatArray]:
    """Return the optimum with other inductances: below a sampling interval L has two minima."""
    R, L = plan.names.index("R"), plan.names.index("L")
    found = []
    for intervals in np.geomspace(LEAST, MOST, OTHERS):
        other = polish.values.copy()
        other[L] = intervals * plan.observed[0].recording.step * other[R]
        found.append(other)
    return found


def _direct(plan: Plan) -> list[FloatArray]:
    """Return what Steiglitz-McBride finds, which knows no local optimum; nothing where no motor has it."""
    o = plan.observed[0]
    if o.lead or o.delay or "v" not in o.inputs:
        return []
    sigma = (max(noise_deviation(o.outputs["i"]), 1e-12), max(noise_deviation(o.outputs["w"]), 1e-12))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of a logarithm near its branch
            v, i, w = o.inputs["v"], o.outputs["i"], o.outputs["w"]
            found = steiglitz_mcbride(v, i, w, step=o.recording.step, sigma=sigma, converged=NEAR)
    except (NoMotorError, np.linalg.LinAlgError):
        return []
    return [np.array([found[name] for name in plan.names])]
