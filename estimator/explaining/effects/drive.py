"""Nonlinear effects of drive, supply, brushes and bearings, through the bundled FMU dc_motor_drive."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import COASTS, ONE_WAY
from estimator.fitting.simulator import Nuisance, per_recording
from estimator.plans.plan import Observed, Plan
from estimator.recordings.samples import filled, median, median_of_known, told_once
from estimator.recordings.signal_noise import input_noise, noise_deviation

DRIVE = "dc_motor_drive"
ROUNDED = "rounded brush drop"  # the effect that stands in the place of a drop of brushes as it is
MOST_BRUSH = 5.0  # times its usual size: more is no drop of brushes
MOST_SAG = 0.4  # of the voltage at the largest current: more is an overload, or the winding's resistance
TRIED = 0.005  # of a usual size: so near signals change in proportion
ONE_SIZE = 0.01  # voltages that differ by less, in parts, are of one size
_usual = told_once(median_of_known)  # each of these effects asks for that of the current
PLATEAU, HELD_ROWS, ABOVE = 3.0, 8, 1.2  # deviations; rows; times the usual current: a current that stays at its peak


def is_of_one_size(v: NDArray[np.float64]) -> bool:
    """Return whether a voltage, (n,), has one size wherever it is on, but for its sensor's noise; or is never on."""
    sizes = np.abs(v)[np.abs(v) > 0.5 * np.max(np.abs(v), initial=0.0)]
    noise = float(input_noise(v)) if len(v) else 0.0
    return not len(sizes) or float(np.std(sizes)) < max(ONE_SIZE * float(np.mean(sizes)), 2 * noise)


def usual_drop(largest: float) -> float:
    """Return the voltage that carbon brushes drop, V, at most a part of the largest voltage."""
    return min(0.5, 0.05 * largest)


def _driven(o: Observed) -> NDArray[np.bool_]:
    """Return the rows of a recording, (n,), that have a voltage; where none is recorded, all."""
    v = o.inputs.get("v")
    return np.ones(len(o.recording.time), dtype=bool) if v is None or not np.any(v) else v != 0


def _torque(plan: Plan) -> float:
    """Return a torque, N.m, that is large for the motor: first estimate of its constant, times its usual current."""
    i = [np.abs(o.outputs["i"][_driven(o)]) for o in plan.observed if "i" in o.outputs]
    if any(x.size for x in i):
        usual = _usual(np.concatenate(i))
    else:  # a tenth of the current at standstill
        usual = 0.1 * plan.largest("v") / plan.guess.get("R", np.inf)
    return plan.guess.get("K", 0.0) * usual


@dataclass(frozen=True)
class Drive(Effect):
    """One parameter of dc_motor_drive, neutral in the linear motor; at most so many times its largest size."""

    fmu: str = DRIVE
    target: str = ""
    unit: str = ""
    needs: str = ""
    most: float = 20.0
    sentence: str = "{name} is {value:.3g} {unit}"
    torques: tuple[float, ...] = ()  # sizes to try, of the torque of the usual current

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the parameter, with sizes from the recordings."""
        sizes = self.sizes(plan)
        if not sizes or sizes[0] <= 0:
            return ()
        return [
            Nuisance(
                self.target, self.unit, 0.0, self.most * max(sizes), 0.0, 0.1 * sizes[0],
                target=self.target, tries=sizes, needs=self.needs,
            )
        ]  # fmt: skip

    def sizes(self, plan: Plan) -> tuple[float, ...]:
        """Return sizes to try."""
        return tuple(part * _torque(plan) for part in self.torques)

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say how large."""
        return self.sentence.format(name=name, value=value, unit=self.unit)


@dataclass(frozen=True)
class DryFriction(Drive):
    """Coulomb friction."""

    name: str = "dry friction"
    target: str = "friction"
    unit: str = "N.m"
    sentence: str = "the motor has a dry friction of {value:.3g} {unit} beside the viscous one"
    torques: tuple[float, ...] = (0.3, 0.8)


@dataclass(frozen=True)
class BreakAway(Drive):
    """Friction that is larger at standstill: there is dry friction, then."""

    name: str = "break-away"
    prior: float = 0.05
    target: str = "stiction"
    unit: str = "N.m"
    needs: str = "friction"
    sentence: str = "the motor breaks away at a torque that is {value:.3g} {unit} above its dry friction"
    torques: tuple[float, ...] = (0.1, 0.5, 2.0)


@dataclass(frozen=True)
class StribeckFriction(Drive):
    """Friction that is larger at rest and falls while the motor gathers speed (Armstrong-Hélouvry et al. 1994)."""

    name: str = "Stribeck friction"
    prior: float = 0.1
    target: str = "stribeck_torque"
    unit: str = "N.m"
    speed_target: str = "stribeck_speed"
    sentence: str = "the friction is {value:.3g} {unit} larger at rest, and falls while the motor gathers speed"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the torque at rest beside dry friction, and the speed at which it has fallen."""
        torque, top = _torque(plan), plan.largest("w")
        if not torque or not top:
            return ()
        together = tuple({self.speed_target: part * top} for part in (0.02, 0.06, 0.18))
        return [
            Nuisance(self.target, self.unit, 0.0, self.most * torque, 0.0, 0.1 * torque, target=self.target,
                     tries=(TRIED * torque,) * len(together), together=together, needs="friction", usual=0.3 * torque),
            Nuisance(self.speed_target, "rad/s", 1e-3 * top, 0.5 * top, 0.06 * top, 0.01 * top, log=True,
                     target=self.speed_target),
        ]  # fmt: skip


@dataclass(frozen=True)
class BrushDrop(Drive):
    """Voltage that drops over the brushes."""

    name: str = "brush drop"
    target: str = "brush"
    unit: str = "V"
    most: float = MOST_BRUSH
    sentence: str = "the brushes drop {value:.3g} {unit}"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the drop: after steps from rest to one voltage it is a gain of the voltage, which nothing tells.

        Of one voltage both ways only the rows in which the current still flows the other way tell it.
        """
        levels = [level for o in plan.observed if (level := self._one_level(o))]
        alike = len(levels) == len(plan.observed) and max(levels) - min(levels) < ONE_SIZE * max(map(abs, levels))
        found = [dataclasses.replace(n, excludes=(ROUNDED,)) for n in super().nuisances(plan)]
        # By its derivative: at its usual size the response is no longer linear in it, and would seem to tell it.
        of_slope = [dataclasses.replace(n, tries=(TRIED * n.tries[0],), usual=n.tries[0], untold=alike) for n in found]
        voltages = [o.inputs["v"] for o in plan.observed if "v" in o.inputs]
        one_size = is_of_one_size(np.concatenate(voltages)) if voltages else False
        return of_slope if alike or one_size else found

    @staticmethod
    def _one_level(o: Observed) -> float:
        """Return the voltage that a motor is switched to from rest, where no other drives it; 0: others do."""
        e = o.excitation
        if e.kind == "step" and not e.running and abs(e.before) < ONE_SIZE * abs(e.after):
            return e.after
        v = o.inputs.get("v")
        if v is None or not coasts_in(o, np.ones(len(v), dtype=bool)) or not is_of_one_size(v):
            return 0.0
        on = v[np.abs(v) > 0.5 * np.max(np.abs(v))]
        return float(np.mean(on)) if len(on) and (np.all(on > 0) or np.all(on < 0)) else 0.0

    def sizes(self, plan: Plan) -> tuple[float, ...]:
        """Return the voltage drop of carbon brushes."""
        return (usual_drop(plan.largest("v")),)


@dataclass(frozen=True)
class CurrentLimit(Drive):
    """A drive that limits the current."""

    name: str = "current limit"
    target: str = "current_limit"
    unit: str = "A"
    sentence: str = "the drive limits the current to {value:.4g} {unit}"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the limit, at or a little below the largest current."""
        peak = plan.largest("i")
        if peak <= 0:
            return ()
        tries = tuple(part * peak for part in (0.98, 0.9, 0.8))
        return [
            Nuisance(
                self.target, self.unit, 0.2 * peak, 3 * peak, 3 * peak, 0.02 * peak,
                target=self.target, tries=tries, absolute=True,
            )
        ]  # fmt: skip

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return the level at which the current stays at its largest while the speed goes on rising."""
        levels = [level for o in plan.observed if (level := _plateau(o)) > 0]
        return {self.target: max(levels)} if levels else {}


def _plateau(o: Observed) -> float:
    """Return the current at which a recording stays for a while at its peak; 0: it does not."""
    if not {"i", "w"} <= set(o.outputs):
        return 0.0
    i, w = np.abs(filled(o.outputs["i"])), np.abs(filled(o.outputs["w"]))
    noise = max(noise_deviation(o.outputs["i"]), 1e-3 * float(np.max(i)))
    smooth = np.convolve(i, np.ones(3) / 3, mode="same")
    top = float(np.max(smooth))
    high = np.flatnonzero(smooth > top - max(PLATEAU * noise, 0.02 * top))
    runs = np.split(high, np.flatnonzero(np.diff(high) > 2) + 1)
    run = max(runs, key=len)
    flows = i[i > 4 * noise]
    if len(run) < HELD_ROWS or not len(flows) or top < ABOVE * median(flows):
        return 0.0
    rises = abs(float(w[run[-1]] - w[run[0]])) > 0.1 * float(np.max(w))
    third = len(run) // 3
    falls = abs(float(np.mean(i[run[:third]]) - np.mean(i[run[-third:]])))
    flat = falls < 2 * noise / np.sqrt(len(run) / 3) + 0.01 * top
    return float(np.median(i[run])) if rises and flat else 0.0


@dataclass(frozen=True)
class Coasting(Drive):
    """A drive that opens the circuit where its command is zero."""

    name: str = "coasting"
    target: str = COASTS
    sentence: str = "the circuit is open where the voltage is zero: the motor coasts"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the switch, where the voltage returns to zero or the motor is seen to coast.

        It is one of each recording where some are seen to coast and others return to no voltage and are not, or begin
        within a response and are never without voltage: their current in the first row would be none.
        """
        where = coasting_switches(plan)
        return [
            Nuisance(
                name, "", 0.0, 1.0, 0.0, 1.0, target=self.target, recording=e, tries=(1.0,), whole=True,
                excludes=(ONE_WAY,),
            )
            for name, e, _ in where
        ]  # fmt: skip

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return the switch where the current is zero at no voltage while the motor turns."""
        return {name: 1.0 for name, _, is_seen in coasting_switches(plan) if is_seen}

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return a drive that lets no current flow back, in its place."""
        return [{ONE_WAY: 1.0}] if name == self.target and ONE_WAY in fit.simulator.index else []

    def tell(self, name: str, value: float, plan: Plan) -> str:
        """Say that it does, and in which recording."""
        of = name.removeprefix(self.target).strip()
        return f"{of}: {self.sentence}" if of else self.sentence


def coasting_switches(plan: Plan) -> list[tuple[str, int | None, bool]]:
    """Return each switch of `Coasting`: name, recording, None for all, and whether the motor is seen to coast there."""
    seen = [coasts_in(o, np.ones(len(o.recording.time), dtype=bool)) for o in plan.observed]
    back = [_returns(o) for o in plan.observed]
    underway = [o.is_underway and not np.any(o.inputs.get("v", np.zeros(1)) == 0) for o in plan.observed]
    if any(seen) and (any(underway) or any(b and not s for b, s in zip(back, seen, strict=True))):
        names = per_recording(plan, COASTS)
        return [(names[e], e, s) for e, s in enumerate(seen) if s or back[e]]
    return [(COASTS, None, any(seen))] if any(seen) or any(back) else []


def _returns(o: Observed) -> bool:
    """Whether the voltage of a recording returns to zero."""
    v = o.inputs.get("v")
    return v is not None and bool(np.any((v[1:] == 0) & (v[:-1] != 0)))


def coasts_in(o: Observed, rows: NDArray[np.bool_]) -> bool:
    """Return whether a recording's motor is seen to turn without voltage and without current in some rows, (n,)."""
    if not {"i", "w"} <= set(o.outputs) or "v" not in o.inputs:
        return False
    w, i = filled(o.outputs["w"]), filled(o.outputs["i"])
    least = max(0.2 * float(np.max(np.abs(w))), 4 * noise_deviation(o.outputs["w"]))
    turning = rows & (o.inputs["v"] == 0) & (np.abs(w) > least)
    turning[1:] &= o.inputs["v"][:-1] == 0
    if np.sum(turning) < HELD_ROWS:
        return False
    away = np.sort(np.abs(i[turning]))[: int(0.8 * np.sum(turning))]
    return bool(np.median(away) < 0.02 * np.max(np.abs(i)) + 2 * noise_deviation(o.outputs["i"]))


@dataclass(frozen=True)
class Sag(Drive):
    """A supply whose voltage falls with the current, with the time constant of its capacitor.

    It stands behind a bridge, or is an amplifier: then it sags at any command, zero too.
    """

    name: str = "sag"
    target: str = "supply_resistance"
    unit: str = "Ohm"
    prior: float = 0.05
    sentence: str = "the supply sags: its resistance is {value:.3g} Ohm"
    time_target: str = "supply_time"
    series_target: str = "supply_series"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return resistance and time constant of the supply, and whether it is an amplifier where that shows."""
        v, i = plan.largest("v"), plan.largest("i")
        if i <= 0:
            return ()
        size = 0.1 * v / i
        duration = max(float(o.recording.time[-1] - o.recording.time[0]) for o in plan.observed)
        taus = [tau for tau in (0.003, 0.02, 0.1) if tau < 0.3 * duration]
        ways = (0.0, 1.0) if self._shows_series(plan) else (0.0,)
        together = tuple({self.time_target: tau, self.series_target: way} for way in ways for tau in taus)
        return [
            Nuisance(self.target, self.unit, 0.0, MOST_SAG * v / i, 0.0, 0.1 * size, target=self.target,
                     tries=(TRIED * size,) * len(together), together=together, usual=0.5 * size),
            Nuisance(self.time_target, "s", 1e-4, 10.0, 0.01, 0.01, log=True, target=self.time_target),
            Nuisance(self.series_target, "", 0.0, 1.0, 0.0, 1.0, target=self.series_target, whole=True),
        ]  # fmt: skip

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return the supply of the other kind, where that shows."""
        if not self._shows_series(fit.simulator.plan):
            return ()
        return [{self.series_target: 1.0 - fit.value(self.series_target)}]

    @staticmethod
    def _shows_series(plan: Plan) -> bool:
        """Whether a motor that is driven is then stopped, or turned back."""
        voltages = [o.inputs["v"] for o in plan.observed if "v" in o.inputs]
        return any(np.any((v[1:] * v[:-1] <= 0) & (v[:-1] != 0)) for v in voltages)


@dataclass(frozen=True)
class DeadBand(Drive):
    """A drive that gives no voltage for small commands."""

    name: str = "dead band"
    target: str = "dead_band"
    prior: float = 0.05
    sentence: str = "the drive gives no voltage for commands up to {value:.3g} V"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the threshold: it lies between two of the smallest voltages; where, is not determined."""
        levels = np.unique([abs(x) for o in plan.observed for x in np.unique(o.inputs.get("v", []))])
        levels = levels[levels > 0]
        tries = tuple(1.001 * float(x) for x in levels[:2]) if 2 < len(levels) <= 20 else ()
        threshold = Nuisance(self.target, "V", 0.0, 1e3, 0.0, 1.0, target=self.target, tries=tries, whole=True)
        return [threshold] if tries else []
