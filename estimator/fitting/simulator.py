"""From candidates to the sensors' signals, with all nuisance parameters. Knows one FMU, no noise and no search.

A nuisance parameter is a number of the bench, not of the motor: a delay, an offset, the time constant of a low-pass. It
has a neutral value at which it has no effect. All of them follow the free parameters of the plan in one vector, so that
the FMU need not be loaded again when one is freed.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.angle_slips import angle_slips
from estimator.fitting.effort import WITH_EVENTS, Effort
from estimator.fitting.problem import Problem, distinct
from estimator.fitting.repeated_samples import mostly_repeats, without_repeats
from estimator.fitting.shaft_angle import shaft_angle, unfolded_orders
from estimator.fitting.whole_fits import WholeFits
from estimator.fmus.workers import Workers
from estimator.noise.clock import Clock, interval_shown
from estimator.noise.recursion import Sections, behind
from estimator.plans.parameters import Box, Parameter, SensorPlace, scaled, unscaled
from estimator.plans.plan import Observed, Plan

FloatArray = NDArray[np.float64]
SUBSTEPS = 4  # rows that are simulated for one where a filter acts between them
CELLS = 500_000  # rows that are simulated at once, at most
KEPT_ANSWERS, KEPT_VALUES = 16, 500_000  # that were asked of late; numbers in all of them, at most

Act = Callable[[FloatArray, float, float], FloatArray]  # (n,) signal, value, sampling interval in s -> (n,) signal
# a simulator, a candidate, (p,), and by which part of a row all is shown earlier -> what is added, (rows, q)
Adds = Callable[["Simulator", FloatArray, float], FloatArray]


@dataclass(frozen=True)
class Nuisance:
    """A nuisance parameter.

    Attributes
    ----------
    neutral : float
        The value without effect.
    size : float
        A typical change, for differences and first tries.
    place : SensorPlace or None
        The stepper's setting that it is, if any.
    target : str
        The FMU's variable that it sets, if any.
    recording : int or None
        Which recording's it is, if it has a target; None: of all.
    output, act : what it does with one output's samples; with no output: with those of all, as what an input does
    adds : what it adds to the outputs, before anything acts on them
    between : bool
        It acts on the signal between the samples too, as a filter before a converter does.
    sections : value, sampling interval in s -> sections of the filter that `act` is, if it is one of a few
        By them it acts on signals as they lie in memory.
    whole : bool
        A number of samples, or a switch: chosen, not fitted by derivatives.
    tries : values at which a score test looks for it
    absolute : bool
        A fit starts at the tried value itself, not at the score test's estimate.
    together : of each try, other nuisances that are set, and freed, with it
    excludes : names, or their beginnings, beside which it makes no sense
    needs : a name without which it makes no sense
    usual : float
        Its usual distance from neutral, where it is tried at less, for the sake of the derivative; 0: as it is tried.
    untold : bool
        No such recording tells it: it is never found, only told among what is not visible.
    foretold : values between which all such recordings have it: that it is there costs nothing, and is no question
    """

    name: str
    unit: str
    lower: float
    upper: float
    neutral: float
    size: float
    log: bool = False
    place: SensorPlace | None = None
    target: str = ""
    recording: int | None = None
    output: str = ""
    act: Act | None = None
    adds: Adds | None = None
    between: bool = False
    sections: Callable[[float, float], Sections] | None = None
    whole: bool = False
    tries: tuple[float, ...] = ()
    absolute: bool = False
    together: tuple[Mapping[str, float], ...] = ()
    excludes: tuple[str, ...] = ()
    needs: str = ""
    usual: float = 0.0
    untold: bool = False
    foretold: tuple[float, float] | None = None

    @property
    def channel(self) -> str:
        """The output that it acts on; "": it acts on all."""
        return self.output or (self.place.output if self.place is not None else "")

    def parameter(self) -> Parameter:
        """Return it as a parameter of a plan."""
        targets = (self.target,) if self.target else ()
        return Parameter(
            self.name, self.unit, self.lower, self.upper, self.log, targets, start=self.neutral, place=self.place,
            recording=self.recording,
        )  # fmt: skip


@dataclass
class Simulator:
    """One plan and its nuisance parameters, on workers.

    Parameters
    ----------
    plan : Plan
        Its free parameters come first.
    nuisances : sequence of Nuisance
    crew : Workers
    sigma : output → float, as `Problem`
    effort : Effort, optional
        Told what is shown.

    Attributes
    ----------
    between : int
        Rows that are simulated for one where a filter acts between them.
    derivatives : (bytes, int), (rows, q, f) array
        The central ones that were asked for last, by their points (slopes.py): a noise, a test and a fit ask in turn.
    """

    plan: Plan
    nuisances: tuple[Nuisance, ...]
    crew: Workers
    sigma: Mapping[str, float]
    effort: Effort | None = None
    problem: Problem = field(init=False)
    between: int = field(init=False, default=SUBSTEPS)
    derivatives: tuple[tuple[bytes, int], FloatArray] | None = field(init=False, default=None)
    _late: dict[tuple[bytes, int, int], FloatArray] = field(init=False, default_factory=dict)
    _phases: tuple[tuple[bytes, int], FloatArray] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        stepped = [n for n in self.nuisances if n.place is not None or n.target]
        fixed = {name: v for name, v in self.plan.fixed.items() if name not in {n.target for n in stepped}}
        wide = dataclasses.replace(
            self.plan, parameters=(*self.plan.parameters, *(n.parameter() for n in stepped)), fixed=fixed
        )
        self.problem = Problem(wide, self.crew, sigma=self.sigma, keep_counts=True)
        self.names = (*self.plan.names, *(n.name for n in self.nuisances))
        self.index = {name: k for k, name in enumerate(self.names)}
        self._stepped = [*range(len(self.plan.names)), *(self.index[n.name] for n in stepped)]
        self._acts = [n for n in self.nuisances if n.act is not None or n.adds is not None]
        self._act_places = np.array([self.index[n.name] for n in self._acts], dtype=int)
        self._idle = np.array([n.neutral for n in self._acts])
        self._filters = np.array([n.between for n in self._acts], dtype=bool)
        specs = [(p.lower, p.upper, p.log) for p in self.plan.parameters]
        specs += [(n.lower, n.upper, n.log) for n in self.nuisances]
        self.lower = np.array([s[0] for s in specs])
        self.upper = np.array([s[1] for s in specs])
        self.log = np.array([s[2] for s in specs], dtype=bool)
        own = [abs(p.upper - p.lower) * 1e-3 for p in self.plan.parameters]
        self.size = np.array([*own, *(n.size for n in self.nuisances)])
        self.neutral = {n.name: n.neutral for n in self.nuisances}
        self.outputs = self.plan.outputs
        keep = np.concatenate([np.arange(o.before + len(o.recording.time)) >= o.before for o in self.plan.observed])
        # Of one recording a slice, which copies nothing.
        self._keep = slice(self.plan.observed[0].before, None) if len(self.plan.observed) == 1 else keep.astype(bool)
        edges = np.cumsum([0, *(len(o.recording.time) for o in self.plan.observed)])
        self.clocks = tuple(
            Clock(o.times, slice(int(a), int(b)))
            for o, a, b in zip(self.plan.observed, edges[:-1], edges[1:], strict=True)
        )
        self.rows = int(edges[-1])

    @cached_property
    def measured(self) -> FloatArray:
        """What is compared, (rows, q); NaN where a sample is missing, or shown again."""
        each = [without_repeats(o, self.outputs) for o in self.observed]
        return each[0] if len(each) == 1 else np.concatenate(each)

    @cached_property
    def steps(self) -> FloatArray:
        """By which the sensors resolve the outputs, (q,), in their units; 0: they are not quantised."""
        return np.asarray(np.max(self.steps_of_each, axis=0))

    @cached_property
    def steps_of_each(self) -> FloatArray:
        """The same of each recording, (n, q): as declared, or as the data show it."""
        return np.array([[self.plan.resolution(o, y) for y in self.outputs] for o in self.observed])

    @cached_property
    def coarse(self) -> NDArray[np.bool_]:
        """Whether an output's resolution is what its neighbours differ by, if they do, (q,): then it is no noise."""
        repeats = np.array([mostly_repeats(o.outputs[y] for o in self.observed) for y in self.outputs])
        return np.asarray((self.steps > 0) & repeats)

    @property
    def observed(self) -> tuple[Observed, ...]:
        """The recordings."""
        return self.plan.observed

    @cached_property
    def angle(self) -> FloatArray | None:
        """The shaft's angle, rad, (rows,), as the recordings show it; None where they do not."""
        return shaft_angle(self.measured, self.outputs, self.clocks)

    @cached_property
    def angle_slips(self) -> FloatArray:
        """By how much the shaft is further than this angle, rad, (rows,), as its ripples show: rows are missing."""
        assert self.angle is not None
        if "angle" in self.outputs:
            return np.zeros(self.rows)
        return angle_slips(self.angle, self.measured, self.outputs, self.clocks)

    @cached_property
    def unfolded(self) -> tuple[tuple[NDArray[np.bool_], ...], ...]:
        """Which orders of the angle the sampling does not alias to a slow change, of each output and recording."""
        assert self.angle is not None
        angles = [self.angle[clock.rows] for clock in self.clocks]
        every = [[interval_shown(~np.isnan(y[clock.rows])) for clock in self.clocks] for y in self.measured.T]
        different = {(e, k) for own in every for e, k in enumerate(own)}
        known = {(e, k): unfolded_orders(angles[e][::k]) for e, k in different}
        return tuple(tuple(known[e, k] for e, k in enumerate(own)) for own in every)

    def values(self, known: Mapping[str, float]) -> FloatArray:
        """Return a candidate, (p,), of known values; nuisances that are not known are neutral."""
        return np.array([known[n] if n in known else self.neutral[n] for n in self.names])

    def at(self, values: FloatArray, known: Mapping[str, float]) -> FloatArray:
        """Return a candidate, (p,), with some values exchanged, inside their bounds."""
        moved = values.copy()
        for name, value in known.items():
            k = self.index[name]
            moved[k] = np.clip(value, self.lower[k], self.upper[k])
        return moved

    def nuisance(self, name: str) -> Nuisance:
        """Return a nuisance parameter by its name."""
        return self.nuisances[self.index[name] - len(self.plan.names)]

    def shown(self, candidates: FloatArray, *, refine: int = 1) -> FloatArray:
        """Return what the sensors show, (c, rows, q), of (c, p) candidates; NaN where the FMU fails.

        What was asked of late is not simulated again: a fit begins where the last one ended. It is not to be changed.
        """
        key = candidates.tobytes(), refine, self.between
        known = self._late.pop(key, None)
        found = self._simulated(candidates, refine) if known is None else known
        self._late[key] = found
        while len(self._late) > KEPT_ANSWERS or sum(answer.size for answer in self._late.values()) > KEPT_VALUES:
            del self._late[next(iter(self._late))]
        found.flags.writeable = key not in self._late
        return found

    def filtered(self, candidates: FloatArray) -> NDArray[np.bool_]:
        """Return which candidates, (c,), show a signal through a filter that acts between two rows."""
        return np.asarray(self._acting(candidates)[:, self._filters].any(axis=1) & self.problem.has_sensors)

    def _acting(self, candidates: FloatArray) -> NDArray[np.bool_]:
        """Return which of what acts on an output's samples does, (c, acts), of candidates."""
        return np.asarray(candidates[:, self._act_places] != self._idle)

    def _simulated(self, candidates: FloatArray, refine: int) -> FloatArray:
        """Return the same, as the FMU tells it now."""
        filtered, began = self.filtered(candidates), time.monotonic()
        found = self._in_parts(candidates, refine, filtered)
        if self.effort is not None:
            a_row = self.problem.steps_a_row * (self.between if filtered.any() else 1) * refine
            a_row *= WITH_EVENTS if self.plan.description.has_events else 1
            taken = 0.0 if self.plan.description.is_bundled else time.monotonic() - began
            steps = self.rows * a_row if a_row > 1 else 0
            self.effort.spend(len(candidates), self.rows * len(self.outputs), steps, taken)
        return found

    def _in_parts(self, candidates: FloatArray, refine: int, filtered: NDArray[np.bool_]) -> FloatArray:
        """Return the same; of no more candidates at once than memory is meant to hold, some `filtered` between rows."""
        alike = filtered.all() or not filtered.any()
        rows = self.between if filtered.any() else 1
        if alike and 0 < len(candidates) <= max(1, CELLS // (self.rows * rows)):
            return np.ascontiguousarray(self._shown(candidates, refine, rows))
        result = np.empty((len(candidates), self.rows, len(self.outputs)))
        for between in (False, True):
            where = np.flatnonzero(filtered == between)
            rows = self.between if between else 1
            many = max(1, CELLS // (self.rows * rows))
            for part in (where[k : k + many] for k in range(0, len(where), many)):
                result[part] = self._shown(candidates[part], refine, rows)
        return result

    def _shown(self, candidates: FloatArray, refine: int, between: int) -> FloatArray:
        """Return the same; `between` rows are simulated for one, for what filters show."""
        unique, which = distinct(candidates[:, self._stepped])
        acting = self._acting(candidates)
        phases = self._signals(unique, refine, between, kept=len(unique) == 1 and bool(acting.any()))
        if len(unique) < len(candidates):
            phases = phases[:, which]
        if not acting.any():
            return np.asarray(phases[0])
        shown, fine = phases[0].copy(), phases[::-1].transpose(1, 2, 0, 3)
        if acting[:, [n.adds is not None for n in self._acts]].any():
            fine = fine.copy()
        for c, (candidate, acts) in enumerate(zip(candidates, acting, strict=True)):
            adds = [n.adds for n in itertools.compress(self._acts, acts) if n.adds is not None]
            if adds:
                for part in range(between):
                    fine[c, :, -1 - part] += sum(add(self, candidate, part / between) for add in adds)
                shown[c] = fine[c, :, -1]
            for j, output in enumerate(self.outputs):
                own = [(n, float(candidate[self.index[n.name]])) for n in itertools.compress(self._acts, acts)
                       if n.act is not None and n.output in ("", output)]  # fmt: skip
                for clock in self.clocks if own else ():
                    _show_through(own, fine[c, clock.rows, :, j], shown[c, clock.rows, j], clock.step)
        return np.asarray(shown)

    def _signals(self, unique: FloatArray, refine: int, between: int, *, kept: bool) -> FloatArray:
        """Return signals, (between, c, rows, q), each a part of a row later than the next; `kept`: not to be changed.

        Filters and means are tried on those of one candidate one after the other, where a recording is too long for all
        at once: they are kept until others are asked for.
        """
        key = unique.tobytes(), refine
        if kept and self._phases is not None and self._phases[0] == key and between in (1, len(self._phases[1])):
            return self._phases[1][:between]
        self._phases = None
        steps = np.array([clock.step for clock in self.clocks])
        # A time-invariant model: with inputs later by a part of a row it shows what lies between.
        late = np.repeat(np.arange(between)[:, None] * steps / between, len(unique), axis=0) if between > 1 else None
        signals = self.problem.signals(np.tile(unique, (between, 1)), refine=refine, late=late)
        phases = signals[:, self._keep].reshape(between, len(unique), self.rows, -1)
        if kept:
            self._phases = key, phases
        return phases

    def descend(
        self, values: FloatArray, where: NDArray[np.int_], weights: FloatArray, **limits: Any
    ) -> tuple[FloatArray, bool, FloatArray, FloatArray | None] | None:
        """Do a descent of what is free, by its places, in a worker process; None where that is not possible there.

        Parameters
        ----------
        weights : (rows, q) array
            On the misfit of each sample; 0 where one is missing.
        limits : as `WholeFits.descend`

        Returns
        -------
        As `WholeFits.descend`, without the lead, and the derivatives as (rows, q, f).
        """
        stepped = {k: j for j, k in enumerate(self._stepped)}
        if self._acting(values[None, :]).any() or not set(where.tolist()) <= stepped.keys():
            return None
        box = Box(self.lower[where], self.upper[where], self.log[where])
        wide = np.zeros((sum(o.before + len(o.recording.time) for o in self.observed), len(self.outputs)))
        wide[self._keep] = weights
        free = [stepped[k] for k in where.tolist()]
        found = WholeFits(self.problem).descend(values[self._stepped], free, box, wide, **limits)
        if found is None:
            return None
        x, beside, shown, derivatives = found
        own = None if derivatives is None else np.moveaxis(derivatives[:, self._keep], 0, 2)
        return x, beside, shown[self._keep], own

    def forget(self) -> None:
        """Give up the memory of the signals between two rows, which filters and means are tried on."""
        self._phases = None

    def spacing(self, values: FloatArray) -> FloatArray:
        """Return by which steps, (p,), s, delays act on a candidate, (p,): a filter takes a signal from row to row.

        A current that jumps, as that of a winding without inductance does, does so between two of the rows that are
        simulated: a filter shows the same wherever that is. 0: a change of any size acts.
        """
        steps = np.zeros(len(self.names))
        if any(n.between and values[self.index[n.name]] != n.neutral for n in self._acts):
            places = [(n.name, n.place) for n in self.plan.parameters] + [(n.name, n.place) for n in self.nuisances]
            for name, place in places:
                if place is not None and place.kind == "delay":
                    steps[self.index[name]] = min(clock.step for clock in self.clocks) / self.between
        return steps

    def scaled(self, values: FloatArray) -> FloatArray:
        """Return values, (..., p), on their scales: logarithms where these are such."""
        return scaled(values, self.log)

    def unscaled(self, x: FloatArray, where: NDArray[np.int_] | slice = slice(None)) -> FloatArray:
        """Return the values, (..., p), of scaled ones; of some names, if these are given by their places."""
        return unscaled(x, self.log[where])

    def inputs(self, name: str) -> FloatArray:
        """Return an input over all rows, (rows,); zero where no recording has it."""
        return np.concatenate([o.inputs.get(name, np.zeros(len(o.recording.time))) for o in self.observed])


def _show_through(acts: Sequence[tuple[Nuisance, float]], fine: FloatArray, shown: FloatArray, interval: float) -> None:
    """Show a signal through what acts on it at its values, one after the other: filters before what a logger does.

    Parameters
    ----------
    fine : (rows, between) array
        The signal between the samples too, the last of each row at its sample.
    shown : (rows,) array
        The signal at its samples; takes what is shown.
    """
    filters = [(n, value) for n, value in acts if n.between]
    step = interval / fine.shape[1]
    for k, (nuisance, value) in enumerate(filters, start=1):
        assert nuisance.act is not None
        if k == len(filters) and nuisance.sections is not None:
            behind(nuisance.sections(value, step), fine, shown)
            continue
        fine = nuisance.act(fine.ravel(), value, step).reshape(fine.shape)
        if k == len(filters):
            shown[:] = fine[:, -1]
    for nuisance, value in acts:
        if not nuisance.between:
            assert nuisance.act is not None
            shown[:] = nuisance.act(shown.copy(), value, interval)


def per_recording(plan: Plan, kind: str) -> Sequence[str]:
    """Return the names of a nuisance parameter of each recording; the plain name if there is one recording.

    No name of a recording holds the mark behind which a fit numbers the coefficients of one group, #.
    """
    if len(plan.observed) == 1:
        return [kind]
    names = [o.recording.name.replace("#", "№") for o in plan.observed]
    return [f"{kind} {n if names.count(n) == 1 else k + 1}" for k, n in enumerate(names)]
