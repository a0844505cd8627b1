"""Whether outputs answer to changes as it is explained: a score test of any further response. Knows no effect.

A channel that goes through a filter, a mean, a delay or a drive that nobody named shows

    y[k] + c0 (y[k] - y[k-1]) + c1 (y[k-1] - y[k-2]) + ...

of the explained signal y: some numbers c for any of them, as long as they act within the first samples after a change.
These are where L is estimated, and where one sensor's filter stands for another's, or for the winding. z'z falls by a
chi-square number with as many degrees of freedom, if there is nothing (Rao 1948): of each channel, and of all together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.distributions import chi_square_limit
from estimator.fitting.fit import Fit

FloatArray = NDArray[np.float64]

RESPONSES = 5  # samples after a change, a number each


@dataclass(frozen=True)
class Unexplained:
    """A further response that the residuals show.

    Attributes
    ----------
    output : of this channel; "" of all together
    excess : how much larger the root of the statistic is than its limit
    shift : (f + m,) array
        By how much the estimates of the fit's names move if it is freed.
    """

    output: str
    excess: float
    shift: FloatArray


def unexplained_responses(fit: Fit, chance: float) -> list[Unexplained]:
    """Return the further responses that the residuals show; of an explanation that holds one with this chance."""
    outputs, test = fit.simulator.outputs, fit.test()
    whitened = [fit.whitener.flat(_changes(fit, j)) for j in range(len(outputs))]
    groups = [*zip(outputs, ([w] for w in whitened), strict=True)]
    if len(outputs) > 1:
        groups.append(("", whitened))
    found: list[Unexplained] = []
    for output, parts in groups:
        columns = np.hstack(parts)
        norms = np.linalg.norm(columns, axis=0)
        columns = columns[:, norms > 0] / norms[norms > 0]
        across = columns - test.basis @ (test.basis.T @ columns)
        gain, coefficients = test.gain(across)
        limit = chi_square_limit(max(1, columns.shape[1]), chance / len(groups))
        if gain > limit and (output or not found):
            shift = np.zeros(len(fit.names))
            inside = fit.at_bound == 0
            covariance = fit.covariance_parts()[0][np.ix_(inside, inside)]
            shift[inside] = covariance @ (fit.jacobian[:, inside].T @ (columns @ coefficients))
            found.append(Unexplained(output, float(np.sqrt(gain / limit)), shift))
    return found


def _changes(fit: Fit, j: int) -> FloatArray:
    """Return the changes of a channel's explained signal in the last samples, (rows, q, RESPONSES); 0 in the others."""
    result = np.zeros((*fit.shown.shape, RESPONSES))
    for clock in fit.simulator.clocks:
        y = np.nan_to_num(fit.shown[clock.rows, j])
        change = np.diff(y, prepend=y[:1])
        for k in range(RESPONSES):
            result[clock.rows.start + k : clock.rows.stop, j, k] = change[: len(change) - k]
    return result
