"""Variances of parameters that change while they are recorded, about the mean that is estimated. Fits nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.explanation import Explanation
from estimator.explaining.transient_ripple import transient_ripple_sizes
from estimator.fitting.fit import Fit
from estimator.fitting.windows import find_windows

FloatArray = NDArray[np.float64]


def drift_variances(explanation: Explanation) -> FloatArray:
    """Return the variances, (p,), of a plan's parameters, on their scales, about their means over the recordings."""
    fit = explanation.fit
    names = fit.simulator.plan.names
    variances = np.zeros(len(names))
    groups: dict[str, list[float]] = {}
    for a in explanation.additions:
        own = [x for n, x in zip(fit.names, fit.estimates.tolist(), strict=True) if n == a.name]
        for name, change in (a.effect.changes(fit, own[0]) if own else {}).items():
            groups.setdefault(name, []).append(change)
    for name, changes in groups.items():
        if name in names:
            k = names.index(name)
            variances[k] = max(x * x for x in changes) / 12 / _scale(fit, k) ** 2  # any value on the way is as good
    if "B" in names:
        k = names.index("B")
        known = float(fit.covariance_parts()[0][k, k])  # at one speed it is in there
        variances[k] += max(friction_variance(fit) - known, 0.0)
    if "L" in names:
        k = names.index("L")
        variances[k] += _inductance_variance(fit) * (1.0 if fit.simulator.log[k] else float(fit.values[k]) ** 2)
    return np.where(fit.at_bound[: len(names)] == 0, variances, 0.0)


def _scale(fit: Fit, k: int) -> float:
    return float(fit.values[k]) if fit.simulator.log[k] else 1.0


def friction_variance(fit: Fit) -> float:
    """Return the variance of B's mean, on its scale, over the recordings where the friction's torque wanders.

    To the noise that is a torque of one size, which a speed that changes fast tells from B w. But it is the friction
    itself that wanders, B with it: the mean of an Ornstein-Uhlenbeck process over a time T has the variance
    s^2 2 (u - u^2 (1 - exp(-1 / u))), u its time constant over T (Gillespie 1996). Each recording has a mean of
    its own, and tells B by the square of its speed, over the time that it lasts.
    """
    deviation, tau = fit.whitener.noise.torque
    if deviation == 0 or "w" not in fit.simulator.outputs:
        return 0.0
    w, parts, tells = fit.shown[:, fit.simulator.outputs.index("w")], [], []
    for clock in fit.simulator.clocks:
        runs = w[clock.rows][fit.whitener.moving[clock.rows]]
        if runs.any():
            u = tau / (len(runs) * clock.step)
            parts.append(2 * (u - u * u * (1 - np.exp(-1 / u))) / float(np.mean(runs**2)))
            tells.append(clock.step * float(runs @ runs))
    shares = np.array(tells) / max(sum(tells), 1e-300)
    variance = deviation**2 * float(shares**2 @ np.array(parts))
    return variance / _scale(fit, fit.simulator.plan.names.index("B")) ** 2


def _inductance_variance(fit: Fit) -> float:
    """Return the variance of L, relative, over the angles at which the shaft may stand at an edge.

    The coil that a brush shorts is missing in L as it is in R, which makes the current's ripple, but L goes with the
    square of the turns: twice as much. The current's rise tells L, within a part of a turn: at the angle where the
    shaft stands then.
    """
    sizes = [np.mean(np.square(of)) for name, of in transient_ripple_sizes(fit).items() if name.startswith("ripple i ")]
    edges = sum(len(transients) for transients in find_windows(fit).transients)
    return 2**2 * float(sum(sizes)) / max(edges, 1)
