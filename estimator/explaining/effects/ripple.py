"""Ripple locked to the shaft: commutation in the current, an eccentric encoder in the speed, the same in all runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL, STANDS_OUT
from estimator.explaining.commutated_winding import most_change, of_back_emf, of_resistance
from estimator.explaining.effects.base import USUAL
from estimator.explaining.effects.shaft_order import (
    OF_BACK_EMF,
    OF_ONE_SIZE,
    OF_RESISTANCE,
    OF_SIGNAL,
    ShaftOrder,
    angle_of,
    level_of,
    orders_in,
    standing_out,
    without_ripple,
)
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.motor_response import motor_values
from estimator.fitting.shaft_angle import HIGHEST_ORDER
from estimator.fitting.windows import find_windows
from estimator.plans.part import LONG
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]

LEAST_TURNS = 4.0  # with fewer, no order is resolved
AS_GOOD = 0.9  # of the best order's power: the lowest order that explains as much is selected
LEAST_QUANTA = 1.0  # of a speed's quantum
ORDERS_BESIDE = 2  # neighbouring orders that a few turns do not resolve
ORDERS_NEARBY = 12  # on either side: by the median of their powers an order is judged
STANDSTILL = 1e-3  # of the largest signal: less stands still
MOST_LINES = 4  # an output, at most


@dataclass(frozen=True)
class Ripple(ShaftOrder):
    """Cosine and sine of one order of the angle, as large as the signal or of one amplitude, each recording's own."""

    name: str = "ripple"
    prior: float = USUAL / HIGHEST_ORDER
    sharp: bool = True
    is_line: bool = True

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return, of each output, the order that explains most of the residuals, where its power stands out."""
        found = []
        settled = find_windows(fit).settled & fit.whitener.moving
        z = np.where(settled[:, None], standing_out(fit), 0.0)  # a misfit in a transient is no ripple
        for j, y in enumerate(fit.simulator.outputs):
            taken, theta = orders_in(fit, y), angle_of(fit, y)
            if theta is None or np.ptp(theta) < 2 * np.pi * LEAST_TURNS:
                return ()
            if y == "angle" or len(taken) >= MOST_LINES:
                continue
            level = level_of(fit, j)
            power = self.power_each_way(theta, z[:, j] * level, fit, j)
            power[[k - 1 for k in taken]] = 0.0
            best = float(np.max(power))
            order = int(np.argmax(power > AS_GOOD * best)) + 1
            around = np.arange(max(0, order - 1 - ORDERS_NEARBY), min(HIGHEST_ORDER, order + ORDERS_NEARBY))
            near = power[[k for k in around if abs(k - order + 1) > ORDERS_BESIDE and k + 1 not in taken]]
            if best < STANDS_OUT * median(near[near > 0]) if np.any(near > 0) else True:
                continue
            coarse = float(fit.simulator.steps[j])
            if coarse > 0 and self._amplitude(power[order - 1], z[:, j], level, fit, j) < LEAST_QUANTA * coarse:
                continue  # the beat of the encoder's lines with the clock
            line, test = Linear(f"ripple {y} {order}", np.zeros((*z.shape, 0)), self.units(fit, y)), fit.test()
            forms = [self._in_form(fit, theta, line, form) for form in self._forms(fit, y)]
            found.append(max(forms, key=lambda line: test.gain(test.across(line.columns))))
        return found

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the line as it is, of a signal and its sensor as they are simulated now."""
        y = group.name.split(" ")[1]
        theta = angle_of(fit, y)
        assert theta is not None  # the line was found by it
        theta = without_ripple(theta, fit, [(group, coefficients)])
        own = (group.columns @ coefficients)[:, fit.simulator.outputs.index(y)]
        return self._in_form(fit, theta, group, group.form, own)

    def reshaped(self, fit: Fit, group: Linear) -> Sequence[Linear]:
        """Return the line in those other forms that explain something beside its own."""
        y, test = group.name.split(" ")[1], fit.test()
        theta, forms = angle_of(fit, y), self._forms(fit, y)
        assert theta is not None  # the line was found by it
        others = [self._in_form(fit, theta, group, form) for form in forms if form != group.form]
        return [other for other in others if test.gain(test.across(other.columns)) > LEAST_FALL]

    def _forms(self, fit: Fit, y: str) -> tuple[int, ...]:
        if y != "i" or motor_values(fit) is None:
            return (OF_SIGNAL, OF_ONE_SIZE)
        of_one_way = (OF_SIGNAL, OF_ONE_SIZE, OF_RESISTANCE)  # no settled row tells a back EMF's from them
        return (*of_one_way, OF_BACK_EMF) if _turns_back(fit) else of_one_way

    def _in_form(self, fit: Fit, theta: FloatArray, line: Linear, form: int, own: FloatArray | float = 0.0) -> Linear:
        """Return a line as large as the signal, of one size, or as a winding makes it that changes with the angle.

        That of a resistance may be there in transients besides the others, and one of one size where settled rows show
        more than it can make: there neither follows from what settled rows show.
        `own` is what the line adds to its signal, (rows,), where the fit's explanation does not hold it.
        """
        _, y, order = line.name.split(" ")  # as `linear` names it
        j, k, is_long = fit.simulator.outputs.index(y), int(order), len(theta) > LONG
        level = level_of(fit, j)
        turns = (np.abs(level) > STANDSTILL).astype(np.float64)
        if OF_RESISTANCE not in self._forms(fit, y):
            one_size = self.columns(fit, theta, turns, k, j)
            columns = one_size if form == OF_ONE_SIZE else self.columns(fit, theta, level, k, j)
            return dataclasses.replace(line, columns=columns, form=form, transient=None if is_long else one_size)
        of_winding = of_emf = constant = None
        if form == OF_RESISTANCE or not is_long:
            of_winding = of_resistance(fit, theta, k, fit.explained[:, j] + own)
        if form == OF_BACK_EMF:
            of_emf = of_back_emf(fit, theta, k, fit.explained[:, j] + own)
        if form == OF_ONE_SIZE or not is_long:
            constant = self.columns(fit, theta, turns, k, j)
        if (made := {OF_RESISTANCE: of_winding, OF_BACK_EMF: of_emf}.get(form)) is not None:
            columns = made / max(float(np.max(np.hypot(made[:, j, ::2], made[:, j, 1::2]))), 1e-300)
        elif form == OF_ONE_SIZE and constant is not None:
            columns = constant
        else:
            columns = self.columns(fit, theta, level, k, j)
        line = dataclasses.replace(line, columns=columns, form=form, most_transient=most_change(k) / 2**0.5)
        return line if is_long else dataclasses.replace(line, transient=of_winding, beyond=constant)

    def _amplitude(self, power: float, z: FloatArray, level: FloatArray, fit: Fit, j: int) -> float:
        """Return the amplitude of an order, in the output's unit, from its power in the whitened residuals."""
        present = fit.whitener.present[:, j]
        unit = float(np.sqrt(np.mean(fit.residuals()[present, j] ** 2) / max(np.mean(z[present] ** 2), 1e-300)))
        return 2 * unit * float(np.sqrt(power)) / max(float(np.sum(level[present] ** 2)), 1.0)


def _turns_back(fit: Fit) -> bool:
    """Whether the shaft turns in both directions, far enough to resolve an order in each."""
    theta = fit.simulator.angle
    if theta is None:
        return False
    turns = np.concatenate([np.diff(theta[clock.rows]) for clock in fit.simulator.clocks]) / (2 * np.pi)
    return bool(min(np.sum(turns[turns > 0]), -np.sum(turns[turns < 0])) > LEAST_TURNS)
