"""A torque that wanders, such as friction does: found in all rows, or left open. Adds no effect.

Settled rows alone, each stretch with a level of its own, hardly show friction that wanders more slowly than a stretch
lasts, and it is what B's error is made of. So all rows are asked, by the restricted likelihood of a few sizes. Where
one is clearly likelier than none, it is part of the noise. Where the recordings leave it open, as short ones do, each
size is another noise that is possible, to be averaged over. So is a torque that wanders more slowly, and further:
within a part of its time both are the same random walk, but B is known less by the slower.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.explanation import Explanation
from estimator.explaining.parameter_drift import friction_variance
from estimator.fitting.fit import Fit, refreshed, with_level
from estimator.fitting.gauss_newton import solved
from estimator.fitting.motor_response import with_machine
from estimator.noise.noise_model import NoiseModel
from estimator.noise.restricted_likelihood import USUAL_TORQUE, RestrictedLikelihood, unusual

FloatArray = NDArray[np.float64]

MOST_ROWS = 60_000  # of more rows the settled ones show it
WANDERING = 0.8  # of benches: friction that is constant to 0.1 % is rare
SIZES = (0.004, 0.012, 0.04, 0.12)  # of the usual torque, each as likely before a recording is seen
WANDERS = 4.0  # of -2 log L: it widens the bars, no more, so that it may be taken in by chance in 2 of 100 recordings
PROMISES = 0.25  # of that, by one of the sizes: between two of them, and by another time, it falls hardly further
SLOWER = (3.0, 9.0)  # times as slow, by the root of that as large
EXCLUDED = 5.0  # of -2 log L that a size is less likely than none: the average knows it no more


@dataclass(frozen=True)
class OpenTorque:
    """A size of the torque that wanders which the recordings leave open.

    Attributes
    ----------
    deviation : its standard deviation, N.m
    behind : -2 log of its probability above that of no such torque
    covariance : (p, p) array
        Of the plan's parameters with it, on their scales.
    """

    deviation: float
    behind: float
    covariance: FloatArray


def with_wandering_torque(
    explanation: Explanation, *, most: float = np.inf, left_open: bool = True
) -> tuple[Explanation, tuple[OpenTorque, ...]]:
    """Return the explanation fitted with a torque that wanders, as it is where none shows, and what is left open.

    In all rows the misfit of a transient may be taken for it: whether an explanation is adequate must be asked before,
    or a torque that is no larger than friction may well be. Long recordings show it in their settled rows; a speed
    alone does not tell the usual torque.

    Parameters
    ----------
    most : float
        Of the usual torque: a larger one is none.
    left_open : bool
        Whether what is left open is asked for.
    """
    fit = with_machine(with_level(explanation.fit))
    noise, usual = fit.whitener.noise, usual_torque(fit)
    if usual == 0.0:
        return explanation, ()
    misfit = np.where(fit.whitener.present, fit.residuals(), 0.0)
    stacked = np.concatenate([misfit[:, :, None], fit.raw], axis=2)
    stacked = np.where(fit.whitener.present[:, :, None], stacked, 0.0)
    likelihood = RestrictedLikelihood(fit.whitener.of(noise), stacked)
    without = dataclasses.replace(noise, torque=(0.0, 1.0))
    sizes = [dataclasses.replace(noise, torque=(size * usual, USUAL_TORQUE)) for size in SIZES]
    still = likelihood.misfit(without)
    tried = _misfits(likelihood, sizes, still)
    starts = sizes[: len(tried)]
    if noise.torque[0] > 0:
        starts, tried = [*starts, noise], [*tried, likelihood.misfit(noise)]
    if min(tried) <= still - PROMISES * WANDERS:
        found, value = likelihood.largest(starts[int(np.argmin(tried))], [("torque", 0)])
        if value <= still - WANDERS and found.torque[0] <= most * usual:
            wanders = solved(refreshed(fit, fit.whitener.of(found)))
            explanation = dataclasses.replace(explanation, fit=wanders)
            return explanation, _slower(wanders, likelihood, value) if left_open else ()
    if not left_open:
        return explanation, ()
    if noise.torque[0] > 0:  # the settled rows show it
        return explanation, _slower(fit, likelihood, tried[-1] + float(unusual(noise.torque[1])))
    slower = [dataclasses.replace(own, torque=(own.torque[0], own.torque[1] * t)) for own in starts for t in SLOWER]
    beside = [(own, value - still) for own, value in zip(starts, tried, strict=True)]
    beside += [(own, likelihood.misfit(own) - still + float(unusual(own.torque[1]))) for own in slower]
    each = len(SIZES) * float(np.sum(np.exp(-0.5 * unusual(USUAL_TORQUE * np.array([1.0, *SLOWER])))))
    prior = 2 * float(np.log(each * (1 - WANDERING) / WANDERING))
    return explanation, tuple(_open(fit, own, behind + prior) for own, behind in beside if behind <= EXCLUDED)


def usual_torque(fit: Fit) -> float:
    """Return the torque of a machine's friction, N.m; 0 where recordings do not tell one that wanders, or are long."""
    noise = fit.whitener.noise
    machine, seat = noise.machine, noise.seat
    if machine is None or not {0, 1} <= set(seat) or fit.simulator.rows > MOST_ROWS:
        return 0.0
    a, b = machine
    shown = fit.shown[fit.whitener.moving]
    return float(abs(a[1, 0] / b[1])) * _usual_current(*(shown[:, seat.index(k)] for k in (0, 1)))


def with_usual_torque(fit: Fit, part: float) -> Fit:
    """Return the fit as it is by a torque that wanders, a part of the usual one; as it is where none is told."""
    fit = with_machine(with_level(fit))
    noise, usual = fit.whitener.noise, usual_torque(fit)
    largest = max(part * usual, noise.torque[0])
    if not largest > 0:
        return fit
    return refreshed(fit, fit.whitener.of(dataclasses.replace(noise, torque=(largest, USUAL_TORQUE))))


def _usual_current(current: FloatArray, speed: FloatArray) -> float:
    """Return the current that friction takes, A, of a machine that moves, (n,) each: its median or its mean.

    One that is always driven to another speed takes more than friction most of the time; what speeds it up comes back.
    """
    if not len(current):
        return 0.0
    return min(float(np.median(np.abs(current))), abs(float(np.mean(current * np.sign(speed)))))


def _misfits(likelihood: RestrictedLikelihood, sizes: Sequence[NoiseModel], still: float) -> list[float]:
    """Return -2 log restricted likelihood of ever larger torques, as far as any of them may be as likely as none.

    A size that is excluded and less likely than the one before it leaves larger ones less likely still.
    """
    found = [still]
    for noise in sizes:
        found.append(likelihood.misfit(noise))
        if found[-1] - still > EXCLUDED and found[-1] > found[-2]:
            break
    return found[1:]


def _slower(fit: Fit, likelihood: RestrictedLikelihood, value: float) -> tuple[OpenTorque, ...]:
    """Return the slower and larger torques that are as possible as that of a fit's noise, by -2 log its likelihood."""
    slower = _more_slowly(fit.whitener.noise)
    beside = [(own, likelihood.misfit(own) + float(unusual(own.torque[1])) - value) for own in slower]
    return tuple(_open(fit, own, behind) for own, behind in beside if behind <= EXCLUDED)


def _more_slowly(noise: NoiseModel) -> list[NoiseModel]:
    """Return noises whose torque is the same random walk for a while, but wanders more slowly, and further."""
    deviation, tau = noise.torque
    return [dataclasses.replace(noise, torque=(deviation * np.sqrt(times), tau * times)) for times in SLOWER]


def _open(fit: Fit, noise: NoiseModel, behind: float) -> OpenTorque:
    """Return the torque of a noise, with what is known of the parameters by it."""
    p = len(fit.simulator.plan.names)
    wanders = refreshed(fit, fit.whitener.of(noise))
    covariance = wanders.covariance_parts()[0][:p, :p].copy()
    k = wanders.names.index("B") if "B" in wanders.names else None
    if k is not None:
        covariance[k, k] = max(covariance[k, k], friction_variance(wanders))
    return OpenTorque(noise.torque[0], behind, covariance)


def hidden_torque(torques: Sequence[OpenTorque], fit: Fit) -> float:
    """Return the largest torque left open, N.m, by which B's averaged variance is twice its own, or more; 0: none."""
    k = fit.names.index("B") if "B" in fit.names else None
    own = 0.0 if k is None else float(fit.covariance_parts()[0][k, k])
    told = [t for t in torques if k is not None and np.exp(-0.5 * t.behind) * t.covariance[k, k] > own]
    return max((t.deviation for t in told), default=0.0)
