"""A parameter that changes from run to run: a motor that warms, another of the line. Its size: between_runs.py.

It is found by derivatives, and then followed by secants to what the motor shows with each run's own value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.between_runs import BETWEEN
from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear

FloatArray = NDArray[np.float64]

USUAL_CHANGE = 0.03  # of a parameter, between runs
MOST_CHANGE = 1.0  # of a logarithm
DRY = "friction"  # of the machine, beside the viscous one
PARAMETERS = 5  # of a motor: any of them may change
LEAST_SECANT, MOST_SECANT = 1e-3, 3.0  # of a logarithm: of a smaller or larger change the secant is that of this one


@dataclass(frozen=True)
class RunsDiffer(Effect):
    """Deviation of one parameter in each recording from the mean of all."""

    name: str = BETWEEN.strip()
    follows: bool = True
    sentence: str = ""  # the random effect of all runs is reported instead (between_runs.py)

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one group for each shared parameter: its derivatives in each recording less those in the last."""
        s, found = fit.simulator, []
        if len(s.clocks) < 2:
            return ()
        *first, last = [clock.rows for clock in s.clocks]
        for parameter in s.plan.parameters:
            if parameter.name not in fit.free or parameter.recording is not None or not parameter.log:
                continue
            own = fit.raw[:, :, fit.free.index(parameter.name)]
            if (beside := _beside(fit, parameter.name)) is not None:
                of_dry = fit.raw[:, :, fit.free.index(beside)]
                own = own + (of_dry if s.log[s.index[beside]] else fit.value(beside) * of_dry)
            columns = _less_in_the_last(own, first, last)
            if np.any(columns):
                name = f"{parameter.name}{BETWEEN}"
                found.append(
                    Linear(
                        name, columns, ("",) * len(first), least=-MOST_CHANGE, most=MOST_CHANGE, size=USUAL_CHANGE,
                        one_of=PARAMETERS,
                    )
                )  # fmt: skip
        return found

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the secants to what each recording shows with its own value."""
        s, name = fit.simulator, group.name.removesuffix(BETWEEN)
        k, each, beside = s.index[name], [clock.rows for clock in s.clocks], _beside(fit, name)
        changes = np.append(coefficients, -np.sum(coefficients))
        changes = np.clip(changes, -MOST_SECANT, MOST_SECANT)
        changes = np.where(np.abs(changes) < LEAST_SECANT, np.copysign(LEAST_SECANT, changes), changes)
        candidates = np.repeat(fit.values[None], len(changes), axis=0)
        candidates[:, k] = np.clip(candidates[:, k] * np.exp(changes), s.lower[k], s.upper[k])
        changes = np.log(candidates[:, k] / fit.values[k])
        if beside is not None:
            candidates[:, s.index[beside]] *= np.exp(changes)
        secants = np.zeros_like(fit.shown)
        for rows, shown, change in zip(each, s.shown(candidates), changes, strict=True):
            if change == 0 or not np.isfinite(shown[rows]).all():
                return None
            secants[rows] = (shown[rows] - fit.shown[rows]) / change
        return replace(group, columns=_less_in_the_last(secants, each[:-1], each[-1]))


def _beside(fit: Fit, name: str) -> str | None:
    """Return what changes in the same proportion as a parameter: with B the dry friction of the same bearings."""
    return DRY if name == "B" and DRY in fit.free else None


def _less_in_the_last(own: FloatArray, first: Sequence[slice], last: slice) -> FloatArray:
    """Return a derivative, (rows, q), in each of the first recordings, less that in the last, (rows, q, first)."""
    columns = np.zeros((*own.shape, len(first)))
    for k, rows in enumerate(first):
        columns[rows, :, k], columns[last, :, k] = own[rows], -own[last]
    return columns
