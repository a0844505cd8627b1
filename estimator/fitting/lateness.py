"""How late a sensor shows what changes steadily, by its delay, means and filters. Knows no effect and no noise."""

from __future__ import annotations

import numpy as np

from estimator.fitting.fit import Fit
from estimator.fitting.motor_response import acting
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import ChainSpec
from estimator.stepping import layout

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
