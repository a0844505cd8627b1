"""The logged voltage has an offset: a converter's zero, a ground that floats. The motor stands where it shows one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import edges_of
from estimator.fitting.motor_response import late_response, motor_values
from estimator.plans.plan import Plan
from estimator.recordings.samples import mean_of_known

FloatArray = NDArray[np.float64]

MOST_OFFSET = 0.2  # of the largest voltage
USUAL_OFFSET = 0.01  # of it
LEAST_ROWS, STANDS = 5, 0.01  # rows at rest; of the largest speed: less is none
TOLD, ALIKE = 5.0, 0.2  # standard errors that a voltage at rest has to be off zero; part by which recordings may differ


EACH = "of each recording"


@dataclass(frozen=True)
class VoltageOffset(Effect):
    """A voltage, V, that the log shows more than the motor has: in all recordings, or as each shows it at rest."""

    name: str = "voltage offset"
    prior: float = SELDOM
    sentence: str = "the logged voltage is {value:.3g} V {more} than the motor's"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return one for all recordings, where the voltage has several values: rest, and another.

        Where recordings show other voltages while the motor stands, one for the size of these, too.
        """
        if motor_values(fit) is None:
            return ()
        s = fit.simulator
        v = s.inputs("v")
        if not np.ptp(v) > 0:
            return ()
        largest = float(np.max(np.abs(v)))
        most, usual = MOST_OFFSET * largest, USUAL_OFFSET * largest
        shown = _at_rest(fit, most)
        size = float(np.max(np.abs(shown))) if shown is not None else 0.0
        alike = shown is not None and size > 0 and bool(np.ptp(shown) <= ALIKE * size)
        column = late_response(fit, -np.ones_like(v))[:, :, None]
        found = [self._of(self.name, column, most, max(usual, size) if alike else usual, foretold=alike)]
        if shown is not None and size > 0 and not alike:
            own = np.concatenate(
                [np.full(len(c.time), x / size) for c, x in zip(s.clocks, shown.tolist(), strict=True)]
            )
            found.append(
                self._of(f"{self.name} {EACH}", late_response(fit, -own)[:, :, None], most, size, foretold=True)
            )
        return found

    def _of(self, name: str, column: FloatArray, most: float, size: float, *, foretold: bool) -> Linear:
        return Linear(name, column, ("V",), least=-most, most=most, size=size, moves=True, foretold=foretold)

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how large."""
        if name == self.name:
            return self.sentence.format(value=abs(value), more="more" if value > 0 else "less")
        return f"the logged voltages are off by what each shows while the motor stands, {value:.3g} V at most"


def _at_rest(fit: Fit, most: float) -> FloatArray | None:
    """Return the voltage that each recording shows, V, before its first change, while the motor stands; 0: none.

    None where one begins with another, or shows no speed then.
    """
    s = fit.simulator
    if "w" not in s.outputs:
        return None
    v, w = s.inputs("v"), s.measured[:, s.outputs.index("w")]
    span, fastest, shown = float(np.ptp(v)), float(np.nanmax(np.abs(w))), list[float]()
    for o, clock in zip(s.observed, s.clocks, strict=True):
        first = int(next(iter(edges_of(v[clock.rows], span)), 0))
        at = slice(clock.rows.start, clock.rows.start + first)
        if first < LEAST_ROWS or not abs(mean_of_known(w[at])) < STANDS * fastest:
            return None
        known = 0.0 if o.uncertain is None else float(np.linalg.norm(o.uncertain[0]))  # of a mean in the noise's place
        error = np.hypot(float(np.std(v[at])) / np.sqrt(first), known)
        level = float(np.mean(v[at]))
        if abs(level) > most:
            return None
        shown.append(level if abs(level) > TOLD * error else 0.0)
    return np.array(shown)
