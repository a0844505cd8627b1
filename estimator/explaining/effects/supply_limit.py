"""The command asks for more voltage than the supply has: what a controller's output is before it is limited."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.missing_voltage import Corners, is_linear, shown_more
from estimator.fitting.simulator import Nuisance, Simulator
from estimator.plans.part import LONG
from estimator.plans.plan import Observed, Plan

NAME = "supply limit"
TRIED = (0.95, 0.8, 0.65, 0.5)  # of the largest command
LEAST = 0.1  # of it: less is no supply
BELOW = 0.1  # of the largest command: others are smaller by more, or one gain stands for the limit


@dataclass(frozen=True)
class SupplyLimit(Effect):
    """The largest voltage, V, of either sign that the drive gives whatever its command is."""

    name: str = NAME
    prior: float = SELDOM
    sentence: str = "the drive gives {value:.4g} V at most, less than its command asks for"

    def nuisances(self, plan: Plan) -> Sequence[Nuisance]:
        """Return it for commands of several sizes; not in long recordings."""
        commands = [o.inputs["v"] for o in plan.observed if "v" in o.inputs and not o.is_measured]
        rows = sum(len(o.recording.time) for o in plan.observed)
        if not commands or rows > LONG or not is_linear(plan):
            return []
        sizes = np.abs(np.concatenate(commands))
        top = float(np.max(sizes))
        if not np.any((sizes > LEAST * top) & (sizes < (1 - BELOW) * top)):
            return []
        return [
            Nuisance(
                NAME, "V", LEAST * top, top, top, 0.01 * top,
                adds=partial(shown_more, NAME, _missing), tries=tuple(part * top for part in TRIED), absolute=True,
            )
        ]  # fmt: skip


def _missing(s: Simulator, limit: float, o: Observed) -> Corners:
    """Return what is missing from a command beyond a limit."""
    command = o.inputs["v"]
    off = np.clip(command, -limit, limit) - command
    jumps = np.diff(off, prepend=0.0)
    at = np.flatnonzero(jumps)
    return o.times[at], jumps[at], np.zeros(len(at))
