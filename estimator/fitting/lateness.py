"""How late a sensor shows what changes steadily, by its delay, means and filters. Knows no effect and no noise."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.simulator import Act
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import ChainSpec
from estimator.stepping import layout

if TYPE_CHECKING:
    from estimator.fitting.fit import Fit

FloatArray = NDArray[np.float64]

RAMP_ROWS = 1_000  # after which the slowest filter, 60 rows, shows a ramp as late as it ever will


def lateness(fit: Fit, output: str) -> tuple[float, float]:
    """Return by how many s an output's sensor shows a steady slope late, behind the recording's own delay.

    Returns
    -------
    What is simulated with the FMU: a mean over the interval, a delay, declared means and filters; and what acts on
    simulated samples: means and filters that were found.
    """
    s = fit.simulator
    step = min(clock.step for clock in s.clocks)
    chain = s.plan.chains.get(output, ChainSpec())
    simulated = chain.delay + 0.5 * (chain.average - 1) * step
    simulated += step * sum((b1 + 2 * b2) / (b0 + b1 + b2) - (a1 + 2 * a2) / (1 + a1 + a2)
                            for b0, b1, b2, a1, a2 in chain.sections(step))  # fmt: skip
    simulated += 0.5 * step if s.plan.sensors[output] == layout.MEAN else 0.0
    place = SensorPlace("delay", None, output)
    simulated += sum(fit.value(n.name) for n in s.nuisances if n.place == place)
    ramp = step * np.arange(RAMP_ROWS, dtype=np.float64)
    acted = (float(ramp[-1] - act(ramp, value, step)[-1]) for act, value in acting(fit, output))
    return simulated, sum(acted, 0.0)


def acting(fit: Fit, output: str) -> list[tuple[Act, float]]:
    """Return what a sensor does with an output's samples, and with which value."""
    s, found = fit.simulator, []
    for nuisance in s.nuisances:
        if nuisance.output == output and nuisance.act is not None:
            value = fit.value(nuisance.name)
            if value != nuisance.neutral:
                found.append((nuisance.act, value))
    return found


def soon_shown(fit: Fit) -> FloatArray:
    """Return the largest size of each signal, (rows, q), from a row to that in which its sensor shows what happens."""
    s, late = fit.simulator, np.zeros(fit.shown.shape[1], dtype=np.int64)
    for j, output in enumerate(s.outputs):
        late[j] = int(np.ceil(sum(lateness(fit, output)) / s.clocks[0].step - 0.5))
    if not (late > 0).any():
        return fit.shown
    shown = np.abs(fit.shown)
    for clock, j in itertools.product(s.clocks, np.flatnonzero(late > 0).tolist()):
        own, left = shown[clock.rows, j], int(late[j])
        while left > 0 and len(own) > 1:  # the largest of 2, 4, 8 rows, and of those that are left
            by = min(left, late[j] - left + 1, len(own) - 1)
            own[:-by] = np.fmax(own[:-by], own[by:])
            left -= by
    return shown
