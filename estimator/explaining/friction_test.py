"""Whether friction depends on the speed as it is explained: a score test of any other law. Adds no effect.

To noise with a torque that wanders a fan or a dry friction that nobody named is nearly a part of it, and B takes in the
rest. So torques that grow as the square of the speed, and ones that do not grow, are asked for at the end, whatever
effects are known: z'z falls by a chi-square number with a degree of freedom each, if neither is there (Rao 1948).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.distributions import chi_square_limit
from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import motor_values, response
from estimator.plans.part import LONG

FloatArray = NDArray[np.float64]

DEPENDENT = 1e-6  # of the power of the columns, each of length 1: directions of less are not asked for
STANDS = 0.01  # of the largest speed: a slower machine may be held
KNOWN = {"fan load": 0, "friction": 1}  # what is estimated already


def unexplained_friction(fit: Fit, chance: float) -> tuple[float, FloatArray]:
    """Return what another law of friction would explain, of an explanation that holds beyond its limit with a chance.

    Returns
    -------
    How much larger the root of the statistic is than its limit, and by how much all that is free would move with it, on
    its scales, (f + m,). Both are 0 where it is no motor's, its speed is not shown, or the recording is long.
    """
    s, still = fit.simulator, np.zeros(len(fit.names))
    if motor_values(fit) is None or "w" not in s.outputs or s.rows > LONG:
        return 0.0, still
    w = fit.shown[:, s.outputs.index("w")]
    top = float(np.max(np.abs(w)))
    laws = [k for name, k in KNOWN.items() if name not in fit.names]
    if not 0 < top < np.inf or not laws:
        return 0.0, still
    torques = np.column_stack([w * np.abs(w) / top**2, np.sign(w) * (np.abs(w) > STANDS * top)])[:, laws]
    columns = fit.whitener.flat(response(fit, torque=torques))
    norms = np.sqrt(np.maximum(np.sum(columns**2, axis=0), 1e-300))
    columns /= norms
    test = fit.test()
    information, scores = test.together(columns)
    power, axes = np.linalg.eigh(information)
    told = power > DEPENDENT
    if not told.any():
        return 0.0, still
    along = axes[:, told].T @ scores
    ratio = float(np.sqrt(np.sum(along**2 / power[told]) / chi_square_limit(int(told.sum()), chance)))
    sizes = axes[:, told] @ (along / power[told])
    moved = -fit.covariance_parts()[0] @ (fit.whitened[:].T @ (columns @ sizes))
    return ratio, moved * _share(fit, moved)


def _share(fit: Fit, moved: FloatArray) -> float:
    """Return how much of a move, (f + m,), is possible: another law takes no more of the friction than all of B."""
    by_b = [abs(x) for x, name, log in zip(moved, fit.names, fit.is_log, strict=True) if name == "B" and log]
    return float(1 / max([1.0, *by_b]))
