"""A case made concrete: recordings mapped on an FMU, free parameters, sensors. Knows no file, simulates nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import Case
from estimator.fmus.fmu import FmuDescription
from estimator.plans.binding import Binding
from estimator.plans.parameters import Parameter, SensorPlace
from estimator.recordings.excitation import Excitation
from estimator.recordings.filters import Filter, filter_sections
from estimator.recordings.finding import Finding
from estimator.recordings.quantum import quantum
from estimator.recordings.recording import Recording
from estimator.recordings.sensors import Section
from estimator.recordings.signal_noise import is_measured
from estimator.recordings.understood import Understood

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

PLAINLY = 0.2  # of the largest voltage: one that drives the motor, and how far apart two levels are


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
    rest : int
        Samples simulated before the first of the recording, or the lead, without any input: of a motor at rest whose
        first row has its voltage, which a delay would otherwise not reach.
    at_rest : bool
        The case says that the recording begins at rest: no motion before its voltage is looked for.
    delay : float
        s, of the outputs behind the inputs as the case says it, or as the data show it at first sight; 0 where the
        parameters have a delay.
    notes : sentences about what was done to its samples
    has_phase : bool
        Its angle begins anywhere, not where the model's does: encoder counts, or a motor that runs already.
    read : what was read: FMU input or output → its column, the time last
    findings : what of it cannot be as it was read
    uncertain : (n, k) array, optional
        V: what k errors of variance 1 add to a motor's voltage, such as those of the means of its levels.
    taken : (n,) array, optional
        s, when the rows were taken, where that is not what the clock says.
    early : float
        s before its first row for which its inputs are not known, though they have changed since.
    is_underway : bool
        The first row may lie within a response to what came before: its speed and current are estimated from the start.
    is_quiet : bool
        The voltage was measured, and what does not reach the motor of it, its sensor's noise, is left out.
    jumps : FMU input → (n,) array of bool
        Rows at which an input that goes on lines else has jumped, and stood before as in the row before.
    """

    recording: Recording
    inputs: Mapping[str, FloatArray]
    outputs: Mapping[str, FloatArray]
    excitation: Excitation
    lead: int
    delay: float = 0.0
    notes: tuple[str, ...] = ()
    has_phase: bool = False
    read: tuple[Understood, ...] = ()
    findings: tuple[Finding, ...] = ()
    rest: int = 0
    at_rest: bool = False
    uncertain: FloatArray | None = None
    taken: FloatArray | None = None
    is_underway: bool = False
    is_quiet: bool = False
    early: float = 0.0
    jumps: Mapping[str, BoolArray] = field(default_factory=dict)

    @cached_property
    def is_measured(self) -> bool:
        """Whether the voltage was measured: else it is a command."""
        return self.is_quiet or ("v" in self.inputs and is_measured(self.inputs["v"]))

    @property
    def times(self) -> FloatArray:
        """When the rows were taken, (n,), s."""
        return self.recording.time if self.taken is None else self.taken

    @property
    def before(self) -> int:
        """Samples simulated before the first of the recording."""
        return self.lead + self.rest

    def changes(self, name: str) -> FloatArray:
        """Return by how much an input changes at each row, (n,): from zero at the first, unless a motor runs there."""
        u = self.inputs[name]
        return np.diff(u, prepend=u[0] if self.lead or self.excitation.running else 0.0)

    @cached_property
    def compared(self) -> FloatArray:
        """Samples of the outputs, (before + n, q), NaN before the first of the recording; not to be changed."""
        rows = np.column_stack(list(self.outputs.values()))
        return np.concatenate([np.full((self.before, rows.shape[1]), np.nan), rows]) if self.before else rows

    def resting(self, output: str, *, without: int = 0) -> FloatArray:
        """Return an output's samples before the first voltage, (n,), but for the last `without` rows of them.

        None of a machine that turns already.
        """
        if self.excitation.kind == "none" or self.excitation.running or self.excitation.before != 0:
            return np.zeros(0)
        y = self.outputs[output][: max(0, self.excitation.index - without)]
        return y[~np.isnan(y)]

    def in_time(self) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return inputs and outputs, (n − d,) each, as if there were no delay, of d samples."""
        late = round(self.delay / self.recording.step)
        kept = len(self.recording.time) - abs(late)
        first, second = max(0, -late), max(0, late)
        inputs = {name: u[first : first + kept] for name, u in self.inputs.items()}
        return inputs, {name: y[second : second + kept] for name, y in self.outputs.items()}


@dataclass(frozen=True)
class ChainSpec:
    """What stands between an output and what its sensor shows: samples averaged, filters, gain, offset, delay."""

    average: int = 1
    filters: tuple[Filter, ...] = ()
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0  # s, beyond that of the recording
    quantum: float = 0.0  # step of the quantisation, where it is declared

    @property
    def is_plain(self) -> bool:
        """Whether nothing stands between that has a memory of samples."""
        return self.average == 1 and not self.filters

    @property
    def is_straight(self) -> bool:
        """Whether it is shown at once and as it is, but for what is averaged and filtered."""
        return (self.gain, self.offset, self.delay) == (1.0, 0.0, 0.0)

    def sections(self, step: float) -> tuple[Section, ...]:
        """Return the sections of all filters at a sampling interval in s."""
        return tuple(section for spec in self.filters for section in filter_sections(spec, step=step))


@dataclass(frozen=True)
class Plan:
    """A case made concrete against its FMU and recordings; nothing has been simulated yet."""

    case: Case
    binding: Binding
    observed: tuple[Observed, ...]
    parameters: tuple[Parameter, ...]
    fixed: Mapping[str, float]
    sensors: Mapping[str, int]
    guess: Mapping[str, float]
    notes: tuple[str, ...]
    chains: Mapping[str, ChainSpec] = field(default_factory=dict)
    declared: frozenset[str] = frozenset()  # what of the measurement chain the case says: "offset i", "delay of 0"
    wanted: tuple[SensorPlace, ...] = ()  # what of it the case frees
    temperatures: tuple[float | None, ...] = ()  # °C, of the winding, one a recording
    stands_at: float | None = None  # °C, for which a shared R stands; None: it is one in all

    @property
    def description(self) -> FmuDescription:
        """The FMU, in SI units."""
        return self.binding.description

    def unit(self, signal: str) -> str:
        """Return the SI unit of an input or an output."""
        return self.binding.signal(signal).unit

    def on(self, description: FmuDescription) -> Plan:
        """Return the same plan with another FMU that has all its names; what the case does not name is as it was."""
        binding, named = self.binding.on(description), {t for p in self.parameters for t in p.targets}
        held = {n: v.start for n, v in self.binding.parameters.items() if n not in named and isinstance(v.start, float)}
        held = {n: x for n, x in held.items() if n in binding.own and binding.own[n].start != x}
        return replace(self, binding=binding, fixed={**held, **self.fixed})

    @property
    def shortest_step(self) -> float:
        """The least sampling interval of the recordings, s."""
        return min(o.recording.step for o in self.observed)

    def largest(self, signal: str) -> float:
        """Return the largest size of an output or input in the recordings, SI; 0 where there is none."""
        signals = [{**o.inputs, **o.outputs}.get(signal) for o in self.observed]
        return max((float(np.nanmax(np.abs(x))) for x in signals if x is not None), default=0.0)

    def resolution(self, o: Observed, output: str) -> float:
        """Return the step of the quantisation of an output in a recording, SI: as declared, or as its data show it."""
        return self.chains.get(output, ChainSpec()).quantum or quantum(o.outputs[output])

    @property
    def has_levels(self) -> bool:
        """Whether the motor is driven by voltages of several sizes, each for a while."""
        voltages = [np.abs(o.inputs["v"]) for o in self.observed if "v" in o.inputs]
        sizes = np.sort(np.concatenate([*voltages, np.zeros(1)]))
        driven = sizes[sizes > PLAINLY * sizes[-1]]
        few = len(driven) // 10
        return bool(len(driven) and driven[-1 - few] - driven[few] > PLAINLY * driven[-1 - few])

    @property
    def wanted_levels(self) -> str:
        """Voltages that would tell more than those of the recordings, in words: a sign tells no more than a size."""
        return "levels of the voltage that are further apart" if self.has_levels else "voltages of two sizes"

    @property
    def outputs(self) -> tuple[str, ...]:
        """FMU outputs that are compared."""
        return tuple(self.observed[0].outputs)

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters."""
        return tuple(p.name for p in self.parameters)
