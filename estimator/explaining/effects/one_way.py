"""A drive that lets current flow one way only: one switch and a diode, or a supply that takes no current back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import SELDOM
from estimator.explaining.effects.drive import HELD_ROWS, Drive
from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import COASTS, ONE_WAY
from estimator.fitting.simulator import Nuisance
from estimator.plans.plan import Observed, Plan
from estimator.recordings.samples import filled
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

FALLS = 0.2  # of the largest voltage: a command that falls by more would brake the motor
SLOWS = 4.0  # standard errors of the speed's fall
NONE = 0.02  # of the largest current: less is none


@dataclass(frozen=True)
class OneWay(Drive):
    """A current that never flows against the command: a motor that is faster than its command coasts."""

    name: str = "one-way current"
    prior: float = SELDOM
    target: str = ONE_WAY
    sentence: str = "the drive lets no current flow back: the motor coasts where it is faster than its command"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return the switch, where a command falls or the motor is seen not to be braked."""
        if not any(_falls(o).any() for o in plan.observed):
            return []
        return [
            Nuisance(
                self.target, "", 0.0, 1.0, 0.0, 1.0, target=self.target, tries=(1.0,), whole=True, excludes=(COASTS,)
            )
        ]

    def at_first_sight(self, plan: Plan) -> Mapping[str, float]:
        """Return the switch where the current is zero after a command has fallen, and nowhere flows back."""
        seen = [_is_not_braked(o) for o in plan.observed if _falls(o).any()]
        return {self.target: 1.0} if seen and all(seen) else {}

    def mirrored(self, fit: Fit, name: str) -> Sequence[Mapping[str, float]]:
        """Return a circuit that opens at no voltage, in its place."""
        return [{COASTS: 1.0}] if COASTS in fit.simulator.index else []


def _falls(o: Observed) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the rows of a recording, (n,), from which on its voltage is smaller by a part of the largest."""
    v = o.inputs.get("v")
    if v is None:
        return np.zeros(len(o.recording.time), dtype=bool)
    down = np.zeros(len(v), dtype=bool)
    down[1:] = np.abs(v[:-1]) - np.abs(v[1:]) > FALLS * np.max(np.abs(v))
    return down


def _is_not_braked(o: Observed) -> bool:
    """Return whether the current of a recording rests at zero after its voltage has fallen, while the motor turns."""
    if not {"i", "w"} <= set(o.outputs):
        return False
    i, w, v = filled(o.outputs["i"]), filled(o.outputs["w"]), o.inputs["v"]
    none = NONE * float(np.max(np.abs(i))) + 2 * noise_deviation(o.outputs["i"])
    turning = np.abs(w) > 0.2 * np.max(np.abs(w))
    rests = turning & (np.abs(i) < none) & (w * v >= 0)
    after = np.flatnonzero(_falls(o))
    if np.mean(i[turning] * np.sign(w[turning]) < -2 * none) > 0.01:
        return False
    spans = [slice(k, k + 10 * HELD_ROWS) for k in after.tolist()]
    return any(
        np.count_nonzero(rests[own]) >= HELD_ROWS and _slows(np.abs(w[own]), noise_deviation(w)) for own in spans
    )


def _slows(speed: FloatArray, noise: float) -> bool:
    """Whether a speed falls over some rows, (n,): of a command that the supply cannot give the fall moves nothing."""
    half = len(speed) // 2
    fall = float(np.mean(speed[:half]) - np.mean(speed[half:]))
    return fall > SLOWS * noise * float(np.sqrt(2 / max(half, 1)))
