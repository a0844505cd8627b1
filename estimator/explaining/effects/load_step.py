"""The load changes at an instant: a weight that is hung on, a brake that is put on or off, a hand on the shaft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.machine_effects import usual_friction
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.latency import edges_of
from estimator.fitting.motor_response import motor_values, response, speed_of
from estimator.fitting.simulator import per_recording
from estimator.fitting.windows import find_windows
from estimator.motor.state_space import poles
from estimator.noise.clock import Clock
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

INSTANTS = 48  # that are tried in a recording, evenly; BETWEEN of them then, again and again, beside the best
BETWEEN = 7
NOTHING = 1e-9  # of information
PROMISING = 10.0  # of z'z: what lowers it by less is not looked for between the instants
WANDERS = 0.2  # of the usual friction: it changes by less by itself
RESPONSE = 3.0  # time constants of the motor in which a response has come by 95 %
ENOUGH = 0.2  # of the rows: fewer settled ones are a signal's that has no levels
STANDS = 0.01  # of the largest speed: below it stands
FURTHEST = 20  # rows by which an instant is moved at a time


@dataclass(frozen=True)
class LoadStep(Effect):
    """A torque that acts on the shaft from an instant on, N.m against positive speed; another ends it.

    An impulse in the row before, N.m.s, is the part of that row in which it acts, and tells in which row it begins.
    """

    name: str = "load step"
    prior: float = SELDOM
    sharp: bool = True
    follows: bool = True
    is_last: bool = True
    doubt: str = "the load on the shaft changes while it is recorded: record without a load, or one that is known"

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the instant of each recording from which on a torque explains most of the residuals."""
        s, values = fit.simulator, motor_values(fit)
        if values is None or not {"w", "angle"} & set(s.outputs):
            return ()
        names, least = per_recording(s.plan, self.name), WANDERS * usual_friction(fit, values)
        return [
            _from_row(fit, _named(name, clock, row), clock, row)
            for clock, name, (row, torque) in zip(s.clocks, names, fit.once(_likeliest), strict=True)
            if row and abs(torque) > least
        ]

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the columns of the row in which its impulse has it begin."""
        _, clock = self._recording(fit, group)
        step, impulse = coefficients.tolist()
        late = -round(impulse / (step * clock.step) + 0.5) if step else 0  # rows
        row = group.form + int(np.clip(late, -FURTHEST, FURTHEST))
        if not late or row not in _between_changes(fit, clock, fit.simulator.inputs("v")[clock.rows]):
            return None
        return _from_row(fit, group.name, clock, row)

    def named(self, fit: Fit, group: Linear) -> str:
        """Return its name with the instant that it has been moved to."""
        return _named(*self._recording(fit, group), group.form)

    def _recording(self, fit: Fit, group: Linear) -> tuple[str, Clock]:
        """Return the effect's name in the recording of a group, and its clock."""
        s = fit.simulator
        names = per_recording(s.plan, self.name)
        return next(pair for pair in zip(names, s.clocks, strict=True) if group.name.startswith(f"{pair[0]} near "))

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say whether there is more or less of it."""
        way = "more" if value > 0 else "less"
        return f"{name}: from then on a torque of {abs(value):.3g} N.m {way} acts against positive speed"


def _likeliest(fit: Fit) -> list[tuple[int, float]]:
    """Return the row of each recording from which on a torque lowers z'z most, and that, N.m; 0 where none is asked."""
    found, several = [], len(fit.simulator.clocks) > 1
    for o, clock in zip(fit.simulator.observed, fit.simulator.clocks, strict=True):
        rows = _between_changes(fit, clock, o.inputs["v"])
        tried = np.linspace(0, len(rows) - 1, INSTANTS + 2).round().astype(int)[1:-1]
        apart, best, torque = len(rows) / (INSTANTS + 1), 0, 0.0
        of_rows = partial(_torques, fit, clock)
        while len(rows):
            asked = rows[np.unique(tried)]
            along, power = fit.test().scores_of(of_rows, asked, clock.rows if several else slice(None))
            k = int(np.argmax(along**2 / np.maximum(power, NOTHING)))
            best, torque = int(asked[k]), float(along[k] / max(power[k], NOTHING))
            if apart <= 1 or along[k] ** 2 < PROMISING * power[k]:
                break
            near = np.searchsorted(rows, best) + np.linspace(-apart, apart, BETWEEN).round().astype(int)
            tried, apart = np.clip(near, 0, len(rows) - 1), apart * 2 / (BETWEEN - 1)
        found.append((best, torque))
    return found


def _between_changes(fit: Fit, clock: Clock, v: FloatArray) -> NDArray[np.int64]:
    """Return rows of a recording in which a load may change.

    None of a transient is, nor one whose own response the next change of the voltage cuts short: what changes as the
    voltage does is the drive's, or friction of another law. Of a signal without levels any may be. None is where the
    motor stands: friction holds it then, and what acts from its first motion on is friction.
    """
    windows, values = find_windows(fit), motor_values(fit)
    assert values is not None
    whole = clock.step * len(clock.time)
    slowest = 1 / max(-float(np.max(poles(values).real)), 1 / whole)  # s
    free = windows.settled[clock.rows] & ~windows.sharp[clock.rows]
    for edge in edges_of(v).tolist():
        free[max(0, edge - math.ceil(RESPONSE * slowest / clock.step)) : edge] = False
    if np.count_nonzero(free) < ENOUGH * len(free):
        free = ~windows.sharp[clock.rows]
    w = speed_of(fit, fit.shown)
    assert w is not None  # asked of a fit that has it
    free &= np.abs(w[clock.rows]) > STANDS * np.max(np.abs(w))
    return np.flatnonzero(free)[1:-1]


def _named(name: str, clock: Clock, row: int) -> str:
    """Return a recording's name of the effect with its instant, to about a hundredth of the recording."""
    digits = max(0, math.ceil(2 - math.log10(clock.step * len(clock.time))))
    return f"{name} near {clock.time[row]:.{digits}f} s"


def _from_row(fit: Fit, name: str, clock: Clock, row: int) -> Linear:
    """Return the columns of a torque that begins in a row of a recording, or within the row before."""
    columns = np.zeros((fit.simulator.rows, len(fit.simulator.outputs), 2))
    columns[clock.rows] = _torques(fit, clock, np.array([row, row - 1]))
    columns[:, :, 1] = (columns[:, :, 1] - columns[:, :, 0]) / clock.step
    return Linear(name, columns, ("N.m", "N.m.s"), one_of=INSTANTS, form=row, moves=True)


def _torques(fit: Fit, clock: Clock, rows: NDArray[np.int64]) -> FloatArray:
    """Return the change of a recording's signals, (n, q, c), by torques of 1 N.m from each of c of its rows on."""
    held = (np.arange(len(clock.time))[:, None] >= rows).astype(np.float64)
    return response(fit, torque=held, within=clock)
