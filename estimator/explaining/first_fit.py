"""The first fit, before any effect is selected: its starts, its bounds, what is seen before it. Selects nothing."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition import Addition, is_switch
from estimator.explaining.addition_tests import AdditionTests
from estimator.explaining.effects.base import Effect
from estimator.explaining.explanation import Explanation, followed
from estimator.fitting.fit import Fit, new_fit, refreshed
from estimator.fitting.gauss_newton import solved_roughly
from estimator.fitting.simulator import Simulator
from estimator.noise.noise_model import NoiseModel

FloatArray = NDArray[np.float64]
Seen = Sequence[tuple[Effect, Mapping[str, float]]]  # effects, with the values at which a fit starts

# Factors about the first estimates: bounds of the fit while effects are missing.
NEARBY = {"R": 5.0, "K": 4.0, "J": 6.0, "L": 50.0}
NO_NOISE = 0.2  # of the noise's power as neighbours tell it: a first fit that is further from it misses something
SEEN = 1.0  # of z'z: by so much a switch that is seen may be worse than none


@dataclass(frozen=True)
class FirstFit:
    """Where a selection begins.

    Parameters
    ----------
    tests : AdditionTests
        Of what may be added; its simulators.
    always : names of nuisance parameters that are free from the start
    deviations : (q,) array
        Of the noise, a first estimate.
    effects : those that may be found
    """

    tests: AdditionTests
    always: tuple[str, ...]
    deviations: FloatArray
    effects: tuple[Effect, ...]

    @contextmanager
    def held_near(self, starts: Sequence[FloatArray]) -> Iterator[None]:
        """Bound a motor's parameters near their first estimates for a while.

        A start that leaves only noise misses no effect, wherever it lies.
        """
        s = self.tests.base
        lower, upper = s.lower.copy(), s.upper.copy()
        if not any(self._leaves_noise(start) for start in starts):
            near_lower, near_upper = self._near()
            begun = [s.values(dict(zip(s.plan.names, start.tolist(), strict=True))) for start in starts]
            shown = s.shown(np.clip(begun, near_lower, near_upper))
            if np.isfinite(shown).all(axis=(1, 2)).any():  # there may be no motor that the FMU simulates
                s.lower[:], s.upper[:] = near_lower, near_upper
        try:
            yield
        finally:
            s.lower[:], s.upper[:] = lower, upper

    def _near(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds, (p,) each, of all names, with a motor's parameters near their first estimates."""
        s = self.tests.base
        lower, upper = s.lower.copy(), s.upper.copy()
        for k, name in enumerate(s.plan.names):
            near = s.plan.guess.get(name, 0.0)
            if name in NEARBY and near > 0 and s.log[k]:
                lower[k], upper[k] = max(lower[k], near / NEARBY[name]), min(upper[k], near * NEARBY[name])
        return lower, upper

    def explanation(self, starts: Sequence[FloatArray]) -> Explanation:
        """Return the best first fit: from every start, with and without effects that are seen before a fit."""
        s = self.tests.base
        seen = [(e, e.at_first_sight(s.plan)) for e in self.effects]
        far = [(e, known) for e, known in seen if e.fmu and known]
        tried = []
        for start in starts:
            begun = dict(zip(s.plan.names, start.tolist(), strict=True))
            for held in ([], *self._held_together(far)):
                additions, simulator = list[Addition](), s
                for e, known in held:
                    rival = self.tests.rivals(e.fmu)
                    if rival is not None and set(known) <= set(rival.neutral):
                        simulator = rival
                        additions += _seen(e, known, rival)
                beside = {a.name for a in additions}
                own = [(e, {n: v for n, v in known.items() if n in simulator.index}) for e, known in seen if not e.fmu]
                alone = [a for e, known in own for a in _seen(e, known, simulator)]
                alone = [a for a in alone if not _excludes(simulator, a.name, beside)]
                additions = [*alone, *additions]
                names = {n for a in additions for n in (a.name, *a.free)}
                values = {n: v for _, known in (*own, *held) for n, v in known.items() if n in names}
                free = (*s.plan.names, *self.always, *(n for a in additions for n in a.free))
                fit = new_fit(simulator, simulator.values({**begun, **values}), free, self._noise)
                fit = self.with_open_columns(fit)
                columns = [(e, group) for e in self.effects for group in e.seen(fit)]
                additions += [Addition(e, g.name, g.columns.shape[2], np.inf, linear=g) for e, g in columns]
                fit = dataclasses.replace(fit, linear=(*fit.linear, *(g for _, g in columns)))
                found = Explanation(solved_roughly(fit), tuple(additions))
                tried.append(followed(found) if columns else found)
        return min(tried, key=self._criterion)

    def _held_together(self, far: Seen) -> list[Seen]:
        """Return what is seen of another FMU, in two parts where one thing excludes another; nothing: none is seen."""
        for one, other in itertools.permutations(far, 2):
            rival = self.tests.rivals(one[0].fmu)
            if rival is not None and any(_excludes(rival, n, other[1]) for n in one[1]):
                return [[seen for seen in far if seen is not gone] for gone in (one, other)]
        return [list(far)] if far else []

    def cost(self, starts: Sequence[FloatArray]) -> float:
        """Return z'z of the first fit, by the first estimate of the noise."""
        with self.held_near(starts):
            return self.explanation(starts).fit.cost

    def with_open_columns(self, fit: Fit) -> Fit:
        """Return a fit with the columns that are free from the start."""
        return dataclasses.replace(fit, linear=tuple(group for e in self.effects for group in e.always(fit)))

    @property
    def _noise(self) -> NoiseModel:
        return NoiseModel.plain(self.deviations, tuple(-1 for _ in self.tests.base.outputs))

    def _leaves_noise(self, start: FloatArray) -> bool:
        """Whether a start, (p,), explains the recordings but for their noise, by its first estimate."""
        s = self.tests.base
        values = s.values(dict(zip(s.plan.names, start.tolist(), strict=True)))
        begun = new_fit(s, values, s.plan.names, self._noise)
        return refreshed(begun, begun.whitener).cost < (1 + NO_NOISE) * self.tests.samples

    def _criterion(self, explanation: Explanation) -> float:
        """Return a criterion in which a switch that is seen needs no fit to tell it: what does is not yet there."""
        n = self.tests.samples
        return explanation.criterion(n) - sum(a.penalty(n) + SEEN for a in explanation.additions if is_switch(a))


def _excludes(simulator: Simulator, name: str, others: Collection[str]) -> bool:
    """Whether a nuisance parameter makes no sense beside one of others."""
    excluded = simulator.nuisance(name).excludes if name in simulator.index else ()
    return any(other.startswith(excluded) for other in others) if excluded else False


def _seen(effect: Effect, known: Mapping[str, float], simulator: Simulator) -> list[Addition]:
    """Return the additions that the recordings show before any fit, each with all of its numbers."""
    found = []
    stems = {n: stem if (stem := n.rpartition("#")[0]) in known else n for n in known}
    for name in dict.fromkeys(stems.values()):
        free = () if simulator.nuisance(name).whole else tuple(n for n, stem in stems.items() if stem == name)
        found.append(Addition(effect, name, max(1, len(free)), np.inf, free=free))
    return found
