"""The supply's voltage drifts while recordings last: a battery that empties, a supply that warms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import late_response, motor_values
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

MOST_DRIFT, USUAL_DRIFT = 0.3, 0.02  # of the voltage, over the longest recording
KNOWN = 0.5  # deviation of the voltage, of its change: its command is right at one end or at the other
NOTHING = 1e-9  # of information
RELAXING = 0.0, 3.0  # time constants in the longest recording: along a line, or fast at first


@dataclass(frozen=True)
class SupplyDrift(Effect):
    """A voltage that is its command times what changes, by a part of it over the longest recording.

    All recordings are of one supply, which does the same in each. Whether it gave what the command says at first, or in
    the end, nobody knows. A voltage that is measured shows what its supply does.
    """

    name: str = "supply drift"
    prior: float = SELDOM

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return each form, of all recordings of a motor by a command; right halfway through its change."""
        s = fit.simulator
        if motor_values(fit) is None or any(o.is_measured for o in s.observed):
            return ()
        longest = max(clock.time[-1] - clock.time[0] for clock in s.clocks)
        part = np.concatenate([(clock.time - clock.time[0]) / longest for clock in s.clocks])
        changes = [np.expm1(-n * part) / np.expm1(-n) - 0.5 if n else part - 0.5 for n in RELAXING]
        forms = np.column_stack([*changes, np.full(s.rows, KNOWN)])
        columns = late_response(fit, s.inputs("v")[:, None] * forms)
        return [
            Linear(
                self.name, columns[:, :, k : k + 1], ("",), least=-MOST_DRIFT, most=MOST_DRIFT, size=USUAL_DRIFT,
                one_of=len(changes), form=k, uncertain=columns[:, :, -1:],
            )
            for k in range(len(changes))
        ]  # fmt: skip

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the form that explains most beside all else."""
        forms = self.linear(fit)
        if not forms:
            return None
        along, power = fit.test().scores(np.concatenate([g.columns for g in forms], axis=2))
        return forms[int(np.argmax(along**2 / np.maximum(power, NOTHING)))]

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say in which direction."""
        way = "rises" if value > 0 else "falls"
        return f"the supply drifts: the voltage {way} by {100 * abs(value):.3g} % over the longest recording"
