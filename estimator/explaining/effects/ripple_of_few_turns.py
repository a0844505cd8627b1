"""Ripple locked to the shaft without a spectral line: there are too few turns, or the signal is large at edges only."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL
from estimator.explaining.commutated_winding import of_resistance
from estimator.explaining.effects.base import USUAL
from estimator.explaining.effects.ripple import MOST_LINES
from estimator.explaining.effects.shaft_order import (
    OF_RESISTANCE,
    OF_SIGNAL,
    ShaftOrder,
    angle_of,
    level_of,
    orders_in,
    standing_out,
)
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values
from estimator.fitting.shaft_angle import HIGHEST_ORDER, LINE_CYCLES
from estimator.fitting.windows import find_windows
from estimator.noise.clock import Clock

FloatArray = NDArray[np.float64]

LOW_ORDERS = (1, 2)  # orders in the speed: a disc with its centre beside the axis, and a tilted one
MOST_ECCENTRICITY = 0.05  # of the speed: the disc of an encoder is centred better
FEWEST_TURNS = 1.0  # with fewer, no order is tested
BELOW_LINE = 4.0  # times LINE_CYCLES: with more cycles an order is a line (ripple.py)
FARTHEST, FINEST = 8.0, 0.05  # rows by which an angle may be early or late; to which its lateness is found
TRIED_SHIFTS = 24  # on either side
ENOUGH_ROWS = 6000  # rows that the lateness is found from, at most
PERIODS_AT_EDGES = 4.0  # of an order while the current is large: with fewer it cannot be distinguished from a transient


@dataclass(frozen=True)
class Eccentricity(ShaftOrder):
    """Cosine and sine of a low order of the angle, in proportion to the speed, each recording's own."""

    name: str = "eccentricity"
    prior: float = USUAL / 2

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the low orders that have too few periods for a line, by all rows, also in transients."""
        outputs = fit.simulator.outputs
        if "w" not in outputs or not np.any(fit.shown[:, (j := outputs.index("w"))]):
            return ()
        theta = angle_of(fit, "w")
        if theta is None:
            return ()
        turns, largest = _turns(theta, fit), float(np.max(np.abs(fit.shown[:, j])))
        if turns < FEWEST_TURNS:
            return ()
        return [
            Linear(f"ripple w {k}", self.columns(fit, theta, fit.shown[:, j] / largest, k, j), self.units(fit, "w"),
                   least=-MOST_ECCENTRICITY * largest, most=MOST_ECCENTRICITY * largest)
            for k in LOW_ORDERS if k * turns < BELOW_LINE * LINE_CYCLES
        ]  # fmt: skip


@dataclass(frozen=True)
class Commutation(ShaftOrder):
    """Cosine and sine of an order of the angle, in proportion to the current, which is large at edges only.

    It is added to the current, or the winding's resistance changes so: then the winding smooths it as it does all else.
    """

    name: str = "commutation"
    prior: float = USUAL / HIGHEST_ORDER

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the order that explains most of the current's residuals, also in transients."""
        outputs = fit.simulator.outputs
        theta = angle_of(fit, "i") if "i" in outputs else None
        if theta is None or _turns(theta, fit) < FEWEST_TURNS:
            return ()
        j = outputs.index("i")
        taken, settled = orders_in(fit, "i"), find_windows(fit).settled
        level, z = level_of(fit, j), standing_out(fit)[:, j]
        if find_windows(fit).enough and np.sum(level[settled] ** 2) > np.sum(level[~settled] ** 2):
            return ()  # settled rows tell its size better: it is a line
        power = self.power(theta, level * z, fit, j)
        power[[k - 1 for k in (*LOW_ORDERS, *taken)]] = 0.0
        power[: max(0, int(PERIODS_AT_EDGES / max(_turns_at_edges(theta, level, fit), 1e-9)))] = 0.0
        if len(taken) >= MOST_LINES or not np.any(power):
            return ()
        order = int(np.argmax(power)) + 1
        line, test = Linear(f"ripple i {order}", np.zeros((*fit.shown.shape, 0)), self.units(fit, "i")), fit.test()
        forms = [self._in_form(fit, theta, line, form) for form in self._forms(fit)]
        return [max(forms, key=lambda line: test.gain(test.across(line.columns)))]

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the order's columns, the lateness of the angle found from the last fit."""
        theta = angle_of(fit, "i")
        if theta is None:
            return None
        own = (group.columns @ coefficients)[:, fit.simulator.outputs.index("i")]
        return self._in_form(fit, theta, group, group.form, own)

    def reshaped(self, fit: Fit, group: Linear) -> Sequence[Linear]:
        """Return the line in its other form, if that explains something beside its own."""
        theta, test = angle_of(fit, "i"), fit.test()
        assert theta is not None  # the line was found by it
        others = [self._in_form(fit, theta, group, form) for form in self._forms(fit) if form != group.form]
        return [other for other in others if test.gain(test.across(other.columns)) > LEAST_FALL]

    def _forms(self, fit: Fit) -> tuple[int, ...]:
        return (OF_SIGNAL, OF_RESISTANCE) if motor_values(fit) is not None else (OF_SIGNAL,)

    def _in_form(self, fit: Fit, theta: FloatArray, line: Linear, form: int, own: FloatArray | float = 0.0) -> Linear:
        """Return a line as large as the current, or as a resistance that changes with the angle makes it.

        `own` is what the line adds to the current, (rows,), where the fit's explanation does not hold it.
        """
        j, order = fit.simulator.outputs.index("i"), int(line.name.split(" ")[2])
        if form == OF_RESISTANCE:
            columns = of_resistance(fit, theta, order, fit.explained[:, j] + own)
            columns = columns / max(float(np.max(np.hypot(columns[:, j, ::2], columns[:, j, 1::2]))), 1e-300)
        else:
            columns = self._in_time(fit, theta, level_of(fit, j), order, j, standing_out(fit)[:, j])
        return dataclasses.replace(line, columns=columns, form=form)

    def _in_time(self, fit: Fit, theta: FloatArray, level: FloatArray, order: int, j: int, z: FloatArray) -> FloatArray:
        """Return an order's columns, its angle shifted so that it explains most of z: a sensor may be slow."""
        clocks = fit.simulator.clocks
        weighted = level * z
        step, late, reach = min(c.step for c in clocks), 0.0, FARTHEST
        while reach > FINEST:
            tried = late + step * np.linspace(-reach, reach, 2 * TRIED_SHIFTS + 1)
            powers = sum(_powers(order * theta[c.rows], c, weighted[c.rows], tried) for c in clocks)
            late, reach = float(tried[int(np.argmax(powers))]), 1.5 * reach / TRIED_SHIFTS
        shifted = np.concatenate([_shifted(theta, c, late) for c in clocks])
        return self.columns(fit, shifted, level, order, j)


def _turns_at_edges(theta: FloatArray, level: FloatArray, fit: Fit) -> float:
    """Return the turns of a recording while its current is large, the most of all: where its size tells an order."""
    turn = np.abs(np.diff(theta, prepend=theta[:1])) * level**2
    return max(float(np.sum(turn[c.rows][1:])) / (2 * np.pi) for c in fit.simulator.clocks)


def _turns(theta: FloatArray, fit: Fit) -> float:
    """Return by how many turns the shaft has moved on at the end of a recording, the most of all."""
    return max(float(np.ptp(theta[c.rows])) / (2 * np.pi) for c in fit.simulator.clocks)


def _powers(angle: FloatArray, clock: Clock, weighted: FloatArray, tried: FloatArray) -> FloatArray:
    """Return the power of an order's wave in weighted residuals, (n,), at each tried lateness, s, in even steps.

    Between two rows of an even clock the angle moves on evenly: the wave turns on by the same factors from one lateness
    to the next.
    """
    n, every = len(angle), 1 + len(angle) // ENOUGH_ROWS
    if clock.steps[1] is not None or every > 1:
        times, own = clock.time[::every], weighted[::every]
        moved = (np.exp(1j * np.interp(times + late, clock.time, angle)) for late in tried)
        return np.array([abs(np.vdot(wave, own)) ** 2 for wave in moved])
    base, ahead = np.exp(1j * angle), np.diff(angle, append=angle[-1:])
    back = base * np.conj(np.append(base[1:], base[-1:]))
    rows, part = divmod(float(tried[0]) / clock.step, 1.0)
    further = float(tried[1] - tried[0]) / clock.step
    wave, turn = base * np.exp(1j * part * ahead), np.exp(1j * further * ahead)
    early, late = np.cumsum(weighted), np.cumsum(weighted[::-1])
    powers = np.empty(len(tried))
    for k in range(len(tried)):
        m = min(max(round(rows), -n), n)
        if m > 0:  # what lies beyond the rows is as at their end
            total = np.vdot(wave[m:], weighted[: n - m]) + np.conj(base[-1]) * late[m - 1]
        else:
            total = np.vdot(wave[: n + m], weighted[-m:]) + (np.conj(base[0]) * early[-m - 1] if m else 0.0)
        powers[k] = abs(total) ** 2
        wave, part = wave * turn, part + further
        if part > 1 - 1e-9:
            wave, part, rows = wave * back, part - 1, rows + 1
    return powers


def _shifted(theta: FloatArray, clock: Clock, late: float) -> FloatArray:
    """Return the angle, rad, some seconds later than it was integrated, over a clock's rows."""
    own = theta[clock.rows]
    return np.asarray(np.interp(clock.time + late, clock.time, own)) if late else own
