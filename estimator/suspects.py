"""Wrong assumptions that a fit betrays: a sagging supply, dry friction, lost samples. Knows the motor, no FMU.

Each suspect is a direction in which the residuals of a motor's step response would lie: what the outputs would do, to
first order, if it were true. The residuals are projected on it, free of what the estimated parameters (and freed
nuisances) explain; beyond ACCUSED standard deviations of the noise of the settled part it is named.

A gain of the current's sensor, or a supply whose voltage falls in proportion to the current, is no suspect: other
parameters explain it exactly (R and L × 1/g, J and B × g), so no recording of this kind can tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.noise import find_colour, quadratic

if TYPE_CHECKING:
    from estimator.fit import Fit

FloatArray = NDArray[np.float64]

ACCUSED = 5.0  # standard deviations: once in 2 million of one direction of white noise
SAGS = (0.003, 0.01, 0.03, 0.1)  # s in which a supply may recover
LOST_FROM = 60  # places in the transient at which lost samples are looked for, at most
SETTLED_FROM = 0.2  # of the part after the step: what follows tells the noise


@dataclass(frozen=True)
class Suspicion:
    """A suspect with its evidence: standard deviations, and its size in `unit`."""

    name: str
    deviations: float
    size: float
    sentence: str


def suspicions(fit: Fit, *, onset: int) -> list[Suspicion]:
    """Return what the residuals of a single step's fit betray, the strongest first.

    Parameters
    ----------
    onset : int
        Sample at which the input acts first.
    """
    problem, polish, plan = fit.problem, fit.polish, fit.problem.plan
    values = {**dict(zip(plan.names, polish.values.tolist(), strict=True)), **plan.fixed}
    if len(plan.observed) != 1 or plan.observed[0].excitation.kind != "step" or plan.observed[0].lead:
        return []
    if not {"R", "K", "L", "J", "B"} <= set(values) or not set(plan.outputs) <= {"i", "w"}:
        return []
    o = plan.observed[0]
    after = np.maximum(np.arange(len(o.recording.time)) - onset, 0) * o.recording.step
    jump = o.excitation.after - o.excitation.before
    inside = polish.jacobian[:, polish.at_bound == 0]
    basis = np.linalg.qr(inside)[0]
    weights = 1 / polish.deviations[problem.output_of_residual]
    late = onset + int(SETTLED_FROM * (len(after) - onset))
    colours = []
    for j in range(len(plan.outputs)):
        series = problem.series(np.where(fit.treatment.keep > 0, polish.residuals, np.nan), j)[0][0]
        colours.append(find_colour([series[late:] - np.nanmean(series[late:])]))

    def judged(rows: FloatArray) -> tuple[float, float]:
        """Return deviations and size of a direction, (n, 2) current and speed."""
        chosen = rows[:, [("i", "w").index(y) for y in plan.outputs]]
        column = fit.treatment.apply((problem.spread_out([chosen]) * weights)[None, :], weighted=True)[0]
        across = column - basis @ (basis.T @ column)
        power = float(across @ across)
        if power <= 1e-9 * float(column @ column):
            return 0.0, 0.0
        variance = sum(
            float(quadratic(problem.spread_columns(across[:, None], j), colour)[0, 0])
            for j, colour in enumerate(colours)
        )
        product = float(across @ polish.residuals)
        return abs(product) / max(np.sqrt(variance), 1e-300), -product / power

    found = []
    sags = [(*judged(jump * _to_decaying_voltage(values, after, tau)), tau) for tau in SAGS]
    z, size, tau = max(sags)
    found.append(
        Suspicion(
            "supply sag",
            z,
            size,
            f"the supply's voltage seems to sag at the step ({100 * size:+.2g} % at first, recovering in some"
            f" {tau:g} s; {z:.1f} standard deviations); record the motor's voltage, not the command",
        )
    )
    z, size = judged(_to_torque(values, after))
    found.append(
        Suspicion(
            "dry friction",
            z,
            size,
            f"the residuals look like a dry (Coulomb) friction of some {abs(size):.2g} N·m besides B"
            f" ({z:.1f} standard deviations); record two voltage levels and estimate it (dc_motor_friction)",
        )
    )
    slope = np.gradient(_response(values, after) * jump, axis=0) * (after > 0)[:, None]
    speed = np.abs(slope[:, 1]) / max(float(np.max(np.abs(slope[:, 1]))), 1e-300)
    places = np.flatnonzero(speed > 0.02)
    places = places[:: max(1, len(places) // LOST_FROM)]
    losses = [(*judged(slope * (np.arange(len(after)) >= k)[:, None]), int(k)) for k in places[1:]]
    if losses:
        z, size, k = max(losses)
        found.append(
            Suspicion(
                "lost samples",
                z,
                size,
                f"some {abs(size):.1f} samples seem to {'be missing' if size > 0 else 'have been repeated'} at about"
                f" t = {o.recording.time[k]:.4g} s ({z:.1f} standard deviations); check the logger's clock",
            )
        )
    return sorted((s for s in found if s.deviations > ACCUSED), key=lambda s: -s.deviations)


def _modes(values: dict[str, float]) -> FloatArray:
    R, K, L, J, B = (values[n] for n in ("R", "K", "L", "J", "B"))
    return np.array([[-R / L, -K / L], [K / J, -B / J]])


def _response(values: dict[str, float], t: FloatArray) -> FloatArray:
    """Return current and speed, (n, 2), after a unit step of the voltage."""
    return _step(_modes(values), np.array([1 / values["L"], 0.0]), t)


def _to_torque(values: dict[str, float], t: FloatArray) -> FloatArray:
    """Return the response, (n, 2), to a unit of torque against the motion from its start."""
    return _step(_modes(values), np.array([0.0, -1 / values["J"]]), t)


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
