"""One number of all recordings in the place of each one's own, such as a bench's delay. Knows no effect by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from estimator.explaining.addition import Addition, without_columns
from estimator.explaining.explanation import Explanation, with_added, without
from estimator.fitting.gauss_newton import solved_roughly
from estimator.fitting.simulator import per_recording

FAR = 6.0  # times what it saves: one number that misses so much more, to first order, is not tried


def in_common(explanation: Explanation, samples: int) -> Iterator[Explanation]:
    """Yield the explanation with one number in the place of those that all recordings have of an effect.

    Where it was found that all have it, each by its own number, other effects were missing: these differed more then.
    """
    fit = explanation.fit
    for effect in dict.fromkeys(a.effect for a in explanation.additions if a.linear is None):
        alike = [a for a in explanation.additions if a.effect is effect and a.free == (a.name,)]
        own = [a for a in alike if a.name.startswith(f"{effect.name} ")]
        if len(own) < 2:
            continue
        names, s = per_recording(fit.simulator.plan, effect.name), fit.simulator
        if {a.name for a in own} == set(names) and effect.name in s.index:
            one = without_columns(own[0])
            one = dataclasses.replace(one, name=effect.name, free=(effect.name,), again=False, parts=(), foretold=None)
            least = fit.cost + sum(a.penalty(samples) for a in own) - one.penalty(samples)
            mean, behind = _mean(explanation, own)
            if behind < FAR * (least - fit.cost):
                yield _with_one(explanation, own, one, mean, limit=least)


def _mean(explanation: Explanation, own: Sequence[Addition]) -> tuple[float, float]:
    """Return the weighted mean of numbers, and by how much z'z rises with it in their places, to first order."""
    fit = explanation.fit
    at = [fit.names.index(a.name) for a in own]
    values, told = fit.estimates[at], np.linalg.pinv(fit.covariance_parts()[0][np.ix_(at, at)])
    mean = float(told.sum(axis=0) @ values / told.sum())
    return mean, float((values - mean) @ told @ (values - mean))


def _with_one(explanation: Explanation, own: Sequence[Addition], one: Addition, mean: float, *, limit: float
              ) -> Explanation:  # fmt: skip
    bare = explanation
    for a in own:
        bare = without(bare, a, iterations=0)
    fit = bare.fit
    begun = dataclasses.replace(fit, values=fit.simulator.at(fit.values, {one.name: mean}), free=(*fit.free, one.name))
    return with_added(bare, solved_roughly(begun, limit=limit), one)
