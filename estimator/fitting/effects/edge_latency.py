"""Each change of the command reaches the motor at a latency of its own: a controller that looks at times of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.fitting.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.machine import as_late, motor_values, response
from estimator.plans.plan import Plan

MOST = 12  # edges; more are a signal, not levels
LEAST = 0.05  # of the voltage's range


@dataclass(frozen=True)
class EdgeLatency(Effect):
    """Further delays, s, of the changes of the voltage after the first."""

    name: str = "latency of each edge"
    prior: float = 0.05

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one group a motor whose voltage has a few levels."""
        s = fit.simulator
        if motor_values(fit) is None:
            return ()
        v, columns = s.inputs("v"), []
        for clock in s.clocks:
            u = v[clock.rows]
            jumps = np.flatnonzero(np.abs(np.diff(u)) > LEAST * max(float(np.ptp(v)), 1e-300)) + 1
            if not 2 <= len(jumps) <= MOST:
                continue
            for k in jumps[1:]:
                pulse = np.zeros(s.rows)
                pulse[clock.rows.start + k] = -(u[k] - u[k - 1]) / clock.step
                columns.append(response(fit, voltage=as_late(fit, pulse)))
        if not columns:
            return ()
        return [Linear(self.name, np.stack(columns, axis=2), ("s",) * len(columns), size=s.clocks[0].step)]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say so."""
        return "the changes of the voltage reach the motor at delays of their own"
