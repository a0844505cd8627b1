"""A sensor of the current with two ranges, whose gains differ: a meter that switches, a log of two channels."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.of_signals import MOST_CHANGE
from estimator.fitting.fit import Fit, Linear, refreshed
from estimator.fitting.score_test import likeliest
from estimator.plans.part import LONG

FloatArray = NDArray[np.float64]

FINE = 8  # limits from one that is tried to the next
LOWEST, RATIO, COARSE = 0.05, 1.25, 14  # of the largest current: the first limit tried, the next ones, how many
LEAST_ROWS = 3  # on either side of a limit


@dataclass(frozen=True)
class GainByRange(Effect):
    """By which part the gain of large currents is that of small ones more; which of both is right is not known."""

    name: str = "gain by range of i"
    prior: float = SELDOM / 10  # few sensors switch while they record
    share: float = 0.5
    doubt: str = "the current sensor has another gain for large currents: check the scales of its ranges"
    sentence: str = "the gain of large currents differs by {percent:.3g} % from that of small ones"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for each limit that is tried; none of a long recording."""
        return list(self._of_limits(fit, fit.shown, range(0, FINE * COARSE, FINE)))

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the limit near the group's own that explains most beside all else."""
        near = range(max(group.form - FINE, 0), group.form + FINE + 1)
        found = list(self._of_limits(fit, fit.shown + group.columns @ coefficients, near))
        if not found:
            return None
        exact = refreshed(fit, dataclasses.replace(fit.whitener, shared=None))
        along, power = exact.test().scores(np.concatenate([g.columns for g in found], axis=2))
        return found[likeliest(np.abs(along), power)]

    def _of_limits(self, fit: Fit, shown: FloatArray, limits: range) -> Iterator[Linear]:
        s = fit.simulator
        if "i" not in s.outputs or "gain i" in s.plan.declared or s.rows > LONG or not np.isfinite(shown).all():
            return
        j = s.outputs.index("i")
        i = shown[:, j]
        for k in limits:
            is_large = np.abs(i) > LOWEST * RATIO ** (k / FINE) * np.max(np.abs(i))
            if not LEAST_ROWS <= np.count_nonzero(is_large) <= len(i) - LEAST_ROWS:
                continue
            columns, uncertain = (np.zeros((*shown.shape, 1)) for _ in range(2))
            columns[:, j, 0], uncertain[:, j, 0] = np.where(is_large, 0.5, -0.5) * i, 0.5 * i
            yield Linear(
                self.name, columns, ("",), least=-MOST_CHANGE, most=MOST_CHANGE, one_of=COARSE, form=k,
                uncertain=uncertain,
            )  # fmt: skip
