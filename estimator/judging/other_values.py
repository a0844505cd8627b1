"""Whether other recordings contradict an estimate's parameters: chi-square of the difference, with both covariances.

The other recordings are fitted separately, from the estimate's values, with a noise model of their own. With d the
difference, C the estimate's covariance and I the Fisher information of the other recordings (nuisance parameters of
their own projected out),

    d' (I^-1 + C)^-1 d       is chi-square with the rank of I as degrees of freedom

if the estimate holds. Directions that I does not determine are not tested.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.distributions import chi_square_beyond
from estimator.explaining.adequacy import adequacy
from estimator.explaining.explanation import Explanation
from estimator.explaining.explanation_noise import count_deviations, with_noise
from estimator.fitting.fit import Fit
from estimator.fitting.gauss_newton import solved
from estimator.results.result import Estimate, OtherValues

FloatArray = NDArray[np.float64]

LEAST_EIGENVALUE = 1e-9  # of the largest, of the scaled information: smaller ones are numerical errors of differences

LOST = 10.0  # times the noise: a fit that leaves as much has found no values, and nothing excuses the difference


def other_values(held: Fit, estimate: Estimate) -> OtherValues | None:
    """Test whether the recordings of a fit contradict the estimate's values; None if nothing can be compared.

    Parameters
    ----------
    held : Fit
        Solved, at the estimate's values; only nuisance parameters of its recordings are free.
    """
    s = held.simulator
    names, covariance = _covariance(held, estimate)
    if not names:
        return None
    start = solved(dataclasses.replace(held, free=(*names, *held.free)))
    fit = with_noise(Explanation(start), count_deviations(s.plan)).fit
    if not np.isfinite(fit.cost):
        return None
    where = [s.index[name] for name in names]
    apart = (s.scaled(fit.values) - s.scaled(held.values))[where]
    n = len(names)
    rest = np.linalg.qr(fit.jacobian[:, n:])[0]
    own = fit.jacobian[:, :n] - rest @ (rest.T @ fit.jacobian[:, :n])
    information = own.T @ own
    checked = adequacy(fit, n, is_searched=False)
    if not any(f.what == "size" and f.excess > LOST for f in checked.failures):
        covariance = covariance + checked.widened(fit)[:n, :n]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    told, directions = np.linalg.eigh(information / np.outer(scale, scale))
    seen = told > LEAST_EIGENVALUE * told[-1]
    if not seen.any():  # a recording in which nothing moves
        return None
    along = directions[:, seen].T * scale
    difference = along @ apart
    both = np.diag(1 / told[seen]) + along @ covariance @ along.T
    chi_square = float(difference @ np.linalg.solve(both, difference))
    degrees = int(np.sum(seen))
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.sqrt(np.diag(fit.covariance())[:n] + np.diag(covariance))
        ratios = np.where(np.isfinite(errors) & (errors > 0), np.abs(apart) / errors, 0.0)
    worst = int(np.argmax(ratios))
    return OtherValues(
        chi_square=chi_square,
        degrees=degrees,
        chance=chi_square_beyond(degrees, chi_square),
        values=dict(zip(names, fit.values[where].tolist(), strict=True)),
        worst=names[worst],
        apart=float(ratios[worst]),
        estimated=float(held.values[where[worst]]),
    )


def _covariance(held: Fit, estimate: Estimate) -> tuple[tuple[str, ...], FloatArray]:
    """Return the parameters that estimate and recordings share, and their covariance, (n, n), on the fit's scales."""
    s = held.simulator
    everything = {**estimate.parameters, **estimate.chain}
    names, deviations = [], []
    for name in estimate.correlated:
        error = everything[name].standard_error if name in everything else None
        if error is None or name not in s.index or name in held.free:
            continue
        value = held.values[s.index[name]]
        names.append(name)
        deviations.append(error / abs(value) if s.log[s.index[name]] and value != 0 else error)
    if estimate.correlation is None:
        return (), np.zeros((0, 0))
    which = [estimate.correlated.index(name) for name in names]
    deviation = np.array(deviations)
    return tuple(names), np.outer(deviation, deviation) * estimate.correlation[np.ix_(which, which)]
