"""Checks of the emulator itself: steady state, exact linear response, dry friction, determinism."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import emulate
import numpy as np
from plant import Motor, simulate, steady_state
from scipy.integrate import solve_ivp
from scipy.linalg import expm


def linear() -> float:
    """Return the largest relative difference between ideal recordings and the exact response, row by row."""
    worst = 0.0
    for seed in range(40):
        case = emulate.case(seed, ideal=True)
        p = case.truth
        a = np.array([[-p["R"] / p["L"], -p["K"] / p["L"]], [p["K"] / p["J"], -p["B"] / p["J"]]])
        for recording in case.recordings:
            if recording.excitation == "coast, open":
                continue
            time, volts, current, speed = recording.table.T
            current = current * (1e-3 if "mA" in recording.header[2] else 1)
            speed = speed / (emulate.RAD_TO_RPM if "rpm" in recording.header[3] else 1)
            x, states, cache = np.zeros(2), [], {}
            for step, v in zip(np.diff(time, append=2 * time[-1] - time[-2]), volts, strict=True):
                states.append(x)
                key = round(step * 1e9)
                if key not in cache:
                    cache[key] = expm(a * key * 1e-9)
                x_v = np.linalg.solve(a, [-v / p["L"], 0.0])
                x = x_v + cache[key] @ (x - x_v)
            model = np.array(states)
            for k, y in enumerate((current, speed)):
                worst = max(worst, float(np.max(np.abs(y - model[:, k])) / np.max(np.abs(y))))
    return worst


def settled() -> float:
    """Return the largest relative difference from the closed-form steady state, with and without dry friction."""
    worst = 0.0
    for dry in (0.0, 0.004, 0.02):
        m = Motor(R=2.0, K=0.05, L=1e-3, J=1e-5, B=2e-5, dry=dry)
        run = simulate(m, 1e-4, np.full(6000, 9.0))
        i, w = steady_state(m, 9.0)
        worst = max(worst, abs(run.current[-1] / i - 1), abs(run.speed[-1] / w - 1))
    return worst


def friction() -> float:
    """Compare step, reversal and zero, with dry friction and drag, against LSODA with events."""
    m = Motor(R=2.0, K=0.05, L=2e-3, J=1e-5, B=2e-5, dry=0.02, drag=2e-7, brush=0.3, brush_current=0.2)
    h, plan = 2e-5, ((0.05, 9.0), (0.05, -6.0), (0.08, 0.0))
    run = simulate(m, h, np.concatenate([np.full(round(d / h), v) for d, v in plan]))

    def rate(s: float, v: float) -> Callable[[float, np.ndarray], list[float]]:
        def f(_: float, x: np.ndarray) -> list[float]:
            i, w = x
            e = v - m.R * i - m.K * w - m.brush * np.tanh(i / m.brush_current)
            t = 0.0 if s == 0 else m.K * i - m.B * w - m.drag * abs(w) * w - m.dry * s
            return [e / m.L, t / m.J]

        return f

    def change(s: float) -> Any:
        def f(_: float, x: np.ndarray) -> float:
            return float(s * x[1] + 1e-9 if s else abs(m.K * x[0]) - m.dry * (1 + 1e-8))

        event: Any = f
        event.terminal, event.direction = True, -1 if s else 1
        return event

    x, clock, worst, s = np.zeros(2), 0.0, 0.0, 0.0
    for d, v in plan:
        end = clock + d
        while clock < end - 1e-12:
            if s == 0.0 and abs(m.K * x[0]) > m.dry * (1 + 1e-9):
                s = float(np.sign(x[0]))
            event = change(s)
            part: Any = solve_ivp(
                rate(s, v), (clock, end), x, "LSODA", rtol=1e-10, atol=1e-11, events=event, dense_output=True
            )
            rows = np.arange(int(np.ceil(part.t[0] / h - 1e-6)), min(len(run.time), int(part.t[-1] / h)))
            if len(rows):
                y = part.sol(rows * h)
                worst = max(
                    worst, np.max(np.abs(y[0] - run.current[rows])) / 4.5, np.max(np.abs(y[1] - run.speed[rows])) / 170
                )
            x, clock = part.y[:, -1].copy(), part.t[-1]
            if part.status == 1:
                if s:
                    x[1] = 0.0
                s = 0.0 if s else float(np.sign(x[0]))
    return float(worst)


def main() -> None:
    """Print the differences and assert that they are small."""
    a, b, c = linear(), settled(), friction()
    pairs = [
        (x, y) for n in (3, 8) for x, y in zip(emulate.case(n).recordings, emulate.case(n).recordings, strict=True)
    ]
    same = all(np.array_equal(x.table, y.table, equal_nan=True) for x, y in pairs)
    print(f"linear {a:.1e}, steady {b:.1e}, friction against LSODA {c:.1e}, same seed same rows {same}")
    assert a < 1e-8 and b < 1e-8 and c < 1e-4 and same


if __name__ == "__main__":
    main()
