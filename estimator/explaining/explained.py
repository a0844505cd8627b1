"""From a least-squares fit to values, standard errors, effects found and rivals. Knows no verdict."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition import Addition
from estimator.explaining.adequacy import Adequacy, adequacy
from estimator.explaining.averaging import averaged
from estimator.explaining.between_runs import BetweenRuns, is_between_runs, of_fit
from estimator.explaining.effects.base import Effect
from estimator.explaining.effects.drive import Coasting
from estimator.explaining.effects.edge_latency import EdgeLatency
from estimator.explaining.effects.voltage_noise import VoltageNoise, with_errors_of_converters, without_noise
from estimator.explaining.effects.voltage_offset import VoltageOffset
from estimator.explaining.effects.voltage_sensor import VoltageSensorLag, before_sensor
from estimator.explaining.explanation import Explanation
from estimator.explaining.explanation_noise import by_noise_of
from estimator.explaining.findings import (
    COARSE,
    ENDED,
    Found,
    found_effects,
    not_visible,
    rival_in_words,
    too_seldom,
    varying_parameters,
)
from estimator.explaining.incoherent_noise import quieted_again, quieted_at_sight
from estimator.explaining.interpretations import Interpretation, interpretations
from estimator.explaining.likelier_interpretation import likelier_interpretation, on_simulators_of
from estimator.explaining.noise_of_all_rows import by_all_rows
from estimator.explaining.open_circuits import OwnVoltage, with_open_circuits
from estimator.explaining.parameter_drift import drift_variances
from estimator.explaining.profile_widths import further_reach
from estimator.explaining.rarity import seldom_together
from estimator.explaining.rivals import settled, simulated_finely
from estimator.explaining.selection import Selection
from estimator.explaining.selection_of_plan import may_be_replaced, selection_of
from estimator.explaining.wandering_torque import OpenTorque, hidden_torque, with_wandering_torque
from estimator.fitting.effort import OF_ADDITIONS, Effort
from estimator.fitting.fit import Fit
from estimator.fitting.latency import with_latencies
from estimator.fitting.lateness import lateness
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fmus.workers import Workers
from estimator.noise.in_parts import Columns, products
from estimator.plans.free_parameters import first_guess
from estimator.plans.parameters import Parameter, SensorPlace
from estimator.plans.plan import Plan
from estimator.results.result import NotVisible, Rival

FloatArray = NDArray[np.float64]

REPORTED = SensorPlace("nuisance")  # of a nuisance parameter
WIDE = 1e30  # bounds of a parameter that has none
TOLD = 20.0  # of z'z of a first fit: a plan that misses so much less is the likelier, by 1 in 22 000


@dataclass(frozen=True)
class Explained:
    """The best explanation of the recordings, and how certain it is.

    Attributes
    ----------
    plan : Plan
        The case's, its parameters followed by the nuisance parameters.
    polish : LeastSquaresFit
        Their values, standard errors and covariance, averaged over rivals; residuals and derivatives are whitened.
    noise : (q,) array
        Root mean square of each output's residuals, outliers left out.
    at_rest : (q,) array
        The same without the growth of the noise with the signals.
    found : what was found of the bench
    rivals : explanations that are nearly as likely and give other parameters
    not_visible : what may be there unnoticed and moves a parameter far beyond its bar, the farthest first
    adequacy : Adequacy
    explanation : Explanation
    between : BetweenRuns
        What varies from recording to recording; part of the polish's covariance.
    hidden_torque : float
        A torque that wanders by as much would not show, and B's standard error holds it, N.m; 0: it is no part of that.
    """

    plan: Plan
    polish: LeastSquaresFit
    noise: FloatArray
    at_rest: FloatArray
    found: tuple[Found, ...]
    rivals: tuple[Rival, ...]
    not_visible: tuple[NotVisible, ...]
    adequacy: Adequacy
    explanation: Explanation
    between: BetweenRuns
    hidden_torque: float

    @property
    def fit(self) -> Fit:
        """The best explanation's fit."""
        return self.explanation.fit

    def shown_rows(self) -> FloatArray:
        """Return what the sensors show by the best explanation without ripple, (rows, q)."""
        fit = self.fit
        plain = [k for k, name in enumerate(fit.linear_names) if not name.startswith("ripple ")]
        if not plain:
            return fit.shown + 0.0
        return np.asarray(fit.shown + fit.raw[:, :, len(fit.free) :][:, :, plain] @ fit.coefficients[plain])

    def shown(self) -> list[FloatArray]:
        """Return the same, (n, q), one a recording."""
        rows = self.shown_rows()
        return [rows[clock.rows] for clock in self.fit.simulator.clocks]

    def residuals(self, candidates: FloatArray) -> FloatArray:
        """Return whitened residuals, (c, m), of candidates of the plan's parameters, (c, p); ripple as it is."""
        fit = self.fit
        s, columns = fit.simulator, fit.raw[:, :, len(fit.free) :]
        names = [parameter.name for parameter in self.plan.parameters]
        wide = np.repeat(fit.values[None, :], len(candidates), axis=0)
        coefficients = np.repeat(fit.coefficients[None, :], len(candidates), axis=0)
        linear = {name: k for k, name in enumerate(fit.linear_names)}
        told_from = _told_from(fit)
        for name, column in zip(names, candidates.T, strict=True):
            if name in s.index:
                wide[:, s.index[name]] = column
            else:
                coefficients[:, linear[name]] = column - told_from[name]
        explained = s.shown(wide) + np.einsum("rqm,cm->crq", columns, coefficients)
        off = np.where(fit.whitener.present, explained - s.measured, 0.0)
        failed = np.asarray(~np.isfinite(off).all(axis=(1, 2)))
        whitened = fit.whitener(np.where(failed[:, None, None], 0.0, off).transpose(1, 2, 0))[0]
        result = whitened.reshape(-1, len(candidates)).T.copy()
        result[failed] = np.nan
        return result


def explain(
    plan: Plan,
    crew: Workers,
    starts: Sequence[FloatArray],
    *,
    sigma: Mapping[str, float],
    deviations: FloatArray,
    effects: Sequence[Effect],
    enter: Callable[[str], None] = lambda phase: None,
    known: Explanation | None = None,
    briefly: bool = False,
    is_wanted: Callable[[Adequacy], bool] = lambda checked: True,
) -> Explained:
    """Explain the recordings of a plan.

    Parameters
    ----------
    starts : (p,) arrays
        Of the plan's free parameters.
    sigma : output -> float
        As `Problem`.
    deviations : (q,) array
        Of each output's noise, a first estimate.
    effects : the effects that may be found
    enter : callable
        Told the phase that begins.
    known : Explanation, optional
        Of a part of the rows.
    briefly : bool
        Without rivals, and what else may be added: for a start.
    is_wanted : callable
        Whether an explanation that is so adequate is wanted: else what it costs most, its rivals, is not looked for.
    """
    effort = Effort(plan)
    begin = partial(selection_of, crew=crew, sigma=sigma, deviations=deviations, effects=effects, effort=effort)
    plan, opened, late = _read_at_sight(plan, effects, lambda one, other: _is_likelier(begin, one, other, starts))
    if late:
        plan, again = _guessed_again(plan)
        starts = [*starts, again]
    plan, starts, filtered = _before_sensor(plan, effects, begin, starts)
    noisy, told_quiet = plan, ""
    if any(e.name == VoltageNoise.name for e in effects) and may_be_replaced(plan):
        at_sight = quieted_at_sight(plan)
        if at_sight is not None and (at_sight.is_sure or _is_likelier(begin, at_sight.plan, plan, starts)):
            plan, told_quiet, _ = at_sight
        plan = with_errors_of_converters(plan)
    ways, selections, explanation = likelier_interpretation(plan, begin, starts, known)
    plan, selection = ways[0].plan, selections[0]
    changed = [Found(EdgeLatency.name, "", t, "") for t in late]
    changed += [Found(VoltageSensorLag.name, "", t, "") for t in filtered]
    quiet, told = _quiet(plan, noisy, explanation, told_quiet)
    changed += told
    if quiet is not None:
        rest = tuple(a for a in explanation.additions if a.name != VoltageNoise.name)
        plan, begun = quiet, dataclasses.replace(explanation, additions=rest)
        also = [way.plan.case for way in ways[1:] if way.plan.case is not ways[0].plan.case]
        selections = [begin(plan), *(begin(dataclasses.replace(plan, case=case)) for case in also)]
        selection = selections[0]
        explanation = selection.explain(starts, begun)
    checked = adequacy(explanation.fit, len(plan.names))
    if not briefly and (checked.failures or explanation.additions):
        usual = _without_seldom(selection, explanation, partial(begin, plan), starts)
        checked = checked if usual is explanation else adequacy(usual.fit, len(plan.names))
        explanation, checked = by_all_rows(selection, usual, checked)
    rivals: list[Explanation] = []
    open_additions: Sequence[Addition] = ()
    torques: Sequence[OpenTorque] = ()
    if not briefly and is_wanted(checked):
        enter("rivals")
        likeliest, rivals, is_fine = simulated_finely(selection, *settled(selection, explanation))
        if not is_fine:
            changed.append(COARSE)
        if likeliest is not explanation:
            explanation, checked = likeliest, adequacy(likeliest.fit, len(plan.names))
        if not checked.failures:  # else a wandering torque would be taken for what is missing
            wanders, torques = with_wandering_torque(explanation)
            if wanders is not explanation:
                rivals = [by_noise_of(wanders, rival) for rival in rivals]
            explanation = wanders
        open_additions = selection.tests.additions(explanation, selection.effects)
    if effort.was_spent:
        changed.append(ENDED)
    turned = None
    if len(selections) > 1:  # the other way to read the recordings, with all that was found
        turned = on_simulators_of(explanation, selections[1])
        rivals.append(turned)
    has_offset = any(n.startswith(("offset w", VoltageOffset.name)) for n in explanation.names())
    for own in opened:
        behind = _lateness_of_speed(explanation.fit, own.recording)
        doubt = "" if has_offset else own.doubt(*_told_of(explanation.fit, "K"), behind)
        changed.append(Found(Coasting.name, "", own.sentence, doubt))
    if len(ways) > 1:
        changed.append(Found(ways[0].effect, "", ways[0].told, ""))
    samples = selection.tests.samples
    return _explained(plan, explanation, checked, rivals, (open_additions, torques), samples, changed, (turned, ways))


def _without_seldom(
    selection: Selection, explanation: Explanation, begin: Callable[..., Selection], starts: Sequence[FloatArray]
) -> Explanation:
    """Return what explains the recordings best: without what is too seldom together, where that is likelier.

    Effects that were found early stand in for others, and then need each other: taken away one by one, each is missed.
    What has to be doubted by itself is no way out.
    """
    fit, n, best = explanation.fit, selection.tests.samples, explanation
    errors = np.sqrt(np.maximum(np.diag(fit.covariance()), 1e-300))[: len(fit.simulator.plan.names)]
    for effect in [a.effect for a in seldom_together(explanation, errors)]:
        if selection.effort.is_spent(part=OF_ADDITIONS):
            break
        found = begin(effects=tuple(e for e in selection.effects if e.name != effect.name)).explain(starts)
        is_sound = not any(a.effect.doubt and a.name not in explanation.names() for a in found.additions)
        if is_sound and found.criterion(n) < by_noise_of(found, best).criterion(n):
            best = on_simulators_of(found, selection)
    return best


def _read_at_sight(
    plan: Plan, effects: Sequence[Effect], is_likelier: Callable[[Plan, Plan], bool]
) -> tuple[Plan, tuple[OwnVoltage, ...], tuple[str, ...]]:
    """Return a plan whose voltages are as they reach the motor, where circuits are open, and what edges are late.

    A current loop may hold the current at none, too: there the voltage tells what flows.
    """
    late: tuple[str, ...] = ()
    opened: tuple[OwnVoltage, ...] = ()
    if any(e.name == Coasting.name for e in effects) and may_be_replaced(plan):
        as_open, found = with_open_circuits(plan)
        if not (found and is_likelier(plan, as_open)):
            plan, opened = as_open, found
    if any(e.name == EdgeLatency.name for e in effects):
        plan, late = with_latencies(plan)
    return plan, opened, late


def _before_sensor(
    plan: Plan, effects: Sequence[Effect], begin: Callable[[Plan], Selection], starts: Sequence[FloatArray]
) -> tuple[Plan, Sequence[FloatArray], tuple[str, ...]]:
    """Return a plan of the voltage before its sensor's filter, where that is likelier, starts, and words."""
    before, told = before_sensor(plan) if any(e.name == VoltageSensorLag.name for e in effects) else (plan, "")
    if not told:
        return plan, starts, ()
    before, again = _guessed_again(before)
    starts_of_both = [*starts, again]
    if not all(_is_likelier(begin, before, way.plan, starts_of_both) for way in interpretations(plan)):
        return plan, starts, ()
    return before, starts_of_both, (told,)


def _guessed_again(plan: Plan) -> tuple[Plan, FloatArray]:
    """Return a plan whose guess is of its voltages as they reach the motor now, and that guess as a start, (p,).

    A motor that answers late was guessed, and fitted, as a slow one.
    """
    guess = first_guess(plan.binding, plan.observed)
    known = [guess.get(p.quantity or p.name, p.start) for p in plan.parameters]
    middle = [np.sqrt(p.lower * p.upper) if p.log else 0.5 * (p.lower + p.upper) for p in plan.parameters]
    start = np.array([m if x is None else x for x, m in zip(known, middle, strict=True)])
    lower, upper = (np.array([getattr(p, end) for p in plan.parameters]) for end in ("lower", "upper"))
    return dataclasses.replace(plan, guess=guess), np.clip(start, lower, upper)


def _is_likelier(begin: Callable[[Plan], Selection], one: Plan, other: Plan, starts: Sequence[FloatArray]) -> bool:
    """Whether the first fit tells that a plan is likelier than another of the same recordings, whose samples it has.

    What neither explains is what a difference is to be compared with.
    """
    first = [begin(plan).first for plan in (one, other)]
    cost, before = (own.cost(starts) for own in first)
    return before - cost > TOLD * max(1.0, cost / first[0].tests.samples)


def _lateness_of_speed(fit: Fit, recording: int) -> float:
    """Return by how many s a recording shows the speed later than the voltage."""
    return fit.delay(recording) + sum(lateness(fit.simulator, fit.value, "w"))


def _quiet(plan: Plan, noisy: Plan, explanation: Explanation, told: str) -> tuple[Plan | None, list[Found]]:
    """Return the plan with the voltages that the motor sees, as it is explained, or None, and what was found of that.

    Parameters
    ----------
    noisy, told : the plan with voltages as they were logged, and what of them was told at sight
    """
    if told:
        return quieted_again(plan, noisy, explanation.fit), [Found(VoltageNoise.name, "", told, "")]
    quiet = without_noise(explanation.fit, plan)
    found = found_effects(explanation, plan) if quiet is not None else []
    return quiet, [f for f in found if f.name == VoltageNoise.name]


def _told_of(fit: Fit, name: str) -> tuple[float, float]:
    """Return a parameter's value and its standard error in a fit; 0 where it is fixed."""
    if name not in fit.names:
        return fit.simulator.plan.fixed.get(name, np.nan), 0.0
    k = fit.names.index(name)
    value = float(fit.estimates[k])
    return value, float(np.sqrt(fit.covariance()[k, k])) * (abs(value) if fit.is_log[k] else 1.0)


def _explained(
    plan: Plan,
    explanation: Explanation,
    checked: Adequacy,
    rivals: Sequence[Explanation],
    left_open: tuple[Sequence[Addition], Sequence[OpenTorque]],
    samples: int,
    changed: Sequence[Found],
    other_way: tuple[Explanation | None, Sequence[Interpretation]],
) -> Explained:
    fit = explanation.fit
    p = len(plan.names)
    between = of_fit(fit, p)
    more = checked.widened(fit) + between.covariance
    more[range(p), range(p)] += drift_variances(explanation)
    mean = averaged(explanation, left_open[0], rivals, samples, left_open[1], np.diag(more)[:p])
    names = fit.names
    reported = [k for k, n in enumerate(names) if k >= p and not n.startswith("ripple ") and not is_between_runs(n)]
    kept = [*range(p), *reported]
    seen, unseen = (part[np.ix_(kept, kept)] for part in fit.covariance_parts())
    seen[:p, :p] = mean.covariance
    seen += more[np.ix_(kept, kept)]
    switches = any(a.effect.fmu for a in explanation.additions)
    seen += further_reach(fit, p, switches=switches)[np.ix_(kept, kept)]
    covariance = seen + unseen
    values = (fit.estimates + [_told_from(fit).get(name, 0.0) for name in names])[kept]
    log = fit.is_log[kept]
    rest = [k for k in range(len(names)) if k not in kept]
    jacobian: Columns = fit.whitened
    if rest:
        q = np.linalg.qr(jacobian[:][:, rest])[0]
        jacobian = jacobian[:][:, kept]
        jacobian = jacobian - q @ (q.T @ jacobian)
    with np.errstate(invalid="ignore"):
        errors = np.sqrt(np.diag(covariance)) * np.where(log, np.abs(values), 1.0)
    information = products(jacobian, jacobian)
    sizes, axes = np.linalg.eigh(seen)
    scores = information @ axes * np.sqrt(np.maximum(sizes, 0.0))  # its square is never negative, as rounded as it is
    whitener, left = fit.whitener, np.nan_to_num(fit.residuals())
    usual = whitener.present & (whitener.inflate == 1.0)
    polish = LeastSquaresFit(
        values=values,
        cost=fit.cost,
        deviations=np.ones(len(plan.outputs)),
        covariance=covariance,
        standard_errors=errors,
        at_bound=fit.at_bound[kept],
        jacobian=jacobian,
        residuals=-fit.z,
        scores=scores @ scores.T,
    )
    extended = dataclasses.replace(plan, parameters=(*plan.parameters, *(_parameter(fit, names[k]) for k in reported)))
    return Explained(
        plan=extended,
        polish=polish,
        noise=_rms(left, usual),
        at_rest=_rms(left / whitener.noise.scale(whitener.level, whitener.moving), usual),
        found=(
            *changed,
            *found_effects(explanation, plan),
            *varying_parameters(between, plan),
            *too_seldom(seldom_together(explanation, errors[:p] / np.where(log[:p], np.abs(values[:p]), 1.0))),
        ),
        rivals=tuple(rival_in_words(told, explanation, other_way) for told in mean.rivals),
        not_visible=not_visible(mean.hidden, plan.names, values[:p], errors[:p], log[:p]),
        adequacy=checked,
        explanation=explanation,
        between=between,
        hidden_torque=hidden_torque(left_open[1], fit),
    )


def _rms(values: FloatArray, present: NDArray[np.bool_]) -> FloatArray:
    counts = np.array([max(np.count_nonzero(own), 1) for own in present.T])
    return np.asarray(np.sqrt(np.sum(np.where(present, values, 0.0) ** 2, axis=0) / counts))


def _told_from(fit: Fit) -> dict[str, float]:
    """Return what a linear coefficient of 0 is reported as, by its name: a gain is then 1."""
    groups = [g.told_from for g in fit.linear for _ in g.units]
    return dict(zip(fit.linear_names, groups, strict=True))


def _parameter(fit: Fit, name: str) -> Parameter:
    """Return a nuisance parameter as a parameter of the plan."""
    s = fit.simulator
    if name in s.index:
        return dataclasses.replace(s.nuisance(name).parameter(), targets=(), place=REPORTED)
    base, _, number = name.partition("#")
    group = next(g for g in fit.linear if g.name == base)
    unit = group.units[int(number or 0)]
    return Parameter(name, unit, -WIDE, WIDE, log=False, targets=(), place=REPORTED)
