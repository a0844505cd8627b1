"""Noise and wandering torque that all rows tell, asked before an explanation is doubted. Adds no effect.

While effects are looked for, settled rows alone tell the noise, which then holds no misfit of a transient. Stretches
that are shorter than friction takes to change do not show that it wanders, nor few settled rows a slight colour, and
effects may have made up for both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import LEAST_FALL
from estimator.explaining.adequacy import Adequacy, adequacy
from estimator.explaining.explanation import Explanation, without
from estimator.explaining.explanation_noise import with_noise
from estimator.explaining.selection import Selection
from estimator.explaining.wandering_torque import with_usual_torque, with_wandering_torque
from estimator.fitting.fit import Fit

FloatArray = NDArray[np.float64]

PLAIN = 60.0  # of a chi-square: what stands out so by the largest torque is no torque that wanders
USUAL_WANDER = 0.05  # of the friction: benches show 0.3 to 3 %


def by_all_rows(selection: Selection, explanation: Explanation, checked: Adequacy) -> tuple[Explanation, Adequacy]:
    """Return an explanation with the noise that all rows tell, and its adequacy, where that is all that is missing.

    No larger torque is asked for than benches have: any misfit is small beside one that may be anything.
    """
    parameters, samples = len(selection.tests.base.plan.names), selection.tests.samples
    wanders = with_wandering_torque(explanation, most=USUAL_WANDER, left_open=False)[0]
    slimmer = selection.without_idle(wanders)
    if slimmer is not wanders:
        wanders = with_wandering_torque(slimmer, most=USUAL_WANDER, left_open=False)[0]
    wanders = with_noise(wanders, selection.differenced, moving=True)
    wanders = _without_what_wanders(with_wandering_torque(wanders, most=USUAL_WANDER, left_open=False)[0], samples)
    wanders = selection.at_best(wanders)
    other = adequacy(wanders.fit, parameters)
    likelier = wanders.misfit(samples) + LEAST_FALL < explanation.misfit(samples)
    is_simpler = set(wanders.names()) < set(explanation.names()) and likelier
    return (wanders, other) if not other.failures and (checked.failures or is_simpler) else (explanation, checked)


def _without_what_wanders(explanation: Explanation, samples: int) -> Explanation:
    """Return an explanation without what stands for a torque that wanders, which is larger then.

    Such as a drift, or another friction in each recording: its mean in one differs by chance from that in another.
    """
    by_largest = with_usual_torque(explanation.fit, USUAL_WANDER).covariance()
    asked = [a for a in explanation.additions if a.linear is not None and not a.effect.is_line]
    asked = [a for a in asked if not _stands_out(explanation.fit, a.name, by_largest)]
    while True:
        # A torque that comes is charged as any part of the noise.
        more = LEAST_FALL if explanation.fit.whitener.noise.torque[0] == 0 else 0.0
        fewer = [
            with_wandering_torque(without(explanation, a), most=USUAL_WANDER, left_open=False)[0]
            for a in asked
            if a.name in explanation.names()
        ]
        best = min(fewer, key=lambda e: e.misfit(samples), default=explanation)
        if best is explanation or best.misfit(samples) + more >= explanation.misfit(samples):
            return explanation
        explanation = best


def _stands_out(fit: Fit, name: str, covariance: FloatArray) -> bool:
    """Whether the columns of an addition are far from none by this covariance of all that the fit estimates."""
    own = [k for k, n in enumerate(fit.names) if n.partition("#")[0] == name]
    found = fit.estimates[own]
    return float(found @ np.linalg.pinv(covariance[np.ix_(own, own)], hermitian=True) @ found) > PLAIN
