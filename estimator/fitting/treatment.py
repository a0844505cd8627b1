"""What is taken out of a fit's residuals: outliers, ripple locked to the angle, drift. Knows the motor."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.noise import Ripple, find_colour, find_outliers, find_ripple
from estimator.fitting.polish import Polish
from estimator.fitting.problem import Problem
from estimator.plans.plan import ChainSpec, Plan
from estimator.recordings.excitation import quantum
from estimator.recordings.samples import filled
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

SMOOTH = 5  # degree of the polynomial by which the model's angle is corrected


@dataclass(frozen=True)
class Accused:
    """A wrong assumption that was believed: its standard deviations, and what the outputs would do, (n, q).

    No rows where it is set right in the plan. The place is that of what happens at one time, in rows.
    """

    name: str
    deviations: float
    sentence: str
    rows: FloatArray
    size: float = 0.0
    which: int = 0  # of all that were tried
    place: int = 0


@dataclass(frozen=True)
class Treatment:
    """What is taken out of the residuals: outliers left out, ripple and wrong assumptions projected away.

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
    accused: tuple[Accused, ...] = ()

    def also(self, columns: list[FloatArray]) -> Treatment:
        """Return the treatment that takes out further columns, (m,) in the outputs' units, too."""
        more = [column * self.keep / self.scale for column in columns]
        basis = np.linalg.qr(np.column_stack([self.basis, *more]))[0]
        return dataclasses.replace(self, basis=basis)

    def rescaled(self, scale: FloatArray) -> Treatment:
        """Return the treatment that takes out the same columns from residuals weighed by other deviations, (m,)."""
        basis = np.linalg.qr(self.basis * (self.scale / scale)[:, None])[0]
        return dataclasses.replace(self, basis=basis, scale=scale)

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


def find_treatment(
    problem: Problem, raw: FloatArray, polish: Polish, *, accused: tuple[Accused, ...] = ()
) -> Treatment:
    """Return what to take out of (m,) residuals, in the outputs' units, besides what is accused already."""
    plan, m, q, values = problem.plan, len(raw), len(problem.outputs), polish.values
    scale = polish.deviations[problem.output_of_residual]
    keep, lost = np.ones(m), np.zeros(q)
    columns: list[FloatArray] = [problem.spread_out([a.rows]) for a in accused if len(a.rows)]
    ripples: list[tuple[str, Ripple]] = []
    outliers: list[tuple[str, int]] = []
    if columns:  # what it explains is no outlier
        raw = Treatment(keep, np.zeros((m, 0)), lost, scale).also(columns).apply(raw[None, :])[0]
    for j, name in enumerate(problem.outputs):
        for e, (series, index) in enumerate(problem.series(raw, j)):
            o = plan.observed[e]
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
                envelope=_speed_share(plan, e) if name == "w" and not plan.counted else None,
                least=0.5 * quantum(o.outputs[name]) * (o.recording.step if plan.counted and name == "w" else 1.0),
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
    return Treatment(keep, basis, lost, scale, ripples=tuple(ripples), outliers=tuple(outliers), accused=accused)


def _speed_share(plan: Plan, recording: int) -> FloatArray:
    """Return the measured speed, (n,), over its largest."""
    w = filled(plan.observed[recording].outputs["w"])
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
        return filled(o.outputs["angle"])
    if "w" not in o.outputs:
        return None
    w = filled(o.outputs["w"])
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
