"""What drifts over a recording while the shaft turns: friction, a winding that warms up. Knows the motor, no FMU."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.evidence import Evidence
from estimator.fitting.polish import Polish
from estimator.fitting.problem import Problem
from estimator.fitting.treatment import Treatment, onset
from estimator.plans.plan import Plan
from estimator.recordings.samples import filled
from estimator.results.linear import MOTOR, is_motor

FloatArray = NDArray[np.float64]

DRIFTS = 5.0  # standard deviations of a drift that is taken out
STATES = ("i", "w", "angle")
EXPLAINED = 0.05  # of its power: a response that goes on to the end looks like a drift
LEAST = 500  # samples after the step: fewer tell no drift


def with_drift(problem: Problem, raw: FloatArray, polish: Polish, treatment: Treatment) -> Treatment:
    """Return the treatment that takes out what drifts over the recording, if anything does, too.

    Friction or a winding that warms up move current and speed slowly, in proportion to the speed: a straight line in
    time, with its zero in the middle of the part after the step, so that the parameters stand for the mean.

    Parameters
    ----------
    raw : (m,) array
        Residuals in the outputs' units, not treated.
    """
    plan = problem.plan
    if len(plan.observed) > 1 or plan.observed[0].excitation.kind != "step" or "w" not in plan.outputs:
        return treatment
    start, n = onset(problem, 0, polish.values), len(plan.observed[0].recording.time)
    if n - start < LEAST:
        return treatment
    weighted = treatment.apply(raw[None, :])[0] / polish.deviations[problem.output_of_residual]
    judged = Evidence(problem, polish, treatment, weighted, start=start, explained=EXPLAINED)
    line = _line(filled(plan.observed[0].outputs["w"]), start)
    drifts, columns = [], []
    for j, name in enumerate(problem.outputs):
        rows = np.zeros((n, len(problem.outputs)))
        rows[:, j] = line
        column = problem.spread_out([rows])
        z, size = judged(column)
        if z > DRIFTS:
            drifts.append((name, size))
        columns.append(column)
    if not drifts:
        return treatment
    known = {**dict(zip(plan.names, polish.values.tolist(), strict=True)), **plan.fixed}
    if is_motor(known) and set(plan.outputs) <= set(STATES):
        moved = _motor_drift(plan, known, start)
        columns = [problem.spread_out([own]) for own in moved]
        told = {name for name, _ in drifts}
        sizes = _sizes(problem, polish, treatment, weighted, columns)
        over = 2 * sizes @ np.array([own[-1] for own in moved])  # the line ends at one half
        drifts = [(name, size) for name, size in zip(problem.outputs, over.tolist(), strict=True) if name in told]
    return dataclasses.replace(treatment.also(columns), drifts=tuple(drifts), lost=treatment.lost + 1)


def _sizes(
    problem: Problem, polish: Polish, treatment: Treatment, weighted: FloatArray, columns: list[FloatArray]
) -> FloatArray:
    """Return how much of each column, (m,) in the outputs' units, the measurement holds beside the parameters."""
    scale = polish.deviations[problem.output_of_residual]
    inside = polish.jacobian[:, polish.at_bound == 0]
    rows = treatment.apply(np.vstack([inside.T, [column / scale for column in columns]]), weighted=True)
    return -np.asarray(np.linalg.lstsq(rows.T, weighted, rcond=None)[0])[-len(columns) :]


def _line(w: FloatArray, start: int) -> FloatArray:
    """Return a straight line in time, (n,), from −1/2 to 1/2 after the start, in proportion to the speed."""
    n = len(w)
    final = float(np.mean(w[-(n - start) // 2 :]))
    ramp = np.clip(np.where(np.arange(n) > start, w / final if final else 0.0, 0.0), 0.0, 1.0)
    return np.asarray(ramp * (np.arange(n) - (start + n) / 2) / (n - start))


def _motor_drift(plan: Plan, known: Mapping[str, float], start: int) -> list[FloatArray]:
    """Return what a friction and a resistance that drift by their own size would change, (n, q) each.

    To first order the motor responds to the torque and to the voltage that the drift takes: B w(t) s(t), R i(t) s(t),
    with s(t) a straight line through zero in the middle of the part after the step.
    """
    R, K, L, J, B = (known[n] for n in MOTOR)
    o = plan.observed[0]
    h, n = o.recording.step, len(o.recording.time)
    system = np.array([[-R / L, -K / L, 1 / L, 0.0], [K / J, -B / J, 0.0, -1 / J], [0, 0, 0, 0], [0, 0, 0, 0]])
    E = _exponential(system * h)
    jump = o.excitation.after - o.excitation.before
    line = (np.arange(n) - (start + n) / 2) / max(n - start, 1)
    shift = np.zeros((2, n, 2))
    i = w = 0.0
    d = [[0.0, 0.0], [0.0, 0.0]]
    (a, b, c, e), (f, g, p, q) = E[0].tolist(), E[1].tolist()
    for k in range(n):
        shift[0, k], shift[1, k] = d[0], d[1]
        voltage = jump if k >= start else 0.0
        torque, drop = B * w * line[k], R * i * line[k]
        d = [
            [a * d[0][0] + b * d[0][1] + e * torque, f * d[0][0] + g * d[0][1] + q * torque],
            [a * d[1][0] + b * d[1][1] - c * drop, f * d[1][0] + g * d[1][1] - p * drop],
        ]
        i, w = a * i + b * w + c * voltage, f * i + g * w + p * voltage
    index = [STATES.index(y) for y in plan.outputs]
    return [np.column_stack([rows, np.cumsum(rows[:, 1]) * h])[:, index] for rows in shift]


def _exponential(A: FloatArray) -> FloatArray:
    """Return e^A, by squaring."""
    halvings = max(0, int(np.ceil(np.log2(max(float(np.abs(A).sum(axis=1).max()), 1e-300)))) + 4)
    x = A / 2.0**halvings
    term = total = np.eye(len(A))
    for k in range(1, 14):
        term = term @ x / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)
