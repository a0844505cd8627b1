"""How late a sensor shows what changes steadily, by its delay, means and filters. Knows no effect and no noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.simulator import Act, Simulator
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import ChainSpec
from estimator.stepping import layout

FloatArray = NDArray[np.float64]
Value = Callable[[str], float]  # of a parameter, by its name

SMALL = 0.6  # rows: more is late by a row; a mean over the interval is by half a row
RAMP_ROWS = 10_000  # after which the slowest filter, 500 rows, shows a ramp as late as it ever will


def lateness(s: Simulator, value: Value, output: str) -> tuple[float, float]:
    """Return by how many s an output's sensor shows a steady slope late, behind the recording's own delay.

    Returns
    -------
    What is simulated with the FMU: a mean over the interval, a delay, declared means and filters; and what acts on
    simulated samples: means and filters that were found.
    """
    step = min(clock.step for clock in s.clocks)
    chain = s.plan.chains.get(output, ChainSpec())
    simulated = channel_delay(s, value, output) + 0.5 * (chain.average - 1) * step
    simulated += step * sum((b1 + 2 * b2) / (b0 + b1 + b2) - (a1 + 2 * a2) / (1 + a1 + a2)
                            for b0, b1, b2, a1, a2 in chain.sections(step))  # fmt: skip
    simulated += 0.5 * step if s.plan.sensors[output] == layout.MEAN else 0.0
    ramp = step * np.arange(RAMP_ROWS, dtype=np.float64)
    acted = (float(ramp[-1] - act(ramp, own, step)[-1]) for act, own in acting(s, value, output))
    return simulated, sum(acted, 0.0)


def recording_delay(s: Simulator, value: Value, recording: int) -> float:
    """Return by how much a recording's outputs come after its inputs, s: its own delay, and that of all."""
    places = {n.place: n.name for n in s.nuisances if n.place is not None}
    own, common = places.get(SensorPlace("delay", recording)), places.get(SensorPlace("delay"))
    late = value(own) if own is not None else s.observed[recording].delay
    return float(late + (value(common) if common is not None else 0.0))


def channel_delay(s: Simulator, value: Value, output: str) -> float:
    """Return an output's own delay, s, behind that of its recording."""
    place = SensorPlace("delay", None, output)
    found = sum(value(n.name) for n in s.nuisances if n.place == place)
    return float(s.plan.chains.get(output, ChainSpec()).delay + found)


def acting(s: Simulator, value: Value, output: str) -> list[tuple[Act, float]]:
    """Return what a sensor does with an output's samples, and with which value."""
    found = []
    for nuisance in s.nuisances:
        if nuisance.output == output and nuisance.act is not None:
            own = value(nuisance.name)
            if own != nuisance.neutral:
                found.append((nuisance.act, own))
    return found


def soon_shown(s: Simulator, value: Value, shown: FloatArray) -> FloatArray:
    """Return the largest size of each signal, (rows, q), from a row to that in which its sensor shows what happens."""
    late = np.array([sum(lateness(s, value, output)) for output in s.outputs])
    rows = np.array([np.ceil(late / clock.step - SMALL) for clock in s.clocks], dtype=np.int64)
    if not (rows > 0).any():
        return shown
    shown = np.abs(shown)
    for e, j in zip(*np.nonzero(rows > 0), strict=True):
        own, left = shown[s.clocks[e].rows, j], int(rows[e, j])
        while left > 0 and len(own) > 1:  # the largest of 2, 4, 8 rows, and of those that are left
            by = min(left, rows[e, j] - left + 1, len(own) - 1)
            own[:-by] = np.fmax(own[:-by], own[by:])
            left -= by
    return shown
