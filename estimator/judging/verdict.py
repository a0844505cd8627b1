"""How far to believe an estimate: ok, doubtful (why) or refused (why). Knows the data, the fit and the motor's poles.

An estimate is refused where the transient is lost and R or J with it; everything else is an estimate with a reason to
doubt it, or without. What no recording can tell at all is refused before (`refusal.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import at_given_bound
from estimator.fitting.polish import Polish
from estimator.fitting.suspects import hidden_friction
from estimator.judging.coasting import coasting
from estimator.judging.refusal import CONTRADICTED, lost_transients, refused_notes, slow_for_the_motor
from estimator.judging.scales import scales_at_odds
from estimator.judging.step_check import StepCheck
from estimator.plans.noise_level import beside_means
from estimator.plans.plan import Plan
from estimator.recordings.excitation import quantum
from estimator.results.linear import MOTOR, is_motor
from estimator.results.result import Status, Verdict
from estimator.stepping import layout

if TYPE_CHECKING:
    from estimator.fitting.fit import Fit
    from estimator.judging.structure import Structure
    from estimator.plans.space import Steady

FloatArray = NDArray[np.float64]

DOUBTFUL_ERROR = 0.1  # relative standard error
TRADED = 0.98  # correlation of two that stand in for each other
USELESS_ERROR = 0.5  # relative standard error: the parameter is not identified
MISFIT = 1.5  # residuals' deviation over the noise that the data show
HIDDEN = 0.1  # of the friction: less of it that may be dry is not told
NUMERICAL = 1e-6  # of a signal's deviation: smaller residuals are no misfit


@dataclass(frozen=True)
class ParameterStatus:
    """What a parameter's number is worth."""

    status: Status
    reason: str | None


@dataclass(frozen=True)
class Judgement:
    """The verdict with its reasons, a status for each parameter that is not ok, and notes on the data."""

    verdict: Verdict
    reasons: tuple[str, ...]
    statuses: Mapping[str, ParameterStatus]
    notes: tuple[str, ...] = ()


def judge(
    plan: Plan,
    values: Mapping[str, float],
    polish: Polish | None,
    *,
    steady: Steady | None,
    noise: FloatArray,
    rmse: FloatArray,
    spread: FloatArray,
    step: StepCheck,
    fit: Fit | None = None,
    structure: Structure | None = None,
) -> Judgement:
    """Judge an estimate.

    Parameters
    ----------
    values : parameter → estimate
    polish : Polish or None
        None for methods that end with the search.
    steady : Steady or None
        Of a single step.
    noise, spread : (q,) arrays
        Deviation of each output's noise as the data show it, and of the signal.
    rmse : (q,) array
        Of what the sensors show; it is the misfit where there is no polish.
    step : StepCheck
        What a finer communication step changes.
    fit : Fit or None
        What was found of the measurement chain.
    structure : Structure or None
        What the outputs cannot tell, whatever the noise.
    """
    reasons: list[str] = []
    statuses: dict[str, ParameterStatus] = {}
    if steady is not None and not steady.settling.settled:
        reasons.append(
            f"the step response has not settled: {steady.settling.reason}; record for longer, until speed and"
            " current stay constant"
        )
    if polish is not None:
        untold = () if structure is None else structure.untold
        reasons += [structure.sentence] if structure is not None and structure.untold else []
        alone = _identified(plan, values, polish)
        statuses.update({n: s for n, s in alone.items() if n not in untold})
        reasons += _by_parameter(statuses)
        statuses.update({n: ParameterStatus("not identified", structure.sentence) for n in untold} if structure else {})
        reasons += _traded(plan, polish, statuses)
        shown = polish.deviations if fit is None else fit.problem.noise_shown(polish.deviations)
        reasons += _misfit(plan, shown, noise, spread)
        reasons += step.reasons
        reasons += _drifts(fit)
        wrong = [
            *_wrong_assumptions(fit),
            *_gains(plan, values, fit),
            *scales_at_odds(plan),
            *_fast(plan, values),
            *coasting(plan),
        ]
        reasons += wrong
        if held := at_given_bound(plan, polish):
            wrong.append(f"{', '.join(held)} may not go where the recording wants it")
        if wrong:  # numbers that stand on it are not to be relied on
            for name in set(plan.names) & set(MOTOR) - set(statuses):
                statuses[name] = ParameterStatus("doubtful", wrong[0])
        reasons += _coloured(plan, fit)
        lost = lost_transients(plan, {**values, **plan.fixed})
        told = {n for n in ("R", "J") if n not in statuses or statuses[n].status != "not identified"}
        impossible = any(CONTRADICTED in sentence for sentence in lost)
        if lost and (impossible or told != {"R", "J"} or _misfit(plan, shown, noise, spread)):
            return Judgement("refused", tuple(lost), {}, (*refused_notes(plan), *_put_back(fit)))
        reasons += slow_for_the_motor(plan)
    else:
        reasons += [*_misfit(plan, rmse, noise, spread), *_fast(plan, values)]
    return Judgement(
        "doubtful" if reasons else "ok",
        tuple(reasons),
        statuses,
        (*_notes(plan, steady), *_chain_notes(fit), *step.notes),
    )


def _identified(plan: Plan, values: Mapping[str, float], polish: Polish) -> dict[str, ParameterStatus]:
    statuses = {}
    has_winding = set(MOTOR) <= {*(p.quantity or p.name for p in plan.parameters), *plan.fixed}
    for j, parameter in enumerate(plan.parameters):
        if parameter.place is not None:
            continue
        name, value = parameter.name, values[parameter.name]
        error = polish.standard_errors[j]
        relative = error / abs(value) if value else np.inf
        if polish.at_bound[j] != 0:
            side = "lower" if polish.at_bound[j] < 0 else "upper"
            bound = parameter.lower if side == "lower" else parameter.upper
            reason = f"the estimate lies at its {side} bound {bound:.4g}; widen the bound or check the recording"
            if has_winding and name == "L" and side == "lower":
                reason = _small_inductance(plan, values)
            statuses[name] = ParameterStatus("not identified", reason)
        elif not relative < USELESS_ERROR:
            size = f"{100 * relative:.0f} %" if np.isfinite(relative) and relative < 100 else "more than 100 times"
            reason = f"cannot be told from this recording: the standard error is {size} of the value"
            if has_winding and name == "L":
                reason = f"{reason}; {_small_inductance(plan, values)}"
            statuses[name] = ParameterStatus("not identified", reason)
        elif relative > DOUBTFUL_ERROR:
            statuses[name] = ParameterStatus("doubtful", f"its standard error is {100 * relative:.0f} % of its value")
    return statuses


def _by_parameter(statuses: Mapping[str, ParameterStatus]) -> list[str]:
    """Return the reasons with the parameters that they are for, each once."""
    named: dict[str, list[str]] = {}
    for name, status in statuses.items():
        named.setdefault(status.reason or status.status, []).append(name)
    return [f"{', '.join(names)}: {reason}" for reason, names in named.items()]


def _traded(plan: Plan, polish: Polish, statuses: Mapping[str, ParameterStatus]) -> list[str]:
    """Name the two parameters that stand in for each other most, where one of them is not told well."""
    motor = [j for j, p in enumerate(plan.parameters) if p.place is None and polish.standard_errors[j] > 0]
    deviation = np.sqrt(np.diag(polish.covariance))
    pairs = [
        (float(polish.covariance[j, k] / (deviation[j] * deviation[k])), plan.names[k], plan.names[j])
        for j in motor
        for k in motor
        if k < j and {plan.names[j], plan.names[k]} & set(statuses) and np.isfinite(deviation[j] * deviation[k])
    ]
    correlation, one, other = max(pairs, key=lambda pair: abs(pair[0]), default=(0.0, "", ""))
    if abs(correlation) < TRADED:
        return []
    single = all(o.excitation.kind == "step" for o in plan.observed) and len(plan.observed) == 1
    remedy = "record several voltage levels or both directions, or fix" if single else "fix"
    return [f"{one} and {other} stand in for each other (correlation {correlation:+.3f}); {remedy} one of them"]


def _small_inductance(plan: Plan, values: Mapping[str, float]) -> str:
    h = plan.observed[0].recording.step
    R = next((x for n, x in {**plan.fixed, **values}.items() if n == "R" or n.startswith("R ")), None)
    about = f"L/R is about {values['L'] / R:.2g} s against a sampling interval of" if R else "it is sampled every"
    return f"{about} {h:g} s; sample faster to tell L"


def _misfit(plan: Plan, deviations: FloatArray, noise: FloatArray, spread: FloatArray) -> list[str]:
    reasons = []
    noise = beside_means(plan, noise)
    for j, name in enumerate(plan.outputs):
        found = deviations[j]
        if found > MISFIT * noise[j] and found > NUMERICAL * spread[j]:
            unit = plan.description.variable(name).unit
            times = found / max(noise[j], 1e-300)
            size = f"{times:.1f} times" if times < 1000 else "far above"
            reasons.append(
                f"the model does not explain {name}: its residuals have a deviation of {found:.3g} {unit}, {size} the"
                f" noise of {noise[j]:.2g} {unit} that the recording shows"
            )
    return reasons


def _fast(plan: Plan, values: Mapping[str, float]) -> list[str]:
    """Say when the motor is faster than the recording can show: |Im λ| h > π, or all is over within a sample."""
    known = {**values, **plan.fixed}
    if not is_motor(known):
        return []
    R, K, L, J, B = (known[n] for n in MOTOR)
    poles = np.linalg.eigvals(np.array([[-R / L, -K / L], [K / J, -B / J]]))
    h = max(o.recording.step for o in plan.observed)
    frequency = float(np.max(np.abs(poles.imag)))
    if frequency * h > np.pi:
        return [
            f"the motor oscillates at {frequency / 2 / np.pi:.4g} Hz, above half the sampling rate of {1 / h:g} Hz:"
            " other parameters fit these samples as well; sample faster"
        ]
    slowest = float(np.min(np.abs(poles.real)))
    if slowest * h > 1:
        return [
            f"the motor follows the voltage within {1 / slowest:.2g} s, less than the sampling interval of {h:g} s:"
            " other parameters may fit these few samples as well; sample faster"
        ]
    return []


def _coloured(plan: Plan, fit: Fit | None) -> list[str]:
    """Say which residuals are not white though the measurement chain gives them no colour."""
    if fit is None:
        return []
    reasons = []
    for name, colour in zip(plan.outputs, fit.colours, strict=False):  # none of a fit without noise
        chain = fit.problem.plan.chains.get(name)
        plain = plan.sensors[name] == layout.IDENTITY and (chain is None or chain.is_plain)
        noise = fit.problem.noise_shown(fit.polish.deviations)[plan.outputs.index(name)]
        coarse = max(quantum(o.outputs[name]) for o in plan.observed) > noise  # quantisation beats with the speed
        if plain and not coarse and colour.is_significant:
            reasons.append(
                f"the residuals of {name} are not white: neighbours correlate by {colour.neighbours:+.2f}; something"
                " acts that the model or its sensors leave out; the standard errors allow for its colour only"
            )
    return reasons


def _drifts(fit: Fit | None) -> list[str]:
    """Say what drifts over the recording; the trend is taken out, the parameters stand for the mean."""
    if fit is None:
        return []
    plan = fit.problem.plan
    return [
        f"{name} drifts by {size:.3g} {plan.description.variable(name).unit} over the recording, more than its noise"
        " can: friction or a winding that warms up; the parameters stand for the mean; let the motor run warm first"
        for name, size in fit.treatment.drifts
    ]


def _wrong_assumptions(fit: Fit | None) -> list[str]:
    """Name the wrong assumptions that the residuals show."""
    return [] if fit is None else [a.sentence for a in fit.treatment.accused]


def _put_back(fit: Fit | None) -> list[str]:
    """Say which samples explain the recording if they are missing, where the jump that they make is refused."""
    return [] if fit is None else [a.sentence for a in fit.treatment.accused if not len(a.rows)]


def _gains(plan: Plan, values: Mapping[str, float], fit: Fit | None) -> list[str]:
    """Say that a sensor's gain contradicts what is held fixed or another sensor; of which, nobody can tell."""
    names = [] if fit is None else [n for n in fit.names if n.startswith("gain ")]
    what = "what is held fixed does not fit" if plan.fixed or not names else "the signals contradict each other in"
    return [
        f"{what} the recording unless {name.removeprefix('gain ')} is shown with a gain of"
        f" {values[name]:.4g}; a gain of another signal may explain it as well; check the sensors' scales"
        for name in names
    ]


def _hidden(fit: Fit) -> str:
    """Say how much of the friction may be dry without being noticed."""
    found = hidden_friction(fit)
    if found is None or not found[1] > 0 or found[0] < HIDDEN * found[1]:
        return ""
    size = "any size" if found[0] == found[1] else f"up to {100 * found[0] / found[1]:.0f} % of all friction"
    return f"; nor a dry friction of {size} (in B and J): record two voltage levels to separate them"


def _chain_notes(fit: Fit | None) -> list[str]:
    """Say what was found of the measurement chain."""
    if fit is None:
        return []
    plan, _polish = fit.problem.plan, fit.polish
    tabled = set(plan.names)  # those stand in the table of the measurement chain, with their bars
    notes = [s for name, s in zip(fit.names, fit.freed, strict=True) if name not in tabled or not _is_plain(name)]
    notes += fit.nearly
    if set(MOTOR) <= set(plan.names) and "i" in plan.outputs:
        notes.append(
            "not visible in such a recording: a gain error g of the current (R, L by 1/g, J, B by g), the supply's"
            f" resistance (in R){_hidden(fit)}"
        )
    notes += _ripples(fit)
    for name, count in fit.treatment.outliers:
        notes.append(f"{name} has {count} outlier{'; it is' if count == 1 else 's; they are'} left out")
    for name, colour in zip(plan.outputs, fit.colours, strict=False):  # none of a fit without noise
        if not colour.is_white:
            notes.append(
                f"the residuals of {name} are not white (autoregression of order {len(colour.coefficients)});"
                " the standard errors allow for it"
            )
    return notes


def _is_plain(name: str) -> bool:
    """Whether a value of the measurement chain says all by its name: a delay or an offset, but not what is odd."""
    return name.startswith(("offset", "delay")) and name not in ("delay w", "delay i")


def _ripples(fit: Fit) -> list[str]:
    """Say which ripple was taken out of each output, in one sentence, the largest first."""
    plan = fit.problem.plan
    sentences = []
    for name in plan.outputs:
        largest: dict[int, float] = {}
        for output, ripple in fit.treatment.ripples:
            if output == name:
                largest[ripple.order] = max(ripple.amplitude, largest.get(ripple.order, 0.0))
        if largest:
            every = sorted(largest.items(), key=lambda entry: -entry[1])
            told = ", ".join(f"{order} ({amplitude:.3g})" for order, amplitude in every)
            orders = "an order" if len(every) == 1 else "orders"
            unit = plan.description.variable(name).unit
            sentences.append(
                f"{name} has a ripple at {orders} of the shaft's angle, taken out of the residuals; order (amplitude,"
                f" {unit}): {told}"
            )
    return sentences


def _notes(plan: Plan, steady: Steady | None) -> tuple[str, ...]:
    notes = list(plan.notes)
    for o in plan.observed:
        e, title = o.excitation, o.recording.title
        if e.kind == "step":
            notes.append(
                f"{title}: step from {e.before:.4g} to {e.after:.4g} at t = {o.recording.time[e.index]:.6g} s"
                + (", the motor already runs before it" if o.lead else "")
            )
        elif e.kind == "several":
            notes.append(f"{title}: the input has several levels")
        if not o.recording.even:
            jitter = float(np.std(np.diff(o.recording.time))) / o.recording.step
            notes.append(f"{title}: the clock jitters by {100 * jitter:.2g} % of a step; each sample has its own time")
        counts = [f"{np.sum(~np.isnan(y))} of {name}" for name, y in o.outputs.items()]
        notes.append(f"{title}: samples: {', '.join(counts)}")
    if steady is not None and steady.settling.settled:
        t = plan.observed[0].recording.time[steady.settling.start]
        state = steady.state
        notes.append(f"settled from t = {t:.6g} s: v = {state.v:.6g} V, i = {state.i:.6g} A, w = {state.w:.6g} rad/s")
    return tuple(notes)
