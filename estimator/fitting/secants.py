"""A descent that goes on past the kinks of an FMU that switches, by secants. Knows one fit, no effect and no noise."""

from __future__ import annotations

import dataclasses

import numpy as np

from estimator.fitting.fit import Fit
from estimator.fitting.gauss_newton import longest_steps, placed, solved
from estimator.fitting.slopes import Point, Slopes

SECANTS, KINKED = 6, 0.7  # times that errors grow by secants; of a derivative: a smaller secant is taken
WENT_ON = 0.01  # of z'z: a continued descent that ends this much lower is an improvement


def with_secants(fit: Fit) -> Fit:
    """Return the fit with secants over one standard error in place of derivatives that are much larger.

    Where an FMU switches, its signals have kinks. A derivative there may be large on one side only, and the descent
    stops. With the secant of the flatter side it goes on, as long as the cost falls.
    """
    s, where, (low, high) = fit.simulator, fit.where, fit.bounds
    f = len(where)
    for _ in range(SECANTS):
        x = s.scaled(fit.values)[where]
        deviation = np.sqrt(np.maximum(np.diag(fit.covariance())[:f], 0.0))
        reach = np.where(np.isfinite(deviation) & (deviation > 0), deviation, 0.0)
        reach = np.minimum(reach, np.where(s.log[where], 0.5, longest_steps(fit)))
        here = Point(s, where, fit.values, x, low, high, fit.shown, s.between)
        points = np.concatenate([np.minimum(x + reach, high), np.maximum(x - reach, low)])
        shown = s.shown(np.concatenate([here.beside(end) for end in (points[:f], points[f:])]))
        width = points - np.tile(x, 2)
        usable = (width != 0) & np.isfinite(shown).all(axis=(1, 2))
        change = np.where(usable[:, None, None], np.nan_to_num(shown) - fit.shown, 0.0).transpose(1, 2, 0)
        secants = change / np.where(width != 0, width, 1.0)
        norms = np.where(usable, np.linalg.norm(fit.whitener.flat(secants), axis=0), np.inf).reshape(2, f)
        side = np.argmin(norms, axis=0)
        kinked = np.flatnonzero(norms.min(axis=0) < KINKED * np.linalg.norm(fit.jacobian[:, :f], axis=0))
        if not len(kinked):
            break
        raw = fit.slopes.raw.copy()
        raw[:, :, kinked] = secants[:, :, side[kinked] * f + kinked]
        fit = dataclasses.replace(fit, slopes=Slopes(None, known=raw))
        for k in kinked.tolist():
            moved = x.copy()
            moved[k] = points[side[k] * f + k]
            tried = solved(dataclasses.replace(fit, values=placed(fit, moved)), tolerance=1e-6)
            if tried.cost < fit.cost - WENT_ON:
                fit = tried
                break
    return fit
