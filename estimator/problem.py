"""Candidates → costs and residuals over all recordings, through one FMU. Knows no search.

Built from a case: which FMU variable takes which column, which parameters are free and between which bounds, where to
begin. A candidate is an array of the free parameters in their units, in the order of `Problem.parameters`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator import layout
from estimator.case import Case, Chebyshev1, ParameterSpec
from estimator.errors import CaseError, FmuError, InputError, RecordingError, suggestion
from estimator.excitation import Excitation, find_delay, find_excitation, noise_deviation, quantum
from estimator.fmu import FmuDescription, Variable
from estimator.integral import integral_estimate
from estimator.mapping import begins_elsewhere, fixed_values, integral_of, mapped, settings, target
from estimator.parameters import Box, Parameter
from estimator.recording import Recording, motor_columns, read_recording
from estimator.sensors import Section, Sensor, chebyshev1_sections
from estimator.workers import Batch, Experiment, Job, Workers

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOTOR = ("R", "K", "L", "J", "B")
PAPER_BOX = {"R": (0.01, 5.0), "K": (0.005, 0.1), "L": (1e-7, 0.5), "J": (1e-7, 1e-3), "B": (1e-5, 1e-3)}
WIDTH = {"R": 100.0, "K": 100.0}  # bounds around the data's start when none are given: factor either way
USUAL_WIDTH = 1e4
LATE = 2  # samples: a response that starts this much later than it could is delayed
COUNTS, WHOLE = (16, 1e6), 0.02  # counts a turn of an encoder whose differences are the speed
REST_SAMPLES, REST_LIMIT = 50, 10.0  # before the step; times the noise of differences: more is no noise
SIGMA_FLOOR = 1e-3  # of a signal's deviation: the least that the search takes for its noise


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


def plan_case(case: Case, description: FmuDescription, *, recordings: Sequence[Recording] | None = None) -> Plan:
    """Make a case concrete.

    Raises
    ------
    InputError
        A recording, a column, an FMU variable or a bound is wrong: one sentence.
    """
    description = mapped(case, description)
    fixed, texts = fixed_values(case, description)
    recordings = [read_recording(path) for path in case.recordings] if recordings is None else list(recordings)
    if not recordings:
        raise CaseError('the case names no recording; add [[recording]] with file = "run.csv"')
    observed = tuple(_observe(case, description, recording) for recording in recordings)
    for other in observed[1:]:
        if tuple(other.outputs) != tuple(observed[0].outputs):
            raise RecordingError(
                f"{other.recording.title} measures {', '.join(other.outputs)}, but {observed[0].recording.title}"
                f" measures {', '.join(observed[0].outputs)}; all recordings need the same columns"
            )
    guess, notes = _guess(case, observed)
    parameters = _parameters(case, description, guess)
    if not parameters:
        raise CaseError("every parameter is fixed; leave at least one free")
    return Plan(
        case=case,
        description=description,
        observed=observed,
        parameters=parameters,
        fixed=fixed,
        sensors=_sensors(case, description, observed),
        guess=guess,
        notes=notes,
        chains=_chains(case, observed),
        texts=texts,
    )


class Problem:
    """A plan, with its FMU loaded into workers.

    Parameters
    ----------
    plan : Plan
    workers : Workers
        Loaded by this constructor.
    sigma : output → float
        Deviations that weigh the outputs in `costs`, in their units.
    """

    def __init__(self, plan: Plan, workers: Workers, *, sigma: Mapping[str, float], keep_counts: bool = False) -> None:
        self.plan, self.workers = plan, workers
        self.parameters = plan.parameters
        self.box = Box.of(plan.parameters)
        self.outputs = plan.outputs
        description = plan.description
        targets = [t for p in self.parameters for t in p.targets]
        taken = [target(description, name) for name in targets]
        held = {name: target(description, name) for name in plan.fixed if name not in targets}
        held = {name: v for name, v in held.items() if v.is_real and v.causality != "input"}
        self.variables = tuple(v.name for v in (*taken, *held.values()))  # as a candidate's values follow in the FMU
        gains = [g for p in self.parameters for g in (p.gains or (1.0,) * len(p.targets))]
        self._gain = np.array([g / v.factor for g, v in zip(gains, taken, strict=True)])
        self._shift = np.array([-v.offset / v.factor for v in taken])
        self._column = [j for j, p in enumerate(self.parameters) for _ in p.targets]
        self._has_sensors = (
            any(p.place is not None for p in self.parameters)
            or any(o.delay != 0 for o in plan.observed)
            or any(c.gain != 1 for c in plan.chains.values())
        )
        self.sigma = dict(sigma)
        self._constant = np.array([(plan.fixed[n] - v.offset) / v.factor for n, v in held.items()])
        inputs = tuple(plan.observed[0].inputs)
        driven = [description.variable(n) for n in inputs]
        read = [_read_variable(description, plan.sensors[y], y) for y in self.outputs]
        self._job = Job(
            description=description,
            parameter_references=tuple(v.value_reference for v in (*taken, *held.values())),
            input_references=tuple(v.value_reference for v in driven),
            output_references=tuple(v.value_reference for v in read),
            sensors=tuple(plan.sensors[y] for y in self.outputs),
            experiments=tuple(self._experiment(o, sigma) for o in plan.observed),
            sensor_values=1 + 2 * len(self.outputs) if self._has_sensors else 0,
            even_steps=not description.capabilities.get("canHandleVariableCommunicationStepSize", True),
            reinstantiate=description.restart == "re-instantiate",
            fresh_process=description.restart == "fresh process",
            types=types_of([*taken, *held.values(), *driven, *read]),
            settings=settings(description, plan.fixed, plan.texts),
            scale=tuple((v.factor, v.offset) for v in read)
            if any((v.factor, v.offset) != (1, 0) for v in read)
            else (),
        )
        workers.load(self._job, keep_counts=keep_counts)
        lengths = [o.lead + len(o.recording.time) for o in plan.observed]
        self._edges = np.cumsum([0, *lengths])
        measured = np.concatenate([self._measured(o) for o in plan.observed])
        self._used = ~np.isnan(measured)
        self._measured_used = measured[self._used]
        self.output_of_residual = np.broadcast_to(np.arange(len(self.outputs)), measured.shape)[self._used].astype(
            np.int64
        )
        spreads = []
        for j in range(len(self.outputs)):
            column = measured[:, j]
            spread = float(np.nanstd(column))
            spreads.append(spread if spread > 0 else max(abs(float(np.nanmean(column))), 1e-12))
        self.spread = np.array(spreads)

    def costs(self, candidates: FloatArray, bounds: FloatArray | None = None) -> FloatArray:
        """Return the weighted sums of squares, (n,), of (n, p) candidates; infinity where cut short or failed."""
        self._take_over()
        return self.workers.run(self._values(candidates), bounds=bounds).costs

    def trajectories(self, candidates: FloatArray, *, refine: int = 1) -> Batch:
        """Simulate (n, p) candidates to the end and keep what the sensors show."""
        self._take_over()
        return self.workers.run(self._values(candidates), refine=refine, record=True)

    def residuals(self, candidates: FloatArray) -> FloatArray:
        """Return simulated minus measured, (n, m), in the outputs' units, missing samples left out; NaN if failed."""
        shown = self.trajectories(candidates).shown
        assert shown is not None
        return np.asarray(shown[:, self._used] - self._measured_used)

    def reference(self, candidate: FloatArray, *, recording: int = 0) -> FloatArray:
        """Return what the sensors show, (n, outputs), of one candidate simulated by fmpy's methods alone."""
        self._take_over()
        return self.workers.reference(self._values(candidate[None, :])[0, recording], experiment=recording)

    def _take_over(self) -> None:
        """Load this problem again if the workers have served another since."""
        if self.workers.job is not self._job:
            self.workers.load(self._job, keep_counts=True)

    def shown(self, batch: Batch, index: int = 0) -> list[FloatArray]:
        """Split one candidate's trajectories by recording, (n, outputs) each, without the lead."""
        assert batch.shown is not None
        return [
            batch.shown[index, self._edges[e] + o.lead : self._edges[e + 1]] for e, o in enumerate(self.plan.observed)
        ]

    def spread_out(self, rows: list[FloatArray]) -> FloatArray:
        """Return (n, outputs) arrays, one a recording, as a residual vector, (m,)."""
        parts = []
        for o, part in zip(self.plan.observed, rows, strict=True):
            parts += [np.zeros((o.lead, len(self.outputs))), part]
        return np.asarray(np.concatenate(parts)[self._used])

    def series(self, residuals: FloatArray, output: int) -> list[tuple[FloatArray, IntArray]]:
        """Split (m,) residuals of one output by recording: (n,) each, NaN where missing, and their indices (-1)."""
        index = np.full(self._used.shape, -1, dtype=np.int64)
        index[self._used] = np.arange(len(residuals))
        result = []
        for e, o in enumerate(self.plan.observed):
            own = index[self._edges[e] + o.lead : self._edges[e + 1], output]
            result.append((np.where(own >= 0, residuals[own], np.nan), own))
        return result

    def spread_columns(self, jacobian: FloatArray, output: int) -> list[FloatArray]:
        """Split an (m, p) array of one output by recording: (n, p) each, zero where a sample is missing."""
        blocks = []
        for _, own in self.series(np.zeros(len(jacobian)), output):
            blocks.append(np.where((own >= 0)[:, None], jacobian[own], 0.0))
        return blocks

    def used(self, rows: FloatArray) -> FloatArray:
        """Pick from (rows, outputs) trajectories the samples that are compared, (m,)."""
        return np.asarray(rows[self._used])

    def _values(self, candidates: FloatArray) -> FloatArray:
        free = candidates[:, self._column] * self._gain + self._shift
        constant = np.broadcast_to(self._constant, (len(candidates), len(self._constant)))
        values = np.concatenate([free, constant], axis=1)
        repeated = np.repeat(values[:, None, :], len(self.plan.observed), axis=1)
        return np.concatenate([repeated, self._sensor_values(candidates)], axis=2) if self._has_sensors else repeated

    def _sensor_values(self, candidates: FloatArray) -> FloatArray:
        """Return delay, then gain and offset of every output, (n, recordings, values)."""
        plan, q = self.plan, len(self.outputs)
        values = np.zeros((len(candidates), len(plan.observed), 1 + 2 * q))
        values[:, :, 0] = [o.delay for o in plan.observed]
        values[:, :, 1::2] = [plan.chains[y].gain if y in plan.chains else 1.0 for y in self.outputs]
        for p, column in zip(self.parameters, candidates.T, strict=True):
            if p.place is None:
                continue
            where = slice(None) if p.place.recording is None else slice(p.place.recording, p.place.recording + 1)
            if p.place.kind == "delay":
                values[:, where, 0] = column[:, None]
            else:
                j = self.outputs.index(p.place.output)
                values[:, where, 1 + 2 * j + (p.place.kind == "offset")] = column[:, None]
        return values

    def _chains(self, step: float) -> tuple[tuple[int, tuple[Section, ...]], ...]:
        specs = [self.plan.chains.get(y, ChainSpec()) for y in self.outputs]
        if all(s.is_plain for s in specs):
            return ()
        chains = []
        for s in specs:
            sections: tuple[Section, ...] = ()
            if s.filter is not None:
                sections = chebyshev1_sections(
                    order=s.filter.order, ripple=s.filter.ripple, cutoff=s.filter.cutoff, step=step
                )
            chains.append((s.average, sections))
        return tuple(chains)

    def _experiment(self, observed: Observed, sigma: Mapping[str, float]) -> Experiment:
        recording = observed.recording
        own = [self._own_unit(name, signal) for name, signal in observed.inputs.items()]
        inputs = np.column_stack(own) if own else np.empty((len(recording.time), 0))
        inputs = np.concatenate([np.repeat(inputs[:1], observed.lead, axis=0), inputs])
        start = self.plan.description.default_experiment["start_time"] or 0.0
        return Experiment(
            start=start,
            interval=recording.step,
            substeps=_substeps(self.plan.case, recording),
            inputs=inputs,
            measured=self._measured(observed),
            weights=np.array([1 / sigma[y] ** 2 for y in self.outputs]),
            chains=self._chains(recording.step),
        )

    def _own_unit(self, name: str, signal: FloatArray) -> FloatArray:
        """Return an input in the FMU's unit."""
        variable = self.plan.description.variable(name)
        return signal if variable.factor == 1 and variable.offset == 0 else (signal - variable.offset) / variable.factor

    def _measured(self, observed: Observed) -> FloatArray:
        measured = np.column_stack([observed.outputs[y] for y in self.outputs])
        return np.concatenate([np.full((observed.lead, measured.shape[1]), np.nan), measured])


def output_deviations(plan: Plan) -> dict[str, tuple[float, float]]:
    """Return, for each output, the deviation of its noise as the data show it, and of the signal itself."""
    result = {}
    for name in plan.outputs:
        chain = plan.chains.get(name, ChainSpec())
        noise = np.sqrt(np.mean([(_noise(o, name) * _smoothing(chain, o.recording.step)) ** 2 for o in plan.observed]))
        spread = float(np.nanstd(np.concatenate([o.outputs[name] for o in plan.observed])))
        result[name] = (float(noise), spread)
    return result


def _smoothing(chain: ChainSpec, step: float) -> float:
    """Return how much larger filtered white noise is than its second differences make it seem."""
    if chain.filter is None:
        return 1.0
    f = chain.filter
    sensor = Sensor(sections=chebyshev1_sections(order=f.order, ripple=f.ripple, cutoff=f.cutoff, step=step))
    impulse = np.array([sensor.show(float(k == 2)) for k in range(2000)])
    second = impulse[2:] - 2 * impulse[1:-1] + impulse[:-2]
    return float(np.linalg.norm(impulse) / np.linalg.norm(second) * np.sqrt(6))


def _noise(o: Observed, name: str) -> float:
    """Return the deviation of an output's noise: at rest before the step, where it is coloured, or differences."""
    rest = o.outputs[name][: o.excitation.index] if o.excitation.kind != "none" and not o.excitation.running else None
    fast = noise_deviation(o.outputs[name])
    if rest is None or np.sum(~np.isnan(rest)) < REST_SAMPLES:
        return fast
    known = rest[~np.isnan(rest)]
    slow = float(np.median(np.abs(known - np.median(known)))) / 0.6745
    return slow if fast < slow < REST_LIMIT * fast else fast


def _substeps(case: Case, recording: Recording) -> int:
    if case.step is None:
        return 1
    substeps = round(recording.step / case.step)
    if substeps < 1 or abs(recording.step / case.step - substeps) > 1e-6 * substeps:
        raise CaseError(
            f"the communication step {case.step:g} s does not divide the sampling interval {recording.step:g} s"
            f" of {recording.title}; take {recording.step:g} s or a whole fraction of it"
        )
    return substeps


def _observe(case: Case, description: FmuDescription, recording: Recording) -> Observed:
    inputs, outputs = _columns(case, description, recording)
    driven: dict[str, FloatArray] = {}
    for name, column in inputs.items():
        signal = recording.signal(column, unit=description.variable(name, role="input").unit or None)
        if np.isnan(signal).any():
            k = int(np.flatnonzero(np.isnan(signal))[0])
            raise RecordingError(
                f"{recording.title}: {column} has no sample at t = {recording.time[k]:g} s; an input must be complete"
            )
        driven[name] = signal
    for name, value in case.fixed.items():
        variable = target(description, name)
        if variable.causality == "input" and variable.is_real:
            driven[name] = np.full(len(recording.time), value)
    measured = {}
    for name, column in outputs.items():
        signal = recording.signal(column, unit=description.variable(name, role="output").unit or None)
        measured[name] = _without_rest(signal) if name == "angle" else signal
    if not driven:  # the FMU moves by itself, as the motor did
        return Observed(recording, driven, measured, Excitation("several", 0, 0.0, 0.0, False), 0)
    first = next(iter(driven.values()))
    excitation = find_excitation(first, measured)
    if begins_elsewhere(case, description):  # nothing to run in, and the way from there is a response
        kind = "several" if excitation.kind == "none" else excitation.kind
        still = dataclasses.replace(excitation, kind=kind, running=False)
        return Observed(recording, driven, measured, still, 0)
    lead = 0
    if excitation.running and first[0] != 0 and excitation.kind != "none":
        lead = len(first) - (excitation.index if excitation.kind == "step" else 0)
    late = find_delay(excitation, measured) if lead == 0 else 0
    return Observed(recording, driven, measured, excitation, lead, late * recording.step if late >= LATE else 0.0)


def _without_rest(angle: FloatArray) -> FloatArray:
    """Leave out what an encoder shows before it counts first: its error is constant there."""
    known = angle[~np.isnan(angle)]
    resting = int(np.argmax(angle != known[0])) if quantum(angle) > 0 else 0
    resting = int(np.argmax(~np.isnan(angle) & (angle != known[0]))) if resting else 0
    return np.where(np.arange(len(angle)) < resting, np.nan, angle)


def _columns(case: Case, description: FmuDescription, recording: Recording) -> tuple[dict[str, str], dict[str, str]]:
    """Return FMU input → column and FMU output → column, from the case or from the usual names."""
    undriven = all(v.name in case.fixed for v in description.of_causality("input"))
    if case.outputs and (case.inputs or undriven):
        return (
            {name: recording.column(column) for name, column in case.inputs.items()},
            {name: recording.column(spec.column) for name, spec in case.outputs.items()},
        )
    inputs = {name: recording.column(column) for name, column in case.inputs.items()}
    outputs = {name: recording.column(spec.column) for name, spec in case.outputs.items()}
    roles = motor_columns(recording, required=[*([] if inputs else ["v"]), *([] if outputs else ["i", "w"])])
    if not inputs:
        for role in ("v", "load"):
            if role in roles and any(v.name == role for v in description.of_causality("input")):
                inputs[role] = roles[role]
        if "v" not in inputs:
            known = ", ".join(v.name for v in description.of_causality("input")) or "none"
            raise FmuError(
                f"{description.path.name} has no input 'v' (its inputs: {known});"
                " say in a case file, under [inputs], which input takes which column"
            )
    if not outputs:
        measured = [r for r in ("i", "w", "angle") if r in roles and not (r == "angle" and "w" in roles)]
        names = [v.name for v in description.variables if v.causality == "output"]
        outputs = {role: roles[role] for role in measured if role in names}
        missing = [role for role in measured if role not in names]
        if missing:
            raise FmuError(
                f"{description.path.name} has no output {missing[0]!r}{suggestion(missing[0], names)};"
                " say in a case file, under [outputs], which output shows which column"
            )
    return inputs, outputs


def _is_differenced(description: FmuDescription, observed: tuple[Observed, ...]) -> bool:
    """Whether the speed is that of encoder counts, differenced: its steps are 2π / (whole counts a turn) / interval."""
    if not any(v.name == "angle" for v in description.variables):
        return False
    for o in observed:
        step = quantum(o.outputs["w"]) * o.recording.step
        counts = 2 * np.pi / step if step > 0 else 0.0
        if not (COUNTS[0] <= counts <= COUNTS[1] and abs(counts - round(counts)) < WHOLE):
            return False
    return True


def _sensors(case: Case, description: FmuDescription, observed: tuple[Observed, ...]) -> dict[str, int]:
    sensors = {}
    for name in observed[0].outputs:
        spec = case.outputs.get(name)
        mean = spec is not None and spec.sensor == "mean"
        mean = mean or (spec is None and name == "w" and _is_differenced(description, observed))
        sensors[name] = layout.MEAN if mean else layout.IDENTITY
        if mean:
            _read_variable(description, layout.MEAN, name)
    return sensors


def _chains(case: Case, observed: tuple[Observed, ...]) -> dict[str, ChainSpec]:
    chains = {}
    for name, spec in case.outputs.items():
        if spec.filter is None or name not in observed[0].outputs:
            continue
        for o in observed:
            if not spec.filter.cutoff * o.recording.step < 0.5:
                raise CaseError(
                    f"output {name!r}: the filter's cutoff {spec.filter.cutoff:g} Hz is not below half the sampling"
                    f" rate of {o.recording.title}, {0.5 / o.recording.step:g} Hz"
                )
        chains[name] = ChainSpec(filter=spec.filter)
    return chains


def _read_variable(description: FmuDescription, sensor: int, name: str) -> Variable:
    """Return the variable to read for an output: a mean is read from the output's integral."""
    if sensor != layout.MEAN:
        return description.variable(name, role="output")
    integral = integral_of(name)
    for variable in description.variables:
        if variable.name == integral:
            return variable
    raise FmuError(
        f"{description.path.name} has no output that integrates {name!r} (such as 'angle' for 'w');"
        ' sensor = "mean" needs it; use sensor = "identity"'
    )


def types_of(variables: Sequence[Variable]) -> tuple[str, ...]:
    """Return the types of variables; nothing if all are real."""
    return () if all(v.is_real for v in variables) else tuple(v.type for v in variables)


def _guess(case: Case, observed: tuple[Observed, ...]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return a first guess of the motor's parameters from the data, and what to tell of it."""
    for o in observed:
        if {"v"} <= set(o.inputs) and {"i", "w"} <= set(o.outputs) and o.excitation.kind != "none":
            late = round(o.delay / o.recording.step)
            v = o.inputs["v"][: len(o.inputs["v"]) - late]
            i, w = o.outputs["i"][late:], o.outputs["w"][late:]
            load = case.fixed.get("load", 0.0)
            guess = integral_estimate(v, i, w, step=o.recording.step, load=load)
            return _sane(guess, v, i, w, step=o.recording.step), ()
    return {}, ()


def _sane(guess: Mapping[str, float], v: FloatArray, i: FloatArray, w: FloatArray, *, step: float) -> dict[str, float]:
    """Replace what noise has driven out of reason by orders of magnitude that the signals allow."""
    peak_v, peak_i, peak_w = (max(float(np.nanmax(np.abs(x))), 1e-12) for x in (v, i, w))
    R = guess["R"] if 0 < guess["R"] < 1e3 * peak_v / peak_i else 0.5 * peak_v / peak_i
    K = guess["K"] if 0 < guess["K"] < 1e2 * peak_v / peak_w else 0.9 * peak_v / peak_w
    least_L = 0.05 * step * R
    L = guess["L"] if guess["L"] > least_L else 5 * step * R if guess["L"] <= 0 else least_L
    usual_J = K * K / R * 10 * step
    J = guess["J"] if guess["J"] > 1e-3 * usual_J else usual_J
    B = guess["B"] if guess["B"] > 1e-6 * K * K / R else 1e-2 * K * K / R
    return {"R": R, "K": K, "L": L, "J": J, "B": B}


def _parameters(case: Case, description: FmuDescription, guess: Mapping[str, float]) -> tuple[Parameter, ...]:
    available = [v.name for v in description.of_causality("parameter")]
    names = [n for n in case.parameters if n not in case.fixed]
    if not case.parameters:
        names = [n for n in MOTOR if n in available and n not in case.fixed]
        if not names and not any(n in available for n in MOTOR):
            listed = ", ".join(available[:20]) or "none"
            raise FmuError(
                f"{description.path.name} has none of the parameters R, K, L, J, B (its parameters: {listed});"
                " name those to estimate in a case file, under [parameters]"
            )
    elif all(n in MOTOR for n in case.parameters) and all(n in available for n in MOTOR):
        names = [n for n in MOTOR if n not in case.fixed]  # bounds for some do not fix the others
    return tuple(_parameter(name, case, description, guess) for name in names)


def _parameter(name: str, case: Case, description: FmuDescription, guess: Mapping[str, float]) -> Parameter:
    spec = case.parameters.get(name) or ParameterSpec(name=name)
    targets = [target(description, variable) for variable in (spec.fmu or (name,))]
    first, gains = targets[0], spec.gains or (1.0,) * len(targets)
    for variable in targets:
        if not variable.is_real:
            raise FmuError(
                f"{variable.name!r} of {description.path.name} is {variable.type}; only real parameters are estimated;"
                " give it a value under [fixed]"
            )
    paper = case.search.method in ("paper", "original")
    start = spec.start if spec.start is not None else guess.get(name)
    if start is None:
        start = spec.nominal if spec.nominal is not None else _over(_number(first.start), gains[0])
    lower, upper = spec.minimum, spec.maximum
    if paper and name in PAPER_BOX:
        lower = PAPER_BOX[name][0] if lower is None else lower
        upper = PAPER_BOX[name][1] if upper is None else upper
    width = WIDTH.get(name, USUAL_WIDTH)
    low, high = _limits(targets, gains)
    if lower is None:
        lower = start / width if start is not None and start > 0 else low
        if low is not None and lower is not None:
            lower = max(lower, low)
    if upper is None:
        upper = start * width if start is not None and start > 0 else high
        if high is not None and upper is not None:
            upper = min(upper, high)
    if lower is None or upper is None or not np.isfinite([lower, upper]).all():
        raise InputError(
            f"parameter {name!r} has no bounds and no positive start to put them around; give them with"
            f" --bounds {name}=MIN:MAX or in the case file"
        )
    if lower >= upper:
        raise InputError(f"parameter {name!r}: the lower bound {lower:g} is not below the upper bound {upper:g}")
    if (low is not None and lower < low) or (high is not None and upper > high):
        raise InputError(
            f"parameter {name!r}: the bounds {lower:g} to {upper:g} leave the range"
            f" {low} to {high} that {description.path.name} allows"
        )
    return Parameter(
        name=name,
        unit=first.unit,
        lower=float(lower),
        upper=float(upper),
        log=lower > 0 and not paper,
        targets=tuple(v.name for v in targets),
        start=None if start is None else float(np.clip(start, lower, upper)),
        nominal=spec.nominal,
        gains=spec.gains,
    )


def _limits(targets: Sequence[Variable], gains: Sequence[float]) -> tuple[float | None, float | None]:
    """Return the range of a parameter in which all its variables stay within theirs."""
    lows, highs = [], []
    for variable, gain in zip(targets, gains, strict=True):
        ends = [_over(variable.minimum, gain), _over(variable.maximum, gain)]
        low, high = ends if gain > 0 else ends[::-1]
        lows += [] if low is None else [low]
        highs += [] if high is None else [high]
    return max(lows, default=None), min(highs, default=None)


def _over(value: float | None, gain: float) -> float | None:
    return None if value is None else value / gain


def _number(value: float | str | None) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
