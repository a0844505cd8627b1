"""Model averaging: rivals, and additions not accepted, widen the standard errors by their weights. Knows no effect.

Explanation m weighs exp(-c_m / 2), c_m its evidence above the best's. The values stay the best explanation's, so that
what follows from them is consistent; their covariance is that of the mixture about them (`mixture`). Of an addition
that was not accepted the score test tells its parameters and their covariance without a refit. Its number has a usual
size as prior deviation, so that its penalty is log det (I + information), not log n (MacKay 1992). An effect that the
recording hardly shows, and that would move a parameter far, widens the standard errors although it was not accepted. An
effect whose usual size would not show at all is left out: no such recording can tell it. Up to which size an effect
hides, and how far it then moves the parameters, is reported (`hidden`), and belongs into the tolerances. The sizes of a
torque that wanders which are left open are averaged over, too: with each the parameters have another covariance.

What each recording has of its own, such as friction that drifts, is possible in one of them, and alike in all: one
alone may move no parameter, because the others hold it, where all together do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import TOLD_POWER
from estimator.explaining.addition import Addition, Scores, is_timing
from estimator.explaining.explanation import Explanation
from estimator.explaining.mixture import Mixture
from estimator.explaining.wandering_torque import OpenTorque
from estimator.fitting.simulator import per_recording
from estimator.noise.in_parts import products
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

VISIBLE = 1.0  # of z'z, by an effect of usual size: a smaller one is not visible
LARGER = 1.25  # times its usual size: an effect that hides up to more is told to hide beyond the usual one
TOLD_WITHIN = 6.0  # of the criterion: a rival that is further behind weighs less than 5 %
FARTHEST = 50.0  # of a logarithm: a rival's parameter is no further away
DIFFERS, SMALL = 1.0, 1e-3  # standard errors, and part of a parameter, by which a rival must differ to be told: less
# than a thousandth is in the bars, and below what any sensor's gain is off by
ELSEWHERE, FAR_WITHIN = 10.0, 10.0  # standard errors; of the criterion: of another timing of its channels one so far
# away is told though it weighs less, and though it is the explanation with more: lags exchanged are in no bar


@dataclass(frozen=True)
class WeighedRival:
    """A rival explanation that is nearly as likely and gives other parameters.

    Attributes
    ----------
    apart : standard errors that it lies away, in the parameter that it moves most
    parameter : that parameter's name
    behind : its evidence above the best explanation's; below 0 where it is the more likely one
    weight : its part of what is likely, of all explanations that are
    """

    explanation: Explanation
    apart: float
    parameter: str
    behind: float
    weight: float


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that the recordings do not show up to a size at which it would be accepted as likely as not.

    Attributes
    ----------
    addition : with its usual size; what is hidden up to more is called unusual
    size : that size, in the addition's unit, at most the usual one
    whatever_size : bool
        It is the usual one, and larger ones would hide as well.
    moves : (p,) array
        By so much the estimate is then off, on the parameters' scales.
    """

    addition: Addition
    size: float
    whatever_size: bool
    moves: FloatArray


@dataclass(frozen=True)
class Averaged:
    """Averaged covariance, (p, p), on the parameters' scales; what may be hidden; differing rivals.

    Where the recordings determine only combinations of parameters, the covariance is that of these combinations.
    """

    covariance: FloatArray
    hidden: tuple[HiddenEffect, ...]
    rivals: tuple[WeighedRival, ...]


def averaged(
    explanation: Explanation,
    open_additions: Sequence[Addition],
    rivals: Sequence[Explanation],
    samples: int,
    torques: Sequence[OpenTorque],
    beside: FloatArray,
) -> Averaged:
    """Return the parameters averaged over the explanations that are possible.

    Parameters
    ----------
    open_additions : what may still be added, with what the score test says
    rivals : other explanations, nearly as likely
    torques : sizes of a torque that wanders which are left open
    beside : (p,) array
        Variances that the standard errors hold besides: a rival that lies within is no news.
    """
    fit = explanation.fit
    names = fit.simulator.plan.names
    p = len(names)
    inside = fit.at_bound == 0
    covariance, untold = fit.covariance_parts()
    own = fit.simulator.scaled(fit.values)[:p]
    mixture = Mixture(covariance[:p, :p])
    hidden = []
    rivals = [r for r in rivals if not _is_untold(r, explanation)]
    fuller = {
        next(iter(more)) for r in rivals if len(more := r.names() - explanation.names()) == 1 and _holds(r, explanation)
    }
    alone = _one_of_each(open_additions)
    for a in (*alone, *_alike_in_recordings(alone, fit.simulator.plan)):
        if a.scores is None or a.name in fuller:  # its refit tells more
            continue
        scores = a.usual_scores
        power = float(np.trace(scores.information))
        off = scores.moves[:p]
        if a.usual > 0 and len(scores.along) == 1:
            part = np.inf if a.untold else float(np.sqrt(a.penalty(samples) / max(power, 1e-300)))
            share = min(1.0, part)
            hidden.append(HiddenEffect(a, share * a.usual, part > LARGER, share * off[:, 0]))
        if a.gain <= 0 or power <= (VISIBLE if a.has_known_size else TOLD_POWER * scores.whole):
            continue
        for part in (1.0, a.effect.small):
            if part == 1.0 or part**2 * power > VISIBLE:
                size, spread, behind = a.posterior(part)
                moved = part * off
                mixture.add(behind, -moved @ size, moved @ spread @ moved.T)
    for t in torques:
        mixture.add(t.behind, np.zeros(p), t.covariance - covariance[:p, :p])
    told = []
    deviation = np.sqrt(np.maximum(np.diag(covariance + untold)[:p] + beside, 1e-300))
    for number, rival in enumerate(rivals, start=1):
        behind = rival.evidence(samples) - explanation.evidence(samples)
        there, other = _beside(own, rival, fit.is_log[:p])
        if untold[:p, :p].any():
            there, other = _beside_combinations(explanation, rival) or (there, other)
        mixture.add_rival(behind, there - own, other)
        with np.errstate(invalid="ignore"):
            apart = np.abs(there - own) / np.where(np.isfinite(deviation), deviation, np.inf)
        least = SMALL * np.where(fit.is_log[:p], 1.0, np.abs(own))
        apart = np.where(inside[:p] & (np.abs(there - own) > least), apart, 0.0)  # one at a bound is not told anyhow
        other_number = _numbers(rival) != _numbers(explanation) and _effects(rival) == _effects(explanation)
        held = other_number or _holds(rival, explanation) or _is_last(rival, explanation)  # by the bars alone
        farthest = float(np.max(apart, initial=0.0))
        is_near = behind < TOLD_WITHIN and farthest > DIFFERS and not held
        if is_near or (behind < FAR_WITHIN and farthest > ELSEWHERE and _differ_in_timing(rival, explanation)):
            told.append((rival, number, farthest, int(np.argmax(apart)), float(behind)))
    total, weights = mixture.covariance(), mixture.weights()
    held = ~inside[:p]
    total[held] = total[:, held] = 0.0
    rivals_told = tuple(
        WeighedRival(r, apart, names[j], behind, float(weights[number]))
        for r, number, apart, j, behind in told
        if behind <= min(u[4] for u in told if _effects(u[0]) == _effects(r))  # of alike ones one
    )
    return Averaged(total, tuple(hidden), rivals_told)


def _differ_in_timing(one: Explanation, other: Explanation) -> bool:
    """Whether two explanations differ in what makes outputs late, or in values alone, and have all else in common."""
    names = one.names() ^ other.names()
    return all(is_timing(a) for a in (*one.additions, *other.additions) if a.name in names)


def _holds(rival: Explanation, explanation: Explanation) -> bool:
    """Whether a rival is the explanation with more."""
    return explanation.names() < rival.names()


def _is_untold(rival: Explanation, explanation: Explanation) -> bool:
    """Whether a rival is the explanation with one number more, that the recordings tell no better than its usual size.

    Such as a drop of brushes at one size of voltage: it is as possible whatever they show, and belongs to what hides.
    """
    more, sizes, fit = rival.names() - explanation.names(), rival.sizes(), rival.fit
    if len(more) != 1 or not _holds(rival, explanation) or not more <= set(sizes) & set(fit.names):
        return False
    (name,) = more
    k = fit.names.index(name)
    return bool(VISIBLE * fit.covariance_parts()[0][k, k] > sizes[name] ** 2)


def _is_last(rival: Explanation, explanation: Explanation) -> bool:
    """Whether a rival has what is told only where no explanation without it is near, and is harmless."""
    new = (a.effect for a in rival.additions if a.name not in explanation.names())
    return any(effect.is_last and not effect.doubt for effect in new)


def _beside(own: FloatArray, rival: Explanation, log: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return a rival's values, (p,), and covariance, (p, p), on the scales of `own`, linear about it.

    A parameter that vanishes in the rival is far away on a logarithmic scale, and as far as zero on its own.
    """
    p = len(own)
    there = rival.fit.simulator.scaled(rival.fit.values)[:p]
    ratio = np.where(log, np.exp(np.clip(np.where(log, there - own, 0.0), -FARTHEST, FARTHEST)), 1.0)
    return np.where(log, own + ratio - 1, there), _told_there(rival, log) * np.outer(ratio, ratio)


def _beside_combinations(explanation: Explanation, rival: Explanation) -> tuple[FloatArray, FloatArray] | None:
    """Return the same where the recordings tell combinations only: by what they show of the rival's parameters.

    The way along which parameters stand in for each other bends: what lies far along it would seem to differ, too, in
    what is told. None: the FMU fails there.
    """
    fit, other = explanation.fit, rival.fit
    s, p = fit.simulator, len(fit.simulator.plan.names)
    values = np.where(fit.at_bound[:p] == 0, other.values[:p], fit.values[:p])
    shown = s.shown(np.concatenate([values, fit.values[p:]])[None, :])
    if not np.isfinite(shown).all():
        return None
    told = fit.covariance_parts()[0][:p]
    moves = told @ products(fit.whitened, fit.whitener.changes(shown, fit.shown))
    turned = told @ products(fit.whitened, fit.whitener.whitened(other.slopes.raw[:, :, :p]))
    return s.scaled(fit.values)[:p] + moves[:, 0], turned @ _told_there(rival, fit.is_log[:p]) @ turned.T


def _told_there(rival: Explanation, log: NDArray[np.bool_]) -> FloatArray:
    """Return a rival's covariance, (p, p), of the parameters on its scales.

    One that is hardly told there reaches to zero, too, and takes the others no further: its logarithm has the prior
    deviation 1.
    """
    p, sizes, c = len(log), rival.sizes(), rival.fit.covariance_parts()[0]
    known = [k for k, name in enumerate(rival.fit.names) if name in sizes]  # a usual size is a prior deviation
    prior = np.diag([sizes[rival.fit.names[k]] ** 2 for k in known])
    c = c - c[:, known] @ np.linalg.solve(c[np.ix_(known, known)] + prior, c[known])
    for k in np.flatnonzero(log & (np.diag(c)[:p] > 0)):
        c = c - np.outer(c[:, k], c[k]) / (c[k, k] + 1.0)
    return np.asarray(c[:p, :p])


def _one_of_each(additions: Sequence[Addition]) -> list[Addition]:
    """Return the additions, of each name the likeliest."""
    best: dict[str, Addition] = {}
    for a in additions:
        if a.name not in best or a.gain > best[a.name].gain:
            best[a.name] = a
    return list(best.values())


def _alike_in_recordings(additions: Sequence[Addition], plan: Plan) -> list[Addition]:
    """Return what several recordings may have of the same size, in usual sizes, as one addition of an effect."""
    ends, kinds = per_recording(plan, ""), dict[str, list[Addition]]()
    for a in additions:
        end = next((e for e in ends if e and a.name.endswith(e)), "")
        known = a.usual > 0 and a.scores is not None and a.numbers == 1 and a.gain > 0
        if end and known:
            kinds.setdefault(a.name.removesuffix(end), []).append(a)
    found = []
    for kind, several in kinds.items():
        if len(several) > 1:
            scores = Scores.alike([a.usual_scores for a in several])
            effect, tried = several[0].effect, max(a.tried for a in several)
            found.append(Addition(effect, kind, 1, scores.gain, scores=scores, tried=tried))
    return found


def _effects(explanation: Explanation) -> list[str]:
    return sorted(a.effect.name for a in explanation.additions)


def _numbers(explanation: Explanation) -> dict[str, float]:
    """Return what was added, and of what is chosen, not fitted by derivatives, its number."""
    fit = explanation.fit
    whole = {n.name for n in fit.simulator.nuisances if n.whole}
    return {a.name: fit.value(a.name) if a.name in whole else 0.0 for a in explanation.additions}
