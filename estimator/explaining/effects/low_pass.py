"""A low-pass of first or second order in a channel: an amplifier, an anti-aliasing filter, an observer.

Of second order are two equal lags, and Butterworth's, the usual anti-aliasing filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect, longest_lateness
from estimator.fitting.fit import Fit
from estimator.fitting.simulator import Nuisance
from estimator.motor.exponential import exponential
from estimator.motor.winding import time_constant
from estimator.noise.recursion import Sections, behind, recursion
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

LATE_SPEED = "delay of w"
TRIED = (0.3, 1.5, 6.0, 40.0, 200.0)  # samples, to half the longest
EXPONENTIAL, TRIED_BY_ROWS = "exponential filter", (1.5, 6.0, 40.0)


def lag(tau: float, h: float) -> Sections:
    """Return the section of tau x' + x = y, exact for a signal on lines between its samples; none where tau is 0."""
    if tau <= 0:
        return ()
    a = float(np.exp(-h / tau))
    return (((1 - (1 - a) * tau / h, (1 - a) * tau / h - a), (-a,)),)


def two_lags(tau: float, h: float) -> Sections:
    """Return the sections of two equal lags."""
    return (*lag(tau, h), *lag(tau, h))


def second_order(tau: float, h: float) -> Sections:
    """Return the section of tau^2 x'' + sqrt(2) tau x' + x = y; none where tau is 0."""
    return (_butterworth(h / tau),) if tau > 0 else ()


def through(of: Callable[[float, float], Sections], y: FloatArray, tau: float, h: float) -> FloatArray:
    """Return y behind a filter's sections, at rest before the first."""
    sections = of(tau, h)
    if not sections:
        return y
    shown = np.empty(len(y))
    behind(sections, np.asarray(y, dtype=np.float64)[:, None], shown)
    return shown


@lru_cache(maxsize=64)
def _butterworth(step: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return b (3,) and a (2,) of the recursion, of a step in units of the time constant."""
    whole = np.zeros((4, 4))  # of [x, x', y, y'], y on a line over the step
    whole[0, 1], whole[1, :3], whole[2, 3] = 1.0, (-1.0, -np.sqrt(2.0), 1.0), 1.0
    after = exponential(whole * step)
    f, last = after[:2, :2], after[:2, 3] / step
    first = after[:2, 2] - last
    trace, turned = float(np.trace(f)), f - np.trace(f) * np.eye(2)
    b = last[0], first[0] + (turned @ last)[0], (turned @ first)[0]
    return tuple(map(float, b)), (-trace, float(np.linalg.det(f)))


FORMS: Mapping[str, tuple[Callable[[float, float], Sections], float, str]] = {
    "lag": (lag, 1.0, "a low-pass of first order"),
    "second-order lag": (two_lags, 2.0, "a low-pass of second order"),
    "Butterworth low-pass": (second_order, np.sqrt(2.0), "a Butterworth low-pass of second order"),
}  # of each: its sections, its delay in time constants, words


@dataclass(frozen=True)
class LowPass(Effect):
    """A low-pass of one output, its time constant in s."""

    name: str = "lag"
    sharp: bool = True
    lateness: float = 1.0

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each output without a declared filter."""
        h, longest, own = plan.shortest_step, longest_lateness(plan), FORMS[self.name][0]
        tries = tuple(n * h for n in TRIED if n * h < 0.5 * longest)
        return [
            Nuisance(
                f"{self.name} of {y}", "s", 0.0, longest, 0.0, h,
                output=y, act=partial(through, own), sections=own, between=True,
                tries=tries, excludes=tuple(f"{form} of {y}" for form in (*FORMS, EXPONENTIAL)),
            )
            for y in plan.outputs
            if f"filter {y}" not in plan.declared and y != "angle"
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return the sensor's lag as the winding's, and the winding's as the sensor's, which is of first order.

        The speed follows the winding's current, whatever is shown of it: behind the other winding it is earlier or
        later, which its own sensor may make up for.
        """
        s = fit.simulator
        if not name.endswith(" i") or not {"R", "L"} <= set(fit.free):
            return ()
        R, L, tau = map(fit.value, ("R", "L", name))
        first = "lag of i"
        if tau <= 0 or first not in s.index:
            return ()
        exchanged = {"L": R * self.lateness * tau, name: 0.0, first: time_constant(R, L)}
        if LATE_SPEED not in s.index:
            return (exchanged,)
        late = fit.value(LATE_SPEED) + time_constant(R, L) - self.lateness * tau
        return (exchanged, {**exchanged, LATE_SPEED: late}) if late > 0 else (exchanged,)

    def in_two(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return means of n samples behind a lag of first order, together as late as one of second order."""
        s, y = fit.simulator, name.rpartition(" ")[2]
        late, mean, first = self.lateness * fit.value(name), f"average {y}", f"lag of {y}"
        if name == first or not {mean, first} <= set(s.index):
            return ()
        h = s.plan.shortest_step
        numbers = s.nuisance(mean).tries
        lags = {n: late - 0.5 * (n - 1) * h for n in numbers}
        return [{name: 0.0, mean: n, first: tau} for n, tau in lags.items() if tau > 0]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say which."""
        y = name.rpartition(" ")[2]
        return f"{y} is shown through {FORMS[self.name][2]} with a time constant of {1e3 * value:.3g} ms"


def by_rows(y: FloatArray, tau: float, h: float) -> FloatArray:
    """Return x of x[k] = a x[k - 1] + (1 - a) y[k], a = exp(-h / tau), at rest before the first row."""
    if tau <= 0:
        return y
    a = float(np.exp(-h / tau))
    return np.asarray(recursion([1 - a], [-a], y))


@dataclass(frozen=True)
class ExponentialFilter(LowPass):
    """An exponential filter that a logger takes from row to row, its time constant in s.

    It has no memory of what was between the rows: it is half a row less late than a low-pass before the converter.
    Told only where no explanation without it is near: of real recordings it stands for a mean of three samples.
    """

    name: str = EXPONENTIAL
    prior: float = 0.1
    is_last: bool = True

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return one for each output without a declared filter."""
        h, longest = plan.shortest_step, longest_lateness(plan)
        tries = tuple(n * h for n in TRIED_BY_ROWS if n * h < 0.5 * longest)
        return [
            Nuisance(
                f"{EXPONENTIAL} of {y}", "s", 0.0, longest, 0.0, h, output=y, act=by_rows, tries=tries,
                excludes=tuple(f"{form} of {y}" for form in FORMS),
            )
            for y in plan.outputs
            if f"filter {y}" not in plan.declared and y != "angle"
        ]  # fmt: skip

    def in_two(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return none."""
        return ()

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say with which coefficient."""
        y, share = name.rpartition(" ")[2], -float(np.expm1(-plan.shortest_step / value)) if value > 0 else 1.0
        return f"{y} is shown through an exponential filter that takes {share:.3g} of each row"
