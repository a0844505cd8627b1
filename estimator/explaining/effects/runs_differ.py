"""A parameter that changes from run to run: a motor that warms, another of the line. Its size: between_runs.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.explaining.between_runs import BETWEEN
from estimator.explaining.effects.base import USUAL, Effect
from estimator.fitting.fit import Fit, Linear

USUAL_CHANGE = 0.03  # of a parameter, between runs
MOST_CHANGE = 1.0  # of a logarithm


@dataclass(frozen=True)
class RunsDiffer(Effect):
    """Deviation of one parameter in each recording from the mean of all, to first order."""

    name: str = BETWEEN.strip()
    prior: float = USUAL / 5  # motors have five parameters
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
            columns = np.zeros((*own.shape, len(first)))
            for k, rows in enumerate(first):
                columns[rows, :, k], columns[last, :, k] = own[rows], -own[last]
            if np.any(columns):
                name = f"{parameter.name}{BETWEEN}"
                found.append(
                    Linear(name, columns, ("",) * len(first), least=-MOST_CHANGE, most=MOST_CHANGE, size=USUAL_CHANGE)
                )
        return found
