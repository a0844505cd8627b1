"""Is the communication step fine enough? The same estimate at a ten times finer one. Runs that simulation only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.explained import Explained
from estimator.fitting.fit import chosen
from estimator.fitting.information import information_parts
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.problem import Problem
from estimator.fitting.projection import triangle
from estimator.fmus.probe import ignores_step
from estimator.noise.in_parts import products
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

REFINEMENT = 10
STEP_ERROR = 1.0  # shift by a finer step, in standard errors
NEGLIGIBLE_SHIFT = 1e-6  # relative: a smaller shift is negligible


@dataclass(frozen=True)
class StepCheck:
    """Result of a finer step: reasons for doubt, and notes."""

    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def step_check(
    problem: Problem, values: FloatArray, polish: LeastSquaresFit | None, explained: Explained | None
) -> StepCheck:
    """Simulate an estimate, (p,), at a finer communication step, and say what that changes.

    Parameters
    ----------
    polish : LeastSquaresFit or None
        None for methods that end with the search: nothing is compared then.
    """
    if explained is None:
        batch = problem.trajectories(values[None, :], refine=REFINEMENT)
        fine = None if batch.shown is None else batch.shown[0]
    else:
        fine = explained.fit.simulator.shown(explained.fit.values[None, :], refine=REFINEMENT)[0]
    if polish is None or fine is None:
        return StepCheck()
    plan = problem.plan
    h = plan.observed[0].recording.step if plan.case.step is None else plan.case.step
    if not np.isfinite(fine).all():
        return StepCheck(
            notes=(f"the step could not be checked: the FMU fails at {h / REFINEMENT:g} s, a tenth of the step",)
        )
    worst = _worst(plan, polish, shift(problem, polish, fine, explained))
    if worst is None:
        return StepCheck()
    if ignores_step(plan.description):
        return StepCheck(
            reasons=(
                f"the FMU ignores the communication step that it is given, so its time is that of the recording only if"
                f" its own step is {h:g} s; set step under [fmu] to the FMU's own",
            )
        )
    errors, name, moved = worst
    size = f"{errors:.1f} standard errors" if errors < 1000 else "far more than its standard error"
    return StepCheck(
        reasons=(
            f"the FMU's own step error matters: a ten times finer communication step would move {name} by {moved},"
            f" {size}; set a finer step in the case file, under [fmu]",
        )
    )


def shift(problem: Problem, polish: LeastSquaresFit, fine: FloatArray, explained: Explained | None) -> FloatArray:
    """Return how far the fine trajectories, (rows, q), would move the scaled parameters, (p,), to first order."""
    if explained is None:
        weights = 1 / polish.deviations[problem.output_of_residual]
        change = problem.compared(fine[None])[0] * weights - polish.residuals
    else:
        fit = explained.fit
        change = fit.whitener((fine - fit.shown)[:, :, None])[0].ravel()
    inside = polish.at_bound == 0
    moved = np.zeros(len(polish.values))
    if inside.any():
        jacobian = chosen(polish.jacobian, inside)
        r = triangle(jacobian)  # r' r x = J' change, either of which may be singular
        along = np.linalg.lstsq(r.T, products(jacobian, change), rcond=None)[0]
        moved[inside] = -np.linalg.lstsq(r, along, rcond=None)[0]
    return moved


def _worst(plan: Plan, polish: LeastSquaresFit, moved: FloatArray) -> tuple[float, str, str] | None:
    """Return the largest shift: in standard errors, whose, and how far; None if none matters."""
    inside = polish.at_bound == 0
    deviation = np.sqrt(np.diag(polish.covariance))
    if inside.any():  # by the noise alone: a step that is too coarse may be why the errors are larger
        alone = np.sqrt(np.diag(information_parts(triangle(chosen(polish.jacobian, inside)))[0]))
        deviation[inside] = np.minimum(deviation[inside], np.where(alone > 0, alone, np.inf))
    found = []
    for j, p in enumerate(plan.parameters):  # what is estimated beside them follows
        relative = moved[j] if p.log else moved[j] / (p.upper - p.lower)
        told = np.isfinite(polish.standard_errors[j])
        if p.place is None and told and 0 < deviation[j] < np.inf and abs(relative) > NEGLIGIBLE_SHIFT:
            size = f"{100 * abs(relative):.2g} %" + ("" if p.log else " of its range")
            found.append((abs(moved[j]) / deviation[j], p.name, size))
    worst = max(found, default=None)
    return worst if worst is not None and worst[0] > STEP_ERROR else None
