"""Orders of the shaft's angle: the angle as recordings show it, and what an order of it adds. Selects no order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.lateness import acting, lateness
from estimator.fitting.shaft_angle import HIGHEST_ORDER
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

AT_ONCE = 2_000  # rows: their waves stay in a processor's cache
EIGHT = 8  # orders, of HIGHEST_ORDER, whose waves are kept
TURNS = 0.05  # of the largest speed: where it is less, an error of the angle is not known
OF_SIGNAL, OF_ONE_SIZE, OF_RESISTANCE, OF_BACK_EMF = range(4)  # forms of a line


def angle_of(fit: Fit, output: str) -> FloatArray | None:
    """Return the shaft's angle, rad, (rows,), at the instants that an output shows; None where no recording tells it.

    It is integrated from the measured speed. Where the speed's sensor is later than the output's, as a mean over the
    interval or a filter is, the shaft is further on: at an order of 20 by a wave while it runs, and not yet at an edge.

    Where the fit has ripples, so are the slips of the angle that they show (angle_slips.py): it is a cost otherwise.

    What ripples add to the speed is taken away: an encoder that shows the speed w as w (1 + a cos k theta) shows the
    angle as theta + a / k sin k theta. By that angle the mean of the ripple over time is not 0, but -a / 2 of its
    amplitude: K would be a² / 2 off.
    """
    theta = fit.once(_angle)
    return None if theta is None else theta + _ahead(fit, output)


def _angle(fit: Fit) -> FloatArray | None:
    theta = fit.simulator.angle
    if theta is not None and any(order_in(g.name, y) for g in fit.linear for y in fit.simulator.outputs):
        theta = theta + fit.simulator.angle_slips
    return None if theta is None else without_ripple(theta, fit, fit.linear_parts)


def _ahead(fit: Fit, output: str) -> FloatArray | float:
    """Return by how much the shaft is further than the angle's sensor says, rad, (rows,), when an output is sampled.

    Of that output, what acts on simulated samples acts on its ripple, too.
    """
    s = fit.simulator
    source = "angle" if "angle" in s.outputs else "w"
    late = sum(lateness(fit.simulator, fit.value, source)) - lateness(fit.simulator, fit.value, output)[0]
    if late == 0:
        return 0.0
    if source == "w":
        return np.asarray(late * fit.shown[:, s.outputs.index("w")])
    shown = fit.shown[:, s.outputs.index("angle")]
    return late * np.concatenate([np.gradient(shown[clock.rows], clock.time) for clock in s.clocks])


def without_ripple(theta: FloatArray, fit: Fit, lines: Iterable[tuple[Linear, FloatArray]]) -> FloatArray:
    """Return an angle, rad, (rows,), without what lines in the speed add to it, each with its coefficients.

    Where the shaft hardly turns, this is what it was before, or, before it turns at all, what it begins with.
    """
    for line, coefficients in lines:
        if (order := order_in(line.name, "w")) is None:
            continue
        j = fit.simulator.outputs.index("w")
        w = fit.shown[:, j]
        turned = np.column_stack([-coefficients[1::2], coefficients[::2]]).ravel()  # a quarter of a wave later
        largest = float(np.max(np.abs(w)))
        turns = np.flatnonzero(np.abs(w) > TURNS * largest)
        if not len(turns):
            continue  # a fit that went astray
        shown_at = w[turns] if line.form == OF_SIGNAL else largest  # an error of an angle is the same at any speed
        added = (line.columns[turns, j] @ turned) / (order * shown_at)
        last = np.searchsorted(turns, np.arange(len(w)), side="right") - 1
        theta = theta - added[np.maximum(last, 0)]
    return theta


def order_in(name: str, output: str) -> int | None:
    """Return the order of a line in an output, by its name; None: it is no such line."""
    words = name.split(" ")
    return int(words[2]) if words[:2] == ["ripple", output] and len(words) == 3 else None


def orders_in(fit: Fit, output: str) -> set[int]:
    """Return the orders that a fit has in an output."""
    return {k for g in fit.linear if (k := order_in(g.name, output)) is not None}


def standing_out(fit: Fit) -> FloatArray:
    """Return residuals over their deviation, (rows, q), outliers weighted; zero where a sample is missing."""
    # By the deviation alone: a correlated noise would contain the lines.
    left = fit.residuals() / fit.whitener.deviation()
    return np.where(fit.whitener.present, left, 0.0) / np.sqrt(fit.whitener.inflate)


def level_of(fit: Fit, j: int) -> FloatArray:
    """Return what an output shows over its largest, (rows,)."""
    return np.asarray(fit.shown[:, j] / max(float(np.max(np.abs(fit.shown[:, j]))), 1e-300))


@dataclass(frozen=True)
class ShaftOrder(Effect):
    """Cosine and sine of one order of the angle in one output, each recording's own."""

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

    def power_each_way(self, theta: FloatArray, z: FloatArray, fit: Fit, j: int) -> FloatArray:
        """Return the same of each direction by itself: what is late comes before its order as the shaft turns back."""
        turns = np.concatenate([np.gradient(theta[clock.rows]) for clock in fit.simulator.clocks])
        ways = [np.where(way, z, 0.0) for way in (turns >= 0, turns < 0)]
        return sum((self.power(theta, own, fit, j) for own in ways if own.any()), np.zeros(HIGHEST_ORDER))

    def columns(self, fit: Fit, theta: FloatArray, level: FloatArray, order: int, j: int) -> FloatArray:
        """Return cosine and sine of an order of the angle, rad, of each recording, as the output shows them."""
        s = fit.simulator
        columns = np.zeros((s.rows, len(s.outputs), 2 * len(s.clocks)))
        for e, clock in enumerate(s.clocks):
            for part, wave in enumerate((np.cos, np.sin)):
                shown = wave(order * theta[clock.rows]) * level[clock.rows]
                for act, value in acting(
                    fit.simulator, fit.value, s.outputs[j]
                ):  # the sensor shows the ripple as it shows the signal
                    shown = act(shown, value, clock.step)
                columns[clock.rows, j, 2 * e + part] = shown
        return columns

    def units(self, fit: Fit, y: str) -> tuple[str, ...]:
        """Return the units of an output's columns."""
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
