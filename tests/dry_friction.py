"""A DC motor with dry friction and brushes, by scipy's solve_ivp from event to event. Knows nothing of the project.

Written from the physics, by cases: the shaft turns one way, 1, the other, -1, or is held, 0; so does the current.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]


def _way(x: float, push: float, hold: float) -> int:
    """Return which way something at rest, or moving at x, goes on; 1 where nothing could hold it."""
    if hold == 0:
        return 1
    if x != 0:
        return 1 if x > 0 else -1
    return 0 if abs(push) <= hold else (1 if push > 0 else -1)


class DryMotor:
    """The motor with parameters R, K, L, J, B, friction, stiction, brush; drag is that of a torque drag w |w|."""

    def __init__(self, parameters: dict[str, float], *, drag: float = 0.0) -> None:
        self.p, self.drag = parameters, drag
        self.breakaway = parameters["friction"] + parameters["stiction"]
        self.x = [0.0, 0.0, 0.0]  # i, w, angle
        self.shaft = self.brushes = 0

    def response(self, voltages: Sequence[float], loads: Sequence[float], *, step: float) -> Vector:
        """Return i [A], w [rad/s] and angle [rad] after each step over which voltage [V] and load [N.m] are held."""
        rows = []
        for voltage, load in zip(voltages, loads, strict=True):
            self._step(float(voltage), float(load), step)
            rows.append(list(self.x))
        return np.array(rows)

    def _step(self, v: float, load: float, step: float) -> None:
        p, time = self.p, 0.0

        def push_on_shaft(x: Sequence[float]) -> float:
            return p["K"] * x[0] - load

        def push_on_current(x: Sequence[float]) -> float:
            return v - p["K"] * x[1]

        while time < step:
            self.shaft = self.shaft or _way(self.x[1], push_on_shaft(self.x), self.breakaway)
            self.brushes = self.brushes or _way(self.x[0], push_on_current(self.x), p["brush"])
            shaft, brushes = self.shaft, self.brushes

            def rates(_: float, x: Vector, shaft: int = shaft, brushes: int = brushes) -> list[float]:
                i, w, _angle = x.tolist()
                voltage = v - p["R"] * i - p["K"] * w - brushes * p["brush"]
                torque = p["K"] * i - p["B"] * w - self.drag * w * abs(w) - load - shaft * p["friction"]
                return [voltage / p["L"] if brushes else 0.0, torque / p["J"] if shaft else 0.0, w]

            events = [
                _event(1, shaft, push_on_shaft, self.breakaway),
                _event(0, brushes, push_on_current, p["brush"]),
            ]
            run = solve_ivp(rates, (time, step), self.x, method="DOP853", rtol=1e-12, atol=1e-14, events=events)
            self.x, time = [float(value) for value in run.y[:, -1]], float(run.t[-1])
            if run.status == 0:
                return
            if len(run.t_events[0]):
                self.shaft = self._turn(1, shaft, push_on_shaft(self.x), self.breakaway)
            if len(run.t_events[1]):
                self.brushes = self._turn(0, brushes, push_on_current(self.x), p["brush"])

    def _turn(self, place: int, way: int, push: float, hold: float) -> int:
        """Return which way it goes on: what was held is let go, what moved is at rest and held or turned round."""
        if way == 0:
            return 1 if push > 0 else -1
        self.x[place] = 0.0
        return _way(0.0, push, hold)


def _event(
    place: int, way: int, push: Callable[[Sequence[float]], float], hold: float
) -> Callable[[float, Vector], float]:
    def event(_: float, x: Vector) -> float:
        if hold == 0:
            return 1.0
        # past its end by what rounding could undo, or it would be held and let go for ever
        return way * float(x[place]) + 1e-13 if way else hold * (1 + 1e-12) - abs(push(x))

    event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
    return event
