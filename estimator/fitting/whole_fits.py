"""Fits that a worker process takes from their start to their end, where a problem allows it. Knows no search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.differences import DIFFERENCE_STEP
from estimator.fitting.problem import Problem
from estimator.fitting.trust_region import ENDED_AT_KNOWN
from estimator.plans.parameters import Box
from estimator.stepping.layout import DONE_BESIDE, DescentLayout, FitsLayout

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class WholeFits:
    """Whole fits of a problem; None is what they return where single candidates have to be simulated for them.

    That is where a simulation failed, where what is free is not in a candidate's values, or compared as it is, and of
    an FMU that is not the package's: its simulations may be slow, and are better dealt out among many processes.
    """

    problem: Problem

    def fits(
        self,
        starts: FloatArray,
        weights: FloatArray,
        *,
        evaluations: int,
        ftol: float,
        xtol: float,
        known: tuple[FloatArray, float] | None = None,
    ) -> list[tuple[FloatArray, float] | None] | None:
        """Do least-squares fits of all parameters.

        Parameters
        ----------
        starts : (k, p) array
            On the parameters' scales, inside their bounds.
        weights : (q,) array
            On each output's residuals.
        known : optional
            An optimum, (p,), on the scales, and its cost, as in `trust_region.steps`.

        Returns
        -------
        Where each ended, (p,), on the scales, and its cost; None: at the known optimum.
        """
        box = self.problem.box
        placing = self._placing(starts[0], range(box.dimension), box)
        if placing is None or self.problem.has_free_phase:
            return None
        found = self.problem.loaded().fit(
            FitsLayout(
                **placing,
                starts=tuple(tuple(start) for start in starts.tolist()),
                evaluations=evaluations,
                ftol=ftol,
                xtol=xtol,
                least_step=DIFFERENCE_STEP,
                weights=tuple(weights.tolist()),
                known=None if known is None else tuple(known[0].tolist()),
                known_cost=0.0 if known is None else known[1],
            )
        )
        if found is None:
            return None
        return [None if how == ENDED_AT_KNOWN else (np.array(x), cost) for x, cost, how in found]

    def descend(
        self, values: FloatArray, free: Sequence[int], box: Box, weights: FloatArray, **limits: Any
    ) -> tuple[FloatArray, bool, FloatArray, FloatArray | None] | None:
        """Do a descent of what is free.

        Parameters
        ----------
        values : (p,) array
            A candidate.
        free : places among the parameters of what is free
        box : of that
        weights : (rows, outputs) array
            On the misfit of each sample; 0 where one is missing.
        limits : what else `DescentLayout` takes

        Returns
        -------
        Where it ended, (f,), on the scales, whether that is the least cost that is known, what is shown there,
        (rows, outputs), and the derivatives of that, (f, rows, outputs), or None.
        """
        placing = self._placing(values, free, box)
        if placing is None:
            return None
        found = self.problem.loaded().descend(DescentLayout(**placing, **limits), weights)
        if found is None:
            return None
        x, _, how, shown, derivatives = found
        return np.array(x), how == DONE_BESIDE, shown, derivatives

    def _placing(self, candidate: FloatArray, free: Sequence[int], box: Box) -> dict[str, Any] | None:
        description = self.problem.plan.description
        if not description.is_bundled or description.restart == "fresh process":
            return None
        return self.problem.values.placing(candidate, free, box)
