"""Ripple locked to the shaft: commutation in the current, an eccentric encoder in the speed, the same in all runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL, STANDS_OUT
from estimator.explaining.commutated_winding import most_change, of_resistance
from estimator.explaining.effects.base import USUAL, Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.lateness import lateness
from estimator.fitting.motor_response import acting, motor_values
from estimator.fitting.shaft_angle import HIGHEST_ORDER
from estimator.fitting.windows import find_windows
from estimator.plans.part import LONG
from estimator.plans.plan import Plan
from estimator.recordings.excitation import quantum
from estimator.recordings.samples import median

FloatArray = NDArray[np.float64]

LEAST_TURNS = 4.0  # with fewer, no order is resolved
AS_GOOD = 0.9  # of the best order's power: the lowest order that explains as much is selected
LEAST_QUANTA = 1.0  # of a speed's quantum
ORDERS_BESIDE = 2  # neighbouring orders that a few turns do not resolve
ORDERS_NEARBY = 12  # on either side: by the median of their powers an order is judged
AT_ONCE = 2_000  # rows: their waves stay in a processor's cache
EIGHT = 8  # orders, of HIGHEST_ORDER, whose waves are kept
STANDSTILL = 1e-3  # of the largest signal: less stands still
TURNS = 0.05  # of the largest speed: where it is less, an error of the angle is not known
MOST_LINES = 4  # an output, at most
OF_SIGNAL, OF_ONE_SIZE, OF_RESISTANCE = range(3)  # forms of a line


def angle_of(fit: Fit, output: str) -> FloatArray | None:
    """Return the shaft's angle, rad, (rows,), at the instants that an output shows; None where no recording tells it.

    It is integrated from the measured speed. Where the speed's sensor is later than the output's, as a mean over the
    interval or a filter is, the shaft is further on: at an order of 20 by a wave while it runs, and not yet at an edge.

    What ripples add to the speed is taken away: an encoder that shows the speed w as w (1 + a cos k theta) shows the
    angle as theta + a / k sin k theta. By that angle the mean of the ripple over time is not 0, but -a / 2 of its
    amplitude: K would be a² / 2 off.
    """
    theta = fit.once(_angle)
    return None if theta is None else theta + _ahead(fit, output)


def _angle(fit: Fit) -> FloatArray | None:
    theta = fit.simulator.angle
    return None if theta is None else _without_ripple(theta, fit, fit.linear_parts)


def _ahead(fit: Fit, output: str) -> FloatArray | float:
    """Return by how much the shaft is further than the angle's sensor says, rad, (rows,), when an output is sampled.

    Of that output, what acts on simulated samples acts on its ripple, too.
    """
    s = fit.simulator
    source = "angle" if "angle" in s.outputs else "w"
    late = sum(lateness(fit, source)) - lateness(fit, output)[0]
    if late == 0:
        return 0.0
    if source == "w":
        return np.asarray(late * fit.shown[:, s.outputs.index("w")])
    shown = fit.shown[:, s.outputs.index("angle")]
    return late * np.concatenate([np.gradient(shown[clock.rows], clock.time) for clock in s.clocks])


def _without_ripple(theta: FloatArray, fit: Fit, lines: Iterable[tuple[Linear, FloatArray]]) -> FloatArray:
    """Return an angle, rad, (rows,), without what lines in the speed add to it, each with its coefficients.

    Where the shaft hardly turns, this is what it was before, or, before it turns at all, what it begins with.
    """
    for line, coefficients in lines:
        words = line.name.split(" ")  # as `linear` names it
        if words[:2] != ["ripple", "w"] or len(words) != 3:
            continue
        j = fit.simulator.outputs.index("w")
        w = fit.shown[:, j]
        turned = np.column_stack([-coefficients[1::2], coefficients[::2]]).ravel()  # a quarter of a wave later
        largest = float(np.max(np.abs(w)))
        turns = np.flatnonzero(np.abs(w) > TURNS * largest)
        if not len(turns):
            continue  # a fit that went astray
        shown_at = w[turns] if line.form == OF_SIGNAL else largest  # an error of an angle is the same at any speed
        added = (line.columns[turns, j] @ turned) / (int(words[2]) * shown_at)
        last = np.searchsorted(turns, np.arange(len(w)), side="right") - 1
        theta = theta - added[np.maximum(last, 0)]
    return theta


def standing_out(fit: Fit) -> FloatArray:
    """Return residuals over their deviation, (rows, q), outliers weighted; zero where a sample is missing."""
    # By the deviation alone: a correlated noise would contain the lines.
    left = fit.residuals() / fit.whitener.noise.deviation(fit.whitener.level)
    return np.where(fit.whitener.present, left, 0.0) / np.sqrt(fit.whitener.inflate)


def level_of(fit: Fit, j: int) -> FloatArray:
    """Return what an output shows over its largest, (rows,)."""
    return np.asarray(fit.shown[:, j] / max(float(np.max(np.abs(fit.shown[:, j]))), 1e-300))


@dataclass(frozen=True)
class Ripple(Effect):
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
            own = (g.name.split(" ") for g in fit.linear if g.name.startswith(f"ripple {y} "))
            taken = {int(words[2]) for words in own if len(words) == 3}
            theta = angle_of(fit, y)
            if theta is None or np.ptp(theta) < 2 * np.pi * LEAST_TURNS:
                return ()
            if y == "angle" or len(taken) >= MOST_LINES:
                continue
            level = level_of(fit, j)
            power = self.power(theta, z[:, j] * level, fit, j)
            power[[k - 1 for k in taken]] = 0.0
            best = float(np.max(power))
            order = int(np.argmax(power > AS_GOOD * best)) + 1
            around = np.arange(max(0, order - 1 - ORDERS_NEARBY), min(HIGHEST_ORDER, order + ORDERS_NEARBY))
            near = power[[k for k in around if abs(k - order + 1) > ORDERS_BESIDE and k + 1 not in taken]]
            if best < STANDS_OUT * median(near[near > 0]) if np.any(near > 0) else True:
                continue
            coarse = max(quantum(o.outputs[y]) for o in fit.simulator.observed)
            if coarse > 0 and self._amplitude(power[order - 1], z[:, j], level, fit, j) < LEAST_QUANTA * coarse:
                continue  # the beat of the encoder's lines with the clock
            line, test = Linear(f"ripple {y} {order}", np.zeros((*z.shape, 0)), self._units(fit, y)), fit.test()
            forms = [self._in_form(fit, theta, line, form) for form in self._forms(fit, y)]
            found.append(max(forms, key=lambda line: test.gain(test.across(line.columns))))
        return found

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the line as it is, of a signal and its sensor as they are simulated now."""
        y = group.name.split(" ")[1]
        theta = angle_of(fit, y)
        assert theta is not None  # the line was found by it
        theta = _without_ripple(theta, fit, [(group, coefficients)])
        own = (group.columns @ coefficients)[:, fit.simulator.outputs.index(y)]
        return self._in_form(fit, theta, group, group.form, own)

    def reshaped(self, fit: Fit, group: Linear) -> Linear | None:
        """Return the line in the form that explains most beside its own, where that may explain more."""
        y, test = group.name.split(" ")[1], fit.test()
        theta, forms = angle_of(fit, y), self._forms(fit, y)
        assert theta is not None  # the line was found by it
        others = [self._in_form(fit, theta, group, form) for form in forms if form != group.form]
        gains = [test.gain(test.across(other.columns)) for other in others]
        return others[int(np.argmax(gains))] if max(gains, default=0.0) > LEAST_FALL else None

    def _forms(self, fit: Fit, y: str) -> tuple[int, ...]:
        of_current = y == "i" and motor_values(fit) is not None
        return (OF_SIGNAL, OF_ONE_SIZE, OF_RESISTANCE) if of_current else (OF_SIGNAL, OF_ONE_SIZE)

    def _in_form(self, fit: Fit, theta: FloatArray, line: Linear, form: int, own: FloatArray | float = 0.0) -> Linear:
        """Return a line as large as the signal, of one size, or as a resistance that changes with the angle makes it.

        The last may be there in transients besides the others, and one of one size where settled rows show more than it
        can make: there neither follows from what settled rows show.
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
        of_winding = constant = None
        if form == OF_RESISTANCE or not is_long:
            of_winding = of_resistance(fit, theta, k, fit.explained[:, j] + own)
        if form == OF_ONE_SIZE or not is_long:
            constant = self.columns(fit, theta, turns, k, j)
        if form == OF_RESISTANCE and of_winding is not None:
            columns = of_winding / max(float(np.max(np.hypot(of_winding[:, j, ::2], of_winding[:, j, 1::2]))), 1e-300)
        elif form == OF_ONE_SIZE and constant is not None:
            columns = constant
        else:
            columns = self.columns(fit, theta, level, k, j)
        line = dataclasses.replace(line, columns=columns, form=form, most_transient=most_change(k) / 2**0.5)
        return line if is_long else dataclasses.replace(line, transient=of_winding, beyond=constant)

    def power(self, theta: FloatArray, z: FloatArray, fit: Fit, j: int) -> FloatArray:
        """Return how much of a whitened output each order explains, (orders,)."""
        total = np.zeros(HIGHEST_ORDER)
        for clock, orders in zip(fit.simulator.clocks, fit.simulator.unfolded[j], strict=True):
            own = z[clock.rows]
            there = np.flatnonzero(own)  # the others tell nothing
            turned, own = theta[clock.rows][there], own[there]
            parts = (slice(k, k + AT_ONCE) for k in range(0, len(own), AT_ONCE))
            waves = sum((_waves(turned[part], own[part]) for part in parts), np.zeros(HIGHEST_ORDER, dtype=complex))
            total += np.where(orders, np.abs(waves) ** 2, 0.0)  # the others are aliased to a slow change
        return total

    def _amplitude(self, power: float, z: FloatArray, level: FloatArray, fit: Fit, j: int) -> float:
        """Return the amplitude of an order, in the output's unit, from its power in the whitened residuals."""
        present = fit.whitener.present[:, j]
        unit = float(np.sqrt(np.mean(fit.residuals()[present, j] ** 2) / max(np.mean(z[present] ** 2), 1e-300)))
        return 2 * unit * float(np.sqrt(power)) / max(float(np.sum(level[present] ** 2)), 1.0)

    def columns(self, fit: Fit, theta: FloatArray, level: FloatArray, order: int, j: int) -> FloatArray:
        """Return cosine and sine of an order of the angle, rad, of each recording, as the output shows them."""
        s = fit.simulator
        columns = np.zeros((s.rows, len(s.outputs), 2 * len(s.clocks)))
        for e, clock in enumerate(s.clocks):
            for part, wave in enumerate((np.cos, np.sin)):
                shown = wave(order * theta[clock.rows]) * level[clock.rows]
                for act, value in acting(fit, s.outputs[j]):  # the sensor shows the ripple as it shows the signal
                    shown = act(shown, value, clock.step)
                columns[clock.rows, j, 2 * e + part] = shown
        return columns

    def _units(self, fit: Fit, y: str) -> tuple[str, ...]:
        return (fit.simulator.plan.unit(y),) * (2 * len(fit.simulator.clocks))

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say which order, and how large."""
        _, y, order = name.split(" ")  # as `linear` names it
        unit = plan.unit(y)
        size = f"{value:.3g} {unit} at its largest"
        return f"{y} has a ripple of order {order} of the shaft's angle, of amplitude {size}"


def _waves(theta: FloatArray, z: FloatArray) -> NDArray[np.complex128]:
    """Return the sums of z, (n,), times the wave of each order of an angle, rad, (orders,)."""
    base = np.exp(1j * theta)
    # Order a + 8 b is a wave of the first eight, times one of every eighth.
    few = [base]
    for _ in range(EIGHT - 1):
        few.append(few[-1] * base)
    steps = [z.astype(complex)]
    for _ in range(HIGHEST_ORDER // EIGHT - 1):
        steps.append(steps[-1] * few[-1])
    return np.asarray((np.array(steps) @ np.array(few).T).ravel())
