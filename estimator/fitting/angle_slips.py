"""Where the shaft's angle, integrated from a recorded speed, slips against the shaft, as its ripples show. No fit.

A logger that loses rows while the machine runs steadily changes nothing that a motor's equations show, but the shaft
has turned on: every ripple goes on with another phase, and is a weaker line with wide flanks, which pass for coloured
noise. An encoder that loses counts does the same. By the angle with its slips a ripple is one line again.

Stretches of a few turns at a steady speed have each the wave of each order. A slip turns the waves of all stretches
behind it by the order times its angle: where that makes the sum of all strong orders large enough, it is there. Of an
angle that does not slip the gain is the largest of chi-squares of so many places and angles. What is near an order and
none, such as a fixed frequency or an order that the sampling folds, drifts in phase as the speed drifts: it tells none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import STANDS_OUT
from estimator.fitting.shaft_angle import HIGHEST_ORDER, TURNING
from estimator.noise.clock import Clock
from estimator.recordings.samples import filled, median

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TURNS, ROWS = 2.0, 40  # of a stretch, at least
STRETCHES = 6  # fewer tell no slip
STEADY = 0.02  # of the largest speed: the speeds of neighbouring stretches differ by less
ORDERS = 6  # of an output, at most
ALIKE = 0.75  # of an order: lines that the sampling folds so near to each other are one, the lowest of them
ANGLES = 180  # of a turn that are tried
MOST_SLIPS = 12  # of a recording
COHERENT = 0.5  # of a line's power is in the sum of its waves behind the slips: else its phase drifts, of no order
LEAST_GAIN = 50.0  # of -2 log L: chi-square of two numbers, at 1 000 places and 180 angles, is above it once in 4e5


@dataclass(frozen=True)
class _Line:
    """The waves of an order in an output, (stretches,), and by what a squared sum of them counts in -2 log L."""

    order: int
    waves: ComplexArray
    weight: float


def angle_slips(theta: FloatArray, measured: FloatArray, outputs: Sequence[str], clocks: Sequence[Clock]) -> FloatArray:
    """Return by how much the shaft is further than its integrated angle, rad, (rows,), but for whole turns.

    Parameters
    ----------
    theta : (rows,) array
        Integrated from the measured speed, rad.
    measured : (rows, q) array
        Of the outputs; NaN where a sample is missing.
    """
    slips = np.zeros(len(theta))
    for clock in clocks:
        own = theta[clock.rows]
        shown = [
            filled(measured[clock.rows, j])
            for j, y in enumerate(outputs)
            if y != "angle" and np.isfinite(measured[clock.rows, j]).any()
        ]
        for stretches in _of_one_direction(own, _stretches(own, clock.time)):
            lines = [line for y in shown for line in _strong_lines(own, y, stretches)]
            for k, slip in _of_coherent_lines(lines, len(stretches)):
                slips[clock.rows.start + stretches[k][0] : clock.rows.stop] += slip
    return slips


def _of_one_direction(theta: FloatArray, stretches: Sequence[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Return the stretches in which the shaft turns in one direction, until it turns in the other, where they are many.

    What ripples with a signal changes its sign with it, which is no slip.
    """
    found: list[list[tuple[int, int]]] = []
    forward = [theta[b] > theta[a] for a, b in stretches]
    for own, ahead, before in zip(stretches, forward, [None, *forward], strict=False):
        if ahead is not before:
            found.append([])
        found[-1].append(own)
    return [own for own in found if len(own) >= STRETCHES]


def _stretches(theta: FloatArray, time: FloatArray) -> list[tuple[int, int]]:
    """Return the first and the last row but one of stretches of some turns at a steady speed."""
    found: list[tuple[int, int]] = []
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(theta)))])
    at = 0
    while at + ROWS < len(theta):
        end = max(at + ROWS, int(np.searchsorted(turned, turned[at] + 2 * np.pi * TURNS)))
        if end >= len(theta):
            break
        found.append((at, end))
        at = end
    speeds = np.array([(theta[b] - theta[a]) / (time[b] - time[a]) for a, b in found])
    if len(found) < STRETCHES:
        return []
    largest = float(np.max(np.abs(speeds)))
    steady = np.abs(speeds) > TURNING * largest
    apart = np.abs(np.diff(speeds)) < STEADY * largest
    steady &= np.concatenate([[True], apart]) & np.concatenate([apart, [True]])
    return [own for own, there in zip(found, steady, strict=True) if there]


def _strong_lines(theta: FloatArray, y: FloatArray, stretches: Sequence[tuple[int, int]]) -> list[_Line]:
    """Return the orders that stand out in the stretches of an output, whatever their phases there."""
    waves, power, rows = np.zeros((len(stretches), HIGHEST_ORDER), dtype=complex), 0.0, 0
    for s, (a, b) in enumerate(stretches):
        x = np.linspace(-1.0, 1.0, b - a)
        own = y[a:b] - np.mean(y[a:b])
        own = own - x * float(x @ own) / float(x @ x)
        base = np.exp(-1j * theta[a:b])
        wave = own.astype(complex)
        for k in range(HIGHEST_ORDER):
            wave = wave * base
            waves[s, k] = np.sum(wave)
        power += float(own @ own)
        rows += b - a
    if power == 0.0:
        return []
    strength = np.sum(np.abs(waves) ** 2, axis=0)
    strong = np.flatnonzero(strength > STANDS_OUT * median(strength))
    turn = median(np.abs([(theta[b] - theta[a]) / (b - a) for a, b in stretches])) / (2 * np.pi)  # of a row
    shown = np.abs((strong + 1) * turn - np.round((strong + 1) * turn))  # as the sampling folds them
    lowest = [k for k in range(len(strong)) if not np.any(np.abs(shown[:k] - shown[k]) < ALIKE * turn)]
    strongest = sorted(strong[lowest].tolist(), key=lambda k: -strength[k])[:ORDERS]
    return [_Line(k + 1, waves[:, k], 2.0 / power) for k in strongest]


def _of_coherent_lines(lines: Sequence[_Line], many: int) -> list[tuple[int, float]]:
    """Return the slips by those lines that are one wave each behind them, as `_of_lines`."""
    lines = list(lines)
    while slips := _of_lines(lines, many):
        turned = np.zeros(many)
        for k, slip in slips:
            turned[k:] += slip
        parts = [abs(np.sum(own.waves * np.exp(-1j * own.order * turned))) / np.sum(np.abs(own.waves)) for own in lines]
        least = int(np.argmin(parts))
        if parts[least] ** 2 >= COHERENT:
            break
        del lines[least]
    return slips


def _of_lines(lines: Sequence[_Line], many: int) -> list[tuple[int, float]]:
    """Return slips, each the stretch before which it is and its angle, rad, with which the lines' sums are largest."""
    found: list[tuple[int, float]] = []
    tried = 2 * np.pi * np.arange(1, ANGLES) / ANGLES
    turned = np.zeros(many)
    while lines and len(found) < MOST_SLIPS:
        gain = np.zeros((many - 1, len(tried)))
        for line in lines:
            waves = line.waves * np.exp(-1j * line.order * turned)
            before = np.cumsum(waves)
            behind = (before[-1] - before[:-1])[:, None] * np.exp(-1j * line.order * tried)
            gain += line.weight * (np.abs(before[:-1, None] + behind) ** 2 - np.abs(before[-1]) ** 2)
        place, angle = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[place, angle] < LEAST_GAIN:
            break
        slip = float((tried[angle] + np.pi) % (2 * np.pi) - np.pi)
        found.append((int(place) + 1, slip))
        turned[int(place) + 1 :] += slip
    return found
