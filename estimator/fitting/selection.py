"""Selection of effects: all are score-tested at once, the best refitted with their rivals. Knows no effect.

The criterion is z'z of whitened residuals (-2 log L at a given noise) plus k log n + 2 log (1 / prior) for an addition
of k numbers, n the samples: Schwarz's criterion with the prior of the effect, which columns that exclude each other
share. An effect that is not there is accepted with a chance of 1e-4 or less (k = 1, n = 2 000, prior 0.2: chi-square
above 10.8; benchmarks/combined.py measures the rate).

    fit what is free, estimate the noise from settled rows
    repeat: score-test every addition; refit the best few; accept the best if the criterion falls
    drop additions that are no longer needed

The noise is estimated again after every addition, from settled rows, so that it does not contain what an effect
explains.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import (
    Fit,
    Linear,
    ScoreTest,
    held_down,
    new_fit,
    refreshed,
    solved,
    with_level,
    with_secants,
)
from estimator.fitting.motor_response import machine_of
from estimator.fitting.noise_model import NoiseModel, Whitener, find_jitter, fit_noise, noise_of_neighbours
from estimator.fitting.simulator import CELLS, Nuisance, Simulator
from estimator.fitting.windows import find_windows
from estimator.plans.part import LONG

FloatArray = NDArray[np.float64]

MOST_ADDITIONS = 12  # additions, spectral lines and others each
ROUNDS = 10
REFITTED = 3  # additions refitted in a round
PREDICTED_PART = 0.6  # of the best predicted fall of the criterion: with less an addition is not refitted
# Factors about the first estimates: bounds of the fit while effects are missing.
NEARBY = {"R": 5.0, "K": 4.0, "J": 6.0, "L": 50.0}
NEVER_ZERO = ("R", "K", "J")  # at a bound something else stands for it; L and B may vanish
QUIET = 0.1  # of the first estimate of the deviation: the noise is taken to be no less
NO_CHANGE, DOUBLINGS = 0.1, 2  # of z'z: a smaller change is negligible; doublings of the rows between samples, at most
TRIED_WHOLE = 3  # values of an integer nuisance parameter that are refitted
HARDLY_MOVED = 1e-3  # of z'z: score tests of a long recording are not done again
ROUGH = 8  # iterations of a fit that is only compared
RIVALS_WITHIN = 10.0  # of the criterion: explanations that are no further above the best are rivals
PARALLEL = 0.9  # canonical correlation of an addition with one that is doubted: it is refitted as a rival
RIVALS_REFITTED = 3  # rivals of an addition that are refitted, of each effect the likeliest
MOST_WITHIN = 2  # additions of what happens within samples, each exchanged for every other of these
EXCHANGES, EXCHANGED = 2, 0.1  # of an explanation for a more likely rival, at most; by which its criterion is lower
NOTHING = 1e-9  # of the power of a change: the recordings do not show it
IDLE = 6.0  # times the penalty: an addition is refitted without if its Wald statistic is below


@dataclass(frozen=True)
class Scores:
    """What a score test says of k columns, for a unit of each: all that is needed of them beside a fit.

    Attributes
    ----------
    along : (k,) array
        A'r, A the whitened columns without their part that the fit explains, r what it leaves.
    information : (k, k) array
        A'A.
    whole : float
        Sum of squares of the whitened columns, W.
    explained : (f + m, k) array
        J'W, J the fit's derivatives.
    """

    along: FloatArray
    information: FloatArray
    whole: float
    explained: FloatArray

    @classmethod
    def of(cls, test: ScoreTest, jacobian: FloatArray, across: FloatArray, whitened: FloatArray) -> Scores:
        """Return the scores of whitened columns, (rows q, k), without and with what the fit explains of them."""
        whole = float(np.vdot(whitened, whitened))
        return cls(across.T @ test.left, across.T @ across, whole, jacobian.T @ whitened)


@dataclass(frozen=True)
class Addition:
    """A candidate addition to an explanation: nuisance parameters or columns.

    Attributes
    ----------
    gain : float
        The fall of z'z to first order.
    starts : values of nuisance parameters at which a refit starts
    free : nuisance parameters that it frees
    linear : Linear or None
    scores : Scores or None
        What the score test says of its columns.
    across : (rows q, k) array
        Whitened columns without their part that the fit explains, for a unit of each, where they were asked for.
    tried : int
        Of how many tried values it is the best; of columns that exclude each other each is one of so many.
    usual, unit : float, str
        Its usual size, where it is of one number; 0: none is known.
    """

    effect: Effect
    name: str
    numbers: int
    gain: float
    starts: tuple[Mapping[str, float], ...] = ()
    free: tuple[str, ...] = ()
    linear: Linear | None = None
    scores: Scores | None = None
    across: FloatArray | None = None
    tried: int = 1
    usual: float = 0.0
    unit: str = ""

    def penalty(self, samples: int) -> float:
        """Return its penalty in the criterion."""
        one_of = self.tried if self.linear is not None else 1
        return self.numbers * float(np.log(max(samples, 2))) + 2 * float(np.log(one_of / self.effect.prior))


@dataclass(frozen=True)
class Explanation:
    """A fit and the additions that it holds."""

    fit: Fit
    additions: tuple[Addition, ...] = ()

    def names(self) -> set[str]:
        """Return what was added."""
        return {a.name for a in self.additions}

    def criterion(self, samples: int) -> float:
        """Return the criterion, -2 log L at its noise and the penalties."""
        return self.fit.cost + sum(a.penalty(samples) for a in self.additions)


@dataclass(frozen=True)
class _Tested:
    """What was tested last of a long recording."""

    simulator: Simulator
    whitener: Whitener
    names: tuple[str, ...]
    cost: float
    effects: tuple[Effect, ...]
    found: list[Addition]

    def holds(self, fit: Fit, effects: Sequence[Effect]) -> bool:
        """Whether it is the same of another fit: one whose values have hardly moved since."""
        alike = self.simulator is fit.simulator and self.whitener is fit.whitener and self.names == fit.names
        return alike and self.effects == tuple(effects) and abs(self.cost - fit.cost) < HARDLY_MOVED


@dataclass
class Selection:
    """The search for an explanation.

    Parameters
    ----------
    base : Simulator
        Of the case's FMU.
    rivals : callable
        A bundled FMU's name -> its simulator, or None where it cannot stand in for the case's.
    always : names of nuisance parameters that are free from the start
    deviations : (q,) array
        Of the noise, a first estimate.
    differenced : (q,) array
        Deviation of the counts that a channel differences; 0: it shows no counts.
    effects : those that may be found
    enter : callable
        Told the name of the phase that begins.
    """

    base: Simulator
    rivals: Callable[[str], Simulator | None]
    always: tuple[str, ...]
    deviations: FloatArray
    differenced: FloatArray
    effects: tuple[Effect, ...]
    enter: Callable[[str], None] = lambda phase: None
    _tested: _Tested | None = field(init=False, default=None)

    def _held_near(self, starts: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Bound a motor's parameters near their first estimates; return the bounds that they had."""
        s = self.base
        before = s.lower.copy(), s.upper.copy()
        for k, name in enumerate(s.plan.names):
            near = s.plan.guess.get(name, 0.0)
            if name in NEARBY and near > 0 and s.log[k]:
                s.lower[k] = max(s.lower[k], near / NEARBY[name])
                s.upper[k] = min(s.upper[k], near * NEARBY[name])
        return before

    def first_cost(self, starts: Sequence[FloatArray]) -> float:
        """Return z'z of the first fit, by the first estimate of the noise."""
        lower, upper = self._held_near(starts)
        cost = self._first(starts).fit.cost
        self.base.lower[:], self.base.upper[:] = lower, upper
        return cost

    def explain(self, starts: Sequence[FloatArray], known: Explanation | None = None) -> Explanation:
        """Return the best explanation.

        Parameters
        ----------
        starts : (p,) arrays
            Of the plan's free parameters.
        known : Explanation, optional
            Of a part of the rows: what it holds is not looked for again, and fitted to all of them.
        """
        bounds = self._held_near(starts)
        best = self._first(starts) if known is None else self._begun(known)
        lines = [e for e in self.effects if e.is_line]
        best = self._grown(best, lines, rounds=ROUNDS, renew=False)  # before the noise, which would contain them
        if find_windows(best.fit).enough:
            if known is None:  # else the part has told what is sharp
                best = self.with_noise(best, colour=False)
                best = self._grown(best, [e for e in self.effects if e.sharp], rounds=ROUNDS, colour=False)
        else:  # a noise from residuals would contain missing effects: neighbours tell it first
            best = self._grown(self._with_noise_of_neighbours(best), self.effects, rounds=ROUNDS, renew=False)
        best = self.with_noise(best)
        for _ in range(2):  # effects and noise depend on each other
            before = best.names()
            best = self._without_idle(self._grown(best, self.effects, rounds=ROUNDS))
            if best.names() == before:
                break
            best = self.with_noise(best)
        if (shaken := self._with_jitter(best)) is not None:
            best = self._without_idle(self._grown(shaken, self.effects, rounds=ROUNDS))
        best = min([best, *self._mirrored(best)], key=lambda e: e.fit.cost)
        for simulator in {id(s): s for s in (self.base, best.fit.simulator)}.values():
            p = len(self.base.plan.names)
            simulator.lower[:p], simulator.upper[:p] = bounds[0][:p], bounds[1][:p]
        fine = _with_fine_filters(best.fit) if best.fit.simulator is self.base else best.fit
        return self._at_best(dataclasses.replace(best, fit=fine))

    def _at_best(self, best: Explanation) -> Explanation:
        """Return an explanation fitted to the end, without what that makes absurd."""
        final = solved(best.fit, tolerance=1e-8)
        while absurd := [a for a in best.additions if not (_is_physical(final, a) and _has_its_needs(final, a))]:
            best = self.without(dataclasses.replace(best, fit=final), absurd[-1])
            final = solved(best.fit, tolerance=1e-8)
        return dataclasses.replace(best, fit=final if final.simulator is self.base else with_secants(final))

    def _first(self, starts: Sequence[FloatArray]) -> Explanation:
        """Return the best first fit: from every start, with and without effects that are seen before a fit."""
        s = self.base
        plain = NoiseModel.plain(self.deviations, tuple(-1 for _ in s.outputs))
        seen = [(e, e.at_first_sight(s.plan)) for e in self.effects]
        own = [(e, {n: v for n, v in known.items() if n in s.index}) for e, known in seen if not e.fmu]
        far = [(e, known) for e, known in seen if e.fmu and known]
        tried = []
        for start in starts:
            begun = dict(zip(s.plan.names, start.tolist(), strict=True))
            for held in ([], far) if far else ([],):
                additions = [self._seen(e, name, s) for e, known in own for name in known]
                simulator = s
                for e, known in held:
                    rival = self.rivals(e.fmu)
                    if rival is not None and set(known) <= set(rival.index):
                        simulator = rival
                        additions += [self._seen(e, name, rival) for name in known]
                names = {a.name for a in additions}
                values = {n: v for _, known in (*own, *held) for n, v in known.items() if n in names}
                free = (*s.plan.names, *self.always, *(n for a in additions for n in a.free))
                fit = new_fit(simulator, simulator.values({**begun, **values}), free, plain)
                open_ones = tuple(group for e in self.effects for group in e.always(fit))
                fit = solved(dataclasses.replace(fit, linear=open_ones), iterations=ROUGH)
                tried.append(Explanation(fit, tuple(additions)))
        return min(tried, key=lambda e: e.criterion(self.samples))

    def _begun(self, known: Explanation) -> Explanation:
        """Return an explanation of a part of the rows, fitted to all of them."""
        there, wanted = known.fit, next((a.effect.fmu for a in known.additions if a.effect.fmu), "")
        simulator = self.rivals(wanted) if wanted else self.base
        assert simulator is not None  # the part had it
        values = simulator.values(dict(zip(there.simulator.names, there.values.tolist(), strict=True)))
        values = np.clip(values, simulator.lower, simulator.upper)
        free = [n for n in there.free if n in simulator.index]  # all rows may rule out what the part allows
        fit = new_fit(simulator, values, free, there.whitener.noise)
        open_ones = tuple(group for e in self.effects for group in e.always(fit))
        best = Explanation(solved(dataclasses.replace(fit, linear=open_ones), iterations=ROUGH))
        for a in known.additions:
            if a.linear is None:
                own = (_bare(a),) if a.name in simulator.index else ()
                best = dataclasses.replace(best, additions=(*best.additions, *own))
                continue
            found = self.additions(best, [a.effect], beside=a.name)
            same = [b for b in found if b.name == a.name] or sorted(found, key=lambda b: -b.gain)[:1]
            for b in same:
                best = Explanation(self.refitted(best, b), (*best.additions, _bare(b)))
        return best

    def _seen(self, effect: Effect, name: str, simulator: Simulator) -> Addition:
        """Return an addition that the recordings show before any fit."""
        nuisance = next(n for n in simulator.nuisances if n.name == name)
        free = () if nuisance.whole else (name,)
        return Addition(effect, name, 1, np.inf, free=free)

    @property
    def samples(self) -> int:
        """How many samples are compared."""
        return int(np.sum(~np.isnan(self.base.measured)))

    def with_noise(self, explanation: Explanation, *, colour: bool = True, again: bool = False) -> Explanation:
        """Return the explanation with its noise estimated, or estimated again, and fitted with it."""
        fit = with_level(_renewed(explanation))
        machine, seat = machine_of(fit)
        noise = dataclasses.replace(fit.whitener.noise, machine=machine, seat=seat)
        if not again:
            noise = dataclasses.replace(noise, differenced=self.differenced)
        whitener = fit.whitener.of(noise)
        misfit = np.where(whitener.present, fit.residuals(), 0.0)
        # Spectral lines take nothing of the noise.
        wide = [k for k, name in enumerate(fit.names) if not name.startswith("ripple ")]
        windows = find_windows(fit)
        columns = fit.raw[:, :, wide]
        s = fit.simulator
        found = fit_noise(
            whitener, misfit, columns, windows.settled, windows.sharp, colour=colour, again=again,
            resolution=np.where(s.coarse & (self.differenced == 0), s.steps, 0.0),
        )  # fmt: skip
        fit = held_down(refreshed(fit, whitener.of(found)), windows.onsets)
        return dataclasses.replace(explanation, fit=solved(fit))

    def _with_jitter(self, explanation: Explanation) -> Explanation | None:
        """Return the explanation fitted with samples whose instants are not known exactly; None where they are."""
        fit = with_level(explanation.fit)
        grows = fit.whitener.noise
        found = []
        for noise in (grows, dataclasses.replace(grows, growth=np.zeros_like(grows.growth) + [0.0, 2.0])):
            whitener = fit.whitener.of(noise)
            deviation = noise.deviation(whitener.level)
            fine = (fit.simulator.steps == 0) & (self.differenced == 0)  # quantised signals have other errors
            slope = np.where(whitener.present & fine, whitener.slope / deviation, 0.0)
            z = refreshed(fit, whitener).z.reshape(slope.shape)
            jitter, sizes, gain = find_jitter(z, slope, fit.simulator.clocks[0].step)
            worse = float(np.sum(np.where(whitener.present, z * z + 2 * np.log(deviation), 0.0)))
            found.append((worse - gain, jitter, dataclasses.replace(noise, white=noise.white * sizes)))
            if not np.any(grows.growth[:, 0]):
                break
        _, jitter, noise = min(found, key=lambda f: f[0])
        if jitter == 0.0:
            return None
        whitener = fit.whitener.of(dataclasses.replace(noise, jitter=jitter))
        return dataclasses.replace(explanation, fit=solved(refreshed(fit, whitener)))

    def _with_noise_of_neighbours(self, explanation: Explanation) -> Explanation:
        """Return the explanation fitted by the noise that samples beside each other show."""
        fit = with_level(explanation.fit)
        windows = find_windows(fit)
        misfit = np.where(fit.whitener.present, fit.residuals(), 0.0)
        old, found = fit.whitener.noise, noise_of_neighbours(fit.whitener, misfit, windows.sharp)
        coarse = (fit.simulator.steps > 0) | (self.differenced > 0)  # their noise is of steps, and no growth
        white = np.where(coarse, old.white, np.maximum(found.white, QUIET * old.white))
        found = dataclasses.replace(found, white=white, growth=np.where(coarse[:, None], old.growth, found.growth))
        fit = held_down(refreshed(fit, fit.whitener.of(found)), windows.onsets)
        return dataclasses.replace(explanation, fit=solved(fit))

    def _grown(
        self,
        explanation: Explanation,
        effects: Sequence[Effect],
        *,
        rounds: int,
        colour: bool = True,
        renew: bool = True,
    ) -> Explanation:
        """Return the explanation with every addition that lowers the criterion, one after the other."""
        rejected: set[str] = set()
        for _ in range(2 * rounds):
            found = self._best_addition(explanation, effects, rejected)
            if found is None or is_full(found):
                break
            judged = self.with_noise(found, colour=colour, again=True) if renew else found
            absurd = [a for a in judged.additions if not _is_physical(judged.fit, a)]
            if judged.additions[-1] in absurd:
                rejected.add(found.additions[-1].name)
                continue
            for a in absurd:  # the new one has taken its place
                judged = self.without(judged, a)
            if absurd and judged.criterion(self.samples) > self._by_noise_of(judged, explanation).criterion(
                self.samples
            ):
                rejected.add(found.additions[-1].name)  # or it has not
                continue
            explanation = judged
            rejected.clear()
        return explanation

    def _by_noise_of(self, other: Explanation, explanation: Explanation) -> Explanation:
        """Return an explanation fitted by another's noise: only so do their criteria compare."""
        fit = refreshed(explanation.fit, other.fit.whitener)
        return dataclasses.replace(explanation, fit=solved(fit, iterations=ROUGH))

    def _best_addition(
        self, explanation: Explanation, effects: Sequence[Effect], rejected: set[str]
    ) -> Explanation | None:
        """Return the explanation with the addition that lowers the criterion most; None if none does."""
        n = self.samples
        while True:
            tested = [a for a in self.additions(explanation, effects) if a.name not in rejected]
            ranked = sorted(tested, key=lambda a: a.penalty(n) - a.gain)
            ranked = [a for a in ranked if a.gain > a.penalty(n)]
            if not ranked:
                return None
            most = ranked[0].gain - ranked[0].penalty(n)
            best_few = [a for a in ranked[:REFITTED] if a.gain - a.penalty(n) > PREDICTED_PART * most]
            refits = [(self.refitted(explanation, a), a) for a in best_few]
            falls = [explanation.fit.cost - f.cost - a.penalty(n) for f, a in refits]
            falls = [f if _is_physical(fit, a) else -np.inf for f, (fit, a) in zip(falls, refits, strict=True)]
            k = int(np.argmax(falls))
            if falls[k] > 0:
                fit, addition = refits[k]
                return Explanation(fit, (*explanation.additions, addition))
            rejected |= {a.name for a in best_few}

    def refitted(self, explanation: Explanation, addition: Addition) -> Fit:
        """Return the fit with an addition, from the start of the largest predicted fall."""
        fit = explanation.fit
        if addition.linear is not None:
            return solved(dataclasses.replace(fit, linear=(*fit.linear, addition.linear)), iterations=ROUGH)
        simulator = self._simulator(fit, addition.effect)
        assert simulator is not None
        moved = moved_to(fit, simulator)
        begun = []
        for start in addition.starts:
            values = moved.values.copy()
            for name, value in start.items():
                k = simulator.index[name]
                values[k] = np.clip(value, simulator.lower[k], simulator.upper[k])
            begun.append(dataclasses.replace(moved, values=values, free=(*fit.free, *addition.free)))
        settling = ROUGH if not addition.free else 1
        ready = [solved(b, iterations=settling) for b in begun] if len(begun) > 1 else begun
        return solved(min(ready, key=lambda f: f.cost), iterations=ROUGH)

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
        test, long = fit.test(), fit.simulator.rows > LONG
        result: list[Addition] = []
        taken = {*fit.free, *(g.name for g in fit.linear), *explanation.names()}
        by_simulator: dict[int, tuple[Simulator, list[tuple[Effect, Nuisance]]]] = {}
        for effect in effects:
            groups = effect.linear(fit)
            among = len(groups) if effect.is_one else 1
            for group in groups:
                if group.name in taken:
                    continue
                whitened = fit.whitener(group.columns)[0].reshape(fit.z.size, -1)
                across = whitened - test.basis @ (test.basis.T @ whitened)
                gain, _ = test.gain(across)
                numbers = across.shape[1]
                kept = beside is not None and (effect.doubt or group.name == beside)
                addition = Addition(
                    effect, group.name, numbers, gain, linear=group,
                    scores=Scores.of(test, fit.jacobian, across, whitened), across=across if kept else None,
                    tried=max(among, group.one_of), usual=group.size if numbers == 1 else 0.0, unit=group.units[0],
                )  # fmt: skip
                if long and beside is None and gain <= addition.penalty(self.samples):  # it is not fitted
                    few = dataclasses.replace(group, columns=np.zeros((0, *group.columns.shape[1:])))
                    addition = dataclasses.replace(addition, linear=few)
                result.append(addition)
            simulator = self._simulator(fit, effect)
            own = effect.nuisances(self.base.plan) if simulator is not None else ()
            for nuisance in own:
                if nuisance.name in taken or not nuisance.tries or _is_excluded(nuisance, taken):
                    continue
                assert simulator is not None
                if nuisance.name not in simulator.index:
                    continue
                by_simulator.setdefault(id(simulator), (simulator, []))[1].append((effect, nuisance))
        for simulator, wanted in by_simulator.values():
            result += self._tried(fit, simulator, wanted, test, beside=beside)
        if long and beside is None:
            self._tested = _Tested(fit.simulator, fit.whitener, fit.names, fit.cost, tuple(effects), result)
        return result

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
            usable = np.asarray(np.isfinite(shown).all(axis=(1, 2)))
            change = np.where(usable[:, None, None], shown - moved.shown, 0.0).transpose(1, 2, 0)
            whitened = fit.whitener(change)[0].reshape(fit.z.size, -1)
            across = whitened - test.basis @ (test.basis.T @ whitened)
            for k, (w, t) in enumerate(owners[first : first + many]):
                power = float(across[:, k] @ across[:, k])
                size = float(across[:, k] @ test.left) / power if power > NOTHING else 0.0
                whole = 2 * size * power - power  # of a unit
                gain = whole if wanted[w][1].whole else max(size**2 * power if size > 0 else 0.0, whole)
                tested[w].append((gain, size, t))
                if w not in best or gain > best[w][0]:
                    own = across[:, k : k + 1]
                    scores = Scores.of(test, fit.jacobian, own, whitened[:, k : k + 1])
                    kept = beside is not None and (wanted[w][0].doubt or wanted[w][1].name == beside)
                    best[w] = gain, scores, own.copy() if kept else None, t
        for w, (effect, nuisance) in enumerate(wanted):
            found: list[tuple[float, tuple[Mapping[str, float], ...]]] = []
            for gain, size, t in tested[w]:
                together = nuisance.together[t] if nuisance.together else {}
                if nuisance.whole or nuisance.absolute:
                    starts: tuple[Mapping[str, float], ...] = ({nuisance.name: nuisance.tries[t], **together},)
                else:
                    reach = nuisance.tries[t] - nuisance.neutral
                    now = float(moved.values[simulator.index[nuisance.name]])
                    starts = tuple(
                        {nuisance.name: now + f * reach, **together}
                        for f in dict.fromkeys((float(np.clip(size, 0.1, 8)), 1.0))
                    )
                found.append((gain, starts))
            found.sort(key=lambda f: -f[0])
            if found:
                gain, starts = found[0]
                if nuisance.whole:  # no derivative leads from one to the next
                    starts = tuple(start for _, several in found[:TRIED_WHOLE] for start in several)
                free = () if nuisance.whole else (nuisance.name, *(nuisance.together[0] if nuisance.together else ()))
                reach = 0.0 if nuisance.whole or nuisance.absolute else nuisance.tries[best[w][3]] - nuisance.neutral
                yield Addition(
                    effect, nuisance.name, max(1, len(free)), gain, starts=starts, free=free,
                    scores=best[w][1], across=best[w][2], tried=len(nuisance.tries),
                    usual=reach, unit=nuisance.unit,
                )  # fmt: skip

    def _simulator(self, fit: Fit, effect: Effect) -> Simulator | None:
        """Return the simulator that has an effect: the fit's own, or a rival FMU's."""
        if not effect.fmu or fit.simulator is not self.base:
            return fit.simulator
        return self.rivals(effect.fmu)

    def without(self, explanation: Explanation, addition: Addition, *, iterations: int = ROUGH) -> Explanation:
        """Return the explanation, fitted again, without one of its additions."""
        fit = explanation.fit
        if addition.linear is not None:
            linear = tuple(g for g in fit.linear if g.name != addition.name)
            fit = dataclasses.replace(fit, linear=linear)
        else:
            values = fit.values.copy()
            for name in {addition.name, *addition.free}:
                k = fit.simulator.index[name]
                values[k] = fit.simulator.neutral[k - len(fit.simulator.plan.names)]
            free = tuple(n for n in fit.free if n not in addition.free)
            fit = dataclasses.replace(fit, values=values, free=free)
        rest = tuple(a for a in explanation.additions if a is not addition)
        return Explanation(solved(fit, iterations=iterations), rest)

    def _without_idle(self, explanation: Explanation) -> Explanation:
        """Return the explanation without additions that are no longer needed beside others."""
        n, changed = self.samples, True
        while changed and explanation.additions:
            changed = False
            for addition in explanation.additions:
                if _wald(explanation.fit, addition) > IDLE * addition.penalty(n):
                    continue
                without = self.without(explanation, addition)
                if without.fit.cost - explanation.fit.cost < addition.penalty(n):
                    explanation, changed = self.with_noise(without, again=True), True
                    break
        return explanation

    def _mirrored(self, explanation: Explanation) -> list[Explanation]:
        """Return the explanation at the equivalent values that an effect names, such as two lags exchanged."""
        found = []
        for addition in explanation.additions:
            for known in addition.effect.mirrored(explanation.fit, addition.name):
                fit, own = explanation.fit, addition
                values = fit.values.copy()
                for name, value in known.items():
                    k = fit.simulator.index[name]
                    values[k] = np.clip(value, fit.simulator.lower[k], fit.simulator.upper[k])
                other = next((n for n in known if n not in (*fit.free, addition.name)), None)
                if other is not None:
                    effect = next(e for e in self.effects if other in {n.name for n in e.nuisances(self.base.plan)})
                    own = dataclasses.replace(addition, effect=effect, name=other, free=(other,))
                    fit = dataclasses.replace(fit, free=(*(n for n in fit.free if n not in addition.free), other))
                exchanged = solved(dataclasses.replace(fit, values=values))
                found.append(Explanation(exchanged, tuple(own if a is addition else a for a in explanation.additions)))
        return found

    def _simpler(self, explanation: Explanation, within: Sequence[Addition]) -> list[Explanation]:
        """Return the explanation with one addition in the place of two of those within samples, also mirrored.

        A delay of the current beside a lag of the speed stand for a delay of both.
        """
        found = []
        for one, two in itertools.combinations(within, 2):
            bare = self.without(self.without(explanation, one, iterations=0), two)
            tested = [
                a for a in self.additions(bare, self.effects) if _is_timing(a) and a.name not in (one.name, two.name)
            ]
            for other in sorted(tested, key=lambda a: -a.gain)[:1]:
                simpler = Explanation(self.refitted(bare, other), (*bare.additions, other))
                found += [simpler, *self._mirrored(simpler)]
        return found

    def settled(self, explanation: Explanation) -> tuple[Explanation, list[Explanation]]:
        """Return the explanation, exchanged for a rival as long as one is more likely, and its rivals."""
        for _ in range(EXCHANGES):
            rivals = self.alternatives(explanation)
            sound = [
                r for r in rivals if not any(a.effect.doubt and a.name not in explanation.names() for a in r.additions)
            ]
            best = min(sound, key=lambda e: e.criterion(self.samples), default=explanation)
            if best.criterion(self.samples) > explanation.criterion(self.samples) - EXCHANGED:
                break
            explanation = self._at_best(self._without_idle(self.with_noise(best, again=True)))
        else:
            rivals = self.alternatives(explanation)
        return explanation, rivals

    def alternatives(self, explanation: Explanation) -> list[Explanation]:
        """Return rivals: explanations, nearly as likely, in which another addition replaces one.

        A sharp one stands in for another, or for a short time constant of the model, far from where a derivative
        tells: those are always refitted.
        """
        n = self.samples
        within = [a for a in explanation.additions if _is_timing(a)]
        mirrored = self._mirrored(explanation)
        found = [e for e in mirrored if e.fit.cost - explanation.fit.cost < RIVALS_WITHIN]
        sharp = [e for e in self.effects if e.sharp and not e.is_line]
        grown = (self._best_addition(e, sharp, set()) for e in mirrored)  # a mean of fewer samples and a filter
        found += [e for e in grown if e is not None and e.criterion(n) < explanation.criterion(n) + RIVALS_WITHIN]
        simpler = self._simpler(explanation, within)
        simpler = [e for e in simpler if all(_is_physical(e.fit, a) for a in e.additions)]
        found += [e for e in simpler if e.criterion(n) < explanation.criterion(n) + RIVALS_WITHIN]
        for addition in explanation.additions:
            if addition.effect.name == "offset" or addition.effect.is_line or _is_switch(addition):
                continue
            bare = self.without(explanation, addition)
            lost = bare.fit.cost - explanation.fit.cost
            tested = [a for a in self.additions(bare, self.effects, beside=addition.name) if a.gain > 0]
            own = next((a for a in tested if a.name == addition.name), addition)
            if own is addition and own.linear is not None:
                own = dataclasses.replace(own, across=bare.fit.test().across(own.linear.columns))
            tested = [
                a for a in tested if a.name != addition.name and (not a.effect.doubt or _alike(a, own) > PARALLEL)
            ]
            likely = [a for a in tested if a.gain - a.penalty(n) > PREDICTED_PART * (lost - addition.penalty(n))]
            ranked = sorted(likely, key=lambda a: a.penalty(n) - a.gain)
            likely = list({a.effect.name: a for a in reversed(ranked)}.values())[::-1][:RIVALS_REFITTED]
            if addition in within and len(within) <= MOST_WITHIN:
                likely += [a for a in tested if _is_timing(a) and a not in likely]
            for other in likely:
                rival = Explanation(self.refitted(bare, other), (*bare.additions, other))
                if any(a.linear is not None for a in rival.additions):
                    rival = dataclasses.replace(rival, fit=solved(_renewed(rival), iterations=ROUGH))
                if rival.criterion(n) < explanation.criterion(n) + 2 * RIVALS_WITHIN:
                    rival = dataclasses.replace(rival, fit=solved(rival.fit))
                if rival.criterion(n) < explanation.criterion(n) + RIVALS_WITHIN and _is_physical(rival.fit, other):
                    found.append(rival)
        return found


def _bare(addition: Addition) -> Addition:
    """Return an addition without its columns."""
    return dataclasses.replace(addition, scores=None, across=None)


def _renewed(explanation: Explanation) -> Fit:
    """Return the fit with the columns of its additions computed again at its values."""
    fit, groups = explanation.fit, list(explanation.fit.linear)
    for a in explanation.additions:
        k = next((k for k, g in enumerate(groups) if g.name == a.name), None)
        if a.linear is None or k is None:
            continue
        at = sum(g.columns.shape[2] for g in groups[:k])
        own = slice(at, at + groups[k].columns.shape[2])
        beside = slice(len(fit.free) + own.start, len(fit.free) + own.stop)
        bare = dataclasses.replace(
            fit,
            linear=tuple(g for g in groups if g is not groups[k]),
            coefficients=np.delete(fit.coefficients, own),
            jacobian=np.delete(fit.jacobian, beside, axis=1),
            raw=np.delete(fit.raw, beside, axis=2),
        )
        new = a.effect.renewed(bare, groups[k], fit.coefficients[own])
        if new is not None and new.columns.shape == groups[k].columns.shape:
            groups[k] = new
    raw = np.concatenate([fit.raw[:, :, : len(fit.free)], *(g.columns for g in groups)], axis=2)
    return dataclasses.replace(fit, linear=tuple(groups), raw=raw)


def _with_fine_filters(fit: Fit) -> Fit:
    """Return the fit on a simulator that simulates more rows between the samples if a filter there asks for it.

    Between two rows a signal may be curved, such as the current of a winding with a shorter time constant.
    """
    s = fit.simulator
    for _ in range(DOUBLINGS):
        s.between *= 2
        finer = s.shown(fit.values[None, :])[0]
        change = fit.whitener(np.nan_to_num(finer - fit.shown)[:, :, None])[0]
        if float(np.vdot(change, change)) < NO_CHANGE:
            s.between //= 2
            break
        fit = dataclasses.replace(fit, shown=finer)
    return fit


def moved_to(fit: Fit, simulator: Simulator) -> Fit:
    """Return a fit on another simulator that knows at least its names."""
    if simulator is fit.simulator:
        return fit
    values = simulator.values(dict(zip(fit.simulator.names, fit.values.tolist(), strict=True)))
    return dataclasses.replace(fit, simulator=simulator, values=values)


def _is_physical(fit: Fit, addition: Addition) -> bool:
    """Whether an addition's values are within the bounds of its effect, and it takes no motor parameter's place."""
    if any(end != 0 and name in NEVER_ZERO for name, end in zip(fit.names, fit.at_bound, strict=True)):
        return False
    if addition.linear is not None:
        own = [x for n, x in zip(fit.names, fit.estimates, strict=True) if n.partition("#")[0] == addition.name]
        return all(addition.linear.least <= x <= addition.linear.most for x in own)
    s = fit.simulator
    for name in addition.free:
        k = s.index[name]
        neutral, value = s.neutral[k - len(s.plan.names)], fit.values[k]
        at_end = min(value - s.lower[k], s.upper[k] - value) <= 1e-6 * (s.upper[k] - s.lower[k])
        if at_end and abs(value - neutral) > 1e-6 * (s.upper[k] - s.lower[k]):
            return False
    return True


def _has_its_needs(fit: Fit, addition: Addition) -> bool:
    """Whether what an addition makes no sense without is there too."""
    needs = [n.needs for n in fit.simulator.nuisances if n.name in addition.free and n.needs]
    return set(needs) <= set(fit.free)


def _alike(one: Addition, other: Addition) -> float:
    """Return the largest canonical correlation of two additions' columns, without what the fit explains."""
    if one.across is None or other.across is None or len(one.across) != len(other.across):
        return 0.0
    first, second = (np.linalg.qr(a)[0] for a in (one.across, other.across))
    return float(np.linalg.svd(first.T @ second, compute_uv=False)[0])


def is_full(explanation: Explanation) -> bool:
    """Whether an explanation has more additions of the last one's kind than are taken: spectral lines, or others."""
    lines = explanation.additions[-1].effect.is_line
    return sum(a.effect.is_line == lines for a in explanation.additions) > MOST_ADDITIONS


def _is_switch(addition: Addition) -> bool:
    """Whether an addition is a switch of the drive that the recordings show before any fit, such as an open circuit."""
    return bool(np.isinf(addition.gain)) and not addition.free


def _is_timing(addition: Addition) -> bool:
    """Whether an addition is a nuisance parameter of what happens within samples: a delay, a filter, a mean."""
    return addition.effect.sharp and not addition.effect.is_line and addition.linear is None


def _is_excluded(nuisance: Nuisance, taken: set[str]) -> bool:
    if nuisance.needs and nuisance.needs not in taken:
        return True
    return any(name.startswith(prefix) for prefix in nuisance.excludes for name in taken)


def _wald(fit: Fit, addition: Addition) -> float:
    """Return the Wald statistic of an addition: the square of its numbers over their covariance."""
    names = list(fit.names)
    covariance, at_bound, estimates = fit.covariance(), fit.at_bound, fit.estimates
    wanted = addition.free if addition.linear is None else tuple(
        n for n in names if n.partition('#')[0] == addition.name and n not in fit.free
    )  # fmt: skip
    total = 0.0
    for name in wanted:
        k = names.index(name)
        s = fit.simulator
        neutral = s.neutral[s.index[name] - len(s.plan.names)] if name in s.index else 0.0
        if at_bound[k] == 0 and covariance[k, k] > 0:
            off = np.log(estimates[k] / neutral) if fit.is_log[k] else estimates[k] - neutral
            total += float(off**2 / covariance[k, k])
    return total if wanted else np.inf
