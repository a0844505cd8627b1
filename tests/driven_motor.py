"""A motor with dry friction behind a drive and a supply, by scipy's solve_ivp from event to event.

Written from the physics, by cases, as dry_friction.py is. Knows nothing of the project.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from dry_friction import DryMotor, _event, _way
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]
NEUTRAL = {
    "friction": 0.0,
    "stiction": 0.0,
    "brush": 0.0,
    "current_limit": 1e9,
    "limit_slope": 0.0,
    "dead_band": 0.0,
    "coasts": 0.0,
    "one_way": 0.0,
}
NEUTRAL |= {"stribeck_torque": 0.0, "stribeck_speed": 0.0}
NEUTRAL |= {"supply_resistance": 0.0, "supply_time": 0.0, "supply_series": 0.0}


class DrivenMotor(DryMotor):
    """The motor with parameters R, K, L, J, B and those of NEUTRAL."""

    def __init__(self, parameters: dict[str, float]) -> None:
        super().__init__(NEUTRAL | parameters)
        self.x = [0.0, 0.0, 0.0, 0.0]  # i, w, angle, sag
        self.limiting = 0
        self.breakaway += self.p["stribeck_torque"]

    def _step(self, v: float, load: float, step: float) -> None:  # noqa: C901 - a case for each effect
        p, time = self.p, 0.0
        way = 0 if abs(v) <= p["dead_band"] else (1 if v > 0 else -1)
        longest = step / 8 if p["limit_slope"] else np.inf  # its events are interpolated
        is_open, in_series = way == 0 and p["coasts"] == 1, p["supply_series"] == 1

        def terminal(x: Sequence[float]) -> float:
            loss = x[3] if p["supply_time"] else p["supply_resistance"] * (1 if in_series else way) * x[0]
            return way * abs(v) - loss if in_series else way * (abs(v) - loss)

        def push_on_shaft(x: Sequence[float]) -> float:
            return p["K"] * x[0] - load

        def push_on_current(x: Sequence[float]) -> float:
            return terminal(x) - p["K"] * x[1]

        def further(x: Sequence[float], sign: int) -> float:
            """Return the voltage that is left to drive the current further past its limit."""
            return sign * (push_on_current(x) - p["R"] * x[0]) - p["brush"]

        while time < step:
            self._choose(push_on_current(self.x), further, is_open, way)
            self.shaft = self.shaft or _way(self.x[1], push_on_shaft(self.x), self.breakaway)
            shaft, brushes, limiting = self.shaft, self.brushes, self.limiting

            def rates(
                _: float, x: Vector, shaft: int = shaft, brushes: int = brushes, limiting: int = limiting
            ) -> list[float]:
                i, w, _angle, sag = x.tolist()
                voltage = terminal([i, w, 0.0, sag]) - p["R"] * i - p["K"] * w - brushes * p["brush"]
                if limiting and p["limit_slope"]:
                    voltage -= (i - limiting * p["current_limit"]) / p["limit_slope"]
                x = abs(w) / p["stribeck_speed"] if p["stribeck_speed"] else 4.0
                left = p["stribeck_torque"] * (0.55 * max(1.0 - x, 0.0) + 0.45 * max(1.0 - x / 3.2, 0.0))
                torque = p["K"] * i - p["B"] * w - load - shaft * (p["friction"] + left)
                drawn = p["supply_resistance"] * (1 if in_series else way) * i
                charge = (drawn - sag) / p["supply_time"] if p["supply_time"] else 0.0
                flows = brushes and (not limiting or p["limit_slope"]) and not is_open
                return [voltage / p["L"] if flows else 0.0, torque / p["J"] if shaft else 0.0, w, charge]

            def at_limit(_: float, x: Vector, limiting: int = limiting) -> float:
                if limiting and p["limit_slope"]:
                    return limiting * float(x[0]) - p["current_limit"] * (1 - 1e-13)
                if limiting:
                    return further(list(map(float, x)), limiting) + 1e-12
                return p["current_limit"] * (1 + 1e-13) - abs(float(x[0]))

            at_limit.terminal, at_limit.direction = True, -1  # type: ignore[attr-defined]
            events = [
                _event(1, shaft, push_on_shaft, self.breakaway),
                _one_way_event(brushes, push_on_current, 0 if is_open else way, p["brush"])
                if p["one_way"]
                else _event(0, brushes, push_on_current, 0.0 if is_open else p["brush"]),
                at_limit,
            ]
            run = solve_ivp(
                rates, (time, step), self.x, method="DOP853", rtol=1e-12, atol=1e-14, max_step=longest, events=events
            )
            self.x, time = [float(value) for value in run.y[:, -1]], float(run.t[-1])
            if run.status == 0:
                return
            if len(run.t_events[0]):
                self.shaft = self._turn(1, shaft, push_on_shaft(self.x), self.breakaway)
            if len(run.t_events[1]) and p["one_way"]:
                self.brushes = 0 if brushes else way
                self.x[0] = 0.0
            elif len(run.t_events[1]):
                self.brushes = self._turn(0, brushes, push_on_current(self.x), p["brush"])
            if len(run.t_events[2]):
                self.limiting = 0 if limiting else (1 if self.x[0] > 0 else -1)
                if self.limiting and not p["limit_slope"]:
                    self.x[0] = self.limiting * p["current_limit"]

    def _choose(self, push: float, further: Callable[[Sequence[float], int], float], is_open: bool, way: int) -> None:
        """Choose what the circuit does from here on: open, stuck at the brushes, at the limit of the current."""
        if is_open:
            self.x[0], self.brushes, self.limiting = 0.0, 0, 0
            return
        if not self.p["one_way"]:
            self.brushes = self.brushes or _way(self.x[0], push, self.p["brush"])
        elif not self.brushes:
            self.brushes = way if way * push > self.p["brush"] else 0
        gives_way = self.p["limit_slope"] > 0
        if self.limiting and not gives_way and further(self.x, self.limiting) < 0:
            self.limiting = 0
        sign = 1 if self.x[0] > 0 else -1
        if not self.limiting and sign * self.x[0] >= self.p["current_limit"] and further(self.x, sign) > 0:
            self.limiting = sign


def _one_way_event(
    flows: int, push: Callable[[Sequence[float]], float], way: int, brush: float
) -> Callable[[float, Vector], float]:
    """Return the end of a current that flows, or of none: it begins the way of the command only."""

    def event(_: float, x: Vector) -> float:
        if flows:
            return flows * float(x[0]) + 1e-13
        return brush + 1e-12 - way * push(x) if way else 1.0

    event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
    return event
