"""Noise of a measured voltage that the current does not answer to: told before any fit. Knows plans, no fit.

A motor answers to a jump of its voltage, with all that its sensors add, in the samples that follow; so it does to each
jump of a noise. Of noise that is its sensor's alone there is no answer. A model that it drives would show one, and
delays, filters and drops are then told that are not there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import MEDIAN_SIZE
from estimator.explaining.effects.voltage_noise import VoltageNoise, levels_of, noise_of, quieted
from estimator.fitting.fit import Fit
from estimator.plans.plan import Observed, Plan
from estimator.recordings.samples import filled, median
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

LARGE = 0.3  # of the largest change of a voltage: a change whose answer is read
ANSWER, BEFORE = 40, 3  # samples in which an answer comes, and samples before it
LEAST_ANSWER = 10  # samples behind a change, at least
CLEAR = 0.2  # of an answer's power that may be the current's noise
ABSENT, SURE = 0.4, 4.0  # part of the answers that would be seen, and standard errors from what is seen
OUTLIER = 5.0  # deviations of what the current does from row to row: more is the answer to a change
WHITE = 4.0  # standard errors of the correlation of neighbours: a noise with more is another thing
ALIKE_ROWS = 10  # over which errors of neighbours may hang together
DIFFERENCES: tuple[Callable[[FloatArray], FloatArray], ...] = (np.diff, lambda x: np.diff(x, n=2))


class Quieted(NamedTuple):
    """A plan with the voltages that the motor sees, what was done, in words, and whether the currents alone tell so."""

    plan: Plan
    told: str
    is_sure: bool


def quieted_at_sight(plan: Plan) -> Quieted | None:
    """Return a plan with the voltages that the motor sees; None where their noise reaches it, or there is none.

    Of voltages whose noise is all that they do beside their levels: what follows a current is told by a fit.
    """
    measured = [o.is_measured for o in plan.observed]
    if not any(measured) or any(o.is_quiet or "i" not in o.outputs for o in plan.observed):
        return None
    nothing = [np.zeros((len(o.inputs["v"]), 0)) for o in plan.observed]
    around = _noises(plan, nothing)
    if not all(_is_white(o.inputs["v"], own) for o, own in zip(plan.observed, around, strict=True)):
        return None
    part, error = answered(plan.observed, around)
    if part - SURE * error > 0:
        return None
    is_sure = abs(part) + SURE * error < ABSENT
    told = VoltageNoise().tell(VoltageNoise.name, 1 - part if is_sure else 1.0, plan)
    return Quieted(quieted(plan, around, nothing), told, is_sure)


def quieted_again(quiet: Plan, noisy: Plan, fit: Fit) -> Plan:
    """Return a plan that is quiet at sight, of recordings as they are in a noisy one, as a fit explains them.

    Their voltages may follow what the fit shows, as those of a source do that sags.
    """
    explained = np.nan_to_num(fit.explained)
    shown = [explained[clock.rows] for clock in fit.simulator.clocks]
    observed = tuple(
        dataclasses.replace(o, inputs={**o.inputs, "v": was.inputs["v"]}, is_quiet=False)
        for o, was in zip(quiet.observed, noisy.observed, strict=True)
    )
    plan = dataclasses.replace(quiet, observed=observed)
    return quieted(plan, _noises(plan, shown), shown)


def _noises(plan: Plan, shown: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the noise of each recording's voltage, V, (n,); none of a command's. `shown` as for `noise_of`."""
    return [
        noise_of(o.inputs["v"], own) if o.is_measured else np.zeros(len(own))
        for o, own in zip(plan.observed, shown, strict=True)
    ]


def answered(observed: Sequence[Observed], around: Sequence[FloatArray]) -> tuple[float, float]:
    """Return which part of the answer to a noise the currents show, and its standard error; infinite: none is told.

    Parameters
    ----------
    around : (n,) arrays
        The noise of each recording's voltage, V; one without any tells nothing.
    """
    pairs = [
        (_late(own, answer), o.outputs["i"])
        for o, own in zip(observed, around, strict=True)
        if own.any() and (answer := answer_to_changes(o)) is not None
    ]
    found = [_part([_kept(difference(x), difference(i)) for x, i in pairs]) for difference in DIFFERENCES]
    return min(found, key=lambda f: f[1])


def _late(noise: FloatArray, answer: FloatArray) -> FloatArray:
    """Return what a current does by a noise, (n,), by its answer to 1 V, (k,), which begins `BEFORE` rows before it."""
    padded = np.concatenate([noise, np.zeros(BEFORE)])
    return np.asarray(np.convolve(padded, answer)[BEFORE : BEFORE + len(noise)])


def _kept(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what is expected and seen, (n,) each, without what is no noise: the answer to a change, a missing row."""
    known = np.isfinite(y)
    size = np.abs(np.where(known, y, 0.0) - median(y[known]))
    kept = known & (size < OUTLIER * median(size[known]) / MEDIAN_SIZE)
    return np.where(kept, x, 0.0), np.where(kept, y, 0.0)


def _part(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[float, float]:
    """Return the part of what is expected that is seen, and its standard error, of errors that hang together."""
    power = sum(float(x @ x) for x, _ in pairs)
    if not power > 0:
        return 0.0, np.inf
    part, variance = sum(float(x @ y) for x, y in pairs) / power, 0.0
    for x, y in pairs:
        errors = x * (y - part * x)
        variance += float(errors @ errors)
        for k in range(1, min(ALIKE_ROWS, len(errors))):
            variance += 2 * (1 - k / ALIKE_ROWS) * float(errors[k:] @ errors[:-k])
    return part, float(np.sqrt(max(variance, 0.0))) / power


def answer_to_changes(o: Observed) -> FloatArray | None:
    """Return how the current answers to 1 V that is there for a row, A, (k,), from some rows before; None: unknown."""
    v, i = o.inputs["v"], filled(o.outputs["i"])
    levels = levels_of(v)
    means = [median(v[level]) for level in levels]
    changes = [
        (level, here - last)
        for level, last, here in zip(levels[1:], means, means[1:], strict=False)
        if level.start > BEFORE and level.stop - level.start >= LEAST_ANSWER
    ]
    largest = max((abs(by) for _, by in changes), default=0.0)
    changes = [(level, by) for level, by in changes if abs(by) >= LARGE * largest > 0]
    if not changes:
        return None
    sums, weights = np.zeros(BEFORE + ANSWER), np.zeros(BEFORE + ANSWER)
    for level, by in changes:
        at = level.start
        rows = i[at - BEFORE : min(at + ANSWER, level.stop)] - float(np.mean(i[at - BEFORE : at - 1]))
        sums[: len(rows)] += by * rows
        weights[: len(rows)] += by * by
    step = sums[weights > 0] / weights[weights > 0]
    step = step[: int(np.argmax(step)) + 2]
    answer = np.diff(step, prepend=0.0)
    errors = 2 * len(answer) * noise_deviation(o.outputs["i"]) ** 2 / float(np.max(weights))
    return answer if errors < CLEAR * float(answer @ answer) else None


def _is_white(v: FloatArray, around: FloatArray) -> bool:
    """Whether what a voltage does about its levels, (n,), is a noise, in each of them."""
    for level in levels_of(v):
        own = around[level]
        power = float(own @ own)
        if len(own) > LEAST_ANSWER and power > 0:
            alike = float(own[1:] @ own[:-1]) / power
            if abs(alike) * np.sqrt(len(own)) > WHITE:
                return False
    return True
