"""The noise of an explanation, estimated from what it leaves of the recordings. Knows no search and adds no effect."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import STEP_DEVIATION
from estimator.explaining.coarse_levels import held_by_sensor
from estimator.explaining.explanation import Explanation, renewed
from estimator.explaining.shared_errors import with_shared_errors
from estimator.fitting.fit import Fit, refreshed, slopes_in_time, with_level
from estimator.fitting.gauss_newton import solved, solved_roughly
from estimator.fitting.least_squares import ROUNDING
from estimator.fitting.motor_response import with_machine
from estimator.fitting.outliers import held_down
from estimator.fitting.windows import find_windows
from estimator.noise.autoregression import autoregressions_of_filter
from estimator.noise.jitter import find_jitter, without_responses
from estimator.noise.noise_estimate import Colours, fit_noise
from estimator.noise.noise_growth import noise_of_neighbours
from estimator.noise.noise_model import NoiseModel
from estimator.noise.noise_of_each import with_noise_of_each
from estimator.noise.recursion import recursion
from estimator.plans.plan import Plan
from estimator.recordings.filters import Filter, filter_sections
from estimator.stepping import layout

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

RESPONSE = 4096  # samples of a filter's response to an impulse
ONE_RATE = 0.01  # parts by which sampling intervals may differ: a filter's colour is of one
LEAST_PART = 1e-5  # of the most that an output misses, each by its spread: less is lost in differences of simulations
LOST = 0.25  # of -2 log L a sample: a noise by which it is larger by as much is not that of the recordings
QUIET = 0.1  # of the first estimate of the deviation: the noise is taken to be no less


def count_deviations(plan: Plan) -> FloatArray:
    """Return the deviation of the counts that each output differences, (q,), in its unit; 0: it shows no counts."""
    found = np.zeros(len(plan.outputs))
    for k, y in enumerate(plan.outputs):
        if plan.sensors[y] == layout.MEAN:
            found[k] = max(plan.resolution(o, y) for o in plan.observed) / STEP_DEVIATION
    return found


def with_noise(
    explanation: Explanation,
    differenced: FloatArray,
    *,
    colour: bool = True,
    again: bool = False,
    moving: bool = False,
    settles: bool = True,
) -> Explanation:
    """Return the explanation with its noise estimated, or estimated again, and fitted with it.

    Parameters
    ----------
    differenced : (q,) array
        As `count_deviations`.
    colour : bool
        Whether the noise may be coloured.
    again : bool
        Keep the components of the noise, and estimate their parameters again.
    moving : bool
        Ask rows that have not settled, too, but for the first part of transients, and keep the torque that wanders.
    settles : bool
        Once more where columns are known as well as the noise tells.
    """
    fit = renewed(explanation)
    if any(new is not old for new, old in zip(fit.linear, explanation.fit.linear, strict=True)):
        fit = solved_roughly(fit)  # by its old coefficients a column that has moved is no part of what is explained
    fit = with_machine(with_shared_errors(with_level(fit)))
    noise = fit.whitener.noise
    if not again:
        noise = dataclasses.replace(noise, differenced=differenced)
    whitener = fit.whitener.of(noise)
    misfit = np.where(whitener.present, fit.residuals(), 0.0)
    s = fit.simulator
    rounding = ROUNDING * s.problem.spread
    missed = np.sqrt(np.mean(misfit**2, axis=0))
    if np.all(missed < rounding):  # a simulation's own output: no noise is to be told
        exact = dataclasses.replace(NoiseModel.plain(rounding, noise.seat), machine=noise.machine)
        return dataclasses.replace(explanation, fit=solved(refreshed(fit, whitener.of(exact))))
    spread = s.problem.spread
    least = np.maximum(rounding, LEAST_PART * float(np.max(missed / spread)) * spread)
    windows = find_windows(explanation.fit)
    whitener = with_noise_of_each(whitener, misfit, windows.sharp, s.steps_of_each)
    is_angle = np.array([y == "angle" for y in s.outputs])  # its counts are far apart, as its samples are
    steps = np.where(differenced == 0, s.steps, 0.0)
    found = fit_noise(
        whitener, misfit, fit.raw, ~windows.sharp if moving else windows.settled, windows.sharp,
        colour=colour, again=again, counts=differenced, steps=np.where(is_angle, 0.0, steps),
        resolution=np.where(s.coarse | is_angle, steps, 0.0), is_held=held_by_sensor(fit),
        torque=noise.torque if moving else None, least=least, behind=_colours_of_filters(s.plan),
    )  # fmt: skip
    del misfit  # of a million rows a thirtieth of what is held
    fit = solved(held_down(refreshed(fit, whitener.of(found)), windows.onsets))
    told = dataclasses.replace(explanation, fit=fit)
    if settles and any(group.uncertain is not None for group in fit.linear):  # what their form is, the noise tells
        told = with_noise(told, differenced, colour=colour, again=True, moving=moving, settles=False)
    if again and settles and _unlikelihood(told.fit) - _unlikelihood(explanation.fit) > LOST * s.measured.size:
        return explanation  # settled rows hardly tell how noise grows: all of them tell that it was better known
    return told


def _unlikelihood(fit: Fit) -> float:
    """Return -2 log L of a fit by its own noise, up to a constant."""
    whitener = fit.whitener
    return fit.cost + whitener(np.zeros((*whitener.present.shape, 1)))[1]


def _colours_of_filters(plan: Plan) -> list[Colours]:
    """Return, of each output, what colours white noise may have behind the filters that its case declares."""
    steps = [o.recording.step for o in plan.observed]
    is_one_rate = max(steps) < (1 + ONE_RATE) * min(steps)
    filters = [plan.chains[y].filters if y in plan.chains and is_one_rate else () for y in plan.outputs]
    return [_colours(own, float(np.median(steps))) if own else () for own in filters]


@lru_cache(maxsize=64)
def _colours(filters: tuple[Filter, ...], step: float) -> Colours:
    """Return them of some filters in series at a sampling interval in s."""
    response = np.zeros(RESPONSE)
    response[0] = 1.0
    for b0, b1, b2, a1, a2 in (section for spec in filters for section in filter_sections(spec, step=step)):
        response = recursion((b0, b1, b2), (a1, a2), response)
    return autoregressions_of_filter(response)


def with_jitter(explanation: Explanation, differenced: FloatArray) -> Explanation | None:
    """Return the explanation fitted with samples whose instants are not known exactly; None where they are."""
    fit = with_level(explanation.fit)
    fit = dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener, slope=slopes_in_time(fit)))
    grows = fit.whitener.noise
    edges = [rows for transients in find_windows(explanation.fit).transients for rows in transients]
    found = []
    for noise in (grows, dataclasses.replace(grows, growth=np.zeros_like(grows.growth), running=None)):
        whitener = fit.whitener.of(noise)
        deviation = whitener.deviation()
        slope = np.where(whitener.present & ~_of_steps(fit, differenced), whitener.slope / deviation, 0.0)
        z = refreshed(fit, whitener).z.reshape(slope.shape)
        worse = float(np.vdot(z, z) + 2 * np.sum(np.log(deviation), where=whitener.present))
        jitter, sizes, gain = find_jitter(*without_responses(z, slope, edges), fit.simulator.clocks[0].step)
        found.append((worse - gain, jitter, dataclasses.replace(noise, white=noise.white * sizes)))
        if not grows.grows:
            break
    _, jitter, noise = min(found, key=lambda f: f[0])
    if jitter == 0.0:
        return None
    whitener = fit.whitener.of(dataclasses.replace(noise, jitter=jitter))
    return dataclasses.replace(explanation, fit=solved(refreshed(fit, whitener)))


def with_noise_of_neighbours(explanation: Explanation, differenced: FloatArray) -> Explanation:
    """Return the explanation fitted by the noise that samples beside each other show."""
    fit = with_level(explanation.fit)
    windows = find_windows(explanation.fit)
    misfit = np.where(fit.whitener.present, fit.residuals(), 0.0)
    whitener = with_noise_of_each(fit.whitener, misfit, windows.sharp, fit.simulator.steps_of_each)
    old, found = whitener.noise, noise_of_neighbours(whitener, misfit, windows.sharp)
    coarse = _of_steps(fit, differenced)
    white = np.where(coarse, old.white, np.maximum(found.white, QUIET * old.white))
    assert found.running is not None
    growth, running = np.where(coarse, 0.0, found.growth), np.where(coarse, 1.0, found.running)
    found = dataclasses.replace(found, white=white, growth=growth, running=running)
    fit = held_down(refreshed(fit, whitener.of(found)), windows.onsets)
    return dataclasses.replace(explanation, fit=solved(fit))


def _of_steps(fit: Fit, differenced: FloatArray) -> BoolArray:
    """Whether an output's errors are its sensor's steps, (q,), no noise that grows, nor one of unknown instants.

    Digits that are printed far below the noise are steps, too.
    """
    return np.asarray((fit.simulator.steps > fit.whitener.noise.white) | (differenced > 0))


def by_known_forms(explanation: Explanation) -> Explanation:
    """Return an explanation fitted as if the form of its columns were known: what is not known explains them itself."""
    fit = explanation.fit
    if all(group.uncertain is None for group in fit.linear):
        return explanation
    fit = with_shared_errors(fit, forms=False)
    return dataclasses.replace(explanation, fit=solved_roughly(refreshed(fit, fit.whitener)))


def by_noise_of(other: Explanation, explanation: Explanation) -> Explanation:
    """Return an explanation fitted by another's noise: only so do their criteria compare.

    What is not known of the form of its columns is its own.
    """
    fit = refreshed(explanation.fit, other.fit.whitener)
    if any(group.uncertain is not None for group in (*other.fit.linear, *fit.linear)):
        fit = with_shared_errors(fit)
    return dataclasses.replace(explanation, fit=solved_roughly(fit))
