"""The logged voltage has a sensor's noise that the motor's voltage does not have: no input of the model."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import EDGE
from estimator.fitting.motor_response import as_late, motor_values, response
from estimator.plans.plan import Plan
from estimator.recordings.excitation import noise_deviation

FloatArray = NDArray[np.float64]

VOLTAGE_NOISE = "voltage noise"
UNREACHED = "the logged voltage's noise does not reach the motor"
LEAST_NOISE = 1e-6  # of the largest voltage: less is rounding
EDGE_NOISE = 8.0  # deviations of the voltage's noise: a larger change is an edge, differences of noise hardly ever
MOST_CHANGES = 3000  # changes, at most: more are a signal


@dataclass(frozen=True)
class VoltageNoise(Effect):
    """The part of the voltage's noise that the motor does not see, 0 to 1."""

    name: str = VOLTAGE_NOISE
    prior: float = 0.1

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the response to the logged voltage's deviations from its levels, with opposite sign."""
        s = fit.simulator
        if motor_values(fit) is None:
            return ()
        v = s.inputs("v")
        around = np.zeros(s.rows)
        for clock in s.clocks:
            around[clock.rows] = around_levels(v[clock.rows])
        if np.max(np.abs(around)) <= LEAST_NOISE * np.max(np.abs(v)):
            return ()
        return [Linear(self.name, response(fit, voltage=as_late(fit, -around))[:, :, None], ("",), least=0.3, most=1.3)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say so."""
        return f"{UNREACHED} ({100 * value:.0f} % of it is the sensor's)"


def with_levels(plan: Plan) -> Plan | None:
    """Return the plan whose voltages are the means of their levels, as if their noise were the sensor's alone.

    None where they have no noise about levels.
    """
    observed = []
    for o in plan.observed:
        v = o.inputs.get("v", np.zeros(0))
        observed.append(dataclasses.replace(o, inputs={**o.inputs, "v": v - around_levels(v)}) if len(v) else o)
    pairs = [(o.inputs["v"], q.inputs["v"]) for o, q in zip(plan.observed, observed, strict=True) if "v" in o.inputs]
    if not any(np.max(np.abs(q - v)) > LEAST_NOISE * np.max(np.abs(v)) for v, q in pairs):
        return None
    return dataclasses.replace(plan, observed=tuple(observed))


def around_levels(u: FloatArray) -> FloatArray:
    """Return a voltage less the means of its levels, (n,); zero where it has too many."""
    least = max(EDGE * float(np.ptp(u)), EDGE_NOISE * noise_deviation(u), 1e-300)
    jumps = np.flatnonzero(np.abs(np.diff(u)) > least) + 1
    if len(jumps) > MOST_CHANGES:
        return np.zeros(len(u))
    result = np.empty(len(u))
    for first, last in zip([0, *jumps], [*jumps, len(u)], strict=True):
        result[first:last] = u[first:last] - np.mean(u[first:last])
    return result
