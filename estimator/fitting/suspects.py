"""Wrong assumptions that a fit betrays: a sagging supply, dry friction, lost samples. Knows the motor, no FMU.

Each suspect is a direction in which the residuals of a motor's step response would lie: what the outputs would do, to
first order, if it were true. The residuals are projected on it, free of what the estimated parameters explain, and
judged by the colour that the noise of the settled part has. The strongest of suspects and nuisances goes first; a
suspect that is believed is named and taken out of the residuals, so that it neither bends what is found after it
nor the parameters.

A gain of the current's sensor, or a supply whose voltage falls in proportion to the current, is no suspect: other
parameters explain it exactly (R and L × 1/g, J and B × g), so no recording of this kind can tell, unless one of the
parameters is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.evidence import Evidence
from estimator.fitting.fit import Fit
from estimator.fitting.noise import averaged
from estimator.fitting.treatment import Accused, onset
from estimator.plans.plan import ChainSpec, Plan
from estimator.results.linear import is_motor
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

LOST = "lost samples"
ACCUSED = 4.5  # standard deviations: by white noise once in 150 000 of one direction
AGAIN = 2.0  # standard deviations from which a direction is taken at its size
SAGS = (0.003, 0.01, 0.03, 0.1)  # s in which a supply may recover
LOST_FROM = 60  # places in the transient at which lost samples are looked for, at most
LEAST_LOST = 0.7  # samples: a logger loses whole ones
MOVES = 0.02  # of the largest slope: where the transient is


@dataclass(frozen=True)
class Suspect:
    """What current, speed and angle, (n, 3), would do for a unit of it, and how to say so from size and deviations."""

    name: str
    rows: FloatArray
    tell: Callable[[float, float], str]
    least: float = 0.0  # size in either way
    positive: bool = False  # of no other sign
    place: int = 0
    again: Callable[[float], FloatArray] | None = None  # the rows, (n, 3), for a unit at a size that is not small


def strongest_suspect(fit: Fit) -> Accused | None:
    """Return the strongest of what the residuals of a single step's fit betray; None if nothing."""
    plan, values = fit.problem.plan, _motor_from_rest(fit)
    if values is None or fit.treatment.accused:
        return None  # to first order only: what is left of it would look like another
    start = onset(fit.problem, 0, fit.polish.values)
    judged = Evidence(fit.problem, fit.polish, fit.treatment, fit.polish.residuals, start=start)
    best: Accused | None = None
    for which, suspect in enumerate(_suspects(plan, values, start)):
        rows = _shown(plan, suspect.rows)
        z, size = judged(fit.problem.spread_out([rows]))
        if suspect.again is not None and size > 0 and z > AGAIN:
            rows = _shown(plan, suspect.again(size))
            z, size = judged(fit.problem.spread_out([rows]))
        if (
            z > (best.deviations if best else ACCUSED)
            and abs(size) >= suspect.least
            and (size > 0 or not suspect.positive)
        ):
            best = Accused(suspect.name, z, suspect.tell(size, z), rows, size, which, suspect.place)
    return best


def hidden_friction(fit: Fit) -> tuple[float, float] | None:
    """Return the dry friction that would not be noticed in a motor's single step from rest, and all friction, in N·m.

    Where the current follows the voltage far faster than the speed, a torque that is there from the start looks like
    more inertia and more viscous friction. Taken at half of all friction, where the shaft stands at first.
    """
    plan, values = fit.problem.plan, _motor_from_rest(fit)
    if values is None:
        return None
    R, K, B = (values[n] for n in ("R", "K", "B"))
    o, start = plan.observed[0], onset(fit.problem, 0, fit.polish.values)
    jump = o.excitation.after - o.excitation.before
    total = abs(jump) * K * B / (R * B + K * K)
    after = np.maximum(np.arange(len(o.recording.time)) - start, 0) * o.recording.step
    rows = _turned(_dragged(values, after, jump, total / 2), o.recording.step)
    judged = Evidence(fit.problem, fit.polish, fit.treatment, fit.polish.residuals, start=start)
    z, size = judged(fit.problem.spread_out([_shown(plan, rows)]))
    return (min(total, ACCUSED * abs(size) / z) if z > 0 else total), total


def _motor_from_rest(fit: Fit) -> dict[str, float] | None:
    """Return R, K, L, J, B of a motor that one step starts, seen by its usual outputs; None of anything else."""
    plan = fit.problem.plan
    values = {**dict(zip(plan.names, fit.polish.values.tolist(), strict=True)), **plan.fixed}
    if len(plan.observed) != 1 or plan.observed[0].excitation.kind != "step" or plan.observed[0].lead:
        return None
    return values if is_motor(values) and set(plan.outputs) <= {"i", "w", "angle"} else None


def renewed(fit: Fit, accused: Accused) -> Accused:
    """Return what was accused with its direction taken at a fit that allows for it."""
    plan = fit.problem.plan
    values = {**dict(zip(plan.names, fit.polish.values.tolist(), strict=True)), **plan.fixed}
    start = onset(fit.problem, 0, fit.polish.values)
    suspect = next(s for k, s in enumerate(_suspects(plan, values, start)) if k == accused.which)
    rows = suspect.rows if suspect.again is None else suspect.again(accused.size)
    return replace(accused, rows=_shown(plan, rows))


def _shown(plan: Plan, rows: FloatArray) -> FloatArray:
    """Return current, speed and angle, (n, 3), as the plan's sensors show them, (n, outputs)."""
    h = plan.observed[0].recording.step
    columns = []
    for y in plan.outputs:
        x = rows[:, ("i", "w", "angle").index(y)]
        if plan.sensors[y] == layout.MEAN:
            x = np.diff(rows[:, 2], prepend=0.0) / h
        chain = plan.chains.get(y, ChainSpec())
        x = averaged(x[:, None], chain.average)[:, 0]
        if sections := chain.sections(h):
            from scipy.signal import sosfilt

            x = sosfilt([[b0, b1, b2, 1.0, a1, a2] for b0, b1, b2, a1, a2 in sections], x)
        columns.append(np.asarray(x))
    return np.column_stack(columns)


def _suspects(plan: Plan, values: dict[str, float], start: int) -> Iterator[Suspect]:
    o = plan.observed[0]
    h = o.recording.step
    after = np.maximum(np.arange(len(o.recording.time)) - start, 0) * h
    jump = o.excitation.after - o.excitation.before
    for tau in SAGS:
        yield Suspect("supply sag", _turned(jump * _to_decaying_voltage(values, after, tau), h), _sag(tau))
    yield Suspect(
        "dry friction",
        _turned(np.sign(jump) * _to_torque(values, after), h),
        _dry,
        positive=True,
        again=lambda size: _turned(_dragged(values, after, jump, size), h),
    )
    slope = np.gradient(_response(values, after) * jump, axis=0) * (after > 0)[:, None]
    speed = np.abs(slope[:, 1]) / max(float(np.max(np.abs(slope[:, 1]))), 1e-300)
    places = np.flatnonzero(speed > MOVES)
    places = places[:: max(1, len(places) // LOST_FROM)]
    for k in places[1:].tolist():
        lost = slope * (np.arange(len(after)) >= k)[:, None]
        yield Suspect(LOST, _turned(lost, h), _lost(float(o.recording.time[k])), least=LEAST_LOST, place=k)


def _turned(rows: FloatArray, step: float) -> FloatArray:
    """Return current and speed, (n, 2), with the angle, (n, 3)."""
    w = rows[:, 1]
    return np.column_stack([rows, np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2) * step])])


def _sag(tau: float) -> Callable[[float, float], str]:
    def tell(size: float, z: float) -> str:
        by = f"{100 * size:+.2g} % at first"
        if size < 0:
            return (
                f"the supply's voltage seems to sag at the step ({by}, recovering in some {tau:g} s; {z:.1f} standard"
                " deviations); record the motor's voltage, not the command"
            )
        return (
            f"the supply's voltage seems to be too high at the step ({by}, falling off in some {tau:g} s; {z:.1f}"
            " standard deviations), or a sensor has a filter; record the motor's voltage, and declare the filter"
        )

    return tell


def _dry(size: float, z: float) -> str:
    return (
        f"the residuals look like a dry (Coulomb) friction of some {abs(size):.2g} N·m besides B"
        f" ({z:.1f} standard deviations); record two voltage levels and estimate it (dc_motor_friction)"
    )


def _lost(time: float) -> Callable[[float, float], str]:
    return lambda size, z: (
        f"some {abs(size):.1f} samples seem to {'be missing' if size > 0 else 'have been repeated'} at about"
        f" t = {time:.4g} s ({z:.1f} standard deviations); check the logger's clock"
    )


def _modes(values: dict[str, float]) -> FloatArray:
    R, K, L, J, B = (values[n] for n in ("R", "K", "L", "J", "B"))
    return np.array([[-R / L, -K / L], [K / J, -B / J]])


def _response(values: dict[str, float], t: FloatArray) -> FloatArray:
    """Return current and speed, (n, 2), after a unit step of the voltage."""
    return _step(_modes(values), np.array([1 / values["L"], 0.0]), t)


def _to_torque(values: dict[str, float], t: FloatArray) -> FloatArray:
    """Return the response, (n, 2), to a unit of torque against positive motion."""
    return _step(_modes(values), np.array([0.0, -1 / values["J"]]), t)


def _dragged(values: dict[str, float], t: FloatArray, jump: float, torque: float) -> FloatArray:
    """Return the response, (n, 2), to a unit of dry friction of `torque` N·m: the shaft stands until K i exceeds it.

    Current rises as v / R (1 − exp(−t R / L)) until then; after it the motor is linear again, from that state.
    """
    R, K, L, J = (values[n] for n in ("R", "K", "L", "J"))
    stall, torque = abs(jump) / R, min(torque, 0.9 * K * abs(jump) / R)
    starts = -L / R * np.log(1 - torque / K / stall)
    A = _modes(values)
    final = -np.linalg.solve(A, np.array([abs(jump) / L, -torque / J]))
    eigenvalues, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, (np.array([torque / K, 0.0]) - final).astype(complex))
    later = np.maximum(t - starts, 0.0)
    moving = final + np.real((vectors * weights) @ np.exp(np.outer(eigenvalues, later))).T
    standing = np.column_stack([stall * -np.expm1(-t * R / L), np.zeros_like(t)])
    shown = np.where((t > starts)[:, None], moving, standing)
    return np.asarray(np.sign(jump) * shown - jump * _response(values, t)) / torque


def _to_decaying_voltage(values: dict[str, float], t: FloatArray, tau: float) -> FloatArray:
    """Return the response, (n, 2), to a voltage exp(−t/τ)."""
    A = np.zeros((3, 3))
    A[:2, :2] = _modes(values)
    A[0, 2] = 1 / values["L"]
    A[2, 2] = -1 / tau
    eigenvalues, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, np.array([0, 0, 1], dtype=complex))
    waves = np.exp(np.outer(eigenvalues, t))
    return np.real((vectors * weights) @ waves)[:2].T * (t > 0)[:, None]


def _step(A: FloatArray, g: FloatArray, t: FloatArray) -> FloatArray:
    eigenvalues, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, g.astype(complex)) / eigenvalues
    return np.asarray(np.real((vectors * weights) @ np.expm1(np.outer(eigenvalues, t))).T)
