"""Score tests of all that may be added to an explanation, columns and nuisance parameters. Accepts none of it."""

from __future__ import annotations

import dataclasses
import itertools
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition import NOTHING, Addition, Scores
from estimator.explaining.effects.base import Effect
from estimator.explaining.explanation import Explanation, moved_to
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.score_test import ScoreTest
from estimator.fitting.simulator import CELLS, Nuisance, Simulator, per_recording
from estimator.noise.in_parts import among
from estimator.noise.kalman import give_back
from estimator.noise.whitener import Whitener
from estimator.plans.part import LONG

FloatArray = NDArray[np.float64]

TRIED_WHOLE = 3  # values of an integer nuisance parameter that are refitted
HARDLY_MOVED = 1e-3  # of z'z: score tests are not done again


@dataclass(frozen=True)
class _Tested:
    """What was tested last; the fit itself may be gone."""

    fit: weakref.ref[Fit]
    simulator: Simulator
    whitener: Whitener
    names: tuple[str, ...]
    cost: float
    effects: tuple[Effect, ...]
    found: list[Addition]

    def holds(self, fit: Fit, effects: Sequence[Effect]) -> bool:
        """Whether it holds of a fit: the same, or one whose values have hardly moved since."""
        if self.fit() is fit:
            return self.effects == tuple(effects)
        alike = self.simulator is fit.simulator and self.whitener is fit.whitener and self.names == fit.names
        return alike and abs(self.cost - fit.cost) < HARDLY_MOVED and self.effects == tuple(effects)


@dataclass
class AdditionTests:
    """Score tests of what may be added to explanations of a case; what was tested last is remembered.

    Parameters
    ----------
    base : Simulator
        Of the case's FMU.
    rivals : callable
        A bundled FMU's name -> its simulator, or None where it cannot stand in for the case's.
    """

    base: Simulator
    rivals: Callable[[str], Simulator | None]
    _tested: _Tested | None = field(init=False, default=None)

    @cached_property
    def samples(self) -> int:
        """How many samples are compared."""
        return int(np.sum(~np.isnan(self.base.measured)))

    def simulator(self, fit: Fit, effect: Effect) -> Simulator | None:
        """Return the simulator that has an effect: the fit's own, or a rival FMU's."""
        if not effect.fmu or fit.simulator is not self.base:
            return fit.simulator
        return self.rivals(effect.fmu)

    def additions(
        self, explanation: Explanation, effects: Sequence[Effect], *, beside: str | None = None
    ) -> list[Addition]:
        """Return all candidate additions, each with its predicted fall of z'z.

        Parameters
        ----------
        beside : str, optional
            An addition's name: it keeps its whitened columns, and so do those that are doubted.
        """
        fit = explanation.fit
        if beside is None and self._tested is not None and self._tested.holds(fit, effects):
            return self._tested.found
        give_back(self.base.rows)
        test, long = fit.test(), fit.simulator.rows > LONG
        simulators = [self.simulator(fit, effect) for effect in effects]  # a rival FMU is loaded beside what follows
        result: list[Addition] = []
        taken = {*fit.free, *(g.name for g in fit.linear), *explanation.names()}
        by_simulator: dict[int, tuple[Simulator, list[tuple[Effect, Nuisance]]]] = {}
        offered: list[tuple[Effect, Linear, int]] = []
        for effect in effects:
            groups = effect.linear(fit)
            offered += [(effect, g, g.one_of) for g in groups if g.name not in taken]
            del groups
            while long and offered:  # their columns are not held together
                result += self._scored(fit, [offered.pop(0)], test, beside=beside)
        result += self._scored(fit, offered, test, beside=beside)
        for effect, simulator in zip(effects, simulators, strict=True):
            plan = self.base.plan
            own = (*effect.nuisances(plan), *effect.in_place_of_columns(plan)) if simulator is not None else ()
            for nuisance in own:
                if nuisance.name in taken or not nuisance.tries or _is_excluded(nuisance, taken):
                    continue
                assert simulator is not None
                if nuisance.name not in simulator.index:
                    continue
                by_simulator.setdefault(id(simulator), (simulator, []))[1].append((effect, nuisance))
        give_back(self.base.rows)
        # The fit's own simulator last: it was loaded for the fit, and is asked next.
        tried = [list(self._tried(fit, s, wanted, test, beside=beside)) for s, wanted in [*by_simulator.values()][::-1]]
        result += itertools.chain.from_iterable(tried[::-1])
        stems = {(b.effect, stem) for b in explanation.additions if (stem := self._stem(b.name)) != b.name}
        result = [dataclasses.replace(a, again=True) if self._is_again(a, stems) else a for a in result]
        if beside is None:
            known = weakref.ref(fit), fit.simulator, fit.whitener, fit.names, fit.cost, tuple(effects)
            self._tested = _Tested(*known, result)
        return result

    def _is_again(self, a: Addition, stems: set[tuple[Effect, str]]) -> bool:
        """Whether an addition of a recording is known of another one: not where it is of all of them."""
        stem = self._stem(a.name)
        return stem != a.name and (a.effect, stem) in stems

    def _stem(self, name: str) -> str:
        """Return the name of an addition without that of its recording, where it has one of its own."""
        return next((name.removesuffix(own) for own in self._recordings if name.endswith(own)), name)

    @cached_property
    def _recordings(self) -> tuple[str, ...]:
        """What the names of additions end with that each recording has for itself."""
        return tuple(per_recording(self.base.plan, "")) if len(self.base.plan.observed) > 1 else ()

    def _scored(
        self, fit: Fit, offered: Sequence[tuple[Effect, Linear, int]], test: ScoreTest, *, beside: str | None
    ) -> Iterator[Addition]:
        """Yield groups of columns, each one of so many that are tried, score-tested; all are whitened together."""
        if not offered:
            return
        whitened = fit.whitener.whitened(*(group.columns for _, group, _ in offered))
        each = Scores.of_each(test, fit.whitened, whitened)
        at = 0
        for effect, group, tried in offered:
            numbers = group.columns.shape[2]
            own, scores, gain = slice(at, at + numbers), each[at], each[at].gain
            at += numbers
            kept = beside is not None and (effect.doubt or group.name == beside)
            alone = among(whitened, own) if numbers > 1 or kept else None
            across = test.known.rest(alone) if alone is not None else None
            if numbers > 1:
                assert alone is not None and across is not None
                scores = Scores.of(test, fit.whitened, across, alone)
                gain = test.gain(across)
            elif group.untold or group.least >= 0 > scores.along[0]:  # nothing has this sign
                gain = 0.0
            addition = Addition(
                effect, group.name, numbers, gain, linear=group,
                scores=scores, across=across[:] if kept and across is not None else None,
                tried=tried, usual=group.size if numbers == 1 else 0.0, unit=group.units[0],
                untold=group.untold,
            )  # fmt: skip
            least = dataclasses.replace(addition, again=bool(self._recordings)).penalty(self.samples)
            if fit.simulator.rows > LONG and beside is None and gain <= least:
                none = np.zeros((0, *group.columns.shape[1:]))  # it is not fitted
                few = dataclasses.replace(group, columns=none, transient=None, beyond=None, uncertain=None)
                addition = dataclasses.replace(addition, linear=few)
            yield addition

    def _tried(
        self,
        fit: Fit,
        simulator: Simulator,
        wanted: Sequence[tuple[Effect, Nuisance]],
        test: ScoreTest,
        *,
        beside: str | None,
    ) -> Iterator[Addition]:
        """Yield the nuisance parameters of one simulator, score-tested at the best of their tries."""
        moved = moved_to(fit, simulator)
        rows, owners = [], []
        for w, (_, nuisance) in enumerate(wanted):
            for t, value in enumerate(nuisance.tries):
                candidate = moved.values.copy()
                for name, x in (nuisance.together[t] if nuisance.together else {}).items():
                    candidate[simulator.index[name]] = x
                now = candidate[simulator.index[nuisance.name]]
                shift = 0.0 if nuisance.absolute or nuisance.whole else now - nuisance.neutral
                candidate[simulator.index[nuisance.name]] = value + shift
                rows.append(candidate)
                owners.append((w, t))
        many = max(1, CELLS // fit.z.size)
        tested: list[list[tuple[float, float, int]]] = [[] for _ in wanted]
        best: dict[int, tuple[float, Scores, FloatArray | None, int]] = {}
        for first in range(0, len(rows), many):
            shown = simulator.shown(np.array(rows[first : first + many]))
            if not np.isfinite(shown).all():  # one that failed shows nothing
                shown = np.array([own if np.isfinite(own).all() else moved.shown for own in shown])
            whitened = fit.whitener.changes(shown, moved.shown)
            scores = Scores.of_each(test, fit.whitened, whitened)
            for k, ((w, t), own) in enumerate(zip(owners[first : first + many], scores, strict=True)):
                times = _times(wanted[w][1], t)
                power = times**2 * float(own.information[0, 0])
                size = times * float(own.along[0]) / power if power > NOTHING else 0.0
                whole = 2 * size * power - power  # of a unit
                gain = whole if wanted[w][1].whole else max(size**2 * power if size > 0 else 0.0, whole)
                tested[w].append((gain, size, t))
                if w not in best or gain > best[w][0]:
                    kept = beside is not None and (wanted[w][0].doubt or wanted[w][1].name == beside)
                    across = test.known.rest(times * whitened[:][:, k : k + 1]) if kept else None
                    best[w] = gain, own.scaled(times), across, t
            del shown, whitened  # before the next are simulated
        simulator.forget()
        for w, (effect, nuisance) in enumerate(wanted):
            found: list[tuple[float, tuple[Mapping[str, float], ...]]] = []
            for gain, size, t in tested[w]:
                together = nuisance.together[t] if nuisance.together else {}
                if nuisance.whole or nuisance.absolute:
                    starts: tuple[Mapping[str, float], ...] = ({nuisance.name: nuisance.tries[t], **together},)
                else:
                    reach = _times(nuisance, t) * (nuisance.tries[t] - nuisance.neutral)
                    now = moved.value(nuisance.name)
                    starts = tuple(
                        {nuisance.name: now + f * reach, **together}
                        for f in dict.fromkeys((min(max(size, 0.1), 8.0), 1.0))
                    )
                found.append((gain, starts))
            found.sort(key=lambda f: -f[0])
            if found:
                gain, starts = found[0]
                gain = 0.0 if nuisance.untold else gain
                if nuisance.whole:  # no derivative leads from one to the next
                    starts = tuple(start for _, several in found[:TRIED_WHOLE] for start in several)
                beside_it = nuisance.together[0] if nuisance.together else ()
                switches = {n.name for n in simulator.nuisances if n.whole}
                free = () if nuisance.whole else (nuisance.name, *(n for n in beside_it if n not in switches))
                far = nuisance.whole or nuisance.absolute
                reach = 0.0 if far else nuisance.tries[best[w][3]] - nuisance.neutral
                yield Addition(
                    effect, nuisance.name, max(1, len(free)), gain, starts=starts, free=free,
                    scores=best[w][1], across=best[w][2], tried=len(nuisance.tries),
                    usual=_times(nuisance, best[w][3]) * reach, unit=nuisance.unit, untold=nuisance.untold,
                    foretold=nuisance.foretold,
                )  # fmt: skip


def _times(nuisance: Nuisance, t: int) -> float:
    """Return how many times as large as a try of it a nuisance parameter usually is."""
    reach = nuisance.tries[t] - nuisance.neutral
    return nuisance.usual / reach if nuisance.usual and reach else 1.0


def _is_excluded(nuisance: Nuisance, taken: set[str]) -> bool:
    if nuisance.needs and nuisance.needs not in taken:
        return True
    return any(name.startswith(prefix) for prefix in nuisance.excludes for name in taken)
