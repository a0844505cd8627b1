"""Selection of effects: all are score-tested at once, the best refitted with their rivals. Knows no effect.

By the criterion of explanation.py an effect that is not there is accepted with a chance of 1e-4 or less (k = 1,
n = 2 000, prior 0.2: chi-square above 10.8; benchmarks/combined.py measures the rate).

    fit what is free; what explains most of what it misses comes first
    estimate the noise from settled rows
    repeat: score-test every addition, what each recording may have, such as its delay, together too; refit the best
            few; accept the best if the criterion falls, and with it what ranks beside it of the same effect in other
            samples, such as the offsets of several recordings
    drop additions that are no longer needed

The noise is estimated again after every addition, from settled rows, so that it does not contain what an effect
explains.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition import (
    Addition,
    apart,
    has_its_needs,
    is_held,
    is_needed,
    is_physical,
    is_switch,
    is_timing,
    together,
    wald,
    without_columns,
)
from estimator.explaining.addition_tests import AdditionTests
from estimator.explaining.common_number import in_common
from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.explanation import (
    MOST_ADDITIONS,
    Explanation,
    at_whole_number,
    followed,
    is_full,
    mirrored,
    moved_to,
    moves_ripple,
    named_anew,
    renewed,
    reshaped,
    with_added,
    with_fine_filters,
    without,
)
from estimator.explaining.explanation_noise import (
    by_known_forms,
    by_noise_of,
    with_jitter,
    with_noise,
    with_noise_of_neighbours,
)
from estimator.explaining.first_fit import NO_NOISE, FirstFit
from estimator.fitting.effort import OF_ADDITIONS, Effort
from estimator.fitting.fit import Fit, new_fit, set_aside
from estimator.fitting.gauss_newton import ITERATIONS, ROUGH, solved, solved_roughly
from estimator.fitting.simulator import Simulator, per_recording
from estimator.fitting.windows import find_windows

FloatArray = NDArray[np.float64]

ROUNDS = 20  # of additions accepted or rejected, at most
REFITTED = 3  # additions refitted in a round
PREDICTED_PART = 0.6  # of the best predicted fall of the criterion: with less an addition is not refitted
MOST_OF_IT = 0.5  # of what is missed beyond the noise: what explains more is added before all else
AS_MUCH = 0.9  # of what the best explains: another that does may be the right one, before what is beside it is known
FIRST_ORDER = 0.1  # of it: a long delay or filter explains to first order a small part of what it does when fitted,
NEARLY_ALL = 0.8  # and is added before all else where that is so much of what is missed
RESHAPED = 2  # times that all columns are tried in other forms, at most
MISSED = 1.1  # of z'z a sample: with more, noise is not all that is missed
MUCH = 4.0  # likewise: with more the noise is hardly a part of it
WORTH = 0.02  # of what its outputs miss then: what explains less makes up for another effect, that is not known
COMPARED, DOUBLINGS = 2.0, 2  # of z'z: more rows between the samples change less, while rivals are compared; at most
LEAST_LEFT = 0.05  # of a parameter that never vanishes, where a score test takes it below
ABSURD = 2 * float(np.log(100.0))  # of the criterion: what no bench does has a chance of 1 in 100, by a wrong clock
IDLE = 6.0  # times the penalty: an addition is refitted without if its Wald statistic is below


@dataclass
class Selection:
    """The search for an explanation.

    Parameters
    ----------
    tests : AdditionTests
        Of what may be added.
    first : FirstFit
        Where it begins.
    differenced : (q,) array
        Deviation of the counts that a channel differences; 0: it shows no counts.
    effects : those that may be found
    effort : Effort
        What may be simulated for it.
    """

    tests: AdditionTests
    first: FirstFit
    differenced: FloatArray
    effects: tuple[Effect, ...]
    effort: Effort

    def mirrored(self, explanation: Explanation, *, iterations: int = ITERATIONS, limit: float) -> list[Explanation]:
        """Return an explanation at the equivalent values that its effects name; the rest as for `solved`."""
        return mirrored(explanation, self.effects, self.tests.base.plan, iterations=iterations, limit=limit)

    def added(self, explanation: Explanation, addition: Addition, *, limit: float = np.inf) -> Explanation:
        """Return an explanation fitted with one more addition, a ripple where that moves it; limit as for `solved`."""
        if not moves_ripple(explanation, addition):
            found = with_added(explanation, self.refitted(explanation, addition, limit=limit), addition)
            return followed(found, least=1.0) if addition.effect.follows else found
        found = with_added(explanation, self.refitted(explanation, addition), addition)
        return dataclasses.replace(found, fit=solved_roughly(renewed(found), limit=limit))

    def explain(self, starts: Sequence[FloatArray], known: Explanation | None = None) -> Explanation:
        """Return the best explanation.

        Parameters
        ----------
        starts : (p,) arrays
            Of the plan's free parameters.
        known : Explanation, optional
            Of a part of the rows: what it holds is not looked for again, and fitted to all of them.
        """
        with self.first.held_near(starts):
            begun = self.first.explanation(starts) if known is None else self._begun(known)
            best = self._by_white_noise(begun)
            if best is not None:  # then the first fit is hardly ever asked again, and of a million rows a tenth of all
                again, begun = set_aside(begun.fit), Explanation(best.fit, begun.additions)
                if self.best_addition(best, self.effects, set()) is not None:
                    best, begun = None, Explanation(again(), begun.additions)
            if best is None:
                best = self._with_effects(begun, sharp=known is None)  # the part has told what is sharp
            del begun
            if (shaken := with_jitter(best, self.differenced)) is not None:
                best = self.without_idle(self.grown(shaken, self.effects))
            if (formed := self.reshaped(best)) is not best:
                best = self.without_idle(formed)
            twins = self.mirrored(best, limit=best.fit.cost)
            twins = [e for e in twins if e.is_physical() and not e.names() > best.names()]  # one with more is a rival
            best = min([best, *twins], key=lambda e: e.fit.cost)
        if best.fit.simulator is self.tests.base:
            best = dataclasses.replace(best, fit=with_fine_filters(best.fit, most=DOUBLINGS, least=COMPARED)[0])
        return self.at_best(best)

    def _by_white_noise(self, first: Explanation) -> Explanation | None:
        """Return a first fit by its noise, where that is white; else None.

        White noise contains none of what `_with_effects` looks for before it estimates the noise.
        """
        if abs(first.fit.cost / self.tests.samples - 1) > NO_NOISE or not find_windows(first.fit).enough:
            return None
        best = with_noise(first, self.differenced)
        if not best.fit.whitener.is_white:
            return None
        first.fit.forget()  # of a million rows a quarter of what is held
        return best

    def _with_effects(self, best: Explanation, *, sharp: bool) -> Explanation:
        """Return the explanation with its noise and its effects; `sharp`: look for these before coloured noise."""
        best = self._mostly_explained(best)
        lines = [e for e in self.effects if e.is_line]
        best = bare = self.grown(best, lines, renew=False)  # before the noise, which would contain them
        if find_windows(best.fit).enough:
            if sharp:
                best = with_noise(best, self.differenced, colour=False)
                sharp_ones = [e for e in self.effects if e.sharp]
                best = self.grown(best, [e for e in sharp_ones if not e.is_last], colour=False)
                if best.excess(self.tests.samples) > MUCH:  # what is usual first: others make up for it
                    best = self.grown(best, [e for e in self.effects if e.prior > SELDOM], colour=False)
                best = self.retimed(best, colour=False)
                if best.names() != bare.names():  # beside what is late they were not worth it
                    best = self.grown(best, lines, colour=False)
        else:  # a noise from residuals would contain missing effects: neighbours tell it first
            best = with_noise_of_neighbours(best, self.differenced)
            best = self.grown(best, self.effects, renew=False)
        best = with_noise(best, self.differenced)
        for is_last in (False, True):  # effects and noise depend on each other
            before = best.names()
            best = self.without_idle(self.retimed(self.grown(best, self.effects)))
            if best.names() == before:
                break
            best = with_noise(best, self.differenced)
            if not is_last and self.effort.is_spent(part=OF_ADDITIONS):
                break
        return best

    def _mostly_explained(self, begun: Explanation) -> Explanation:
        """Return an explanation with what explains most of what it misses, by the better of two first steps.

        Two effects may each explain nearly as much, such as a load and a dry friction, as long as what is beside them
        is not known. With that only the right one explains all, and from the other nothing leads back.
        """
        found = self._best_additions(begun, self.effects, set(), MOST_OF_IT)
        ways = found[:1]
        for fall, other in found[1:]:
            one, two = found[0][1].additions[-1], other.additions[-1]
            alike = one.effect is two.effect or (is_timing(one) and is_timing(two))  # those are rivals later
            if not alike and fall > AS_MUCH * found[0][0]:
                ways = [*ways, (fall, other)]
                break
        grown = [self.grown(way, self.effects, renew=False, share=MOST_OF_IT) for _, way in ways]
        return min(grown, key=lambda e: e.criterion(self.tests.samples), default=begun)

    def reshaped(self, explanation: Explanation, *, colour: bool = True) -> Explanation:
        """Return an explanation whose columns have the forms that explain most, each by its own noise.

        Of a wrong form the noise takes in what it leaves, and other effects come to make up for it.
        """
        n = self.tests.samples
        for _ in range(RESHAPED):
            before = explanation
            for a in explanation.additions:
                tried = (with_noise(e, self.differenced, colour=colour, again=True) for e in reshaped(explanation, a))
                explanation = min([explanation, *tried], key=lambda e: e.misfit(n))
            if explanation is before:
                break
        return explanation

    def retimed(self, explanation: Explanation, *, colour: bool = True) -> Explanation:
        """Return an explanation that misses more than noise with another timing of a channel, where that explains more.

        Beside what was not known yet a filter may have fitted better than a mean. What came then makes up for it. And
        what is told only where no explanation without it is near is exchanged for one that is.
        """
        n = self.tests.samples
        channel = {nuisance.name: nuisance.channel for nuisance in self.tests.base.nuisances}
        sharp = [e for e in self.effects if e.sharp and not e.is_line]
        for a in [a for a in explanation.additions if is_timing(a) and channel.get(a.name)]:
            if explanation.excess(n) <= MISSED and not a.effect.is_last:
                continue
            bare = without(explanation, a, iterations=0)
            found, most = list[Explanation](), explanation.criterion(n) + (ABSURD if a.effect.is_last else 0.0)
            for b in self.tests.additions(bare, [e for e in sharp if not (a.effect.is_last and e.is_last)]):
                if self.effort.is_spent(part=OF_ADDITIONS):
                    break
                if is_timing(b) and b.name != a.name and channel.get(b.name) == channel[a.name]:
                    other = self.added(bare, b, limit=most)
                    if other.is_physical() and other.criterion(n) < most:
                        found, most = [other], other.criterion(n)
            if found:
                explanation = with_noise(found[0], self.differenced, colour=colour, again=True)
        return explanation

    def at_best(self, best: Explanation) -> Explanation:
        """Return an explanation fitted to the end, without what that makes absurd."""
        final = solved(best.fit, tolerance=1e-8, left=True)
        while absurd := [a for a in best.additions if not (is_physical(final, a) and has_its_needs(final, a))]:
            best = without(dataclasses.replace(best, fit=final), absurd[-1])
            final = solved(best.fit, tolerance=1e-8)
        return named_anew(dataclasses.replace(best, fit=final))

    def _begun(self, known: Explanation) -> Explanation:
        """Return an explanation of a part of the rows, fitted to all of them."""
        there, wanted = known.fit, next((a.effect.fmu for a in known.additions if a.effect.fmu), "")
        simulator = self.tests.rivals(wanted) if wanted else self.tests.base
        assert simulator is not None  # the part had it
        values = simulator.values(dict(zip(there.simulator.names, there.values.tolist(), strict=True)))
        values = np.clip(values, simulator.lower, simulator.upper)
        free = [n for n in there.free if n in simulator.index]  # all rows may rule out what the part allows
        fit = new_fit(simulator, values, free, there.whitener.noise)
        best = Explanation(solved(self.first.with_open_columns(fit), iterations=ROUGH, told=False))
        for a in known.additions:
            if a.linear is None:
                own = (without_columns(a),) if a.name in simulator.index else ()
                best = dataclasses.replace(best, additions=(*best.additions, *own))
                continue
            found = self.tests.additions(best, [a.effect], beside=a.name)
            same = [b for b in found if b.name == a.name] or found
            if same:  # of several forms with its name the likeliest
                b = max(same, key=lambda b: b.gain)
                best = with_added(best, self.refitted(best, b), without_columns(b))
        return best

    def grown(
        self,
        explanation: Explanation,
        effects: Sequence[Effect],
        *,
        colour: bool = True,
        renew: bool = True,
        share: float = 0.0,
    ) -> Explanation:
        """Return the explanation with every addition that lowers the criterion, one after the other.

        Parameters
        ----------
        colour : bool
            Whether the noise may be coloured.
        renew : bool
            Whether the noise is estimated again after each.
        share : float
            Of what is missed beyond the noise: an addition has to explain more, where more is missed than noise, and
            no bound is why.
        """
        n, rejected = self.tests.samples, set[str]()
        for _ in range(ROUNDS):
            found = self.best_addition(explanation, effects, rejected, share)
            if found is None or is_full(found) or self.effort.is_spent(part=OF_ADDITIONS):
                break
            found = self._switched(found)
            judged = with_noise(found, self.differenced, colour=colour, again=True) if renew else found
            absurd = [a for a in judged.additions if not is_physical(judged.fit, a, before=explanation.fit)]
            if judged.additions[-1] in absurd:
                rejected.add(found.additions[-1].name)
                continue
            for a in absurd:  # the new one has taken its place
                judged = without(judged, a)
            before = by_noise_of(judged, explanation) if absurd else explanation
            if absurd and judged.criterion(n, before.excess(n)) > before.criterion(n, before.excess(n)):
                rejected.add(found.additions[-1].name)  # or it has not
                continue
            explanation = self.reshaped(judged, colour=colour) if renew and is_timing(judged.additions[-1]) else judged
            rejected.clear()
        return explanation

    def _switched(self, found: Explanation) -> Explanation:
        """Return an explanation with the drive's switch that is likeliest beside what was found last."""
        twins = mirrored(
            found, self.effects, self.tests.base.plan, of=is_switch, iterations=ROUGH, limit=found.fit.cost
        )
        return min([found, *twins], key=lambda e: e.fit.cost)

    def best_addition(
        self, explanation: Explanation, effects: Sequence[Effect], rejected: set[str], share: float = 0.0
    ) -> Explanation | None:
        """Return the explanation with the addition that lowers the criterion most; None if none does."""
        return next((e for _, e in self._best_additions(explanation, effects, rejected, share)), None)

    def _best_additions(
        self, explanation: Explanation, effects: Sequence[Effect], rejected: set[str], share: float
    ) -> list[tuple[float, Explanation]]:
        """Return by how much additions lower the criterion, and the explanations with them, the best first.

        The others are fitted as far as they might have been the best.
        """
        n, excess = self.tests.samples, explanation.excess(self.tests.samples)
        least = share * (explanation.fit.cost - n)
        if share and (least < share * n or is_held(explanation.fit)):
            return []
        missed = explanation.fit.missed_by_output() if excess > MISSED else None

        def worth(a: Addition) -> float:
            there = a.shows_in(explanation.fit.simulator)
            own = max(least, a.effect.share * (explanation.fit.cost - n))
            return own if missed is None else max(own, WORTH * float(np.sum(missed[there])))

        while True:
            tested = self.tests.additions(explanation, effects)
            tested = [a for a in (*tested, *self._of_each_recording(tested, explanation)) if a.name not in rejected]
            ranked = sorted(tested, key=lambda a: excess * a.penalty(n) - a.gain)
            ranked = [a for a in ranked if a.gain > excess * a.penalty(n)]
            likely = [a for a in ranked if a.gain > worth(a)]
            late = [a for a in ranked if share and is_timing(a) and worth(a) >= a.gain > FIRST_ORDER * least]
            if not likely and not late:
                return []
            most = likely[0].gain - excess * likely[0].penalty(n) if likely else 0.0
            best_few = [a for a in likely[:REFITTED] if a.gain - excess * a.penalty(n) > PREDICTED_PART * most]
            found: list[tuple[float, Explanation]] = []
            for a in (*best_few, *of_same_channel(explanation.fit.simulator, best_few, likely), *late):
                by_itself = a in late and not a.parts
                wanted = NEARLY_ALL * (explanation.fit.cost - n) if by_itself else worth(a)
                least_cost = explanation.fit.cost - max(excess * a.penalty(n), wanted)
                with_it = self.added(explanation, a, limit=least_cost - max((fall for fall, _ in found), default=0.0))
                if with_it.fit.cost < least_cost and is_physical(with_it.fit, a, before=explanation.fit):
                    parts = dataclasses.replace(with_it, additions=(*explanation.additions, *(a.parts or (a,))))
                    found.append((least_cost - with_it.fit.cost, parts if a.parts else with_it))
            if found:
                (fall, best), *others = sorted(found, key=lambda f: -f[0])
                return [(fall, self._in_company(best, ranked, explanation) or best), *others]
            if not best_few:
                return []
            rejected |= {a.name for a in best_few}

    def _of_each_recording(self, tested: Sequence[Addition], explanation: Explanation) -> list[Addition]:
        """Return nuisance parameters that every recording has, such as its delay, as one: each alone explains a part.

        What a bench does to one recording, or has been found to do to some, it is likely to do to the others.
        """
        plan, known, kinds = self.tests.base.plan, explanation.names(), dict[str, list[Addition]]()
        for a in tested:
            if a.linear is None and a.gain > 0 and a.name in per_recording(plan, a.effect.name):
                kinds.setdefault(a.effect.name, []).append(a)
        return [
            together(own) for kind, own in kinds.items()
            if 1 < len(own) == sum(name not in known for name in per_recording(plan, kind))
        ]  # fmt: skip

    def _in_company(self, found: Explanation, ranked: Sequence[Addition], before: Explanation) -> Explanation | None:
        """Return what was found with what ranks beside it of its effect in other samples; None where that is no better.

        Recordings fitted together have each its own offset: one a round would cost as many rounds as recordings.
        """
        addition = found.additions[-1]
        if addition.linear is None:
            return None
        beside = [a for a in itertools.takewhile(lambda a: a.effect is addition.effect, ranked) if a is not addition]
        company = apart([addition, *beside])[1 : 1 + MOST_ADDITIONS - len(found.additions)]
        if not company:
            return None
        own = [a.linear for a in (addition, *company) if a.linear is not None]
        fit = dataclasses.replace(found.fit, linear=(*before.fit.linear, *own))
        more = Explanation(solved_roughly(fit), (*found.additions, *company))
        n, excess = self.tests.samples, before.excess(self.tests.samples)
        sound = all(is_physical(more.fit, a) for a in (addition, *company))
        return more if sound and more.criterion(n, excess) < found.criterion(n, excess) else None

    def refitted(self, explanation: Explanation, addition: Addition, *, limit: float = np.inf) -> Fit:
        """Return the fit with an addition, from the start of the largest predicted fall; limit as for `solved`."""
        fit = explanation.fit
        if addition.linear is not None:
            return solved_roughly(dataclasses.replace(fit, linear=(*fit.linear, addition.linear)), limit=limit)
        simulator = self.tests.simulator(fit, addition.effect)
        assert simulator is not None
        moved = moved_to(fit, simulator)
        begun = []
        for start in (*addition.starts, *_with_others_moved(moved, addition)):
            values = simulator.at(moved.values, start)
            begun.append(dataclasses.replace(moved, values=values, free=(*moved.free, *addition.free)))
        settling = ROUGH if not addition.free else 1
        ready = [solved(b, iterations=settling) for b in begun] if len(begun) > 1 else begun
        best = min(ready, key=lambda f: f.cost)
        if not addition.free and best.cost < fit.cost:
            best = at_whole_number(best, addition)
        return solved_roughly(best, limit=limit)

    def without_idle(self, explanation: Explanation) -> Explanation:
        """Return the explanation without additions that are no longer needed beside others.

        All are judged by the noise of the whole explanation: one that is estimated again after each would take in what
        it has lost, and let go of the next.
        """
        n, whole = self.tests.samples, by_known_forms(explanation)
        slimmer, excess = whole, whole.excess(n)
        while idle := next(
            (rest for rest in self._slimmer(slimmer) if rest.criterion(n, excess) < slimmer.criterion(n, excess)), None
        ):
            slimmer = idle
        return explanation if slimmer is whole else with_noise(slimmer, self.differenced, again=True)

    def _slimmer(self, explanation: Explanation) -> Iterator[Explanation]:
        """Return the explanation without each of those additions that may be idle: no other makes no sense without.

        So may all but one of the numbers be that each recording has for itself.
        """
        excess = explanation.excess(self.tests.samples)
        yield from in_common(explanation, self.tests.samples)
        for addition in explanation.additions:
            if is_needed(explanation.fit, addition, explanation.additions):
                continue
            penalty = excess * addition.penalty(self.tests.samples)
            if wald(explanation.fit, addition) <= IDLE * penalty:
                least = explanation.fit.cost + penalty
                yield without(explanation, addition, limit=least)


def _with_others_moved(fit: Fit, addition: Addition) -> list[Mapping[str, float]]:
    """Return the start of the largest predicted fall with all else of a fit where its score test says that it goes.

    Of what another FMU has: most of a motor's friction may be dry, and its viscous one a tenth of what stood for both.
    """
    if not (addition.effect.fmu and addition.usual > 0 and addition.scores is not None):
        return []
    start = addition.starts[0]
    times = (start[addition.name] - fit.simulator.neutral.get(addition.name, 0.0)) / addition.usual
    moves = times * addition.usual_scores.moves[: len(fit.free), 0]
    there = {
        name: fit.value(name) * max(1.0 - move, LEAST_LEFT) if is_log else fit.value(name) - move
        for name, move, is_log in zip(fit.free, moves.tolist(), fit.is_log.tolist(), strict=False)
    }
    return [{**there, **start}]


def of_same_channel(simulator: Simulator, best_few: Sequence[Addition], ranked: Sequence[Addition]) -> list[Addition]:
    """Return what else happens within samples of the channels of the best few; of all, where the voltage is slow.

    A mean for a filter, a filter of second order for one of first: which of them fits best a score test does not tell.
    """
    channel = {n.name: n.channel for n in simulator.nuisances}
    shown, known = {channel.get(a.name) for a in best_few if is_timing(a)}, {a.name for a in best_few}
    slow = {n.name for n in simulator.nuisances if n.act is not None and not n.channel}
    every = any(a.name in slow for a in best_few)
    return [a for a in ranked if is_timing(a) and a.name not in known and (every or channel.get(a.name) in shown)]
