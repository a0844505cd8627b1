"""What an effect is: data on how a bench may differ from the model. Knows plans and fits, no selection.

An effect says what may be added to an explanation: nuisance parameters, which are simulated, or columns, which are
linear. How it is tested, accepted, averaged or dropped is the same for all (selection.py). docs/add-an-effect.md shows
how to add one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit, Linear
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

USUAL, SELDOM = 0.2, 0.02  # of the recordings of a bench that have an effect of a kind, roughly
TAU_RATIO, SHORTEST_TAU = 1.5, 2.0  # of neighbours among time constants that are tried; in samples


@dataclass(frozen=True)
class Effect:
    """One way in which a bench differs from the model.

    Attributes
    ----------
    name : str
        Of the effect; its parts begin with it.
    prior : float
        Share of recordings that have it, roughly: it weighs in a decision with 2 log (1 / prior).
    doubt : str
        Why an estimate that needs it is doubtful; "" where it is harmless once modelled.
    fmu : str
        A bundled FMU that has it; "": the case's own.
    sharp : bool
        It shows at edges, or as lines: it is looked for before the noise has a colour, which would hold it already.
    is_line : bool
        It shows as lines of a spectrum: they are no part of the noise, and nothing else stands in for them.
    is_one : bool
        Its groups are one thing at different numbers: of those that are left open the likeliest stands for all.
    excludes : names of nuisances or columns begin with these where the effect makes no sense beside them
    """

    name: str
    prior: float = USUAL
    doubt: str = ""
    fmu: str = ""
    sharp: bool = False
    is_line: bool = False
    is_one: bool = False
    excludes: tuple[str, ...] = ()

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the nuisance parameters that a plan may have of it."""
        return ()

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return groups of columns that may explain what a fit leaves."""
        return ()

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return a group as it is at a fit's values and its own coefficients: made at others; None: as it is."""
        return next((g for g in self.linear(fit) if g.name == group.name), None)

    def always(self, fit: Fit) -> Sequence[Linear]:
        """Return the groups of columns that are free from the start: what a sensor leaves open by its nature."""
        return ()

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return nuisances with the values at which the recordings show them before any fit: where a fit begins."""
        return {}

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return values at which the recordings may be explained as well: of two lags in series, each the other's."""
        return ()

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say that it is there, of this size."""
        return f"{name} is estimated"


def time_constants(step: float, longest: float) -> FloatArray:
    """Return the time constants, s, that an effect tries: from two samples to the longest, in equal ratios."""
    shortest = SHORTEST_TAU * step
    count = 1 + int(max(0.0, np.log(longest / shortest) / np.log(TAU_RATIO)))
    return np.asarray(shortest * TAU_RATIO ** np.arange(count))
