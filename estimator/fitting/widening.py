"""What a nuisance that was nearly freed might move: by that much the errors are widened. Knows fits, no FMU."""

from __future__ import annotations

import dataclasses

import numpy as np

from estimator.fitting.directions import directions
from estimator.fitting.fit import Fit, inflation
from estimator.fitting.freeing import FREED, unit_of

NEARLY = 2.0  # standard deviations from which one that stays fixed widens the errors
TOLD = 1e-3  # of a nuisance's power, beside the parameters: below they cannot be told apart


def widened(fit: Fit) -> Fit:
    """Widen the errors by what a nuisance would move that was nearly freed.

    Between NEARLY and FREED standard deviations it stays fixed, so that clean data keep their small errors; but
    it may be there, and then the parameters are off by this much.
    """
    inside = fit.polish.at_bound == 0
    jacobian = fit.polish.jacobian[:, inside]
    covariance, scores = fit.polish.covariance.copy(), fit.polish.scores.copy()
    if not inside.any() or not np.isfinite(covariance).all():
        return fit
    basis, triangle = np.linalg.qr(jacobian)
    found, plan = [], fit.problem.plan
    for direction in directions(fit):
        column = fit.treatment.apply(direction.column[None, :], weighted=True)[0]
        across = column - basis @ (basis.T @ column)
        power, product = float(across @ across), float(across @ fit.polish.residuals)
        if direction.unit is not None or direction.is_channel or power <= TOLD * float(column @ column):
            continue
        z = abs(product) / np.sqrt(power * max(1.0, inflation(fit)))
        if not NEARLY < z < FREED:
            continue
        size = -product / power
        shift = np.zeros(len(covariance))
        shift[inside] = np.linalg.lstsq(triangle, basis.T @ column * size, rcond=None)[0]
        covariance += np.outer(shift, shift)
        scores[np.ix_(inside, inside)] += np.outer(jacobian.T @ column * size, jacobian.T @ column * size)
        found.append(
            f"{direction.name} of {size:.2g} {unit_of(direction.name, plan)}".rstrip()
            + f" would improve the fit by {z:.1f} standard deviations, too few to free it; the standard"
            " errors allow for it"
        )
    if not found:
        return fit
    scale = np.where(fit.problem.box.log, fit.polish.values, 1.0)
    errors = np.sqrt(np.diag(covariance)) * np.abs(scale)
    polish = dataclasses.replace(fit.polish, covariance=covariance, standard_errors=errors, scores=scores)
    return dataclasses.replace(fit, polish=polish, nearly=(*fit.nearly, *found))
