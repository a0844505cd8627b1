"""Whether what an estimate needs is too seldom to be all that there is. Knows no effect by name.

What no effect stands for, a flexible joint or a second motor, is explained as well as others can: mostly by several
that hardly any bench has together. So an explanation that is as seldom as that, and that the parameters rest on, is
as likely to stand in for something else. Prior probabilities are compared with usual ones, as several usual effects
come together often; where one of many places or frequencies is told, this alone makes no effect seldom.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.addition import Addition
from estimator.explaining.effects.base import SELDOM, USUAL
from estimator.explaining.explanation import Explanation
from estimator.fitting.fit import Fit

FloatArray = NDArray[np.float64]

MOVES = 4.0  # standard errors: a parameter rests on an effect without which it would be so far off
TOO_SELDOM = 0.05  # of the prior probability of usual effects


def seldom_together(explanation: Explanation, errors: FloatArray) -> Sequence[Addition]:
    """Return the seldom effects that the parameters rest on, one addition each, if they are too seldom together.

    Parameters
    ----------
    errors : (p,) array
        Standard errors of the plan's parameters, on their scales.
    """
    fit, found = explanation.fit, dict[str, Addition]()
    for a in (a for a in explanation.additions if not a.effect.is_line and a.effect.prior < USUAL):
        moved = moves_without(fit, a, len(errors))
        with np.errstate(divide="ignore", invalid="ignore"):
            if moved is None or np.nanmax(np.abs(moved / errors), initial=0.0) > MOVES:
                found.setdefault(a.effect.name, a)
    together = np.prod([max(a.effect.prior, SELDOM) / USUAL for a in found.values()])
    return list(found.values()) if together <= TOO_SELDOM * (1 + 1e-9) else []


def moves_without(fit: Fit, addition: Addition, parameters: int) -> FloatArray | None:
    """Return by how much the parameters, (p,), on their scales, would move without an addition, to first order.

    None where it is chosen, not fitted by derivatives: that cannot be told so.
    """
    names, neutral = list(fit.names), fit.simulator.neutral
    own = [
        k for k, name in enumerate(names)
        if (name in addition.free if addition.linear is None else name.partition("#")[0] == addition.name)
    ]  # fmt: skip
    if not own:
        return None
    estimates, is_log = fit.estimates[own], fit.is_log[own]
    rest = np.array([neutral.get(names[k], 0.0) for k in own])
    with np.errstate(divide="ignore", invalid="ignore"):
        away = np.where(is_log & (rest > 0), np.log(estimates / rest), estimates - rest)
    covariance = fit.covariance_parts()[0]
    return np.asarray(-covariance[:parameters, own] @ np.linalg.pinv(covariance[np.ix_(own, own)]) @ away)
