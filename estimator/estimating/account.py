"""Where an estimation stands, and what it has cost: phases, simulations, the best candidate. Knows no method."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.estimating.progress import Progress
from estimator.fmus.workers import Workers

FloatArray = NDArray[np.float64]


class Account:
    """The account of one estimation, from its start to its result.

    Parameters
    ----------
    crew : Workers
        Who simulate. What they did before `opened` was another case's.
    progress : callable, optional
        Told where the estimation stands.

    Attributes
    ----------
    standing : Progress
        Replaced as a whole: whoever reads it, Ctrl-C too, finds it in one piece.
    phases : phase → simulations
    """

    def __init__(self, crew: Workers, progress: Callable[[Progress], None] | None) -> None:
        self.started = time.monotonic()
        self.standing = Progress("", 0)
        self.phases: dict[str, int] = {}
        self._crew, self._progress = crew, progress
        self._open = False
        self._counted = 0

    def opened(self) -> None:
        """Count from here: the FMU is loaded."""
        self._open = True
        self._crew.pool.on_tick = self.tell

    @property
    def failures(self) -> list[Any]:
        """What failed first, and why."""
        return self._crew.failures if self._open else []

    def enter(self, phase: str) -> None:
        """Begin a phase; the simulations until the next are its own, and how many is not known."""
        self.count()
        self.standing = dataclasses.replace(self.standing, phase=phase, expected=None)
        self.tell()

    def expect(self, simulations: int) -> None:
        """Expect so many simulations from here to the end of the phase."""
        self.standing = dataclasses.replace(self.standing, expected=self._simulations + simulations)

    def found(self, names: Sequence[str], values: FloatArray, cost: float) -> None:
        """Remember the best candidate, (p,), by the names that it was found under: a plan may free more later."""
        best = dict(zip(names, values.tolist(), strict=True))
        self.standing = dataclasses.replace(self.standing, parameters=best, best_cost=float(cost))

    def tell(self) -> None:
        """Tell where the estimation stands."""
        self.standing = dataclasses.replace(self.standing, simulations=self._simulations)
        if self._progress is not None:
            self._progress(self.standing)

    def count(self) -> None:
        """Book what was simulated since on the phase under way."""
        done = self._simulations - self._counted
        if done:
            self.phases[self.standing.phase] = self.phases.get(self.standing.phase, 0) + done
        self._counted = self._simulations

    def costs(self, probed: int) -> dict[str, Any]:
        """Return what the estimation has cost so far, as fields of an Estimate; `probed`: simulations before it."""
        self.count()
        return {
            "simulations": self._simulations + probed if self._open else 0,
            "simulations_by_phase": dict(self.phases),
            "failed_simulations": self._crew.failed if self._open else 0,
            "steps": self._crew.steps if self._open else 0,
            "seconds": time.monotonic() - self.started,
        }

    @property
    def _simulations(self) -> int:
        return self._crew.simulations if self._open else 0
