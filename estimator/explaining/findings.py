"""What was found of a bench, what its rivals are and what may hide, in words. Knows an explanation, fits nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import NOTHING_TOLD
from estimator.explaining.addition import Addition
from estimator.explaining.averaging import HiddenEffect, WeighedRival
from estimator.explaining.between_runs import BetweenRuns, sentence
from estimator.explaining.explanation import Explanation
from estimator.explaining.interpretations import Interpretation
from estimator.fitting.fit import Fit
from estimator.motor.names import ALIKE, CHANGES, has_motor
from estimator.plans.plan import Plan
from estimator.results.result import NotVisible, Rival, RivalParameter

FloatArray = NDArray[np.float64]

ENOUGH_RUNS = 4  # of fewer runs the spread is known no better than to its own size: an unusual one is doubted
BEYOND = 4.0  # standard errors: what moves a parameter by more and is not visible is told


@dataclass(frozen=True)
class Found:
    """An effect that was found: name, size, a sentence, and why it makes the estimate doubtful, or ""."""

    effect: str
    name: str
    sentence: str
    doubt: str


COARSE = Found(
    "filters between the samples",
    "",
    "between two samples the current changes faster than what the filters show of it is simulated",
    "L, and what the filters hide, may be further off than the standard errors say; sample faster",
)


ENDED = Found(
    "search",
    "",
    "the search for what the recording shows was ended before all was tried",
    "what was not tried may explain it as well, and give other parameters; declare what is known of the bench, or take"
    " a shorter part, by --window",
)


def found_effects(explanation: Explanation, plan: Plan) -> list[Found]:
    """Return the additions of an explanation in words."""
    fit, found = explanation.fit, []
    for a in explanation.additions:
        if a.linear is not None:
            own = fit.estimates_of(a.name)
            alike = len(set(a.linear.units)) == 1 < len(own)  # a cosine and a sine: the amplitude
            size = float(np.sqrt(2 * np.mean(np.square(own)))) if alike else own[0]
        else:
            size = a.effect.size(fit, a.name)
        if told := a.effect.tell(a.name, size, plan):
            found.append(Found(a.effect.name, a.name, told, a.effect.doubted(a.name, size, plan)))
    return found


def too_seldom(additions: Sequence[Addition]) -> list[Found]:
    """Return what is found of effects that hardly any bench has together, and the parameters rest on; of none nothing.

    It is a reason for doubt alone: they are reported already.
    """
    if not additions:
        return []
    *others, last = (_called(a) for a in additions)
    told = f"the estimate rests on {', '.join(others)} and {last}, which hardly any bench has together"
    return [
        Found("seldom together", "", told, "something that is not known here may look like them; record other levels"
              " of the voltage, or declare what is known of the bench")
    ]  # fmt: skip


def varying_parameters(between: BetweenRuns, plan: Plan) -> list[Found]:
    """Return the parameters that vary between the recordings in words."""
    runs = [o.recording.name for o in plan.observed]
    few = f"{len(runs)} runs hardly tell by how much; record more"
    is_motor = has_motor({p.quantity or p.name for p in plan.parameters} | set(plan.fixed))
    found = []
    for v in (v for v in between.variations if v.told):
        parameter = plan.parameters[v.parameter]
        told = sentence(v, name=parameter.name, unit=parameter.unit, is_log=parameter.log, runs=runs)
        usual = CHANGES.get(parameter.quantity or parameter.name, ALIKE) if is_motor and parameter.log else 0.0
        doubt = few if len(runs) < ENOUGH_RUNS and v.deviation > usual else ""
        found.append(Found("between runs", parameter.name, told, doubt))
    return found


def rival_in_words(
    told: WeighedRival, explanation: Explanation, other_way: tuple[Explanation | None, Sequence[Interpretation]]
) -> Rival:
    """Return a rival explanation with its parameters, and which recording would decide.

    Parameters
    ----------
    other_way : the rival whose recordings are read the other way, and both ways, that of the explanation first
    """
    rival, fit = told.explanation, explanation.fit
    instead = [a for a in rival.additions if a.name not in explanation.names()]
    replaced = [a for a in explanation.additions if a.name not in rival.names()]
    words, over = (" and ".join(_called(a) for a in part) or "nothing more" for part in (instead, replaced))
    sharp = all(a.effect.sharp for a in (*instead, *replaced))
    remedy = (
        "sample faster, or declare the sensor's filter"
        if sharp
        else f"record {fit.simulator.plan.wanted_levels}, or measure it"
    )
    what = f"{words} instead of {over}" if instead or replaced else "the same with other values"
    turned, ways = other_way
    if rival is turned:
        what, remedy = f"{ways[1].way} instead of {ways[0].way}", ways[0].remedy
    return Rival(
        what=what,
        parameters=_rival_parameters(rival.fit),
        differs_in=told.parameter,
        estimated=float(fit.values[rival.fit.simulator.plan.names.index(told.parameter)]),
        apart=told.apart,
        behind=told.behind,
        weight=told.weight,
        decided_by=remedy,
    )


def _called(addition: Addition) -> str:
    """Return an addition's name, or its effect's, where its own is a parameter's of the FMU."""
    effect = addition.effect.name
    return addition.name if addition.name.startswith(effect) else effect


def _rival_parameters(fit: Fit) -> dict[str, RivalParameter]:
    """Return the parameters of a plan as another explanation's fit gives them."""
    plan = fit.simulator.plan
    told, untold = fit.covariance_parts()
    errors = np.sqrt(np.maximum(np.diag(told + untold), 0.0)) * np.where(fit.is_log, np.abs(fit.estimates), 1.0)
    found = {}
    for k, parameter in enumerate(plan.parameters):
        known = fit.at_bound[k] == 0 and errors[k] <= NOTHING_TOLD * abs(fit.values[k])
        value, error = float(fit.values[k]), float(errors[k]) if known else None
        found[parameter.name] = RivalParameter(value, error, parameter.unit)
    return found


def not_visible(
    hidden: Sequence[HiddenEffect], names: Sequence[str], values: FloatArray, errors: FloatArray, log: NDArray[np.bool_]
) -> tuple[NotVisible, ...]:
    """Return what hides in the recordings and would put a parameter far beyond its bar, the farthest first."""
    found: dict[str, NotVisible] = {}
    change = np.reshape([h.moves for h in hidden], (-1, len(values))) * np.where(log, np.abs(values), 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        all_bars = np.nan_to_num(change / errors, posinf=0.0, neginf=0.0)
        all_parts = np.nan_to_num(change / np.abs(values), posinf=0.0, neginf=0.0)
    for h, bars, parts in zip(hidden, all_bars, all_parts, strict=True):
        order = [int(k) for k in np.argsort(-np.abs(bars)) if abs(bars[k]) > BEYOND]
        name = h.addition.effect.name
        if not order or (name in found and _farthest(found[name]) > abs(bars[order[0]])):
            continue
        off = {names[k]: (float(parts[k]), float(bars[k])) for k in order}
        found[name] = NotVisible(name, h.size, h.addition.unit, off, h.whatever_size)
    return tuple(sorted(found.values(), key=_farthest, reverse=True))


def _farthest(effect: NotVisible) -> float:
    return max(abs(bars) for _, bars in effect.off.values())
