"""What depends on the signals themselves: a fan, a field that the current weakens, brushes whose drop rounds off.

Each is a voltage, a torque or an error of a sensor that is a known function of current and speed, times a size. Of a
linear motor, what it adds to the signals is the response to that function of the signals as they are: a fixed point,
which every renewal of the columns comes nearer to.
"""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.drive import MOST_BRUSH, MOST_SAG, ROUNDED, is_of_one_size, usual_drop
from estimator.explaining.effects.voltage_rise import NOISY
from estimator.fitting.fit import Fit, Linear, refreshed
from estimator.fitting.motor_response import as_late, beside_current, motor_values, response, speed_of
from estimator.fitting.score_test import ScoreTest, likeliest
from estimator.motor.winding import time_constant
from estimator.plans.part import LONG
from estimator.recordings.signal_noise import input_noise

FloatArray = NDArray[np.float64]

BRUSH = "brush"  # the nuisance parameter of a drop that does not round off
USUAL_LOAD = 0.3  # of the torque of the motor at its largest speed: a fan
USUAL_CHANGE = 0.05  # part by which K or L falls at the largest current, and by which two gains differ
USUAL_SAG = 0.05  # of the largest voltage, at the largest current
USUAL_EDDY, MOST_EDDY = 0.05, 0.5  # of the winding's conductance, R
BEFORE, BEHIND = 0, 1  # forms: when a sample is taken in its row, seen from the change of the voltage
MOST_CURVE = 0.3  # part by which the largest current is shown too small
POWERS = (1, 2)  # of the current, with which K may fall
MOST_CHANGE = 0.8  # part by which K or L falls at the largest current
FINE = 8  # currents from one to 1.6 times it
HALF_AT = tuple(0.005 * 1.6 ** (k / FINE) for k in range(11 * FINE + 1))  # of the largest, where half of the drop is
NODES, WEIGHTS = (0.5 * (x + shift) for x, shift in zip(np.polynomial.legendre.leggauss(4), (1, 0), strict=True))
MOST_DECAY = 30.0  # time constants of a winding in a row: with more the current is where it tends to
SETTLING = 40  # rounds in which a current settles beside a drop, at most
SETTLED = 1e-4  # of the largest current: a change of no matter
SMALL = 1e-4  # of the current at half of the drop: over which its steepness is told
APART, FAR = 2, 4  # of these currents: those by which the spread of a drop's forms is told; times 1.6 away, at most
LITTLE = 1e-3  # of the largest variance: what a spread has less of is left out


Form = Callable[[FloatArray], FloatArray]
FORMS: tuple[Form, ...] = (  # of a drop that levels off, half of it at 1
    lambda x: 1 - np.exp2(-x),
    lambda x: x / (1 + x),
    lambda x: 2 / np.pi * np.arctan(x),
    lambda x: np.tanh(np.arctanh(0.5) * x),
)


@dataclass(frozen=True)
class OfSignals(Effect):
    """Columns that follow the signals as they are explained, what these columns add to them included."""

    prior: float = SELDOM

    @abstractmethod
    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield groups of columns by the current, A, and the speed, rad/s, (rows,) each; None: it is not measured."""

    def linear(self, fit: Fit) -> Sequence[Linear]:
        """Return them by the signals that are simulated."""
        return list(self._of(fit, fit.once(_before_sensors).shown))

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the group by the signals that are simulated and what it adds."""
        shown = fit.once(_before_sensors).shown + group.columns @ coefficients
        return next((g for g in self._of(fit, shown) if g.name == group.name and g.form == group.form), None)

    def _of(self, fit: Fit, shown: FloatArray) -> Iterator[Linear]:
        if motor_values(fit) is None or not np.isfinite(shown).all():
            return
        outputs = fit.simulator.outputs
        i = shown[:, outputs.index("i")] if "i" in outputs else None
        yield from self.columns(fit, i, speed_of(fit, shown))


def _before_sensors(fit: Fit) -> Fit:
    """Return the fit with the signals as they are, not as filters and means show them."""
    s, values = fit.simulator, fit.values.copy()
    for n in (n for n in s.nuisances if n.act is not None):
        values[s.index[n.name]] = n.neutral
    if np.array_equal(values, fit.values):
        return fit
    return dataclasses.replace(fit, values=values, shown=s.shown(values[None, :])[0])


@dataclass(frozen=True)
class FanLoad(OfSignals):
    """A torque that grows as the square of the speed: a fan, a pump, what the air takes, N.m at 1 rad/s."""

    name: str = "fan load"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield one of all recordings."""
        values, top = motor_values(fit), 0.0 if w is None else float(np.max(np.abs(w)))
        if values is None or w is None or not top > 0:
            return
        size = USUAL_LOAD * values["B"] / top
        if i is not None:
            size = max(size, USUAL_LOAD * values["K"] * float(np.median(np.abs(i))) / top**2)
        shown = response(fit, torque=_within_rows(fit, lambda _, w: w * np.abs(w), i, w)[1])[:, :, None]
        yield Linear(self.name, shown, ("N.m.s2/rad2",), least=0.0, size=size)

    sentence: str = "a load takes {value:.3g} N.m.s2/rad2 times the square of the speed, such as a fan"


@dataclass(frozen=True)
class FieldWeakens(OfSignals):
    """A constant K that falls with the size of the current, by a part at the largest one (armature reaction).

    In proportion to it or to its square, which is not known: halfway between, as uncertain as both are apart.
    """

    name: str = "K falls with the current"
    sentence: str = "K falls by {percent:.3g} % up to the largest current; K stands for that without current"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield one of all recordings."""
        values, peak = motor_values(fit), 0.0 if i is None else float(np.max(np.abs(i)))
        if values is None or i is None or w is None or not peak > 0:
            return

        k = values["K"]

        def emf(power: int, i: FloatArray, w: FloatArray) -> FloatArray:
            return k * (np.abs(i) / peak) ** power * w

        def torque(power: int, i: FloatArray, w: FloatArray) -> FloatArray:
            return k * (np.abs(i) / peak) ** power * i

        shown = []
        for power in POWERS:
            less = _within_rows(fit, partial(emf, power), i, w)[0], _within_rows(fit, partial(torque, power), i, w)[1]
            shown.append(response(fit, voltage=less[0], torque=less[1])[:, :, None])
        mean, half = 0.5 * (shown[0] + shown[1]), 0.5 * (shown[0] - shown[1])
        yield Linear(self.name, mean, ("",), least=0.0, most=MOST_CHANGE, size=USUAL_CHANGE, uncertain=half)


@dataclass(frozen=True)
class Saturation(OfSignals):
    """An inductance that falls in proportion to the current, by a part at the largest one: iron that saturates."""

    name: str = "L falls with the current"
    doubt: str = "the winding's iron saturates: which current the inductance holds at is not known"
    sentence: str = "L falls by {percent:.3g} % up to the largest current; L stands for that without current"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield one of all recordings, where L is estimated."""
        values, peak = motor_values(fit), 0.0 if i is None else float(np.max(np.abs(i)))
        if values is None or i is None or not peak > 0 or "L" not in fit.free:
            return
        voltage = np.zeros_like(i)
        for clock in fit.simulator.clocks:  # of half the square of the current, within a row
            half = 0.5 * i[clock.rows] * np.abs(i[clock.rows]) / peak
            voltage[clock.rows] = values["L"] * np.append(np.diff(half) / np.diff(clock.time), 0.0)
        shown = response(fit, voltage=voltage)[:, :, None]
        yield Linear(self.name, shown, ("",), least=0.0, most=MOST_CHANGE, size=USUAL_CHANGE)


@dataclass(frozen=True)
class TwoGains(OfSignals):
    """A sensor of the current whose gain differs by direction, a part: two half bridges, each with its own shunt.

    Which of both is right is not known.
    """

    name: str = "gain by direction of i"
    doubt: str = "the current sensor has another gain in each direction: check its scale"
    sentence: str = "the gain of the current differs by {percent:.3g} % between its directions"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield one of all recordings, where the current flows both ways."""
        if i is None or "gain i" in fit.simulator.plan.declared:
            return
        i = fit.shown[:, fit.simulator.outputs.index("i")]  # as filters show it
        top, bottom = float(np.max(i)), float(np.min(i))
        if min(top, -bottom) < 0.1 * max(top, -bottom):
            return
        columns, uncertain = (np.zeros((*fit.shown.shape, 1)) for _ in range(2))
        j = fit.simulator.outputs.index("i")
        columns[:, j, 0], uncertain[:, j, 0] = 0.5 * np.abs(i), 0.5 * i
        yield Linear(
            self.name, columns, ("",), least=-MOST_CHANGE, most=MOST_CHANGE, size=USUAL_CHANGE, uncertain=uncertain
        )


@dataclass(frozen=True)
class SensorCurve(OfSignals):
    """A sensor of the current that shows large ones too small, by a part of them at the largest: it saturates slowly.

    Symmetric, so the first term of its series is of third order. The gain is right for small currents.
    """

    name: str = "curve of i"
    sentence: str = "the current's sensor shows {percent:.3g} % less at the largest current: it saturates"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield one of all recordings."""
        peak = 0.0 if i is None else float(np.max(np.abs(i)))
        if i is None or w is None or not peak > 0:
            return
        columns = np.zeros((*fit.shown.shape, 1))
        columns[:, fit.simulator.outputs.index("i"), 0] = -i * (i / peak) ** 2
        yield Linear(self.name, columns, ("",), least=0.0, most=MOST_CURVE, size=USUAL_CHANGE)


@dataclass(frozen=True)
class SagOfPulses(OfSignals):
    """A supply's resistance, Ohm, behind a bridge that connects it for a part of the time, as pulses do.

    A bridge that gives the part d of the supply's voltage draws d i from it: the motor has d (E - R d i), and of the
    resistance d² is in series. With E the largest command.
    """

    name: str = "sag by pulses"
    sentence: str = "the supply behind the bridge sags: at the largest command {value:.3g} Ohm of it are in series"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield one of all recordings, where the command has several sizes."""
        s = fit.simulator
        v, peak = s.inputs("v"), 0.0 if i is None else float(np.max(np.abs(i)))
        largest = float(np.max(np.abs(v), initial=0.0))
        measured = any(input_noise(o.inputs["v"]) > NOISY * largest for o in s.observed)
        if i is None or not peak > 0 or not largest > 0 or measured or is_of_one_size(v):
            return
        part = as_late(fit, np.square(v / largest))
        voltage, _ = _within_rows(fit, lambda i, _: -i, i, None)
        most, size = MOST_SAG * largest / peak, USUAL_SAG * largest / peak
        columns = response(fit, voltage=part * voltage)[:, :, None]
        yield Linear(self.name, columns, ("Ohm",), least=0.0, most=most, size=size)


@dataclass(frozen=True)
class EddyCurrents(OfSignals):
    """A conductance beside the inductance, A/V: eddy currents in its iron. What flows there jumps with the voltage.

    A sample of the current is taken before the voltage's change in its row, or behind it.
    """

    name: str = "eddy currents"
    sentence: str = "beside the inductance {value:.3g} A flow for each volt across it: eddy currents in its iron"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield both forms, of all recordings."""
        if i is not None and w is not None and "L" in fit.free:
            yield from (self._of_conductance(fit, i, w, 0.0, form) for form in (BEFORE, BEHIND))

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the same form by the signals that are simulated and what it adds."""
        shown = fit.once(_before_sensors).shown + group.columns @ coefficients
        w = speed_of(fit, shown)
        assert w is not None
        i = shown[:, fit.simulator.outputs.index("i")]
        return self._of_conductance(fit, i, w, float(coefficients[0]), group.form)

    def _of_conductance(self, fit: Fit, i: FloatArray, w: FloatArray, g: float, form: int) -> Linear:
        """Return what 1 A/V changes, by the current that flows with g of it: that of the inductance does not jump."""
        values, clocks = motor_values(fit), fit.simulator.clocks
        assert values is not None
        (r, k), v = (values[name] for name in "RK"), as_late(fit, fit.simulator.inputs("v"))
        there = v if form == BEHIND else np.concatenate([np.append(v[c.rows][:1], v[c.rows][:-1]) for c in clocks])
        inside = i - g * (there - r * i - k * w)
        mean_i, _ = _within_rows(fit, lambda i, _: i, inside, w)
        mean_w, _ = _within_rows(fit, lambda _, w: w, inside, w)
        across = (v - r * mean_i - k * mean_w) / (1 + g * r)
        own = beside_current(fit, (there - r * inside - k * w) / (1 + g * r))
        moved = response(fit, voltage=-r * across, torque=-k * across)
        return Linear(
            self.name, (moved + own)[:, :, None], ("A/V",), least=0.0, most=MOST_EDDY / r, size=USUAL_EDDY / r,
            one_of=2, form=form,
        )  # fmt: skip


@dataclass(frozen=True)
class RoundedDrop(OfSignals):
    """A drop of the brushes, V, that grows with the current and levels off. In which form is not known, but roughly."""

    name: str = ROUNDED
    prior: float = 0.1
    follows: bool = True
    sentence: str = "the brushes drop up to {value:.3g} V, rounded off at small currents"

    def columns(self, fit: Fit, i: FloatArray | None, w: FloatArray | None) -> Iterator[Linear]:
        """Yield some forms, half of the drop at a current each; none beside a drop as it is, or of a long recording."""
        yield from self._of_forms(fit, i, range(FINE, len(HALF_AT), 2 * FINE), FORMS[::3])

    def _of_forms(
        self, fit: Fit, i: FloatArray | None, halves: Sequence[int], forms: Sequence[Form]
    ) -> Iterator[Linear]:
        peak = 0.0 if i is None else float(np.max(np.abs(i)))
        if i is None or not peak > 0 or BRUSH in fit.free or fit.simulator.rows > LONG:
            return
        size = usual_drop(float(np.max(np.abs(fit.simulator.inputs("v")))))
        tried = [(half, form) for half in halves for form in forms]
        shown = _drops(fit, i, [(HALF_AT[half] * peak, form) for half, form in tried])
        for k, (half, form) in enumerate(tried):
            yield Linear(
                self.name, shown[:, :, k : k + 1], ("V",), least=0.0, most=MOST_BRUSH * size, size=size,
                one_of=len(tried), form=FORMS.index(form) + len(FORMS) * half,
            )  # fmt: skip

    def renewed(self, fit: Fit, group: Linear, coefficients: FloatArray) -> Linear | None:
        """Return the form that explains most beside all else, and how far it is not known.

        The first was found by other values of the motor.
        """
        shown = fit.once(_before_sensors).shown + group.columns @ coefficients
        i = shown[:, fit.simulator.outputs.index("i")]
        test = refreshed(fit, dataclasses.replace(fit.whitener, shared=None)).test()
        halves = range(0, len(HALF_AT), FINE)
        for apart in (FINE // 2, FINE // 4, FINE // 8, 1):  # ever finer about the best
            found = list(self._of_forms(fit, i, halves, FORMS))
            if not found:
                return None
            best = found[likeliest(*test.scores(np.concatenate([g.columns for g in found], axis=2)))]
            near = best.form // len(FORMS)
            halves = range(max(near - apart, 0), min(near + apart, len(HALF_AT) - 1) + 1, apart)
        half, form = HALF_AT[near] * float(np.max(np.abs(i))), FORMS[best.form % len(FORMS)]
        i = _settled_current(fit, i, float(coefficients[0]), (half, form))
        about = [k for k in range(near % APART, len(HALF_AT), APART) if abs(k - near) <= FINE * FAR]
        others = [g.columns for g in self._of_forms(fit, i, about, FORMS)]
        own = _drops(fit, i, [(half, form)])
        return dataclasses.replace(best, columns=own, uncertain=_spread(test, own, np.concatenate(others, axis=2)))


def _spread(test: ScoreTest, own: FloatArray, others: FloatArray) -> FloatArray | None:
    """Return deviations of columns, (rows, q, k), by what explains nearly as much in their place, (rows, q, c).

    None: there are none, as of columns that explain nothing.
    """
    along, power = test.scores(np.concatenate([own, others], axis=2))
    sizes = np.where(power > 0, along / np.maximum(power, 1e-300), 0.0)
    if not sizes[0] > 0:
        return None
    excess = max(1.0, float(test.left @ test.left) / len(test.left))
    gains = np.where(sizes > 0, along * sizes, 0.0)[1:] / excess
    weights = np.exp(0.5 * (gains - max(float(np.max(gains)), 0.0)))
    away = np.sqrt(weights / np.sum(weights)) * (others * (sizes[1:] / sizes[0]) - own)
    scale = np.maximum(np.max(np.abs(own), axis=0), 1e-300)  # of each output
    flat = (away / scale).reshape(-1, away.shape[2])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    some = values > max(LITTLE * values[-1], 0.0)
    return np.asarray(away @ vectors[:, some]) if some.any() else None


def _settled_current(fit: Fit, i: FloatArray, drop: float, found: tuple[float, Form]) -> FloatArray:
    """Return the current, (rows,), that flows with a drop, V, of a form: what it takes off the current lessens it.

    Where half of the drop is reached at a small current, it acts as a resistance far above the winding's: what it takes
    off a current would change its sign. So a current is moved a part of the way to what it leads to, at each instant as
    if the motor were settled, again and again.
    """
    values, j = motor_values(fit), fit.simulator.outputs.index("i")
    assert values is not None
    half, form = found
    plain = fit.once(_before_sensors)
    for _ in range(SETTLING):
        leads_to = plain.shown[:, j] + drop * _drops(plain, i, [found])[:, j, 0]
        x = np.abs(i) / half
        steepness = drop * (form(x + SMALL) - form(x)) / (SMALL * half) / values["R"]
        change = (leads_to - i) / (1 + steepness)
        i = i + change
        if np.max(np.abs(change)) < SETTLED * np.max(np.abs(i)):
            break
    return i


def _drops(fit: Fit, i: FloatArray, forms: Sequence[tuple[float, Form]]) -> FloatArray:
    """Return what drops of 1 V, each half of it at a current and of a form, change, (rows, q, k), by the current, A."""
    voltages, _ = _within_rows(
        fit, lambda i, _: np.column_stack([-np.sign(i) * form(np.abs(i) / half) for half, form in forms]), i, None
    )
    return response(fit, voltage=voltages)


def _within_rows(
    fit: Fit, function: Callable[[FloatArray, FloatArray], FloatArray], i: FloatArray | None, w: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return a function of current and speed as it is held from each row to the next, as a voltage and as a torque.

    Between two rows the speed is on a line; the current, and what a voltage leaves of it, decay as the winding does.
    """
    values = motor_values(fit)
    assert values is not None
    rows = fit.simulator.rows
    i, w = (np.zeros(rows) if x is None else x for x in (i, w))
    mean = np.zeros((2, *function(i, w).shape))
    for clock in fit.simulator.clocks:
        decays = min(clock.step / time_constant(values["R"], values["L"]), MOST_DECAY)
        after = [np.append(x[clock.rows][1:], x[clock.rows][-1]) for x in (i, w)]
        left = WEIGHTS * np.exp(-decays * (1 - NODES))
        for node, *weights in zip(NODES, left / left.sum(), WEIGHTS, strict=True):
            part = np.expm1(-decays * node) / np.expm1(-decays)
            now = (
                x[clock.rows] + share * (y - x[clock.rows])
                for x, y, share in zip((i, w), after, (part, node), strict=True)
            )
            told = function(*now)
            for k, weight in enumerate(weights):
                mean[k][clock.rows] += weight * told
    return mean[0], mean[1]
