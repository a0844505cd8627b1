"""The noise of a fit's residuals: its size, its colour, its covariance between channels. Knows no row and no estimate.

Residuals of channel j at row k are r = g z: g grows with the signal if the data show it (noise of
commutation and contacts), and

    z = white + slow(tau) + differenced + H torque

is a sum of a white part, an exponentially correlated one (Ornstein-Uhlenbeck), the difference of white errors (an
encoder's counts, differenced) and the response of the machine to a torque that wanders, which colours current and speed
together. Such sums are linear state spaces, so that whitening and likelihood are exact at O(rows), with gaps and any
clock (kalman.py). Remaining correlation over few samples, such as a sensor's filter makes, is removed by a short
autoregression.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.motor.exponential import exponential
from estimator.noise.level import Level

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

RESTS, STARTS, RUNS, COASTS = range(4)  # phases of the machine; without a circuit it coasts
WAYS = 8  # sizes of the friction that are told apart
LEAST_MOTION = 1e-3  # of the largest signals: with less of each the machine is at rest


@dataclass(frozen=True)
class NoiseModel:
    """The noise of q channels.

    Attributes
    ----------
    white, differenced : (q,) arrays
        Deviations at rest, in the channels' units.
    growth : (q,) array
        c of g^2 = s^2 + (c |y| / max |y|)^2.
    running : (q,) array, or None
        s while the machine runs, over that at rest; None: 1.
    stands : float
        Of the largest signals: with less of each the machine is as quiet as at rest.
    bends : (q,) array, or None
        Whether g is the larger of s and c |y| / max |y| instead; None: of no channel.
    slow : (q, 2) array
        Deviation and correlation time, s, of the slow part; 0: none.
    torque : deviation where the friction is largest, and correlation time, s, of the torque; in the unit of
        `machine`'s input; 0: none
    machine : (2, 2) and (2,) arrays, or None
        A and b of d[i, w]/dt = A [i, w] + b torque.
    seat : (q,) array
        Which state of the machine a channel shows: 0 current, 1 speed, -1 none.
    jitter : float
        Deviation of the instants at which the samples were taken, s: noise in proportion to the slope.
    short : of the machine at rest and running, of each channel: coefficients of the short autoregression,
        and its innovation's deviation
    filtered : channels whose autoregression is that of their declared filters, steep as it may be: exact from the first
        row of a recording on, and behind gaps and outliers
    repeats : whether a channel's errors repeat themselves at a steady speed (repeating.py)
    """

    white: FloatArray
    differenced: FloatArray
    growth: FloatArray
    slow: FloatArray
    torque: tuple[float, float] = (0.0, 1.0)
    machine: tuple[FloatArray, FloatArray] | None = None
    seat: tuple[int, ...] = ()
    jitter: float = 0.0
    short: tuple[tuple[tuple[FloatArray, float], ...], ...] = ()
    filtered: tuple[int, ...] = ()
    repeats: tuple[bool, ...] = ()
    running: FloatArray | None = None
    stands: float = LEAST_MOTION
    bends: BoolArray | None = None

    @classmethod
    def plain(cls, white: FloatArray, seat: Sequence[int]) -> NoiseModel:
        """Return white noise of these deviations, (q,)."""
        q = len(white)
        slow = np.column_stack([np.zeros(q), np.ones(q)])
        return cls(white, differenced=np.zeros(q), growth=np.zeros(q), slow=slow, seat=tuple(seat))

    @cached_property
    def has_state(self) -> bool:
        """Whether a sample's noise depends on all before it."""
        return bool(self.is_coloured or self.differenced.any())

    @property
    def is_coloured(self) -> bool:
        """Whether it has a slow part, or a torque that wanders."""
        return bool(self.slow[:, 0].any() or self.torque[0] > 0)

    @cached_property
    def grows(self) -> bool:
        """Whether it grows with the signals, or as the machine runs, anywhere: else g is 1."""
        return bool(self.growth.any() or (self.running is not None and np.any(self.running != 1.0)))

    def scale(self, level: FloatArray | Level, moving: BoolArray) -> FloatArray:
        """Return g, (rows, q), at signals over their largest, (rows, q), where the machine runs; not to be changed."""
        if not self.grows:
            return np.broadcast_to(1.0, level.shape)
        running = np.ones(len(self.growth)) if self.running is None else self.running
        bends = np.zeros(len(self.growth), dtype=bool) if self.bends is None else self.bends
        g = np.empty(level.shape)
        for k, (c, s) in enumerate(zip(self.growth.tolist(), running.tolist(), strict=True)):
            own, least = c * level[:, k], 1.0 if s == 1.0 else np.where(moving, s, 1.0)
            g[:, k] = np.maximum(least, own) if bends[k] else np.sqrt(least * least + own * own)
        return g

    def deviation(self, level: FloatArray | Level, moving: BoolArray) -> FloatArray:
        """Return the deviation of each sample, (rows, q), all parts together; not to be changed."""
        power = self.white**2 + 2 * self.differenced**2 + self.slow[:, 0] ** 2
        if self.torque[0] > 0 and self.machine is not None:
            gain = np.abs(np.linalg.solve(self.machine[0], self.machine[1]))
            power = power + np.array([(gain[s] * self.torque[0]) ** 2 if s >= 0 else 0.0 for s in self.seat])
        if not self.grows:
            return np.broadcast_to(np.sqrt(power), level.shape)
        return np.asarray(self.scale(level, moving) * np.sqrt(power))

    def states(
        self, dt: FloatArray, running: FloatArray, phase: IntArray, way: IntArray, *, first: int = 0
    ) -> dict[str, FloatArray]:
        """Return the state space over n steps: transition, process (n, d, d), initial (d, d), readout (q, d).

        Parameters
        ----------
        dt : (n,) array
            Steps, s.
        running : (q,) array
            g while the machine runs.
        phase : (n,) array of RESTS, STARTS, RUNS or COASTS
            A machine at rest has no wandering torque.
        way : (n,) array
            As of `Whitener`; the torque's deviation is that at WAYS.
        first : int
            The step that the initial covariance is of.
        """
        q = len(self.white)
        blocks: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        for j in range(q):
            unit = np.eye(q)[:, j : j + 1]
            if self.slow[j, 0] > 0:
                f = np.exp(-dt / self.slow[j, 1])[:, None, None]
                v = self.slow[j, 0] ** 2
                blocks.append((f, v * (1 - f * f), np.array([[v]]), unit))
            if self.differenced[j] > 0:
                v = self.differenced[j] ** 2
                shift = np.array([[0.0, 0.0], [1.0, 0.0]])
                blocks.append((shift, np.diag([v, 0.0]), np.diag([v, v]), np.hstack([unit, -unit])))
        if self.torque[0] > 0 and self.machine is not None:
            blocks.append(self._machine_block(dt, running, phase, way, first))
        n, d = len(dt), sum(f.shape[-1] for f, *_ in blocks)
        transition, process = np.zeros((2, n, d, d))
        initial, readout = np.zeros((d, d)), np.zeros((q, d))
        at = 0
        for f, noise, start, shown in blocks:
            part = slice(at, at + f.shape[-1])
            transition[:, part, part], process[:, part, part] = f, noise
            initial[part, part], readout[:, part] = start, shown
            at += f.shape[-1]
        return {"transition": transition, "process": process, "initial": initial, "readout": readout}

    def _machine_block(
        self, dt: FloatArray, running: FloatArray, phase: IntArray, way: IntArray, first: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return transition and process covariance of the machine with the wandering torque held over each step."""
        assert self.machine is not None
        a, b = self.machine
        f = np.exp(-dt / self.torque[1])
        transition = driven(a.tobytes(), b.tobytes(), dt.tobytes(), (phase == COASTS).tobytes()).copy()
        transition[:, :2, 2] *= (way / WAYS)[:, None]
        transition[:, 2, 2] = f
        v = self.torque[0] ** 2
        process = np.zeros_like(transition)
        process[:, 2, 2] = np.where(phase == RESTS, 0.0, np.where(phase == STARTS, v, v * (1 - f * f)))
        start, step = process[first].copy(), transition[first].copy()
        for _ in range(60 if phase[first] in (RUNS, COASTS) else 0):  # P = F P F' + Q by doubling
            more = step @ start @ step.T
            start = start + more
            if more.trace() <= 1e-12 * start.trace():
                break
            step = step @ step
        readout = np.zeros((len(self.white), 3))
        for j, seat in enumerate(self.seat):
            if seat >= 0:
                readout[j, seat] = 1 / running[j]
        return transition, process, start, readout


@lru_cache(maxsize=16)
def driven(a: bytes, b: bytes, dt: bytes, coasts: bytes) -> FloatArray:
    """Return `held` over n steps, (n, 3, 3), or `unwound` where the circuit is open; not to be changed."""
    steps, is_open = np.frombuffer(dt).tolist(), np.frombuffer(coasts, dtype=bool).tolist()
    return np.array([(unwound if o else held)(a, b, x) for x, o in zip(steps, is_open, strict=True)]).reshape(-1, 3, 3)


@lru_cache(maxsize=256)
def held(a: bytes, b: bytes, dt: float) -> FloatArray:
    """Return exp([[A, b], [0, 0]] dt), (3, 3): state and held input of a machine over a step."""
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = np.frombuffer(a).reshape(2, 2), np.frombuffer(b)
    return exponential(whole * dt)


@lru_cache(maxsize=256)
def unwound(a: bytes, b: bytes, dt: float) -> FloatArray:
    """Return the same of a machine whose circuit is open: no current flows from its first instant on."""
    decay, input_ = float(np.frombuffer(a).reshape(2, 2)[1, 1]), float(np.frombuffer(b)[1])
    own = np.zeros((3, 3))
    own[1, 1], own[2, 2] = np.exp(decay * dt), 1.0
    own[1, 2] = input_ * (np.expm1(decay * dt) / decay if decay else dt)
    return own
