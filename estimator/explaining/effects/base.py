"""What an effect is: data on how a bench may differ from the model. Knows plans and fits, no selection.

An effect names what may be added to an explanation: nuisance parameters, which are simulated, or linear columns. All
effects are tested, accepted, averaged and dropped in the same way (selection.py). docs/add-an-effect.md shows
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
# How late a sensor shows its signal at most: samples, or s where these are more samples, but no more than a part of the
# recording: a filter of 10 ms before a speed is as usual at 10 kHz as at 1 kHz.
LATEST_SAMPLES, LATEST_TIME, LATEST_PART = 60.0, 0.05, 0.05
TAU_RATIO, SHORTEST_TAU = 1.5, 2.0  # of neighbours among time constants that are tried; in samples


@dataclass(frozen=True)
class Effect:
    """One way in which a bench differs from the model.

    Attributes
    ----------
    name : str
        Of the effect; its parts begin with it.
    prior : float
        Prior probability of a recording to have it, roughly: the criterion has 2 log (1 / prior).
    doubt : str
        Why an estimate that needs it is doubtful; "" where it is harmless once modelled.
    fmu : str
        A bundled FMU that models it; "": the case's own.
    sharp : bool
        It shows at edges, or as spectral lines: it is tested before the noise model has correlation, which would
        contain it.
    is_line : bool
        It shows as spectral lines: they are no part of the noise, and no other effect explains them.
    follows : bool
        Its columns follow from the signals as they are explained so strongly that both are found by turns.
    lateness : float
        Mean delay of a signal for a unit of its number, s; 0: it has none, or not in proportion.
    is_last : bool
        Delays, filters and the model do nearly what it does: it is told only where no explanation without it is near.
    small : float
        A part of its usual size that is as usual, where all sizes are: what is averaged over holds both.
    share : float
        Of what is missed beyond the noise it must explain more: beside another effect that is not known it would make
        up for a part of that.
    sentence : str
        Reports it: a format of its name, the channel that this ends with, its value, and that in ms and percent.
    """

    name: str
    prior: float = USUAL
    doubt: str = ""
    fmu: str = ""
    sharp: bool = False
    is_line: bool = False
    follows: bool = False
    lateness: float = 0.0
    is_last: bool = False
    small: float = 0.0
    share: float = 0.0
    sentence: str = "{name} is estimated"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the nuisance parameters that it may add to a plan."""
        return ()

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return groups of columns that may explain a fit's residuals."""
        return ()

    def in_place_of_columns(self, plan: Plan) -> Sequence[Nuisance]:
        """Return what replaces its columns in a bundled FMU with modes, whose response is no sum: of the same names."""
        return ()

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return a group's columns computed again at a fit's values and its coefficients; None: they do not change.

        The fit is without the group, its residuals are still with it: an effect whose `linear` looks for the likeliest
        columns in them may find others, and its own then stay as they are, unless it says here how they follow.
        """
        return next((g for g in self.linear(fit) if g.name == group.name), None)

    def named(self, fit: Fit, group: Linear) -> str:
        """Return the name of a group's columns, which may have followed the fit to others."""
        return group.name

    def reshaped(self, fit: Fit, group: Linear) -> Sequence[Linear]:
        """Return the group in other forms, that may explain more than its own does."""
        return ()

    def always(self, fit: Fit) -> Sequence[Linear]:
        """Return the groups of columns that are free from the start, such as an encoder's phase."""
        return ()

    def seen(self, fit: Fit) -> Sequence[Linear]:
        """Return the groups of columns that the recordings show before any fit."""
        return ()

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return the nuisance parameters that are seen before any fit, with the values at which a fit starts."""
        return {}

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return equivalent values that explain the recordings as well: two lags in series may be exchanged.

        A nuisance parameter may take the place of the one that is named, which is neutral then.
        """
        return ()

    def in_two(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return values of two other nuisance parameters at which they do nearly what the named one does."""
        return ()

    def in_place_of_model(self, fit: Fit) -> Sequence[Mapping[str, float]]:
        """Return values, its own number's first, at which it does what the model's parameters do in a fit."""
        return ()

    def changes(self, fit: Fit, coefficient: float) -> Mapping[str, float]:
        """Return by how much parameters change during a recording: what is estimated is their mean."""
        return {}

    def size(self, fit: Fit, name: str) -> float:
        """Return how large a nuisance parameter is told to be."""
        return fit.value(name)

    def doubted(self, name: str, value: float, plan: Plan) -> str:
        """Return why an estimate that needs it at this size is doubtful; "" where it is harmless once modelled."""
        return self.doubt

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Return the sentence that reports it with its size; "": none does."""
        channel = name.rpartition(" ")[2]
        return self.sentence.format(name=name, channel=channel, value=value, ms=1e3 * value, percent=100 * value)


@dataclass(frozen=True)
class StandingLine(Effect):
    """A line of the spectrum that stays where it was found."""

    sharp: bool = True
    is_line: bool = True

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return None."""
        return None


def longest_lateness(plan: Plan) -> float:
    """Return how late a sensor may show its signal at most, s: by its delay or a filter's time constant."""
    whole = max(float(o.recording.time[-1] - o.recording.time[0]) for o in plan.observed)
    return max(LATEST_SAMPLES * plan.shortest_step, min(LATEST_TIME, LATEST_PART * whole))


def time_constants(step: float, longest: float) -> FloatArray:
    """Return the time constants, s, that an effect tries: from two samples to the longest, in equal ratios."""
    shortest = SHORTEST_TAU * step
    count = 1 + int(max(0.0, np.log(longest / shortest) / np.log(TAU_RATIO)))
    return np.asarray(shortest * TAU_RATIO ** np.arange(count))
