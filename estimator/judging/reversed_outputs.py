"""Before a search: a motor's FMU whose current or speed counts the other way than the recording's. Knows no search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.problem import Problem

FloatArray = NDArray[np.float64]

REVERSED = -0.9  # correlation about zero of what the FMU shows with what is measured: by less it is not the sign alone
SIGNED = ("i", "w")  # a motor at rest follows its voltage by these, whatever its parameters


def reversed_outputs(problem: Problem, start: FloatArray) -> list[str]:
    """Return a sentence on each output that counts the other way; empty where none does.

    Parameters
    ----------
    start : (p,) array
        Where the search begins.
    """
    plan = problem.plan
    if not plan.binding.is_motor:
        return []
    rows = problem.signals(start[None, :])
    shown = problem.used(rows[0])
    measured = shown - problem.compared(rows)[0]
    found = [
        name
        for k, name in enumerate(problem.outputs)
        if name in SIGNED and _correlation(*(y[problem.output_of_residual == k] for y in (shown, measured))) < REVERSED
    ]
    path, said = plan.description.path.name, {name: chain.gain for name, chain in plan.chains.items()}
    return [
        f"the gain {said[name]:g} of {name} turns it against the recording: {path} counts {name} as the recording does,"
        " so leave the sign out"
        if said.get(name, 1.0) < 0
        else f"{path} counts {name} the other way than the recording: say gain = -1 of {name} under [outputs] in a case"
        " file"
        for name in found
    ]


def _correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation about zero of two (m,) signals; 0 where one is nothing, or no number."""
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if np.isfinite(size) and size > 0 else 0.0
