"""How far to believe an estimate: ok, doubtful (why) or refused (why). Knows the data, the fit and the motor's poles.

Refused only where there is nothing to estimate from: no excitation, a lost transient, a saturated signal. Everything
else is an estimate with a reason to doubt it, or without.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.excitation import find_settling, lost_transient, noise_deviation, saturation
from estimator.fmu import FmuDescription
from estimator.plan import MOTOR, Observed, Plan
from estimator.polish import Polish
from estimator.result import Status, Verdict

if TYPE_CHECKING:
    from estimator.fit import Fit
    from estimator.space import Steady

FloatArray = NDArray[np.float64]

DOUBTFUL_ERROR = 0.1  # relative standard error
USELESS_ERROR = 0.5  # relative standard error: the parameter is not identified
MISFIT = 1.5  # residuals' deviation over the noise that the data show
NUMERICAL = 1e-6  # of a signal's deviation: smaller residuals are no misfit
MOVES = 12.0  # deviations of the noise from end to end: more is a movement
RECTIFIED = 50  # samples at rest that tell a lost sign
STEP_ERROR = 1.0  # shift by a finer step, in standard errors
NEGLIGIBLE_SHIFT = 1e-6  # relative: a smaller shift matters to nobody


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


def refusal(plan: Plan) -> list[str]:
    """Return why nothing can be estimated from the recordings; empty if something can."""
    reasons = []
    if all(o.excitation.kind == "none" for o in plan.observed):
        level = plan.observed[0].excitation.after
        moving = [n for n, y in plan.observed[0].outputs.items() if _moves(y)]
        if level == 0 and moving:
            return [
                f"the voltage is zero throughout while {' and '.join(moving)} move"
                f"{'s' if len(moving) == 1 else ''}: no voltage was logged; record the motor's voltage, too"
            ]
        what = "is zero" if level == 0 else f"stays at {level:.4g} V"
        reasons.append(
            f"the voltage {what} from the first to the last sample while the motor does not start, so nothing is"
            " excited; record a voltage step from standstill"
        )
    for o in plan.observed:
        reasons += _damaged(o, plan.description) + _unsigned(o) + _contradicted(o)
    return reasons


def refused_notes(plan: Plan) -> tuple[str, ...]:
    """Return what a refused step response still tells: its settled part gives B / K and a line between R and K."""
    notes = []
    for o in plan.observed:
        if o.excitation.kind != "step" or not {"i", "w"} <= set(o.outputs) or "v" not in o.inputs:
            continue
        if not find_settling(o.excitation, o.outputs, interval=o.recording.step).settled:
            continue
        tail = max(5, (len(o.recording.time) - o.excitation.index) // 10)
        v, i, w = (float(np.nanmean(x[-tail:])) for x in (o.inputs["v"], o.outputs["i"], o.outputs["w"]))
        if i * v > 0 and w * v > 0:
            notes.append(
                f"{o.recording.title}: the settled part still tells B = {i / w:.4g} K and"
                f" R = {v / i:.5g} - {w / i:.5g} K (SI units)"
            )
    return tuple(notes)


def _moves(y: FloatArray) -> bool:
    """Whether an output changes by far more than its noise."""
    known = y[~np.isnan(y)]
    return float(np.ptp(known)) > MOVES * noise_deviation(known) and float(np.ptp(known)) > 0


def _unsigned(o: Observed) -> list[str]:
    """Find a current whose sign was lost: never negative where the voltage and the speed reverse, or at rest."""
    if "i" not in o.outputs or "v" not in o.inputs:
        return []
    v, i = o.inputs["v"], o.outputs["i"]
    known = i[~np.isnan(i)]
    noise = noise_deviation(known)
    lowest, highest = float(np.min(known)), float(np.max(known))
    if np.min(v) < 0 < np.max(v) and min(-np.min(v), np.max(v)) > 0.2 * np.max(np.abs(v)):
        if lowest > -max(4 * noise, 0.02 * highest) and highest > 10 * noise:
            return [
                f"{o.recording.title}: the voltage goes from {np.min(v):.4g} to {np.max(v):.4g} V, but the current"
                f" never below {lowest:.3g} A: its sign was lost; record it with a sensor that tells the direction"
            ]
        return []
    rest = i[: o.excitation.index] if o.excitation.kind == "step" and o.excitation.before == 0 else known[:0]
    rest = rest[~np.isnan(rest)]
    if len(rest) >= RECTIFIED and not o.excitation.running:
        above = rest[rest > 0]
        if np.min(rest) >= 0 and len(above) > 0.9 * len(rest) and np.mean(above) < 2 * np.std(above):
            return [
                f"{o.recording.title}: the current at rest is never negative in {len(rest)} samples, with a mean of"
                f" {np.mean(rest):.3g} A: its sign was lost; record it with a sensor that tells the direction"
            ]
    return []


def _contradicted(o: Observed) -> list[str]:
    """Find a settled state that no motor has: against its voltage, or giving off power."""
    if o.excitation.kind != "step" or "v" not in o.inputs or o.excitation.after == 0:
        return []
    if any(np.any(u != 0) for name, u in o.inputs.items() if name != "v"):
        return []
    tail = max(5, (len(o.recording.time) - o.excitation.index) // 10)
    v = float(np.mean(o.inputs["v"][-tail:]))
    reasons = []
    for name, what, unit in (("i", "current", "A"), ("w", "speed", "rad/s")):
        y = o.outputs.get(name)
        if y is None or np.isnan(y[-tail:]).all():
            continue
        final, noise = float(np.nanmean(y[-tail:])), noise_deviation(y)
        if final * v < 0 and abs(final) > 6 * noise and abs(final) > 0.02 * float(np.nanmax(np.abs(y))):
            reasons.append(
                f"{o.recording.title}: at the end the {what} is {final:.4g} {unit} under {v:.4g} V, which no motor"
                f" without load does; check the sign of the {what} and of the voltage"
            )
    return reasons


def _damaged(o: Observed, description: FmuDescription) -> list[str]:
    reasons = []
    title = o.recording.title
    for name, y in o.outputs.items():
        clipped = saturation(y) if name != "angle" else None
        if clipped is not None:
            first, run, value = clipped
            unit = description.variable(name).unit
            reasons.append(
                f"{title}: {name} is saturated at {value:.4g} {unit} for {run} samples from"
                f" t = {o.recording.time[first]:.6g} s; record again with a larger sensor range"
            )
        if o.excitation.kind == "step" and name == "w":
            lost = lost_transient(o.excitation, y)
            if lost is not None:
                k, part = lost
                reasons.append(
                    f"{title}: the speed jumps by {100 * part:.0f} % of its response within one sample at"
                    f" t = {o.recording.time[k]:.6g} s: the transient is lost, and R, L and J with it;"
                    " record at a higher rate, without gaps"
                )
    return reasons


def judge(
    plan: Plan,
    values: Mapping[str, float],
    polish: Polish | None,
    *,
    steady: Steady | None,
    noise: FloatArray | None,
    spread: FloatArray,
    shift: FloatArray | None,
    fit: Fit | None = None,
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
    shift : (p,) array or None
        How far a ten times finer communication step moves the scaled parameters.
    fit : Fit or None
        What was found of the measurement chain.
    """
    reasons: list[str] = []
    statuses: dict[str, ParameterStatus] = {}
    if steady is not None and not steady.settling.settled:
        reasons.append(
            f"the step response has not settled: {steady.settling.reason}; record for longer, until speed and"
            " current stay constant"
        )
    if polish is not None:
        statuses.update(_identified(plan, values, polish))
        reasons += [f"{name}: {s.reason}" for name, s in statuses.items()]
        reasons += _misfit(plan, polish, noise, spread)
        reasons += _step_error(plan, polish, shift)
        reasons += _drifts(fit)
        reasons += _betrayed(fit)
    reasons += _aliased(plan, values)
    return Judgement(
        "doubtful" if reasons else "ok", tuple(reasons), statuses, (*_notes(plan, steady), *_chain_notes(fit))
    )


def _identified(plan: Plan, values: Mapping[str, float], polish: Polish) -> dict[str, ParameterStatus]:
    statuses = {}
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
            if name == "L" and side == "lower":
                reason = _small_inductance(plan, values)
            statuses[name] = ParameterStatus("not identified", reason)
        elif not relative < USELESS_ERROR:
            size = f"{100 * relative:.0f} %" if np.isfinite(relative) and relative < 100 else "more than 100 times"
            reason = f"it cannot be told from this recording: its standard error is {size} of its value"
            if name == "L":
                reason = f"{reason}; {_small_inductance(plan, values)}"
            statuses[name] = ParameterStatus("not identified", reason)
        elif relative > DOUBTFUL_ERROR:
            statuses[name] = ParameterStatus("doubtful", f"its standard error is {100 * relative:.0f} % of its value")
    return statuses


def _small_inductance(plan: Plan, values: Mapping[str, float]) -> str:
    h = plan.observed[0].recording.step
    tau = values["L"] / values["R"] if "R" in values else float("nan")
    return f"L/R is about {tau:.2g} s against a sampling interval of {h:g} s; sample faster to tell L"


def _misfit(plan: Plan, polish: Polish, noise: FloatArray | None, spread: FloatArray) -> list[str]:
    if noise is None:
        return []
    reasons = []
    for j, name in enumerate(plan.outputs):
        found = polish.deviations[j]
        if found > MISFIT * noise[j] and found > NUMERICAL * spread[j]:
            unit = plan.description.variable(name).unit
            times = found / max(noise[j], 1e-300)
            size = f"{times:.1f} times" if times < 1000 else "far above"
            reasons.append(
                f"the model does not explain {name}: its residuals have a deviation of {found:.3g} {unit}, {size} the"
                f" noise of {noise[j]:.2g} {unit} that the recording shows"
            )
    return reasons


def _step_error(plan: Plan, polish: Polish, shift: FloatArray | None) -> list[str]:
    if shift is None:
        return []
    deviation = np.sqrt(np.diag(polish.covariance))
    moved = [
        (abs(shift[j]) / deviation[j], name, shift[j])
        for j, name in enumerate(plan.names)
        if 0 < deviation[j] < np.inf and abs(shift[j]) > NEGLIGIBLE_SHIFT and plan.parameters[j].log
    ]
    worst = max(moved, default=(0.0, "", 0.0))
    if worst[0] <= STEP_ERROR:
        return []
    size = f"{worst[0]:.1f} standard errors" if worst[0] < 1000 else "far more than its standard error"
    return [
        f"the FMU's own step error matters: a ten times finer communication step would move {worst[1]} by"
        f" {100 * abs(worst[2]):.2g} %, {size}; set a finer step in the case file, under [fmu]"
    ]


def _aliased(plan: Plan, values: Mapping[str, float]) -> list[str]:
    """Say when the motor oscillates faster than the recording can show: |Im λ| h > π."""
    known = {**values, **plan.fixed}
    if not set(MOTOR) <= set(known):
        return []
    R, K, L, J, B = (known[n] for n in MOTOR)
    poles = np.linalg.eigvals(np.array([[-R / L, -K / L], [K / J, -B / J]]))
    h = max(o.recording.step for o in plan.observed)
    frequency = float(np.max(np.abs(poles.imag)))
    if frequency * h <= np.pi:
        return []
    return [
        f"the motor oscillates at {frequency / 2 / np.pi:.4g} Hz, above half the sampling rate of {1 / h:g} Hz: other"
        " parameters fit these samples as well; sample faster"
    ]


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


def _betrayed(fit: Fit | None) -> list[str]:
    """Name the strongest wrong assumption that the residuals betray."""
    if fit is None or not fit.colours:  # no noise to compare with
        return []
    from estimator.suspects import suspicions
    from estimator.treatment import onset

    return [s.sentence for s in suspicions(fit, onset=onset(fit.problem, 0, fit.polish.values))[:1]]


def _chain_notes(fit: Fit | None) -> list[str]:
    """Say what was found of the measurement chain."""
    if fit is None:
        return []
    plan, polish = fit.problem.plan, fit.polish
    notes = list(fit.freed)
    for j, parameter in enumerate(plan.parameters):
        if parameter.place is not None:
            value, error = polish.values[j], polish.standard_errors[j]
            notes.append(f"{parameter.name} = {value:.6g} {parameter.unit} ± {error:.2g}")
    for name, ripple in fit.treatment.ripples:
        unit = plan.description.variable(name).unit
        notes.append(
            f"{name} has a ripple of order {ripple.order} of the shaft's angle, of amplitude"
            f" {ripple.amplitude:.3g} {unit}; it is taken out"
        )
    for name, count in fit.treatment.outliers:
        notes.append(f"{name} has {count} outliers; they are left out")
    for name, colour in zip(plan.outputs, fit.colours, strict=False):  # none of a fit without noise
        if not colour.is_white:
            notes.append(
                f"the residuals of {name} are not white (autoregression of order {len(colour.coefficients)});"
                " the standard errors allow for it"
            )
    return notes


def _notes(plan: Plan, steady: Steady | None) -> tuple[str, ...]:
    notes = []
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
        for name, y in o.outputs.items():
            notes.append(f"{title}: {name} has {np.sum(~np.isnan(y))} samples, noise {noise_deviation(y):.2g}")
    if steady is not None and steady.settling.settled:
        t = plan.observed[0].recording.time[steady.settling.start]
        state = steady.state
        notes.append(f"settled from t = {t:.6g} s: v = {state.v:.6g} V, i = {state.i:.6g} A, w = {state.w:.6g} rad/s")
    return tuple(notes)
