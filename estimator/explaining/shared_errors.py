"""Errors that samples share beside their noise: of ripple, effects, voltages, coarse sensors. Estimates nothing."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.coarse_levels import coarse_levels
from estimator.explaining.transient_ripple import transient_ripple
from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import late_response, motor_values

FloatArray = NDArray[np.float64]


def with_shared_errors(fit: Fit, *, forms: bool = True) -> Fit:
    """Return the fit with what errors of variance 1 add to its sensors, as they are simulated now.

    Parameters
    ----------
    forms : bool
        Whether those of the form of its columns are among them.
    """
    found = (transient_ripple(fit), _of_forms(fit) if forms else None, _of_voltages(fit), coarse_levels(fit))
    parts = [part for part in found if part is not None]
    shared = np.concatenate(parts, axis=2) if parts else None
    return dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener, shared=shared))


def _of_forms(fit: Fit) -> FloatArray | None:
    """Return what is not known of the form of the columns, (rows, q, k), at their coefficients; None: nothing."""
    found = [group.uncertain * own for group, own in fit.linear_parts if group.uncertain is not None]
    return np.concatenate(found, axis=2) if found else None


def _of_voltages(fit: Fit) -> FloatArray | None:
    """Return what the errors of a motor's voltages add, (rows, q, k); None: they have none."""
    s = fit.simulator
    known = [(o.uncertain, clock.rows) for o, clock in zip(s.observed, s.clocks, strict=True)]
    if motor_values(fit) is None or all(own is None for own, _ in known):
        return None
    columns = []
    for own, rows in known:
        if own is not None:
            voltage = np.zeros((s.rows, own.shape[1]))
            voltage[rows] = own
            columns.append(voltage)
    return late_response(fit, np.concatenate(columns, axis=1))
