"""A fit with its measurement chain: its likelihood, the colour of its residuals, errors for it. No search."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.noise import Colour, find_colour, quadratic
from estimator.fitting.polish import LeastSquares, Polish, information_parts
from estimator.fitting.problem import Problem
from estimator.fitting.treatment import Treatment
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

REWEIGHED, SAME_WEIGHTS = 3, 0.02  # times at most; relative change of the outputs' weights that does not matter


@dataclass(frozen=True)
class Fit:
    """A fit with its measurement chain.

    Attributes
    ----------
    colours : of each output's residuals
    freed : sentences about the nuisances that were freed
    names : of freed nuisances
    nearly : sentences about those that were not, by little
    """

    problem: Problem
    polish: Polish
    treatment: Treatment
    colours: tuple[Colour, ...] = ()
    freed: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    nearly: tuple[str, ...] = ()


def with_coloured_errors(fit: Fit) -> Fit:
    """Return the fit with the sandwich covariance of its residuals' colour."""
    found = fit.colours or colours(fit)
    polish = fit.polish
    inside = polish.at_bound == 0
    if all(c.is_white for c in found) or not inside.any():
        return dataclasses.replace(fit, colours=found)
    middle = np.zeros((len(polish.values), len(polish.values)))
    for j, colour in enumerate(found):
        middle += quadratic(fit.problem.spread_columns(polish.jacobian, j), colour)
    # Directions that are not seen stay out of the product: their size would drown the others.
    seen, unseen = information_parts(polish.jacobian[:, inside])
    covariance = np.zeros_like(polish.covariance)
    covariance[np.ix_(inside, inside)] = seen @ middle[np.ix_(inside, inside)] @ seen + unseen
    scale = np.where(fit.problem.box.log, polish.values, 1.0)
    errors = np.sqrt(np.diag(covariance)) * np.abs(scale)
    polish = dataclasses.replace(polish, covariance=covariance, standard_errors=errors, scores=middle)
    return dataclasses.replace(fit, polish=polish, colours=found)


def at_given_bound(plan: Plan, polish: Polish) -> tuple[str, ...]:
    """Return the parameters that lie at a bound which the case gives them."""
    held = []
    for parameter, side in zip(plan.parameters, polish.at_bound.tolist(), strict=True):
        spec = plan.case.parameters.get(parameter.quantity or parameter.name)
        if spec is not None and (spec.minimum if side < 0 else spec.maximum if side > 0 else None) is not None:
            held.append(parameter.name)
    return tuple(held)


def squares(problem: Problem, treatment: Treatment) -> LeastSquares:
    """Return the least-squares problem of what is left after a treatment."""
    return LeastSquares(
        lambda candidates: treatment.apply(problem.residuals(candidates)),
        problem.box,
        output=problem.output_of_residual,
        spread=problem.spread,
        lost=treatment.lost,
        loss=problem.plan.case.search.loss,
    )


def weighed(fit: Fit) -> Fit:
    """Return the fit whose treatment weighs the outputs as the fit does.

    What moves several outputs at once, a drift or a wrong assumption, is taken out along all of them: by other weights
    the projection would be oblique, the parameters worse and their standard errors wrong.
    """
    for _ in range(REWEIGHED):
        scale = fit.polish.deviations[fit.problem.output_of_residual]
        ratio = scale / fit.treatment.scale
        if not fit.treatment.basis.shape[1] or np.ptp(ratio) < SAME_WEIGHTS * np.max(ratio):
            break
        treatment = fit.treatment.rescaled(scale)
        polish = squares(fit.problem, treatment).polish(fit.polish.values, fit.polish.deviations)
        fit = dataclasses.replace(fit, polish=polish, treatment=treatment)
    return fit


def colours(fit: Fit) -> tuple[Colour, ...]:
    """Return the colour of each output's residuals."""
    residuals = np.where(fit.treatment.keep > 0, fit.polish.residuals, np.nan)
    return tuple(
        find_colour([series for series, _ in fit.problem.series(residuals, j)]) for j in range(len(fit.problem.outputs))
    )


def misfit(fit: Fit) -> float:
    """Return −2 log likelihood, up to a constant, of independent normal noise of unknown deviations."""
    return log_likelihood(fit.problem, fit.polish.deviations)


def log_likelihood(problem: Problem, deviations: FloatArray) -> float:
    """Return −2 log likelihood, up to a constant, at the outputs' deviations."""
    counts = np.bincount(problem.output_of_residual, minlength=len(problem.outputs))
    return float(np.sum(2 * counts * np.log(deviations)))


def chi_square(old: Fit, new: Fit) -> float:
    """Return by how much −2 log likelihood falls from one fit to the other."""
    return misfit(old) - misfit(new)


def inflation(fit: Fit) -> float:
    """Return how much larger low frequencies are in the residuals than white ones would be, at most."""
    return max((float(np.max(c.spectrum(64)[:8])) / max(c.variance, 1e-300) for c in fit.colours), default=1.0)
