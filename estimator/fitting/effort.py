"""How much is simulated at most for one explanation: what no effect explains would never end. Fits nothing."""

from __future__ import annotations

from estimator.plans.plan import Plan

MOST_SAMPLES = 600_000_000  # of all outputs, shown for one explanation: half a minute or a minute
FURTHER = 0.25  # of it, for each further recording: what it has of its own is looked for, too
EACH = 5000  # samples that a candidate costs beside its own, roughly: short recordings have no more time than long ones
LEAST_CANDIDATES = 1000  # that are shown at least, however long the recordings are
A_SAMPLE = 5  # steps that cost as much as a sample that is shown, roughly
WITH_EVENTS = 5  # a step of an FMU with events costs as much as so many of one without
MOST_SECONDS = 900.0  # s, that an FMU of others may take for one explanation, whose steps cost nobody knows what
OF_ADDITIONS = 0.5  # of all of it, by which additions are looked for: the rest is for their rivals


class Effort:
    """Samples that may still be shown by candidates.

    Attributes
    ----------
    was_spent : bool
        Whether something was left out for it.
    """

    def __init__(self, plan: Plan) -> None:
        samples = len(plan.outputs) * sum(len(o.recording.time) for o in plan.observed)
        most = round(MOST_SAMPLES * (1 + FURTHER * (len(plan.observed) - 1)))
        self._left = self._most = max(most, LEAST_CANDIDATES * samples)
        self.was_spent = False

    def spend(self, candidates: int, samples: int, steps: int, seconds: float = 0.0) -> None:
        """Count candidates that were shown, of so many samples and so much as so many steps beside them each.

        Parameters
        ----------
        seconds : float
            That they took, of an FMU of others: counted where that is more. Of a bundled one the same is counted on
            every machine.
        """
        shown = candidates * (EACH + samples + steps // A_SAMPLE)
        self._left -= max(shown, round(seconds / MOST_SECONDS * self._most))

    def is_spent(self, *, part: float = 1.0) -> bool:
        """Return whether a part of it was shown: then nothing more is to be tried."""
        spent = self._left <= (1 - part) * self._most
        self.was_spent |= spent
        return spent
