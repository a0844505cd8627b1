"""Would other recordings want other parameters than an estimate's, beyond chance? Chi-square with both covariances.

The other recordings are fitted for themselves, from the estimate's values on, with a noise model of their own. With d
the difference, C the estimate's covariance and I what the other recordings tell (their Fisher information, free of what
belongs to them alone),

    d' (I^-1 + C)^-1 d       is chi-square with as many degrees of freedom as I tells directions

where the estimate holds. What no direction of I tells is not asked.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.adequacy import adequacy
from estimator.fitting.explained import count_deviation
from estimator.fitting.fit import Fit, solved
from estimator.fitting.selection import Explanation, Selection
from estimator.results.result import Estimate, OtherValues
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

LEAST_EIGENVALUE = 1e-9  # of the largest eigenvalue of the scaled information: less is told by nothing but differences


def other_values(held: Fit, estimate: Estimate) -> OtherValues | None:
    """Return whether the recordings of a fit want other values than the estimate's; None where nothing can be compared.

    Parameters
    ----------
    held : Fit
        Solved, with the estimate's values; free is only what belongs to its recordings.
    """
    from scipy.special import chdtrc

    s = held.simulator
    names, covariance = _covariance(held, estimate)
    if not names:
        return None
    plan = s.plan
    means = [count_deviation(plan, y) if plan.sensors[y] == layout.MEAN else 0.0 for y in plan.outputs]
    selection = Selection(s, lambda fmu: None, (), held.whitener.noise.white, np.array(means), ())
    start = solved(dataclasses.replace(held, free=(*names, *held.free)))
    fit = selection.with_noise(Explanation(start)).fit
    if not np.isfinite(fit.cost):
        return None
    where = [s.index[name] for name in names]
    apart = (s.scaled(fit.values) - s.scaled(held.values))[where]
    n = len(names)
    rest = np.linalg.qr(fit.jacobian[:, n:])[0]
    own = fit.jacobian[:, :n] - rest @ (rest.T @ fit.jacobian[:, :n])
    information = own.T @ own
    covariance = covariance + adequacy(fit, n).widened(fit)[:n, :n]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    told, directions = np.linalg.eigh(information / np.outer(scale, scale))
    seen = told > LEAST_EIGENVALUE * told[-1]
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
        chance=float(chdtrc(degrees, chi_square)),
        values=dict(zip(names, fit.values[where].tolist(), strict=True)),
        worst=names[worst],
        apart=float(ratios[worst]),
        estimated=float(held.values[where[worst]]),
    )


def _covariance(held: Fit, estimate: Estimate) -> tuple[tuple[str, ...], FloatArray]:
    """Return what the estimate and the recordings share, and its covariance, (n, n), on the fit's scales."""
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
