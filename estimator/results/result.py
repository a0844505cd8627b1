"""The outcome of an estimation: values, their standard errors, a verdict. Knows no FMU and no search.

Best values never travel alone: every parameter carries its standard error, its bounds and a status; the whole
carries a verdict with its reasons, and what the estimate cost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Verdict = Literal["ok", "doubtful", "refused"]
Status = Literal["ok", "doubtful", "not identified"]
Bound = Literal["lower", "upper"]
ALIKE = 2.0  # of the criterion: explanations that are no further apart are as likely


@dataclass(frozen=True)
class Setting:
    """What a parameter sets in the FMU: a variable and its value, in the variable's own unit."""

    variable: str
    value: float
    unit: str
    type: str = "Real"  # of FMI: "Real", "Integer", "Boolean", …


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: its value and how well the recording tells it.

    Attributes
    ----------
    name, unit : str
        As in the FMU; SI.
    value : float
        Estimate, in `unit`.
    standard_error : float or None
        One standard deviation, in `unit`; None where the method gives none or it cannot be computed.
    lower, upper : float
        Bounds that the estimate had to respect, in `unit`.
    at_bound : "lower", "upper" or None
    status : "ok", "doubtful" or "not identified"
    reason : str or None
        Why the status is not ok.
    free : bool
        False for a parameter that was fixed by the user.
    nominal : float or None
        The user's nominal value, in `unit`, for comparison only.
    settings : tuple of Setting, or None
        What it sets in the FMU; empty for a value of the measurement chain; None: the variable of its own name.
    repeatability : float or None
        Standard deviation between runs, in `unit`, part of the standard error; 0 where they agree; None: one recording.
    budget : source → change, in `unit`, by one standard uncertainty of what no recording tells
    """

    name: str
    value: float
    unit: str
    lower: float
    upper: float
    standard_error: float | None = None
    at_bound: Bound | None = None
    status: Status = "ok"
    reason: str | None = None
    free: bool = True
    nominal: float | None = None
    settings: tuple[Setting, ...] | None = None
    repeatability: float | None = None
    budget: Mapping[str, float] = field(default_factory=dict)

    @property
    def uncertainty(self) -> float | None:
        """The combined standard uncertainty, in `unit`: the standard error and the budget (GUM 5.1.2)."""
        return None if self.standard_error is None else math.hypot(self.standard_error, *self.budget.values())

    @property
    def is_told(self) -> bool:
        """Whether the recording says anything of it: not, if its value is one of many that fit as well."""
        return self.status != "not identified" or self.standard_error is not None or self.at_bound is not None

    @property
    def set_in_fmu(self) -> tuple[Setting, ...]:
        """What it sets in the FMU."""
        return (Setting(self.name, self.value, self.unit),) if self.settings is None else self.settings


@dataclass(frozen=True)
class DerivedQuantity:
    """Something that follows from the parameters, such as a time constant: value, standard error, SI unit, budget."""

    value: float
    standard_error: float
    unit: str
    budget: Mapping[str, float] = field(default_factory=dict)

    @property
    def uncertainty(self) -> float:
        """The combined standard uncertainty, as a parameter's."""
        return math.hypot(self.standard_error, *self.budget.values())


@dataclass(frozen=True)
class StandardUncertainty:
    """What was given of a quantity that no recording tells, and what of it the recordings leave.

    Attributes
    ----------
    given : str
        "1 %".
    distribution : "rectangular" or "normal"
    value : float
        Standard uncertainty as given; a share where `unit` is empty.
    left : float
        Part of it that the recordings leave open, 0 to 1.
    """

    given: str
    distribution: str
    value: float
    unit: str
    left: float


@dataclass(frozen=True)
class RivalParameter:
    """A parameter as another explanation gives it: value and standard error, in `unit`; None where it has none."""

    value: float
    standard_error: float | None
    unit: str


@dataclass(frozen=True)
class NotVisible:
    """An effect that may be there unnoticed: up to which size, and by how much parameters are then off.

    Attributes
    ----------
    effect, size, unit
        One of this size is found as likely as not.
    off : name → (part of the value, standard errors)
        Estimate less true value, of each parameter that it moves far, the farthest first.
    whatever_size : bool
        That is a usual size, and a larger one would not be found either.
    """

    effect: str
    size: float
    unit: str
    off: Mapping[str, tuple[float, float]]
    whatever_size: bool = False


@dataclass(frozen=True)
class Rival:
    """Another explanation of the recordings, nearly as likely, that gives other parameters.

    Attributes
    ----------
    what : str
        "sag instead of voltage dip".
    parameters : name → RivalParameter
    differs_in : str
        The parameter that it moves by most standard errors.
    estimated : float
        The estimate's value of that parameter.
    apart : float
        By so many standard errors, as they were if the estimate's explanation were known to hold.
    behind : float
        Of the criterion, above the estimate's; a difference of 2 is likelier by e.
    weight : float
        Its part of the mixture that the standard errors are of, 0 to 1.
    decided_by : str
        What would tell which of them holds.
    """

    what: str
    parameters: Mapping[str, RivalParameter]
    differs_in: str
    estimated: float
    apart: float
    behind: float
    weight: float
    decided_by: str

    def sentence(self) -> str:
        """Say what else would explain the recordings, and what it changes."""
        value = self.parameters[self.differs_in].value
        well = "better, by the noise that was found" if self.behind < -ALIKE else "nearly as well"
        return (
            f"{self.what} would explain the recording {well}, with {self.differs_in} = {value:.4g} instead of"
            f" {self.estimated:.4g}; {self.decided_by}"
        )


@dataclass(frozen=True)
class Comparison:
    """Measured against simulated signals of one recording.

    Attributes
    ----------
    name : str
        The recording.
    time : (n,) array, s
    inputs : name → (n,) array, SI
    measured, simulated : output name → (n,) array, SI
        NaN where a sample is missing. Sample k is taken at time[k], before input[k] acts.
    units : output or input name → SI unit
    left_out : output name → (n,) array of bool
        Samples that the fit left out as outliers; an output without such is not there.
    taken_out : output name → (n,) array, SI
        What of measured minus simulated was found to be ripple or drift, and no misfit; 0 where nothing was.
    fine : between the samples of the enlarged part, or None
    """

    name: str
    time: FloatArray
    inputs: Mapping[str, FloatArray]
    measured: Mapping[str, FloatArray]
    simulated: Mapping[str, FloatArray]
    units: Mapping[str, str]
    left_out: Mapping[str, BoolArray] = field(default_factory=dict)
    taken_out: Mapping[str, FloatArray] = field(default_factory=dict)
    fine: FineSignals | None = None


@dataclass(frozen=True)
class FineSignals:
    """Simulated signals on a finer grid than the recording's, over a part of it: (m,) s, and name → (m,) SI."""

    time: FloatArray
    simulated: Mapping[str, FloatArray]


@dataclass(frozen=True)
class SearchHistory:
    """The search seen from outside, one entry a generation.

    Attributes
    ----------
    simulations : (g,) array
        FMU runs started so far.
    best, median : (g,) array
        Cost of the best and of the median nest.
    lower, upper : (g,) arrays, or None
        Costs of the nests at the quartiles: half of all nests lie between.
    """

    simulations: FloatArray
    best: FloatArray
    median: FloatArray
    lower: FloatArray | None = None
    upper: FloatArray | None = None


@dataclass(frozen=True)
class CostProfile:
    """How the cost rises around one parameter's estimate; a rise of 1 is one standard error.

    Attributes
    ----------
    values : (n,) array
        Of the parameter, in its unit, increasing; the estimate is among them.
    held, followed : (n,) arrays
        Rise with the other parameters held, and with them moved to where they fit best; NaN where the FMU failed.
    """

    values: FloatArray
    held: FloatArray
    followed: FloatArray


@dataclass(frozen=True)
class OtherValues:
    """What recordings that an estimate was not fitted to would have instead of its values.

    Attributes
    ----------
    chi_square, degrees : how far these are from the estimate's, with the covariances of both; its degrees of freedom
    chance : of a larger one where the estimate holds
    values : name → value that these recordings alone want
    worst, apart, estimated : the one that is farthest, by how many standard errors of both, and its estimate
    """

    chi_square: float
    degrees: int
    chance: float
    values: Mapping[str, float]
    worst: str
    apart: float
    estimated: float

    def sentence(self, titles: str) -> str:
        """Say that these recordings want other values."""
        chance = f"{self.chance:.1g}" if self.chance > 1e-12 else "below 1e-12"
        return (
            f"{titles} would have other parameters, most of all {self.worst} = {self.values[self.worst]:.4g} instead of"
            f" {self.estimated:.4g}, {self.apart:.1f} standard errors apart (chi-square {self.chi_square:.3g} of"
            f" {self.degrees} degrees of freedom, by chance {chance})"
        )


@dataclass(frozen=True)
class Validation:
    """An estimate against recordings that it was not fitted to.

    Attributes
    ----------
    comparisons : one a recording
    rmse : output name → root mean square error, SI units
    fit_percent : output name → 100 (1 − ‖e‖ / ‖y − mean‖)
    chain : what was fitted to these recordings all the same: their delays, offsets and own parameters → value
    units : name of such a value → SI unit
    others : whether these recordings want other parameters; None where the estimate has no standard errors
    """

    comparisons: tuple[Comparison, ...]
    rmse: Mapping[str, float]
    fit_percent: Mapping[str, float]
    chain: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    others: OtherValues | None = None


@dataclass(frozen=True)
class Estimate:
    """What one estimation found, what it cost, and how to repeat it.

    Attributes
    ----------
    verdict : "ok", "doubtful" or "refused"
    reasons : sentences; empty when ok
    notes : sentences about what was found in the data and used (where the step is, noise, what settled)
    parameters : name → ParameterEstimate; may be empty when refused
    derived : name → DerivedQuantity; gains and time constants, those that the recordings tell
    chain : what was estimated of the measurement chain (delay, offset i, …) → ParameterEstimate
    chosen : what of it was chosen, not fitted by derivatives: switches of the drive, samples of a mean → number
    sensors : output name → what its sensor was taken for: sensor, average, filters, gain, offset, delay
    effects : names of the effects that were found of the bench, as explaining/effects names them
    read : what was read, one mapping a recording: recording, signals (column, unit, who said it), text, implausible
    recordings : what was done to each recording, one mapping each (window, scale, offset, delay, temperature)
    correlation : (p, p) array over the free parameters in the order of `correlated`, or None
    correlated : names of the rows and columns of `correlation`
    information : "eigenvalues" of the scaled Fisher information (its diagonal is 1), ascending, and "least_told":
        parameter name → part in the direction of the least of them
    rmse : output name → root mean square error over all samples used, SI units
    fit_percent : output name → 100 (1 − ‖e‖ / ‖y − mean‖)
    noise : output name → standard deviation of the residuals, without what was taken out of them, SI units
    sample_noise : output name → that of the noise from sample to sample, as the data alone show it, SI units
    simulations : FMU runs started, cut-short ones, probe and step check included
    simulations_by_phase : phase name → runs; sums to `simulations`
    failed_simulations : runs in which the FMU failed
    failures : sentences, one a kind of failure, with the parameters of its first occurrence
    steps : communication steps really done
    seconds : from data loaded to result, imports excluded
    fmu : facts about the FMU (name, path, version, kind, guid, how it was driven)
    versions : package name → version
    comparisons : one a recording
    history : the search seen from outside, or None
    profiles : parameter name → CostProfile, where they were asked for
    validation : how the model does on recordings that it has not seen, where some were given
    rivals : other explanations, nearly as likely, that give other parameters
    not_visible : effects that may be there unnoticed and move a parameter far beyond its standard error
    tolerances : source → StandardUncertainty of what no recording tells, as it was given
    about : what the user says of it: motor, operator, date, … → text
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    parameters: Mapping[str, ParameterEstimate]
    method: str
    seed: int
    simulations: int
    simulations_by_phase: Mapping[str, int]
    failed_simulations: int
    steps: int
    seconds: float
    fmu: Mapping[str, Any]
    versions: Mapping[str, str]
    chain: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    chosen: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    read: tuple[Mapping[str, Any], ...] = ()
    recordings: tuple[Mapping[str, Any], ...] = ()
    rmse: Mapping[str, float] = field(default_factory=dict)
    fit_percent: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    sample_noise: Mapping[str, float] = field(default_factory=dict)
    derived: Mapping[str, DerivedQuantity] = field(default_factory=dict)
    correlation: FloatArray | None = None
    correlated: tuple[str, ...] = ()
    information: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    history: SearchHistory | None = None
    workers: int = 1
    profiles: Mapping[str, CostProfile] = field(default_factory=dict)
    validation: Validation | None = None
    rivals: tuple[Rival, ...] = ()
    not_visible: tuple[NotVisible, ...] = ()
    tolerances: Mapping[str, StandardUncertainty] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)
