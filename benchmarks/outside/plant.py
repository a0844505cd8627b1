"""The machine of the emulated bench: a brushed DC motor and what real ones add to the textbook.

    L di/dt = v - R i - K w          J dw/dt = K i - B w - friction - load

The linear part is propagated exactly (matrix exponential) from cell to cell of a fine grid; the
rest is a constant over a cell, taken at the cell's middle (exponential midpoint rule, second order).
A change of sign of the speed is located inside its cell, and dry friction holds there or lets go.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motor:
    """Parameters in SI units; everything after ``B`` is zero in the textbook's motor."""

    R: float
    K: float
    L: float
    J: float
    B: float
    dry: float = 0.0  # N m, Coulomb friction
    stiction: float = 0.0  # additional share of ``dry`` at rest
    stribeck: float = 1.0  # rad/s over which stiction fades
    drag: float = 0.0  # N m s^2, fan
    brush: float = 0.0  # V, brush drop
    brush_current: float = 1.0  # A over which the brush drop builds up
    l_saturation: float = 0.0  # 1/A^2: L(i) = L / (1 + l i^2)
    k_saturation: float = 0.0  # 1/A^2: K(i) = K (1 - k i^2), held above half K
    cogging: float = 0.0  # N m
    cogging_order: int = 12
    source: float = 0.0  # ohm between command and terminals
    dip: float = 0.0  # ohm, a supply that gives way and recovers
    dip_time: float = 0.02  # s
    limit: float = math.inf  # A, supply in constant-current mode


@dataclass
class Run:
    """What happened on the fine grid: states at the beginning of each cell."""

    time: Array
    current: Array
    speed: Array
    angle: Array
    terminal: Array  # V at the terminals, in the cell


def _propagators(m: Motor, h: float) -> tuple[Array, Array]:
    """Return exp(A h) and its integral from 0 to h."""
    block = np.zeros((4, 4))
    block[:2, :2] = [[-m.R / m.L, -m.K / m.L], [m.K / m.J, -m.B / m.J]]
    block[:2, 2:] = np.eye(2)
    e = expm(block * h)
    return e[:2, :2], e[:2, 2:]


@dataclass(frozen=True)
class _Cells:
    """What acts on the motor in each cell, as lists, and which parts of the machine are linear."""

    volts: list[float]
    opened: list[bool]
    loads: list[float]
    scales: list[float]
    rises: list[float]
    linear_electric: bool
    linear: bool


@dataclass(frozen=True)
class _Steps:
    """Advance of the states over a cell or a part of one."""

    moving: Callable[[float, float, float, float, float, int, float], tuple[float, float]]
    coasting: Callable[[float, float, float, int, float], float]
    standing: Callable[[float, float, int, float], float]
    direction: Callable[[float, float, int], float]


def _electric_rest(m: Motor, linear: bool) -> Callable[[float, float, float, float, float], float]:
    """Return the function of i, w, v, rise, z that gives di/dt beyond (-R i - K w) / L."""
    R, K, L = m.R, m.K, m.L

    def electric_rest(i: float, w: float, v: float, rise: float, z: float) -> float:
        if linear:
            return v / L
        ke = K * max(0.5, 1.0 - m.k_saturation * i * i)
        e = v - R * (1.0 + rise) * i - ke * w - m.source * i - m.dip * (i - z)
        if m.brush:
            e -= m.brush * math.tanh(i / m.brush_current)
        return e * (1.0 + m.l_saturation * i * i) / L + (R * i + K * w) / L

    return electric_rest


def _torque_rest(m: Motor) -> Callable[[float, float, float, float, float, float], float]:
    """Return the function that gives J dw/dt beyond K i - B w, for the direction of motion ``s``."""
    K, B, order = m.K, m.B, float(m.cogging_order)

    def torque_rest(i: float, w: float, th: float, s: float, scale: float, ld: float) -> float:
        dry = m.dry
        if m.stiction:
            dry *= 1.0 + m.stiction * math.exp(-((w / m.stribeck) ** 2))
        t = -scale * dry * s - (scale - 1.0) * B * w - ld * s
        if m.drag:
            t -= m.drag * abs(w) * w
        if m.cogging:
            t += m.cogging * math.sin(order * th)
        if m.k_saturation:
            t -= K * i * min(0.5, m.k_saturation * i * i)
        return t

    return torque_rest


def _cached_propagators(m: Motor, h: float) -> Callable[[float], tuple[float, ...]]:
    """Return the function that gives both propagators of a step, row by row; whole and half cells are kept."""
    cache: dict[float, tuple[float, ...]] = {}

    def matrices(step: float) -> tuple[float, ...]:
        if step in cache:
            return cache[step]
        a, g = _propagators(m, step)
        out = (*a.ravel().tolist(), *g.ravel().tolist())
        if step in (h, h / 2):
            cache[step] = out
        return out

    return matrices


def _steps(m: Motor, h: float, cells: _Cells) -> _Steps:
    """Return the steps of this motor under these inputs."""
    R, K, L, J, B, order = m.R, m.K, m.L, m.J, m.B, float(m.cogging_order)
    vs, loads, scales, rises, linear = cells.volts, cells.loads, cells.scales, cells.rises, cells.linear
    electric_rest, torque_rest = _electric_rest(m, cells.linear_electric), _torque_rest(m)
    matrices = _cached_propagators(m, h)

    def moving(i: float, w: float, th: float, z: float, s: float, k: int, step: float) -> tuple[float, float]:
        v, rise, scale, ld = vs[k], rises[k], scales[k], loads[k]
        p, q = electric_rest(i, w, v, rise, z), torque_rest(i, w, th, s, scale, ld) / J
        if not linear:
            a, b, c, d, e, f, g, o = matrices(step / 2)
            im, wm = a * i + b * w + e * p + f * q, c * i + d * w + g * p + o * q
            p = electric_rest(im, wm, v, rise, z)
            q = torque_rest(im, wm, th + 0.5 * step * wm, s, scale, ld) / J
        a, b, c, d, e, f, g, o = matrices(step)
        return a * i + b * w + e * p + f * q, c * i + d * w + g * p + o * q

    def coasting(w: float, s: float, th: float, k: int, step: float) -> float:
        x, q = math.exp(-B / J * step), torque_rest(0.0, w, th, s, scales[k], loads[k]) / J
        return x * w + q * (step if B == 0 else (1.0 - x) * J / B)

    def standing(i: float, z: float, k: int, step: float) -> float:
        half, full = math.exp(-R / L * step / 2), math.exp(-R / L * step)
        p = electric_rest(i, 0.0, vs[k], rises[k], z)
        p = electric_rest(half * i + (1 - half) * p * L / R, 0.0, vs[k], rises[k], z)
        return full * i + (1 - full) * p * L / R

    def direction(i: float, th: float, k: int) -> float:
        """Tell where a motor at rest goes: -1, 0 (held) or 1."""
        drive = K * i * max(0.5, 1.0 - m.k_saturation * i * i) + m.cogging * math.sin(order * th)
        hold = scales[k] * m.dry * (1.0 + m.stiction) + loads[k]
        return 0.0 if abs(drive) <= hold else math.copysign(1.0, drive)

    return _Steps(moving, coasting, standing, direction)


def _cell_with_friction(
    steps: _Steps, free: bool, state: tuple[float, float, float, float, float], k: int, h: float
) -> tuple[float, float, float]:
    """Advance over cell ``k``, in parts where the speed passes zero; return current, speed, direction of motion."""
    i, w, th, z, s = state
    rest = h
    if s == 0.0:
        s = steps.direction(i, th, k)
    for _ in range(4):
        if s == 0.0:
            return 0.0 if free else steps.standing(i, z, k, rest), 0.0, s
        i1, w1 = (0.0, steps.coasting(w, s, th, k, rest)) if free else steps.moving(i, w, th, z, s, k, rest)
        if w1 * s >= 0.0 or w == w1:
            return i1, w1, s
        part = min(1.0, max(0.0, w / (w - w1)))  # the speed passes zero here
        i, w, rest = i + part * (i1 - i), 0.0, (1.0 - part) * rest
        go = steps.direction(i, th, k)
        s = 0.0 if go == s else go
        if rest <= 1e-9 * h:
            break
    return i, w, s


def _cells(
    m: Motor,
    voltage: Array,
    is_open: NDArray[np.bool_] | None,
    load: Array | None,
    friction_scale: Array | None,
    r_rise: Array | None,
) -> _Cells:
    """Fill in the inputs that are not given."""
    n = len(voltage)
    zero = np.zeros(n)
    linear_electric = not (m.brush or m.l_saturation or m.k_saturation or m.source or m.dip or r_rise is not None)
    return _Cells(
        volts=voltage.tolist(),
        opened=(np.zeros(n, bool) if is_open is None else is_open).tolist(),
        loads=(zero if load is None else load).tolist(),
        scales=(zero + 1.0 if friction_scale is None else friction_scale).tolist(),
        rises=(zero if r_rise is None else r_rise).tolist(),
        linear_electric=linear_electric,
        linear=linear_electric and not (m.drag or m.cogging or m.stiction) and friction_scale is None,
    )


def simulate(
    m: Motor,
    h: float,
    voltage: Array,
    *,
    is_open: NDArray[np.bool_] | None = None,
    load: Array | None = None,
    friction_scale: Array | None = None,
    r_rise: Array | None = None,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Run:
    """Integrate over ``len(voltage)`` cells of width ``h``.

    ``load`` opposes the motion, ``friction_scale`` multiplies B and dry friction, ``r_rise`` is the
    relative growth of R, ``start`` is current, speed, angle.
    """
    n = len(voltage)
    cells = _cells(m, voltage, is_open, load, friction_scale, r_rise)
    vs, opened, rises = cells.volts, cells.opened, cells.rises
    steps = _steps(m, h, cells)
    moving, coasting = steps.moving, steps.coasting
    dip_gain = 1.0 - math.exp(-h / m.dip_time)

    i, w, th = start
    z = i
    s = math.copysign(1.0, w) if w else 0.0
    out_i, out_w, out_th, out_v = [0.0] * n, [0.0] * n, [0.0] * n, [0.0] * n
    frictionless = not (m.dry or m.cogging or load is not None)
    for k in range(n):
        free = opened[k]
        if free:
            i = 0.0
        out_i[k], out_w[k], out_th[k] = i, w, th
        out_v[k] = m.K * w if free else vs[k] - m.source * i - m.dip * (i - z)
        i0, w0 = i, w
        if frictionless:
            i, w = (0.0, coasting(w, s, th, k, h)) if free else moving(i, w, th, z, s, k, h)
        else:
            i, w, s = _cell_with_friction(steps, free, (i, w, th, z, s), k, h)
        if abs(i) > m.limit and not free:
            i = math.copysign(m.limit, i)
            if abs(i0) >= m.limit * (1 - 1e-9):
                out_v[k] = m.R * (1.0 + rises[k]) * i + m.K * w + m.brush * math.tanh(i / m.brush_current)
        z += (i - z) * dip_gain
        th += 0.5 * h * (w0 + w)
    time = np.asarray(h * np.arange(n), dtype=np.float64)
    return Run(time, np.array(out_i), np.array(out_w), np.array(out_th), np.array(out_v))


def steady_state(m: Motor, v: float) -> tuple[float, float]:
    """Return current and speed that settle at ``v``, for viscous and dry friction only."""
    if abs(v) * m.K / m.R <= m.dry:
        return v / m.R, 0.0
    dry = math.copysign(m.dry, v)
    w = (m.K * v - m.R * dry) / (m.K**2 + m.R * m.B)
    return (v - m.K * w) / m.R, w
