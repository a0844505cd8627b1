"""Candidates → costs and residuals over all recordings, through one FMU. Knows no search.

A candidate is an array of the free parameters in their units, in the order of `Problem.parameters`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import Case
from estimator.errors import CaseError
from estimator.fitting.differences import DIFFERENCE_STEP
from estimator.fitting.trust_region import ENDED_AT_KNOWN
from estimator.fitting.winding_temperature import warmth
from estimator.fmus.job import Batch, Experiment, Job
from estimator.fmus.workers import Workers
from estimator.plans.parameters import Box
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.recordings.recording import Recording
from estimator.recordings.sensors import Section
from estimator.stepping.layout import DONE_BESIDE, DescentLayout, FitsLayout, types_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SIGMA_FLOOR = 1e-3  # of a signal's deviation: the least noise that the search assumes


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
        description, binding, settings = plan.description, plan.binding, plan.binding.settings
        targets = list(dict.fromkeys(t for p in self.parameters for t in p.targets))
        taken = [binding.target(name) for name in targets]
        held = {name: binding.target(name) for name in plan.fixed if name not in targets}
        held = {name: v for name, v in held.items() if v.is_real and v.causality != "input"}
        self.variables = tuple(v.name for v in (*taken, *held.values()))  # as a candidate's values follow in the FMU
        self._column, self._gain = self._destinations(targets)
        self._gain /= np.array([v.factor for v in taken])
        self._shift = np.array([-v.offset / v.factor for v in taken])
        self._has_sensors = (
            any(p.place is not None for p in self.parameters)
            or any(o.delay != 0 for o in plan.observed)
            or any(not c.is_straight for c in plan.chains.values())
        )
        self.sigma = dict(sigma)
        self._constant = np.array([(plan.fixed[n] - v.offset) / v.factor for n, v in held.items()])
        inputs = tuple(plan.observed[0].inputs)
        driven = [binding.signal(n) for n in inputs]
        read = [binding.read(y, plan.sensors[y]) for y in self.outputs]
        self._job = Job(
            description=description,
            parameter_references=tuple(v.value_reference for v in (*taken, *held.values())),
            input_references=tuple(v.value_reference for v in driven),
            output_references=tuple(v.value_reference for v in read),
            sensors=tuple(plan.sensors[y] for y in self.outputs),
            experiments=tuple(self._experiment(o, sigma) for o in plan.observed),
            sensor_values=1 + 3 * len(self.outputs) if self._has_sensors else 0,
            linear=tuple(name in plan.case.linear for name in inputs),
            even_steps=not description.capabilities.get("canHandleVariableCommunicationStepSize", True),
            reinstantiate=description.restart == "re-instantiate",
            fresh_process=description.restart == "fresh process",
            types=types_of([v.type for v in (*taken, *held.values(), *driven, *read)]),
            settings=tuple((v.type, v.value_reference, value) for v, value in settings),
            names=(*self.variables, *(v.name for v, _ in settings), *inputs),
            scale=tuple((v.factor, v.offset) for v in read) if any(not v.is_as_it_is for v in read) else (),
        )
        workers.load(self._job, keep_counts=keep_counts)
        assert all(tuple(o.outputs) == tuple(self.outputs) for o in plan.observed)  # as they are laid out
        lengths = [o.before + len(o.recording.time) for o in plan.observed]
        self._edges = np.cumsum([0, *lengths])
        self._phased = self._without_phase()
        self._used = ~np.isnan(self._compared)

    @property
    def _compared(self) -> FloatArray:
        """What is compared, (rows, outputs), NaN where a sample is missing; not to be changed."""
        each = [o.compared for o in self.plan.observed]
        return each[0] if len(each) == 1 else np.concatenate(each)

    @cached_property
    def spread(self) -> FloatArray:
        """The deviation of each measured output, (q,): its scale; of a constant one its size."""
        spreads = []
        for column in self._compared.T:
            spread = float(np.nanstd(column))
            spreads.append(spread if spread > 0 else max(abs(float(np.nanmean(column))), 1e-12))
        return np.array(spreads)

    @cached_property
    def output_of_residual(self) -> NDArray[np.int16]:
        """The output of each residual, (m,)."""
        outputs = np.arange(len(self.outputs), dtype=np.int16)
        return np.asarray(np.broadcast_to(outputs, self._used.shape)[self._used])

    @cached_property
    def _measured_rows(self) -> FloatArray:
        """What is compared, (rows, outputs); 0 where a sample is missing."""
        return self._compared if self._used.all() else np.asarray(np.nan_to_num(self._compared))

    def costs(self, candidates: FloatArray, bounds: FloatArray | None = None) -> FloatArray:
        """Return the weighted sums of squares, (n,), of (n, p) candidates; infinity where cut short or failed."""
        self._take_over()
        return self.workers.run(self._values(candidates), bounds=bounds).costs

    def trajectories(self, candidates: FloatArray, *, refine: int = 1, late: FloatArray | None = None) -> Batch:
        """Simulate (n, p) candidates to the end and keep what the sensors show.

        Parameters
        ----------
        late : (n, recordings) array, optional
            By how much the inputs of each candidate come later, s: for signals between two rows.
        """
        self._take_over()
        return self.workers.run(self._asked(candidates, late), refine=refine, record=True)

    def signals(self, candidates: FloatArray, *, refine: int = 1, late: FloatArray | None = None) -> FloatArray:
        """Return what the sensors show, (n, rows, outputs), of (n, p) candidates; NaN where one failed.

        A recording is simulated once for all candidates that ask the same of it: what moves a parameter of one
        recording leaves the others as they are.
        """
        self._take_over()
        values = self._asked(candidates, late)
        if len(values) > 1 and len(self.plan.observed) > 1 and len((asked := _packed(values))[0]) < len(values):
            packed, which = asked
            batch = self.workers.run(packed, refine=refine, record=True)
            if not batch.failed.any():
                assert batch.shown is not None
                shown = np.empty((len(values), *batch.shown.shape[1:]))
                for e, (first, last) in enumerate(zip(self._edges[:-1], self._edges[1:], strict=True)):
                    shown[:, first:last] = batch.shown[which[:, e], first:last]
                return shown
        shown_by_each = self.workers.run(values, refine=refine, record=True).shown
        assert shown_by_each is not None
        return shown_by_each

    def _asked(self, candidates: FloatArray, late: FloatArray | None) -> FloatArray:
        """Return the values of `trajectories`, (n, recordings, values)."""
        values = self._values(candidates)
        if late is not None:
            values[:, :, -1 - 3 * len(self.outputs)] += late
        return values

    @property
    def has_sensors(self) -> bool:
        """Whether the stepper shows outputs through sensors, delays among them."""
        return self._has_sensors

    def residuals(self, candidates: FloatArray) -> FloatArray:
        """Return simulated minus measured, (n, m), in the outputs' units, missing samples left out; NaN if failed."""
        return self.compared(self.signals(candidates))

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
        """Do least-squares fits in the worker processes, from start to end.

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
        Where each ended, (p,), on the scales, and its cost; None: at the known optimum. None altogether where a
        simulation failed, or where candidates are more than the FMU's parameters, times, beside others.
        """
        placing = self._placing(starts[0], list(range(self.box.dimension)), self.box)
        if placing is None or self._phased:
            return None
        self._take_over()
        found = self.workers.fit(
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
        """Do a descent of what is free in a worker process.

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
        (rows, outputs), and the derivatives of that, (f, rows, outputs), or None; None altogether as `fits`.
        """
        placing = self._placing(values, free, box)
        if placing is None:
            return None
        self._take_over()
        found = self.workers.descend(DescentLayout(**placing, **limits), weights)
        if found is None:
            return None
        x, _, how, shown, derivatives = found
        return np.array(x), how == DONE_BESIDE, shown, derivatives

    def _placing(self, values: FloatArray, free: Sequence[int], box: Box) -> dict[str, Any] | None:
        """Return where what is free of a candidate, (p,), goes, as `Placing` says; None where it is not in its values.

        An output's own delay also moves the others, where it is below 0. None, too, of an FMU that is not the
        package's: its simulations may be slow, and then they are better dealt out among many processes.
        """
        known = self.plan.description.is_bundled and not self._job.fresh_process
        if not known or not np.all(box.high > box.low):
            return None
        shift = self._values(values[None, :])[0]
        column, gain = np.full(shift.shape, -1), np.zeros(shift.shape)
        many, held = self._column.shape[1], self._column.shape[1] + len(self._constant)
        place = np.full(len(self.parameters), -1)
        place[list(free)] = np.arange(len(free))
        column[:, :many] = place[self._column]
        own = column[:, :many] >= 0
        gain[:, :many] = np.where(own, self._gain, 0.0)
        shift[:, :many] = np.where(own, self._shift, shift[:, :many])
        for j, where, at in self._sensors[1] if self._has_sensors else ():
            if j in free and at % 3 == 0 and at > 0:
                return None
            if j in free:
                column[where, held + at], gain[where, held + at] = list(free).index(j), 1.0
                shift[where, held + at] -= values[j]
        return {
            "low": tuple(box.low.tolist()),
            "high": tuple(box.high.tolist()),
            "lower": tuple(box.lower.tolist()),
            "upper": tuple(box.upper.tolist()),
            "log": tuple(box.log.tolist()),
            "column": tuple(column.ravel().tolist()),
            "gain": tuple(gain.ravel().tolist()),
            "shift": tuple(shift.ravel().tolist()),
        }

    def compared(self, shown: FloatArray) -> FloatArray:
        """Return (c, rows, outputs) trajectories minus the measured ones, (c, m), as `residuals` does."""
        return self._picked(shown - self._measured_rows)

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
            batch.shown[index, self._edges[e] + o.before : self._edges[e + 1]] for e, o in enumerate(self.plan.observed)
        ]

    def _without_phase(self) -> list[int]:
        """Return the outputs whose phase is not known, neither free nor declared."""
        plan = self.plan
        if "angle" not in self.outputs or "offset angle" in plan.declared:
            return []
        freed = any(p.place is not None and p.place.output == "angle" for p in plan.parameters)
        return [self.outputs.index("angle")] if any(o.has_phase for o in plan.observed) and not freed else []

    def _picked(self, rows: FloatArray) -> FloatArray:
        """Pick from (c, rows, outputs) what is compared, (c, m); an angle whose phase is not known without its mean."""
        for j in self._phased:
            rows = rows.copy()
            for first, last in zip(self._edges[:-1], self._edges[1:], strict=True):
                turned, turning = rows[:, first:last, j], self._used[first:last, j]
                rows[:, first:last, j] = turned - np.mean(turned[:, turning], axis=1, keepdims=True)
        return rows.reshape(len(rows), -1) if self._used.all() else np.asarray(rows[:, self._used])

    def used(self, rows: FloatArray) -> FloatArray:
        """Pick from (rows, outputs) trajectories the samples that are compared, (m,)."""
        return np.asarray(rows[self._used])

    def _destinations(self, targets: Sequence[str]) -> tuple[IntArray, FloatArray]:
        """Return, of each recording and variable, (recordings, variables), which parameter it takes, times what."""
        column = np.zeros((len(self.plan.observed), len(targets)), dtype=np.int64)
        gain = np.ones(column.shape)
        for j, p in enumerate(self.parameters):
            where = slice(None) if p.recording is None else p.recording
            for name, factor in zip(p.targets, p.gains or (1.0,) * len(p.targets), strict=True):
                column[where, targets.index(name)] = j
                gain[where, targets.index(name)] = factor
                if (p.quantity or p.name) == "R" and p.recording is None:
                    gain[:, targets.index(name)] *= warmth(self.plan.temperatures, len(column))
        return column, gain

    def _values(self, candidates: FloatArray) -> FloatArray:
        """Return the FMU's parameters, then the sensors' values, (n, recordings, values)."""
        recordings, free = self._column.shape
        held = free + len(self._constant)
        sensors = 1 + 3 * len(self.outputs) if self._has_sensors else 0
        values = np.empty((len(candidates), recordings, held + sensors))
        values[:, :, :free] = candidates[:, self._column] * self._gain + self._shift
        values[:, :, free:held] = self._constant
        if sensors:
            values[:, :, held:] = self._sensor_values(candidates)
        return values

    def _sensor_values(self, candidates: FloatArray) -> FloatArray:
        """Return the inputs' delay, then gain, offset and further delay of every output, (n, recordings, values)."""
        usual, placed = self._sensors
        values = np.repeat(usual[None], len(candidates), axis=0)
        for j, where, at in placed:
            values[:, where, at] = candidates[:, j, None]
        earliest = np.minimum(values[:, :, 3::3].min(axis=2), 0.0)  # an output is shown late, never early
        values[:, :, 0] += earliest
        values[:, :, 3::3] -= earliest[:, :, None]
        return values

    @cached_property
    def _sensors(self) -> tuple[FloatArray, list[tuple[int, slice, int]]]:
        """The sensors' values where none is free, (recordings, values); the place of each parameter that is one."""
        plan = self.plan
        usual = np.zeros((len(plan.observed), 1 + 3 * len(self.outputs)))
        chains = [plan.chains.get(y, ChainSpec()) for y in self.outputs]
        usual[:, 0] = [o.delay for o in plan.observed]
        usual[:, 1:] = [x for chain in chains for x in (chain.gain, chain.offset, chain.delay)]
        placed = []
        for j, p in enumerate(self.parameters):
            if p.place is None:
                continue
            where = slice(None) if p.place.recording is None else slice(p.place.recording, p.place.recording + 1)
            at = 0
            if p.place.output:
                at = 1 + 3 * self.outputs.index(p.place.output) + ("gain", "offset", "delay").index(p.place.kind)
            placed.append((j, where, at))
        return usual, placed

    def _chains(self, step: float) -> tuple[tuple[int, tuple[Section, ...]], ...]:
        specs = [self.plan.chains.get(y, ChainSpec()) for y in self.outputs]
        if all(s.is_plain for s in specs):
            return ()
        return tuple((s.average, s.sections(step)) for s in specs)

    def _experiment(self, observed: Observed, sigma: Mapping[str, float]) -> Experiment:
        recording = observed.recording
        own = [self._own_unit(name, signal) for name, signal in observed.inputs.items()]
        inputs = own[0][:, None] if len(own) == 1 else np.empty((len(recording.time), 0))
        inputs = np.column_stack(own) if len(own) > 1 else inputs
        still = [self._own_unit(name, np.zeros(observed.rest)) for name in observed.inputs]
        at_rest = np.column_stack(still) if still else np.empty((observed.rest, 0))
        if observed.before:
            inputs = np.concatenate([at_rest, np.repeat(inputs[:1], observed.lead, axis=0), inputs])
        start = self.plan.description.default_experiment["start_time"] or 0.0
        times = None
        if not recording.even or observed.taken is not None:
            first = observed.before * recording.step
            before = np.arange(observed.before) * recording.step
            times = np.concatenate([before, observed.times - observed.times[0] + first]) + start
        return Experiment(
            start=start,
            interval=recording.step,
            substeps=_substeps(self.plan.case, recording),
            inputs=inputs,
            measured=observed.compared,
            weights=np.array([1 / sigma[y] ** 2 for y in self.outputs]),
            chains=self._chains(recording.step),
            times=times,
        )

    def _own_unit(self, name: str, signal: FloatArray) -> FloatArray:
        """Return an input in the FMU's unit."""
        variable = self.plan.binding.signal(name)
        return signal if variable.is_as_it_is else (signal - variable.offset) / variable.factor


def _packed(values: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return values, (m, recordings, values), that hold those of n candidates, and which each has, (n, recordings).

    The fewest: of every recording what is asked of it once.
    """
    recordings = values.shape[1]
    found = [distinct(values[:, e]) for e in range(recordings)]
    packed = np.empty((max(len(asked) for asked, _ in found), *values.shape[1:]))
    for e, (asked, _) in enumerate(found):
        packed[:, e] = asked[0]
        packed[: len(asked), e] = asked
    return packed, np.array([which for _, which in found], dtype=np.int64).T


def distinct(rows: FloatArray) -> tuple[FloatArray, list[int]]:
    """Return the rows, (n, p), that differ, in their order, and which of them each is."""
    places: dict[bytes, int] = {}
    which = [places.setdefault(row.tobytes(), len(places)) for row in rows]
    return rows[[which.index(k) for k in range(len(places))]], which


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
