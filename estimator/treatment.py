"""What is taken out of a fit's residuals: outliers, ripple locked to the angle, drift. Knows the motor."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator import layout
from estimator.excitation import quantum
from estimator.noise import Ripple, find_colour, find_outliers, find_ripple, quadratic
from estimator.plan import ChainSpec, Plan
from estimator.polish import Polish
from estimator.problem import Problem

FloatArray = NDArray[np.float64]

DRIFTS = 5.0  # standard deviations of a drift that is taken out
DRIFT_FROM = 0.1  # of the part after the step: the colour of what follows judges a drift
SMOOTH = 5  # degree of the polynomial by which the model's angle is corrected


@dataclass(frozen=True)
class Treatment:
    """What is taken out of the residuals: outliers left out, ripple projected away.

    Attributes
    ----------
    keep : (m,) array
        0 for an outlier, else 1.
    drifts : (output, how far it drifts over the recording in its unit), beyond the model
    basis : (m, r) array
        Orthonormal columns that weighted residuals are made orthogonal to.
    scale : (m,) array
        Deviations that weigh them.
    lost : (q,) array
        Degrees of freedom that each output loses.
    """

    keep: FloatArray
    basis: FloatArray
    lost: FloatArray
    scale: FloatArray
    ripples: tuple[tuple[str, Ripple], ...] = ()
    drifts: tuple[tuple[str, float], ...] = ()
    outliers: tuple[tuple[str, int], ...] = ()

    @classmethod
    def none(cls, size: int, outputs: int) -> Treatment:
        """Return the treatment that changes nothing."""
        return cls(np.ones(size), np.zeros((size, 0)), np.zeros(outputs), np.ones(size))

    def apply(self, residuals: FloatArray, *, weighted: bool = False) -> FloatArray:
        """Treat (c, m) residuals, in the outputs' units or weighted."""
        if self.keep.all() and not self.basis.shape[1]:
            return residuals
        treated = residuals * self.keep
        if weighted:
            return np.asarray(treated - (treated @ self.basis) @ self.basis.T)
        return np.asarray(treated - (((treated / self.scale) @ self.basis) @ self.basis.T) * self.scale)


def find_treatment(problem: Problem, raw: FloatArray, polish: Polish) -> Treatment:
    """Return what to take out of (m,) residuals, in the outputs' units."""
    plan, m, q, values = problem.plan, len(raw), len(problem.outputs), polish.values
    scale = polish.deviations[problem.output_of_residual]
    keep, lost = np.ones(m), np.zeros(q)
    columns: list[FloatArray] = []
    ripples: list[tuple[str, Ripple]] = []
    outliers: list[tuple[str, int]] = []
    for j, name in enumerate(problem.outputs):
        for e, (series, index) in enumerate(problem.series(raw, j)):
            far = find_outliers(series)
            if far.any():
                keep[index[far]] = 0.0
                outliers.append((name, int(far.sum())))
            series = np.where(far, np.nan, series)
            start = onset(problem, e, values)
            angle = turned(problem, e, raw)
            if angle is None or name == "angle" or find_colour([series]).is_white:
                continue
            found, waves = find_ripple(
                series,
                angle,
                onset=start,
                average=plan.chains.get(name, ChainSpec()).average,
                envelope=_speed_share(plan, e) if name == "w" else None,
                least=0.5 * quantum(plan.observed[e].outputs[name]),
            )
            for r in range(waves.shape[1]):
                column = np.zeros(m)
                known = index >= 0
                column[index[known]] = waves[known, r]
                columns.append(column * keep)
            ripples += [(name, ripple) for ripple in found]
            lost[j] += waves.shape[1]
        lost[j] += float(np.sum(keep[problem.output_of_residual == j] == 0))
    basis = np.linalg.qr(np.column_stack(columns) / scale[:, None])[0] if columns else np.zeros((m, 0))
    treatment = Treatment(keep, basis, lost, scale, ripples=tuple(ripples), outliers=tuple(outliers))
    drifts, slow = find_drift(problem, treatment.apply(raw[None, :])[0], values)
    if drifts:
        columns += [column * keep for column in slow.T]
        basis = np.linalg.qr(np.column_stack(columns) / scale[:, None])[0]
        treatment = dataclasses.replace(treatment, basis=basis, drifts=drifts, lost=lost + 1)
    return treatment


def find_drift(
    problem: Problem, residuals: FloatArray, values: FloatArray
) -> tuple[tuple[tuple[str, float], ...], FloatArray]:
    """Return what drifts over the recording while the shaft turns, and columns, (m, c), that take it out.

    Friction or a winding that warms up move current and speed slowly, in proportion to the speed: a straight line in
    time, with its zero in the middle of the part after the step, so that the parameters stand for the mean.
    """
    plan, m = problem.plan, len(residuals)
    drifts: list[tuple[str, float]] = []
    columns = []
    for j, name in enumerate(problem.outputs):
        if name == "angle" or len(plan.observed) > 1 or plan.observed[0].excitation.kind != "step":
            return (), np.zeros((m, 0))
        (series, index), known = problem.series(residuals, j)[0], ~np.isnan(problem.series(residuals, j)[0][0])
        w = plan.observed[0].outputs.get("w")
        start = onset(problem, 0, values)
        n = len(series)
        if w is None or n - start < 500:
            return (), np.zeros((m, 0))
        speed = _filled(w)
        final = float(np.mean(speed[-(n - start) // 2 :]))
        ramp = np.clip(np.where(np.arange(n) > start, speed / final if final else 0.0, 0.0), 0.0, 1.0)
        line = ramp * (np.arange(n) - (start + n) / 2) / (n - start)
        used = line * known
        size = float(used @ np.nan_to_num(series)) / float(used @ used)
        late = np.where(np.arange(n) > start + DRIFT_FROM * (n - start), series, np.nan)
        colour = find_colour([late - np.nanmean(late) - size * (line - np.mean(line))])
        error = float(np.sqrt(quadratic([used[:, None]], colour)[0, 0])) / float(used @ used)
        if abs(size) > DRIFTS * error:
            drifts.append((name, size))
        column = np.zeros(m)
        column[index[known]] = used[known]
        columns.append(column)
    if drifts and {"R", "K", "L", "J", "B"} <= {*plan.names, *plan.fixed}:
        columns = _motor_drift(problem, values)
    return tuple(drifts), np.column_stack(columns)


def _motor_drift(problem: Problem, values: FloatArray) -> list[FloatArray]:
    """Return what a friction and a resistance that drift by their own size over the recording would change, (m,) each.

    To first order the motor responds to the torque and to the voltage that the drift takes: B w(t) s(t), R i(t) s(t),
    with s(t) a straight line through zero in the middle of the part after the step.
    """
    plan = problem.plan
    known = {**dict(zip(plan.names, values.tolist(), strict=True)), **plan.fixed}
    R, K, L, J, B = (known[n] for n in ("R", "K", "L", "J", "B"))
    o, start = plan.observed[0], onset(problem, 0, values)
    h, n = o.recording.step, len(o.recording.time)
    system = np.array([[-R / L, -K / L, 1 / L, 0.0], [K / J, -B / J, 0.0, -1 / J], [0, 0, 0, 0], [0, 0, 0, 0]])
    E = _exponential(system * h)
    jump = o.excitation.after - o.excitation.before
    line = (np.arange(n) - (start + n) / 2) / max(n - start, 1)
    base = np.zeros((n, 2))
    shift = np.zeros((2, n, 2))
    i = w = 0.0
    d = [[0.0, 0.0], [0.0, 0.0]]
    (a, b, c, e), (f, g, p, q) = E[0].tolist(), E[1].tolist()
    for k in range(n):
        base[k] = i, w
        shift[0, k], shift[1, k] = d[0], d[1]
        voltage = jump if k >= start else 0.0
        torque, drop = B * w * line[k], R * i * line[k]
        d = [
            [a * d[0][0] + b * d[0][1] + e * torque, f * d[0][0] + g * d[0][1] + q * torque],
            [a * d[1][0] + b * d[1][1] - c * drop, f * d[1][0] + g * d[1][1] - p * drop],
        ]
        i, w = a * i + b * w + c * voltage, f * i + g * w + p * voltage
    index = [("i", "w").index(y) for y in plan.outputs]
    return [problem.spread_out([rows[:, index]]) for rows in shift]


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


def _speed_share(plan: Plan, recording: int) -> FloatArray:
    """Return the measured speed, (n,), over its largest."""
    w = _filled(plan.observed[recording].outputs["w"])
    smooth = np.convolve(np.pad(w, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    return np.asarray(smooth / max(float(np.max(np.abs(smooth))), 1e-300))


def onset(problem: Problem, recording: int, values: FloatArray) -> int:
    """Return the sample at which the input acts first, delay included."""
    o = problem.plan.observed[recording]
    delay = o.delay
    for p, value in zip(problem.parameters, values, strict=True):
        if p.place is not None and (p.place.kind, p.place.output, p.place.recording) == ("delay", "", recording):
            delay = float(value)
    return o.excitation.index + int(np.floor(delay / o.recording.step))


def turned(problem: Problem, recording: int, raw: FloatArray) -> FloatArray | None:
    """Return the shaft's angle, (n,) rad, as measured or from the measured speed; None without either.

    Encoder counts add up without error. The noise of another speed does not: there the model's speed is integrated
    and corrected by what is smooth of its difference to the measured one.
    """
    plan = problem.plan
    o = plan.observed[recording]
    if "angle" in o.outputs:
        return _filled(o.outputs["angle"])
    if "w" not in o.outputs:
        return None
    w = _filled(o.outputs["w"])
    if plan.sensors.get("w") == layout.MEAN:
        return np.asarray(np.cumsum(w) * o.recording.step)
    error = np.nan_to_num(problem.series(raw, problem.outputs.index("w"))[recording][0])
    time = np.linspace(-1.0, 1.0, len(w))
    model, wrong = (
        np.concatenate([[0.0], np.cumsum((x[1:] + x[:-1]) / 2)]) * o.recording.step for x in (w + error, -error)
    )
    chance = float(np.std(error)) * o.recording.step * np.sqrt(len(w))  # how far noise alone would walk
    if float(np.max(np.abs(wrong))) < 4 * chance:
        return np.asarray(model)
    smooth = np.polynomial.legendre.legfit(time, wrong, SMOOTH)
    return np.asarray(model + np.polynomial.legendre.legval(time, smooth))


def _filled(y: FloatArray) -> FloatArray:
    known = np.flatnonzero(~np.isnan(y))
    return np.interp(np.arange(len(y)), known, y[known])
