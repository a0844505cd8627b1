"""A case made concrete: recordings mapped on an FMU, free parameters, sensors. Knows no file, simulates nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.case import Case, Chebyshev1
from estimator.excitation import Excitation
from estimator.fmu import FmuDescription
from estimator.parameters import Parameter
from estimator.recording import Recording

FloatArray = NDArray[np.float64]

MOTOR = ("R", "K", "L", "J", "B")


@dataclass(frozen=True)
class Observed:
    """One recording, mapped on the FMU.

    Attributes
    ----------
    inputs : FMU input → (n,) array
    outputs : FMU output → (n,) array, NaN where a sample is missing
    lead : int
        Samples simulated before the first of the recording, at its first inputs, so that a motor that already runs
        in the first row runs in the simulation too.
    delay : float
        s, of the outputs behind the inputs as the data show it at first sight; 0 where the parameters have a delay.
    """

    recording: Recording
    inputs: Mapping[str, FloatArray]
    outputs: Mapping[str, FloatArray]
    excitation: Excitation
    lead: int
    delay: float = 0.0


@dataclass(frozen=True)
class ChainSpec:
    """What stands between an output and what its sensor shows: samples averaged, filter, gain."""

    average: int = 1
    filter: Chebyshev1 | None = None
    gain: float = 1.0

    @property
    def is_plain(self) -> bool:
        """Whether nothing stands between, but for a gain."""
        return self.average == 1 and self.filter is None


@dataclass(frozen=True)
class Plan:
    """A case made concrete against its FMU and recordings; nothing has been simulated yet."""

    case: Case
    description: FmuDescription
    observed: tuple[Observed, ...]
    parameters: tuple[Parameter, ...]
    fixed: Mapping[str, float]
    sensors: Mapping[str, int]
    guess: Mapping[str, float]
    notes: tuple[str, ...]
    chains: Mapping[str, ChainSpec] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)  # FMU variable → text that it is set to

    @property
    def outputs(self) -> tuple[str, ...]:
        """FMU outputs that are compared."""
        return tuple(self.observed[0].outputs)

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters."""
        return tuple(p.name for p in self.parameters)
