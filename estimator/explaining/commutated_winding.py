"""What a winding shows whose resistance, or back EMF, changes with the shaft's angle. Knows a motor, no noise.

A brush that touches two segments of the commutator shorts a coil: so many times a turn R falls by its share. And few
coils do not add up to a constant K.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import motor_values, response
from estimator.noise.clock import over_steps

FloatArray = NDArray[np.float64]

MOST_AT_ALL = 2.5  # as most_change counts: five coils and wide brushes, or three and narrow ones


def most_change(order: int) -> float:
    """Return the largest amplitude of an order, over the winding's mean resistance, that brushes on a commutator make.

    2 n times a turn one of n coils is shorted, or two instead of one. By the second R falls by 1 / (n - 2), half of the
    time: of which, over the mean, the wave of that order is 2 / pi / (n - 2.5).
    """
    return 2 / np.pi / max(MOST_AT_ALL, order / 2 - 2.5)


def of_resistance(fit: Fit, theta: FloatArray, order: int, current: FloatArray) -> FloatArray:
    """Return what the sensors show more, (rows, q, 2 a recording), where R is R (1 + a cos + b sin) for a, b of 1 each.

    With the current that flows, its ripple included, (rows,) in A, the response is exact.
    """
    values = motor_values(fit)
    assert values is not None
    return response(fit, voltage=_waves(fit, theta, order, -values["R"] * current))


def of_back_emf(fit: Fit, theta: FloatArray, order: int, current: FloatArray) -> FloatArray:
    """Return what the sensors show more, (rows, q, 2 a recording), where K is K (1 + a cos + b sin) for a, b of 1 each.

    Of the current, ripple included, (rows,) in A, the torque has this, and of the speed the voltage: a current is as
    late behind it as the winding makes it, and the other way round as the shaft turns back.
    """
    values, outputs, clocks = motor_values(fit), fit.simulator.outputs, fit.simulator.clocks
    assert values is not None
    if "w" in outputs:
        speed = fit.explained[:, outputs.index("w")]
    else:
        speed = np.concatenate([np.gradient(theta[clock.rows], clock.time) for clock in clocks])
    emf, torque = (_waves(fit, theta, order, values["K"] * signal) for signal in (speed, current))
    return response(fit, voltage=-emf, torque=-torque)


def _waves(fit: Fit, theta: FloatArray, order: int, size: FloatArray) -> FloatArray:
    """Return cosine and sine of an order of the angle, of each recording, (rows, 2 a recording), held over each row."""
    clocks = fit.simulator.clocks
    mean, angle = (over_steps(signal, clocks) for signal in (size, order * theta))
    waves = np.zeros((len(theta), 2 * len(clocks)))
    for e, clock in enumerate(clocks):
        both = np.column_stack([wave(angle[clock.rows]) for wave in (np.cos, np.sin)])
        waves[clock.rows, 2 * e : 2 * e + 2] = both * mean[clock.rows, None]
    return waves
