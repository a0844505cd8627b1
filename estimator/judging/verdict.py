"""The verdict on an estimate: ok, doubtful (why) or refused (why). Knows the data, the fit and the motor's poles.

An estimate is refused if the transient is lost and R or J with it, or if the model describes no output better than its
mean would; all others are ok, or doubtful with reasons.
Recordings that nothing can be estimated from are refused before (`refusal.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import NOTHING_TOLD, USELESS_ERROR
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.judging.coasting import coasting
from estimator.judging.misfit import above_noise, louder, misfit
from estimator.judging.plain_noise import structured
from estimator.judging.refusal import CONTRADICTED, lost_transients, refused_notes, slow_for_the_motor
from estimator.judging.speed_against_angle import scales_at_odds
from estimator.judging.step_check import StepCheck
from estimator.judging.swings import swings
from estimator.judging.worse_than_means import describes_nothing, worse_than_means
from estimator.motor.names import MOTOR, has_motor, is_motor
from estimator.motor.state_space import poles
from estimator.motor.winding import time_constant
from estimator.plans.plan import Plan
from estimator.results.result import Comparison, NotVisible, Status, Verdict

if TYPE_CHECKING:
    from estimator.explaining.explained import Explained
    from estimator.judging.identifiability import Identifiability
    from estimator.plans.space import Steady

FloatArray = NDArray[np.float64]

UNSEEN = 0.05  # of a sampling interval: exp(-20) of the current's rise is left one interval after an edge
DOUBTFUL_ERROR = 0.25  # relative standard error: reported with the parameter, which is still an estimate
TRADED = 0.98  # correlation of two parameters that one recording cannot separate
PLAIN = ("offset", "delay", "delay of")  # effects whose value needs no sentence
HIDDEN = {  # effects whose own names do not tell, or tell the same
    "delay of": "delay of one output",
    "average": "mean of the last samples",
    "lag": "low-pass",
    "second-order lag": "low-pass",
    "Butterworth low-pass": "low-pass",
    "brush drop": "drop of brushes or drive",
    "drop of the drive": "drop of brushes or drive",
}
LATE = "delay of"  # of one output
LATE_OFF = 0.05  # of a parameter: more is doubted
TOLD_HIDDEN, TOLD_PARAMETERS = 4, 2  # effects that may hide, and parameters of each, at most


@dataclass(frozen=True)
class ParameterStatus:
    """Status of a parameter's value, and its reason."""

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
    polish: LeastSquaresFit | None,
    *,
    steady: Steady | None,
    noise: FloatArray,
    rmse: FloatArray,
    spread: FloatArray,
    step: StepCheck,
    explained: Explained | None = None,
    identifiability: Identifiability | None = None,
    compared: Sequence[Comparison] = (),
) -> Judgement:
    """Judge an estimate.

    Parameters
    ----------
    values : parameter → estimate
    polish : LeastSquaresFit or None
        None for methods that end with the search.
    steady : Steady or None
        Of a single step.
    noise, spread : (q,) arrays
        Deviation of each output's noise as the data show it, and of the signal.
    rmse : (q,) array
        Of what the sensors show; it is the misfit where there is no polish.
    step : StepCheck
        What a finer communication step changes.
    explained : Explained or None
        What was found of the bench.
    identifiability : Identifiability or None
        What the outputs cannot tell, whatever the noise.
    compared : Sequence of Comparison
        The recordings against the estimate, for methods whose fit tests no residuals.
    """
    held = () if polish is None else polish.at_given_bound(plan)
    if nothing := describes_nothing(plan, rmse, noise, spread, held=held):
        return Judgement("refused", tuple(nothing), {}, (*refused_notes(plan, nothing), *_notes(plan, steady)))
    worse = worse_than_means(plan, rmse, noise, spread)
    reasons = list(worse)
    statuses: dict[str, ParameterStatus] = {}
    wide: dict[str, ParameterStatus] = {}
    if steady is not None and not steady.settling.settled:
        reasons.append(
            f"the step response has not settled: {steady.settling.reason}; record for longer, until speed and"
            " current stay constant"
        )
    if polish is not None:
        untold = () if identifiability is None else identifiability.untold
        reasons += [identifiability.sentence] if identifiability is not None and identifiability.untold else []
        alone = _identified(plan, values, polish)
        statuses.update({n: s for n, s in alone.items() if n not in untold})
        absent = {p.name for p in plan.parameters if p.vanishes}  # that it is not told is no reason for doubt
        reasons += _by_parameter(
            {n: s for n, s in statuses.items() if s.status == "not identified" and n not in absent}
        )
        wide = {n: s for n, s in statuses.items() if s.status == "doubtful" or n in absent}
        statuses.update(
            {n: ParameterStatus("not identified", identifiability.sentence) for n in untold} if identifiability else {}
        )
        reasons += _traded(plan, polish, statuses)
        missed = misfit(plan, polish, explained, noise, spread)
        wrong = [
            *missed,
            *swings(explained),
            *step.reasons,
            *_doubts(explained),
            *scales_at_odds(plan),
            *_fast(plan, values),
        ]
        wrong += [*_late_unseen(plan, values, explained), *_coasting(plan, explained), *slow_for_the_motor(plan)]
        reasons += wrong
        wrong = [*worse, *wrong]
        if held:
            wrong.append(f"{', '.join(held)} may not go where the recording wants it")
        if wrong:  # parameters that depend on it are not reliable
            for name in set(plan.names) & set(MOTOR) - set(statuses):
                statuses[name] = ParameterStatus("doubtful", wrong[0])
        lost = lost_transients(plan, {**values, **plan.fixed})
        told = {n for n in ("R", "J") if n not in statuses or statuses[n].status != "not identified"}
        impossible = any(CONTRADICTED in sentence for sentence in lost)
        if lost and (impossible or told != {"R", "J"} or missed):
            return Judgement("refused", tuple(lost), {}, (*refused_notes(plan, lost), *_doubts(explained)))
    else:
        reasons += above_noise(plan, rmse, noise, spread) or structured(compared)
        reasons += _fast(plan, values)
    return Judgement(
        "doubtful" if reasons else "ok",
        tuple(reasons),
        statuses,
        (*_notes(plan, steady), *_found(plan, explained, statuses), *_by_parameter(wide), *step.notes),
    )


def _identified(plan: Plan, values: Mapping[str, float], polish: LeastSquaresFit) -> dict[str, ParameterStatus]:
    statuses = {}
    has_winding = has_motor({*(p.quantity or p.name for p in plan.parameters), *plan.fixed})
    for j, parameter in enumerate(plan.parameters):
        name, value = parameter.name, values[parameter.name]
        error = polish.standard_errors[j]
        relative = error / abs(value) if value else np.inf
        most = max(NOTHING_TOLD * abs(value), parameter.upper - parameter.lower)
        if parameter.place is not None and not most < error < np.inf:
            continue  # of an offset near 0 that is known to be, the error is no part of the value
        if polish.at_bound[j] != 0:
            side = "lower" if polish.at_bound[j] < 0 else "upper"
            bound = parameter.lower if side == "lower" else parameter.upper
            reason = f"the estimate lies at its {side} bound {bound:.4g}; widen the bound or check the recording"
            if has_winding and name == "L" and side == "lower":
                reason = _small_inductance(plan, values)
            if parameter.vanishes and side == "lower":
                reason = f"nothing of it is seen: {bound:.4g}, where its search begins, stands for none"
            statuses[name] = ParameterStatus("not identified", reason)
        elif not relative < USELESS_ERROR:
            size = f"{100 * relative:.0f} % of" if relative < NOTHING_TOLD else "more than 100 times"
            reason = f"cannot be told from this recording: the standard error is {size} the value"
            if has_winding and name == "L":
                reason = f"{reason}; {_small_inductance(plan, values)}"
            statuses[name] = ParameterStatus("not identified", reason)
        elif has_winding and name == "L" and _is_unseen(plan, values):
            reason = (
                f"cannot be told from this recording, whatever its standard error; {_small_inductance(plan, values)}"
            )
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


def _traded(plan: Plan, polish: LeastSquaresFit, statuses: Mapping[str, ParameterStatus]) -> list[str]:
    """Name the two most correlated parameters, if one of them has a large standard error."""
    motor = [j for j, p in enumerate(plan.parameters) if p.place is None and polish.standard_errors[j] > 0]
    deviation = np.sqrt(np.nan_to_num(np.diag(polish.covariance), posinf=0.0))  # 0: nothing is told of it
    pairs = [
        (float(polish.covariance[j, k] / (deviation[j] * deviation[k])), plan.names[k], plan.names[j])
        for j in motor
        for k in motor
        if k < j and {plan.names[j], plan.names[k]} & set(statuses) and deviation[j] * deviation[k] > 0
    ]
    correlation, one, other = max(pairs, key=lambda pair: abs(pair[0]), default=(0.0, "", ""))
    if abs(correlation) < TRADED:
        return []
    single = all(o.excitation.kind == "step" for o in plan.observed) and len(plan.observed) == 1
    more = "several voltage levels or both directions" if single else "larger changes of the voltage, and other ones"
    if has_motor(plan.names) and not ({"w", "angle"} & set(plan.outputs) and "i" in plan.outputs):
        more = "the current, too" if "i" not in plan.outputs else "the speed, too"  # no voltage parts them
    return [f"{one} and {other} stand in for each other (correlation {correlation:+.3f}); record {more}, or fix one"]


def _is_unseen(plan: Plan, values: Mapping[str, float]) -> bool:
    """Whether the winding is so fast that no sample shows it, but by an edge that a delay puts right before one."""
    R = _resistance(plan, values)
    return bool(R) and time_constant(R, values["L"]) < UNSEEN * plan.shortest_step


def _resistance(plan: Plan, values: Mapping[str, float]) -> float:
    """Return R, of several the first; 0 where there is none."""
    return next((x for n, x in {**plan.fixed, **values}.items() if n == "R" or n.startswith("R ")), 0.0)


def _small_inductance(plan: Plan, values: Mapping[str, float]) -> str:
    h = plan.shortest_step
    R = _resistance(plan, values)
    if _is_unseen(plan, values):  # its value is none, but a bound of the search
        about = "L/R is too short to be seen at a sampling interval of"
    elif R:
        about = f"L/R is about {time_constant(R, values['L']):.2g} s against a sampling interval of"
    else:
        about = "it is sampled every"
    return f"{about} {h:g} s; sample faster to tell L"


def _fast(plan: Plan, values: Mapping[str, float]) -> list[str]:
    """Say when the motor is faster than the recording can show: |Im λ| h > π, or all is over within a sample."""
    known = {**values, **plan.fixed}
    if not is_motor(known):
        return []
    rates = poles(known)
    h = plan.shortest_step  # a slower recording beside it takes nothing away
    frequency = float(np.max(np.abs(rates.imag)))
    if frequency * h > np.pi:
        return [
            f"the motor oscillates at {frequency / 2 / np.pi:.4g} Hz, above half the sampling rate of {1 / h:g} Hz:"
            " other parameters fit these samples as well; sample faster"
        ]
    slowest = float(np.min(np.abs(rates.real)))
    if slowest * h > 1:
        return [
            f"the motor follows the voltage within {1 / slowest:.2g} s, less than the sampling interval of {h:g} s:"
            " other parameters may fit these few samples as well; sample faster"
        ]
    return []


def _coasting(plan: Plan, explained: Explained | None) -> list[str]:
    """Say that the motor turned before its recording, where that is not estimated."""
    known = explained is not None and any(f.effect == "motion before the voltage" for f in explained.found)
    return [] if known else coasting(plan)


def _doubts(explained: Explained | None) -> list[str]:
    """Say what was found that makes the numbers doubtful, and what else would explain the recordings."""
    if explained is None:
        return []
    found = [f"{f.sentence}: {f.doubt}" for f in explained.found if f.doubt]
    return [*found, *(rival.sentence() for rival in explained.rivals)]


def _late_unseen(plan: Plan, values: Mapping[str, float], explained: Explained | None) -> list[str]:
    """Say what nothing shows of one sensor's timing, and what would put a parameter of the motor's motion far off.

    Where rows are longer than the winding's time constant, all of the current's rise may be between two of them: a
    converter that averages over a part of each row then shows another current, which fits as well.
    """
    R = _resistance(plan, values)
    if explained is None or not R or time_constant(R, {**plan.fixed, **values}.get("L", 0.0)) > plan.shortest_step:
        return []
    for e in explained.not_visible:
        off = {n: part for n, (part, _) in e.off.items() if n in MOTOR and n not in ("L", "B") and abs(part) > LATE_OFF}
        if e.whatever_size and off and e.effect == LATE:
            far = ", ".join(f"{n} {100 * part:+.2g} %" for n, part in off.items())
            return [
                f"nothing shows whether one output is later than the others, as by a delay or a mean over a part"
                f" of each row: {e.size:.2g} {e.unit} would put {far} off; sample faster, or say"
                " under [outputs] what its sensor does, such as delay = 0"
            ]
    return []


def _found(plan: Plan, explained: Explained | None, statuses: Mapping[str, ParameterStatus]) -> list[str]:
    """Say what was found of the bench and is told, what the noise is like, and what no such recording tells."""
    if explained is None:
        return []
    tabled = set(plan.names)  # those are in a table, with their standard errors
    found = [f for f in explained.found if f.name not in statuses or (f.effect == "between runs" and not f.doubt)]
    notes = [f.sentence for f in found if not (f.effect in PLAIN and f.name in tabled)] + louder(explained.adequacy)
    noise, whitener = explained.fit.whitener.noise, explained.fit.whitener
    for j, name in enumerate(plan.outputs):
        unit = plan.unit(name)
        parts = [f"{noise.white[j]:.2g} {unit} from sample to sample"]
        if noise.differenced[j] > 0:
            parts = [f"{noise.differenced[j]:.2g} {unit} a count, differenced"]
        if noise.slow[j, 0] > 0:
            parts.append(f"{noise.slow[j, 0]:.2g} {unit} over {noise.slow[j, 1]:.2g} s")
        growth = float(noise.scale(np.ones((1, len(noise.white))), np.ones(1, dtype=bool))[0, j])
        if growth > 1.005:
            parts.append(f"{growth:.3g} times as much at the largest signal")
        if len(parts) > 1 or noise.differenced[j] > 0:
            notes.append(f"the noise of {name}: {', '.join(parts)}")
        held = int(np.sum(whitener.inflate[:, j] > 1))
        if held:
            notes.append(f"{name} has {held} outlier{'s' if held > 1 else ''}, weighted by Student's t")
    if noise.jitter > 0:
        notes.append(f"the instants of the samples jitter by {1e3 * noise.jitter:.2g} ms: steep parts count for less")
    if noise.torque[0] > 0:
        notes.append(
            f"a torque of {noise.torque[0]:.2g} N.m that wanders over {noise.torque[1]:.2g} s moves current and speed"
        )
    if explained.hidden_torque > 0:
        size = f"{explained.hidden_torque:.2g} N.m"
        how = f"more slowly, by up to {size}," if noise.torque[0] > 0 else f"by {size}"
        notes.append(f"a torque that wanders {how} would not show: the standard error of B holds it")
    if has_motor(plan.names) and "i" in plan.outputs:
        notes.append(
            "not visible in such a recording: a current that is shown 1 % too large (R and L are then 1 % too small, J"
            " and B 1 % too large), the resistance of the supply (a part of R)"
        )
        for size, whatever in (("if no larger than this", False), ("even if larger than this", True)):
            if others := _hidden([e for e in explained.not_visible if e.whatever_size == whatever]):
                notes.append(f"not visible {size}: {', '.join(others)}; {plan.wanted_levels} tell more")
    return notes


def _hidden(effects: Sequence[NotVisible]) -> list[str]:
    """Say what may be there unnoticed, up to which size, and what it would do to which parameters."""
    told: dict[str, str] = {}
    for e in effects:
        words = HIDDEN.get(e.effect, e.effect)
        if words in told or e.effect == "gain":
            continue
        off = [f"{name} {100 * part:+.2g} %" for name, (part, _) in e.off.items()]
        told[words] = f"{f'{words} {e.size:.2g} {e.unit}'.rstrip()} ({', '.join(off[:TOLD_PARAMETERS])})"
    return list(told.values())[:TOLD_HIDDEN]


def _notes(plan: Plan, steady: Steady | None) -> tuple[str, ...]:
    notes = list(plan.notes)
    unit = " V" if plan.binding.is_motor else ""
    for o in plan.observed:
        e, title = o.excitation, o.recording.title
        if e.kind == "step":
            notes.append(
                f"{title}: step from {e.before:.4g} to {e.after:.4g}{unit} at t = {o.recording.time[e.index]:.6g} s"
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
        t, state = plan.observed[0].recording.time[steady.settling.start], steady.state
        means = (("v", state.v, "V"), ("i", state.i, "A"), ("w", state.w, "rad/s"))  # NaN: no sample is there
        told = ", ".join(f"{name} = {mean:.6g} {unit}" for name, mean, unit in means if np.isfinite(mean))
        notes.append(f"settled from t = {t:.6g} s: {told}")
    return tuple(notes)
