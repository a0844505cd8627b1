"""How much is simulated at most for one explanation: what no effect explains would never end. Fits nothing."""

from __future__ import annotations

from estimator.explaining.findings import Found
from estimator.fmus.workers import Workers
from estimator.plans.plan import Plan

MOST_SAMPLES = 400_000_000  # of all outputs that are simulated for one explanation: about a minute and a half
LEAST_CANDIDATES = 1000  # that are simulated at least, however long the recordings are
OF_ADDITIONS = 0.5  # of all of it, by which additions are looked for: the rest is for their rivals

ENDED = Found(
    "search",
    "",
    "the recording shows more than what is known explains: the search for it was ended before all was tried",
    "what was not tried may explain it, and give other parameters; estimate from a shorter part, by --window",
)


class Effort:
    """Candidates that may still be simulated.

    Parameters
    ----------
    crew : Workers
        They count.

    Attributes
    ----------
    was_spent : bool
        Whether something was left out for it.
    """

    def __init__(self, plan: Plan, crew: Workers) -> None:
        samples = len(plan.outputs) * sum(len(o.recording.time) for o in plan.observed)
        candidates = max(LEAST_CANDIDATES, MOST_SAMPLES // samples)
        self._crew, self._begun, self._most = crew, crew.simulations, candidates * len(plan.observed)
        self.was_spent = False

    def is_spent(self, *, part: float = 1.0) -> bool:
        """Return whether a part of it was simulated: then nothing more is to be tried."""
        spent = self._crew.simulations - self._begun >= part * self._most
        self.was_spent |= spent
        return spent
