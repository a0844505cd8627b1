"""Ripple of the driver's switching (PWM) in the current: lines of a fixed frequency, aliased by the sampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import STANDS_OUT
from estimator.explaining.effects.base import USUAL, StandingLine
from estimator.explaining.effects.shaft_order import angle_of, orders_in, standing_out
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.windows import find_windows
from estimator.noise.clock import interval_shown
from estimator.plans.plan import Plan
from estimator.recordings.samples import filled, median

FloatArray = NDArray[np.float64]

OVERSAMPLING = 4  # times the number of rows: frequencies that are tried
STRETCH_CYCLES = 8.0  # of the shortest stretch: a slower line is not distinguished from a misfit
STRETCH_ROWS = 32  # rows of a stretch that has an amplitude of its own
STRETCHES = 6  # at most
LINES_NEARBY, LINE_WIDTH = 60, 6  # frequencies on either side, whose median power judges a line; of these left out
MOST_SWITCHING_LINES, HARMONICS = 6, 12  # at most; of the first line, each aliased to its own frequency
ZOOMS = 7  # by 4 each
MOMENTS = 20  # of a line's expansion: the next is 1e-17 of the first where the phase at the ends turns by 1.05
SHAFT_ORDERS, WANDERS = 3, 0.08  # orders of an uneven shaft, which are no switching; part by which the speed varies
EVEN = 0.02  # of a step: a clock with a larger jitter aliases no line


@dataclass(frozen=True)
class SwitchingRipple(StandingLine):
    """Cosine and sine of one frequency, of an amplitude and phase of their own at each voltage."""

    name: str = "switching ripple"
    prior: float = USUAL / 1000  # of a thousand frequencies one

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return the current's strongest line, where one stands out; then the strongest of its harmonics too."""
        s = fit.simulator
        if "i" not in s.outputs or "v" not in s.observed[0].inputs:
            return ()
        j = s.outputs.index("i")
        windows, stretches = find_windows(fit), stretches_of_voltage(fit)
        later = windows.settled.copy()
        for rows, _ in stretches:
            if np.sum(later[rows]) < max(STRETCH_ROWS, len(rows) // 2):
                later[rows] = ~windows.sharp[rows]  # a misfit there is slow, and no line
        z = np.where(later[:, None], standing_out(fit), 0.0)
        taken = [float(g.name.split()[3]) for g in fit.linear if g.name.startswith("ripple i at ")]
        parts = [(t, z[rows, j]) for rows, t in stretches if np.sum(later[rows]) >= STRETCH_ROWS]
        if len(taken) >= MOST_SWITCHING_LINES or not parts:
            return ()
        seen = [later[rows] & fit.whitener.present[rows, j] for rows, _ in stretches]
        lines = strongest_lines(parts, s.clocks[0].step, taken, max(map(interval_shown, seen)))
        if not taken and lines and _is_the_shafts(lines[0], fit, stretches):
            return ()
        unit = s.plan.unit("i")
        found = []
        for f in lines:
            columns = np.zeros((s.rows, len(s.outputs), 2 * len(stretches)))
            for e, (rows, time) in enumerate(stretches):
                for part, wave in enumerate((np.cos, np.sin)):
                    columns[rows, j, 2 * e + part] = wave(2 * np.pi * f * time)
            told = [
                c for c in range(columns.shape[2]) if _is_wave(columns[:, j, c], stretches[c // 2][0][seen[c // 2]])
            ]
            if told:
                found.append(Linear(f"ripple i at {f:.6g} Hz", columns[:, :, told], (unit,) * len(told)))
        return found

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say where the line lies, and how large it is."""
        return f"i has a ripple at {name.split()[3]} Hz, as sampled, of amplitude {value:.3g} A: the driver's switching"


def _is_wave(column: FloatArray, rows: NDArray[np.int64]) -> bool:
    """Whether a line is seen as a wave: its mean square is 1/2; where a sensor shows every fourth row it may be 0."""
    return len(rows) >= STRETCH_ROWS // 2 and float(np.var(column[rows])) > 0.25


def _is_the_shafts(f: float, fit: Fit, stretches: Sequence[tuple[NDArray[np.int64], FloatArray]]) -> bool:
    """Whether a line, Hz, lies near a low order of the shaft, or near one that is known: its speed wanders a little."""
    theta = angle_of(fit, "i")
    if theta is None:
        return False
    orders = {*range(1, SHAFT_ORDERS + 1), *orders_in(fit, "i")}
    turning = [abs(theta[rows[-1]] - theta[rows[0]]) / (2 * np.pi * (t[-1] - t[0])) for rows, t in stretches]
    return any(abs(f - k * x) < WANDERS * k * x for x in turning for k in orders)


def strongest_lines(
    parts: Sequence[tuple[FloatArray, FloatArray]], step: float, taken: Sequence[float], every: int
) -> list[float]:
    """Return the frequency, Hz, of the line that stands out most, and that of the strongest harmonic of the first.

    Parameters
    ----------
    parts : times, s, and whitened residuals, (n,) arrays
    taken : frequencies of lines that are known
    every : int
        Rows for one that shows the current: above half of that rate are images only, of slow misfits too.
    """
    size = OVERSAMPLING * int(2 ** np.ceil(np.log2(max(len(own) for _, own in parts))))
    power = np.sum([2 * np.abs(np.fft.rfft(own, size)) ** 2 / len(own) for _, own in parts], axis=0)
    frequency = np.fft.rfftfreq(size, step)
    cycle = 1 / (step * min(len(own) for _, own in parts))  # Hz
    power[(frequency < STRETCH_CYCLES * cycle) | (frequency > 0.5 / (every * step))] = 0.0
    for known in taken:
        power[np.abs(frequency - known) < 2 * cycle] = 0.0
    found = []
    k = int(np.argmax(power))
    near = np.r_[power[max(0, k - LINES_NEARBY) : max(0, k - LINE_WIDTH)], power[k + LINE_WIDTH + 1 : k + LINES_NEARBY]]
    if np.any(near > 0) and power[k] > STANDS_OUT * median(near[near > 0]):
        found.append(sharpened(float(frequency[k]), float(frequency[1]), parts))
    if taken:
        folded = np.arange(2, HARMONICS + 1) * taken[0] * every * step
        folded = np.abs(folded - np.round(folded)) / (every * step)
        usable = [f for f in folded if f > 2 * cycle and all(abs(f - known) > cycle for known in (*taken, *found))]
        found += [max(usable, key=lambda f: float(_powers(np.array([f]), parts)[0]))] if usable else []
    return found


def _powers(frequencies: FloatArray, parts: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the power of lines, each of an amplitude of its own in every part."""
    turns = [np.exp(2j * np.pi * np.outer(frequencies, t)) @ own / np.sqrt(len(own)) for t, own in parts]
    return np.asarray(np.sum(np.abs(turns) ** 2, axis=0))


def sharpened(f: float, width: float, parts: Sequence[tuple[FloatArray, FloatArray]]) -> float:
    """Return the frequency, Hz, within a width of `f` at which a line explains most."""
    first, beside, moments = f, width, []
    for t, own in parts:  # sum of own e^(2 pi i f t), expanded about the first frequency: the turns beside it are small
        middle = 0.5 * (t[0] + t[-1])
        wave, turn = np.exp(2j * np.pi * f * t) * own / np.sqrt(len(own)), 2j * np.pi * width * (t - middle)
        told = [wave.sum()]
        for order in range(1, MOMENTS):
            wave = wave * turn / order
            told.append(wave.sum())
        moments.append(told)
    for _ in range(ZOOMS):
        near = f + width * np.linspace(-1, 1, 9)
        away = (near - first) / beside
        powers = np.sum([np.abs(np.polynomial.polynomial.polyval(away, told)) ** 2 for told in moments], axis=0)
        f, width = float(near[np.argmax(powers)]), width / 4
    return f


def stretches_of_voltage(fit: Fit) -> list[tuple[NDArray[np.int64], FloatArray]]:
    """Return rows at which a voltage is held, and their times, s, the longest ones; none where a clock wanders."""
    s = fit.simulator
    found = []
    for e, (o, clock) in enumerate(zip(s.observed, s.clocks, strict=True)):
        if np.ptp(np.diff(clock.time)) > 2 * EVEN * clock.step or abs(clock.step / s.clocks[0].step - 1) > 1e-6:
            return []
        v = filled(o.inputs["v"])
        late = max(0, round(fit.delay(e) / clock.step))
        edges = np.flatnonzero(np.abs(np.diff(v)) > 1e-9 * max(float(np.max(np.abs(v))), 1e-300)) + 1 + late
        bounds = [0, *edges[edges < len(v)].tolist(), len(v)]
        for first, last in zip(bounds[:-1], bounds[1:], strict=True):
            if last - first >= STRETCH_ROWS and v[max(first - late, 0)] != 0:
                rows = np.arange(clock.rows.start + first, clock.rows.start + last)
                found.append((rows, clock.time[first:last]))
    return sorted(found, key=lambda f: -len(f[0]))[:STRETCHES]
