"""Rivals of an explanation: others, nearly as likely, in which another addition replaces one. Averages nothing."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from estimator.explaining.addition import Addition, alike, is_physical, is_sure, is_switch, is_timing
from estimator.explaining.explanation import (
    Explanation,
    followed,
    in_place_of_model,
    in_two,
    moves_ripple,
    renewed,
    with_fine_filters,
    without,
)
from estimator.explaining.explanation_noise import by_noise_of, with_noise
from estimator.explaining.selection import ABSURD, MISSED, PREDICTED_PART, Selection, of_same_channel
from estimator.fitting.gauss_newton import ROUGH, solved, solved_roughly
from estimator.motor.winding import time_constant
from estimator.plans.part import LONG

RIVALS_WITHIN = 10.0  # of the criterion: explanations that are no further above the best are rivals
PARALLEL = 0.9  # canonical correlation of an addition with one that is doubted: it is refitted as a rival, as is one
# that is predicted to be nearly as likely
RIVALS_REFITTED = 5  # rivals of an addition that are refitted, of each effect the likeliest
MOST_WITHIN = 2  # additions of what happens within samples, each exchanged for every other of these
MOST_PAIRED = 3  # of them, for each pair of which one is tried
MOST_FULLER, LEAST_GAIN = 4, 3.0  # rivals to which one more is added; fall of z'z by it that is worth a refit
OTHER_INDUCTANCE, BETWEEN = 5.0, 0.4  # times L; samples of L / R, of which one minimum is below, the other above
SAME = 0.1  # standard errors: explanations that are no further apart are one
MOST_ALIKE = 2  # additions of an effect that are exchanged: many recordings with an offset each tell it by themselves
MOST_LED_BACK = 3  # explanations, the likeliest first, from which what is absurd is taken away
MOST_ROWS = 140_000  # between the samples, of all recordings: with more a fit takes minutes where the FMU has modes
MOST_LEFT = 10.0  # of z'z: what the last of them changes at most, ten times as much as the next would
UNTOLD = 1.0  # of a parameter: its standard error then tells nothing of it
FURTHER = 100.0  # of the criterion: what another FMU has is given another timing where it is no further behind
FOLLOWS = 1.0  # fall of z'z for which the columns of a rival are computed once more at its values
EXCHANGES, EXCHANGED = 8, 0.1  # of an explanation for a more likely rival, at most; by which its criterion is lower
FEW_EXCHANGES = 2  # of one that misses more than noise, at most: an effect that is not known makes every rival likelier


def settled(selection: Selection, explanation: Explanation) -> tuple[Explanation, list[Explanation]]:
    """Return the explanation, exchanged for a rival as long as one is more likely, and its rivals."""
    explanation, rivals = _exchanged_for_rivals(selection, explanation)
    sensible = None if selection.effort.is_spent() else _without_absurd(selection, explanation, rivals)
    return (explanation, rivals) if sensible is None else _exchanged_for_rivals(selection, sensible, most=1)


def _exchanged_for_rivals(
    selection: Selection, explanation: Explanation, *, most: int = EXCHANGES
) -> tuple[Explanation, list[Explanation]]:
    """Return the same by so many exchanges at most, where what is absurd stays."""
    n = selection.tests.samples
    others: list[Explanation] | None = None
    fuller: list[Explanation] | None = None
    for k in range(most):
        if (k >= FEW_EXCHANGES and explanation.excess(n) > MISSED) or (k and selection.effort.is_spent()):
            break
        others, fuller = _others(selection, explanation), None
        best = _likelier(selection, explanation, others)
        if best is None:  # then what the criterion did not accept by its score test may be
            fuller = _fuller(selection, explanation, others)
            best = _likelier(selection, explanation, fuller)
        if best is None:
            break
        best = selection.grown(with_noise(best, selection.differenced, again=True), selection.effects)
        best = selection.at_best(selection.without_idle(best))
        if best.misfit(n) > explanation.misfit(n) - EXCHANGED:  # by its own noise it is not the likelier
            break
        explanation, others, fuller = best, None, None
    others = _others(selection, explanation) if others is None else others
    fuller = _fuller(selection, explanation, others) if fuller is None else fuller
    return explanation, _nearest(selection, explanation, [*others, *fuller])


def _likelier(selection: Selection, explanation: Explanation, others: Sequence[Explanation]) -> Explanation | None:
    """Return the likeliest of other explanations that needs no doubt, if it is likelier than an explanation."""
    n, own = selection.tests.samples, explanation.names()
    rivals = _nearest(selection, explanation, others)
    sound = [r for r in rivals if not any(a.effect.doubt and a.name not in own for a in r.additions)]
    sound = [r for r in sound if _tells(r) >= _tells(explanation)]
    excess, most = explanation.excess(n), explanation.evidence(n) + RIVALS_WITHIN
    sound = [r for r in sound if r.evidence(n) < most]  # what it finds may be of a size that hardly any bench has

    def charged(e: Explanation) -> float:
        is_last = any(a.effect.is_last and a.name not in own for a in e.additions)
        return e.criterion(n, excess) + (ABSURD if is_last else 0.0)

    best = min(sound, key=charged, default=explanation)
    is_likelier = charged(best) <= explanation.criterion(n, excess) - excess * EXCHANGED
    return best if is_likelier else None


def _tells(explanation: Explanation) -> int:
    """Return how many of the plan's parameters are told: to better than their own size, off their bounds."""
    fit = explanation.fit
    p = len(fit.simulator.plan.names)
    errors, values = np.sqrt(np.diag(fit.covariance())[:p]), fit.estimates[:p]
    relative = np.where(fit.is_log[:p], errors, errors / np.maximum(np.abs(values), 1e-300))
    return int(np.count_nonzero((relative < UNTOLD) & (fit.at_bound[:p] == 0)))


def simulated_finely(
    selection: Selection, explanation: Explanation, rivals: list[Explanation]
) -> tuple[Explanation, list[Explanation], bool]:
    """Return an explanation and its rivals fitted on rows between the samples that are fine enough for their filters.

    While they are looked for, all of them are simulated as coarsely: what that costs one it costs the others.

    Returns
    -------
    Explanation, rivals, and whether the rows are fine enough: more of them would move nothing by a standard error.
    """
    s = explanation.fit.simulator
    if s.rows > LONG:
        return explanation, rivals, True
    begun, left = s.between, 0.0
    for e in (explanation, *rivals):  # one of them may have a shorter winding, or a filter that another has not
        finest, there = s.between, e.fit.simulator
        there.between = finest
        fit = e.fit if finest == begun else dataclasses.replace(e.fit, shown=there.shown(e.fit.values[None, :])[0])
        left = max(left, with_fine_filters(fit, most=max(1, int(np.log2(MOST_ROWS / (s.rows * finest)))))[1])
        s.between = there.between
    if s.between > begun:
        for rival in rivals:
            rival.fit.simulator.between = s.between
        explanation = selection.at_best(explanation)
        rivals = [dataclasses.replace(r, fit=solved_roughly(r.fit)) for r in rivals]
    return explanation, rivals, left < MOST_LEFT


def _without_absurd(
    selection: Selection, explanation: Explanation, rivals: Sequence[Explanation]
) -> Explanation | None:
    """Return an explanation without what no bench does, such as a delay before its input; None if none is near.

    Nor does it tell a voltage that rises slowly where what is late may be so by filters and delays.

    Effects that stand for others come in company: a filter for a mean, a delay to make up for it, a friction for the
    rest. No single exchange leads back from there.
    """
    plan, n = selection.tests.base.plan, selection.tests.samples
    fit = explanation.fit
    absurd = {
        a.effect.name
        for a in explanation.additions
        if a.name in fit.simulator.index
        and (a.effect.is_last or (not a.effect.doubt and a.effect.doubted(a.name, a.effect.size(fit, a.name), plan)))
    }
    if not absurd:
        return None
    others = [e for e in selection.effects if e.name not in absurd]
    found = []
    for bare in (explanation, *rivals)[:MOST_LED_BACK]:
        for a in bare.additions:
            if a.effect.name in absurd:
                bare = without(bare, a)
        grown = selection.at_best(selection.without_idle(selection.grown(bare, others)))
        behind = grown.criterion(n) - by_noise_of(grown, explanation).criterion(n)
        found.append((behind, grown))
    behind, best = min(found, key=lambda f: f[0])
    return best if behind < ABSURD else None


def _others(selection: Selection, explanation: Explanation) -> list[Explanation]:
    """Return other explanations, in which another addition replaces one, one two, or two one.

    A sharp one stands in for another, or for a short time constant of the model, far from where a derivative
    tells: those are always refitted.
    """
    within = [a for a in explanation.additions if is_timing(a) and not is_sure(explanation.fit, a)]
    switches = {a.name for a in explanation.additions if is_switch(a)}  # which of them it is has been told before
    limit = _most(selection, explanation, within)
    found = [twin for twin in selection.mirrored(explanation, limit=limit) if switches <= twin.names()]
    found += in_two(explanation, selection.effects, selection.tests.base.plan)
    found += _with_other_inductance(explanation)
    if not selection.effort.is_spent():
        found += _in_place_of_lateness(selection, explanation, within)
    if len(within) <= MOST_PAIRED and not selection.effort.is_spent():
        found += _simpler(selection, explanation, within)
    for addition in explanation.additions:
        if selection.effort.is_spent():
            break
        many = sum(a.effect is addition.effect for a in explanation.additions)
        is_open = not (addition.effect.is_line or is_switch(addition) or is_sure(explanation.fit, addition))
        if is_open and many <= MOST_ALIKE:
            sharp_too = addition in within and len(within) <= MOST_WITHIN
            found += _exchanged(selection, explanation, addition, sharp_too=sharp_too)
    return [e for e in found if e.is_physical()]


def _most(selection: Selection, explanation: Explanation, gone: Sequence[Addition]) -> float:
    """Return the most z'z of a rival that has some additions no more."""
    return explanation.fit.cost + 2 * RIVALS_WITHIN + sum(a.penalty(selection.tests.samples) for a in gone)


def _in_place_of_lateness(
    selection: Selection, explanation: Explanation, within: Sequence[Addition]
) -> list[Explanation]:
    """Return the explanation with what the model may stand for in the place of what makes all outputs late.

    Any recording of a command is explained as well by a voltage that rises as slowly as the current, and no inductance.
    That is no news. But beside a winding that stands for the rise, what is left of the winding makes all outputs late.
    """
    s = explanation.fit.simulator
    channel = {a.name: s.nuisance(a.name).channel for a in within}
    late = [[a] for a in within if not channel[a.name]]
    own = [a for a in within if channel[a.name]]
    late += [own] if {channel[a.name] for a in own} == set(s.outputs) else []
    if not late:
        return []
    limit = _most(selection, explanation, within)
    found = []
    for twin in in_place_of_model(explanation, selection.effects, limit=limit):
        for gone in late if twin.fit.cost < limit else []:
            other = twin
            for a in gone:
                other = without(other, a, limit=limit)
            found.append(other)
    return found


def _with_other_inductance(explanation: Explanation) -> list[Explanation]:
    """Return the explanation from a start with another inductance: below a sampling interval L may have two minima."""
    fit, s = explanation.fit, explanation.fit.simulator
    if not {"R", "L"} <= set(fit.free):
        return []
    samples = time_constant(fit.value("R"), fit.value("L")) / min(clock.step for clock in s.clocks)
    if samples > 1.0:
        return []
    values = fit.values.copy()
    values[s.index["L"]] *= OTHER_INDUCTANCE if samples < BETWEEN else 1 / OTHER_INDUCTANCE
    other = solved(dataclasses.replace(fit, values=values), limit=fit.cost + 2 * RIVALS_WITHIN, beside=fit)
    return [dataclasses.replace(explanation, fit=other)]


def _nearest(selection: Selection, explanation: Explanation, found: Sequence[Explanation]) -> list[Explanation]:
    """Return the rivals among others, which are nearly as likely, the likeliest first, each once."""
    n, rivals = selection.tests.samples, [explanation]
    for e in sorted(found, key=lambda e: e.criterion(n)):
        behind = min(e.criterion(n) - explanation.criterion(n), e.evidence(n) - explanation.evidence(n))
        if behind < RIVALS_WITHIN and not any(_is_same(e, known) for known in rivals):
            rivals.append(e)
    return rivals[1:]


def _is_same(one: Explanation, other: Explanation) -> bool:
    """Whether two explanations are one, reached from two sides."""
    if one.names() != other.names() or abs(one.fit.cost - other.fit.cost) > EXCHANGED:
        return False
    s, p = other.fit.simulator, len(other.fit.simulator.plan.names)
    deviation = np.sqrt(np.diag(other.fit.covariance())[:p])
    apart = np.abs(one.fit.simulator.scaled(one.fit.values)[:p] - s.scaled(other.fit.values)[:p])
    bound = other.fit.at_bound[:p]
    return bool(np.all((apart <= SAME * deviation) | ((bound != 0) & (bound == one.fit.at_bound[:p]))))


def _fuller(selection: Selection, explanation: Explanation, rivals: Sequence[Explanation]) -> list[Explanation]:
    """Return the explanation and its nearest rivals with one more addition of what happens within samples.

    The criterion would not accept it, as its penalty is larger than what the recordings tell of it, and a score test
    tells little of how far it then moves the parameters. So it is with what another FMU has, such as a supply that
    sags: of a resistance beside the winding's.
    """
    n = selection.tests.samples
    sharp = [e for e in selection.effects if e.sharp and not e.is_line]
    near = sorted((e for e in rivals if any(is_timing(a) for a in e.additions)), key=lambda e: e.fit.cost)
    found = []
    for base in (*near[:MOST_FULLER], explanation):
        if selection.effort.is_spent():
            break
        missing = base.fit.cost - explanation.fit.cost - RIVALS_WITHIN
        effects = selection.effects if base is explanation else sharp  # all of its own are known already
        tested = [a for a in selection.tests.additions(base, effects) if a.gain > max(missing, LEAST_GAIN)]
        timing = [a for a in tested if is_timing(a) and not a.effect.is_last]
        far = [a for a in tested if a.effect.fmu and a.free and a.gain > a.penalty(n) - RIVALS_WITHIN]
        for likely in (timing, far):
            for a in sorted(likely, key=lambda a: -a.gain)[:1]:
                limit = explanation.fit.cost + 2 * RIVALS_WITHIN
                fuller = selection.added(base, a, limit=limit)
                found.append(dataclasses.replace(fuller, fit=solved(fuller.fit)))
    return [e for e in found if e.is_physical()]


def _exchanged(
    selection: Selection, explanation: Explanation, addition: Addition, *, sharp_too: bool
) -> list[Explanation]:
    """Return the explanation with another addition in the place of one, where that is nearly as likely.

    Parameters
    ----------
    sharp_too : bool
        Whether all that happens within samples is refitted, whatever the score test predicts.
    """
    n, found = selection.tests.samples, []
    bare = without(explanation, addition)
    lost = bare.fit.cost - explanation.fit.cost
    tested = [a for a in selection.tests.additions(bare, selection.effects, beside=addition.name) if a.gain > 0]
    own = next((a for a in tested if a.name == addition.name), addition)
    if own is addition and own.linear is not None:
        own = dataclasses.replace(own, across=bare.fit.test().across(own.linear.columns))
    worth = lost - addition.penalty(n)
    nearly = worth - 2 * RIVALS_WITHIN
    tested = [
        a
        for a in tested
        if a.name != addition.name
        and (not a.effect.doubt or a.gain - a.penalty(n) > nearly or alike(a, own) > PARALLEL)
    ]
    needed = PREDICTED_PART * worth
    # What another FMU has moves the parameters so far that its score test tells little of it, and has several numbers.
    near = explanation.evidence(n) + RIVALS_WITHIN - bare.evidence(n)
    behind = {a.name: a.posterior()[2] for a in tested if a.scores is not None}
    likely = [
        a
        for a in tested
        if a.gain - a.penalty(n) > (0.0 if a.effect.fmu else needed) or (a.effect.fmu and behind[a.name] < near)
    ]
    ranked = sorted((a for a in likely if not (sharp_too and is_timing(a))), key=lambda a: behind[a.name])
    likely = list({(a.effect.name, _shown_in(a)): a for a in reversed(ranked)}.values())[::-1][:RIVALS_REFITTED]
    if sharp_too:
        likely += [a for a in tested if is_timing(a) and not a.effect.is_last]
    most = explanation.criterion(n) + 2 * RIVALS_WITHIN
    beside_timing = any(is_timing(a) for a in bare.additions)
    for other in likely:
        other = _as_late(explanation, addition, other)
        further = FURTHER if other.effect.fmu and beside_timing else 0.0
        limit = most + further - other.penalty(n) - (bare.criterion(n) - bare.fit.cost)
        rival = _added(selection, bare, other, limit=limit)
        if most <= rival.criterion(n) < most + further:
            rival = _retimed(selection, rival, addition)
        if rival.criterion(n) < most and other.name in rival.names():
            beside = [a for a in rival.additions if a.linear is not None and a.name != other.name]
            for idle in [a for a in beside if not is_physical(rival.fit, a)]:  # the other has taken its place, too
                rival = without(rival, idle)
            found.append(dataclasses.replace(rival, fit=solved(rival.fit)))
    return found


def _added(selection: Selection, bare: Explanation, addition: Addition, *, limit: float) -> Explanation:
    """Return an explanation with one more addition, and its columns by the signals that it explains then.

    Parameters
    ----------
    limit : float
        As for `solved`; not where columns follow what is fitted: by those of before more than the limit may be left.
    """
    limit = np.inf if any(a.effect.follows for a in bare.additions) else limit
    found = selection.added(bare, addition, limit=limit)
    if all(a.linear is None for a in found.additions):
        return found
    if not moves_ripple(bare, addition):
        found = dataclasses.replace(found, fit=solved_roughly(renewed(found), limit=limit))
    return followed(found, least=FOLLOWS)


def _shown_in(addition: Addition) -> tuple[int, ...]:
    """Return the outputs that an addition's columns show in; none of what is simulated."""
    return () if addition.linear is None else tuple(np.flatnonzero(addition.linear.columns.any(axis=(0, 2))).tolist())


def _retimed(selection: Selection, rival: Explanation, gone: Addition) -> Explanation:
    """Return a rival with another addition within samples than the one that is gone, and without what that makes idle.

    Dry friction stands for a delay of the speed: what then makes the current late is another than beside the delay.
    """
    usual = [e for e in selection.effects if not e.is_last]
    tested = [a for a in selection.tests.additions(rival, usual) if is_timing(a) and a.name != gone.name]
    for a in sorted(tested, key=lambda a: -a.gain)[:1]:
        if a.gain > LEAST_GAIN:
            return selection.without_idle(selection.added(rival, a))
    return rival


def _as_late(explanation: Explanation, addition: Addition, other: Addition) -> Addition:
    """Return another addition with one more start where both make a channel late: as late, all else as it is.

    Without the addition a short time constant of the model vanishes, and no refit leads back from there.
    """
    fit, s = explanation.fit, explanation.fit.simulator
    channels = {n.channel for n in s.nuisances if n.name in (addition.name, other.name)} - {""}  # "": of all
    if addition.effect.lateness * other.effect.lateness == 0 or len(channels) > 1:
        return other
    start = {name: fit.value(name) for name in fit.free if name != addition.name}
    delay = addition.effect.lateness * fit.value(addition.name)
    return dataclasses.replace(other, starts=(*other.starts, {**start, other.name: delay / other.effect.lateness}))


def _simpler(selection: Selection, explanation: Explanation, within: Sequence[Addition]) -> list[Explanation]:
    """Return the explanation with one addition in the place of two of those within samples, also mirrored.

    A delay of the current beside a lag of the speed stand for a delay of both.
    """
    found = []
    for one, two in itertools.combinations(within, 2):
        limit = _most(selection, explanation, (one, two))
        bare = without(without(explanation, one, iterations=0), two)
        tested = [
            a
            for a in selection.tests.additions(bare, [e for e in selection.effects if not e.is_last])
            if is_timing(a) and a.name not in (one.name, two.name)
        ]
        ranked, nearest = sorted(tested, key=lambda a: -a.gain), np.inf
        for other in ranked[:1] + of_same_channel(explanation.fit.simulator, ranked[:1], ranked):
            if other is not ranked[0] and nearest > limit + FURTHER:
                break
            simpler = _added(selection, bare, other, limit=limit)
            nearest = min(nearest, simpler.fit.cost)
            found += [simpler, *selection.mirrored(simpler, iterations=ROUGH, limit=limit)]
    return found
