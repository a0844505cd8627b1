"""The search for effects: what it takes away again, by which noise."""

from types import SimpleNamespace

import pytest

from estimator.explaining import selection
from estimator.explaining.addition import Addition
from estimator.explaining.effects import EFFECTS
from estimator.explaining.explanation import Explanation
from estimator.explaining.selection import Selection

COSTS = {"abc": 100.0, "bc": 101.0, "ac": 1100.0, "ab": 1100.0, "b": 1102.0, "c": 1102.0, "a": 2100.0, "": 3000.0}


def test_what_is_idle_is_told_by_the_noise_of_the_whole_explanation(monkeypatch):
    """A noise that is estimated again takes in what a removal leaves: by it the next seems to cost nothing."""

    def of(names, noise):
        cost = COSTS[names] if noise == "first" else 50.0
        additions = tuple(Addition(EFFECTS[0], name, 1, 1.0) for name in names)
        return Explanation(SimpleNamespace(cost=cost, noise=noise), additions)

    estimated = []

    def with_noise(explanation, differenced, *, again):
        estimated.append("".join(sorted(explanation.names())))
        return of(estimated[-1], "again")

    monkeypatch.setattr(selection, "wald", lambda fit, addition: 0.0)
    monkeypatch.setattr(
        selection, "without", lambda e, a, *, limit: of("".join(sorted(e.names() - {a.name})), e.fit.noise)
    )
    monkeypatch.setattr(selection, "with_noise", with_noise)
    search = Selection(SimpleNamespace(samples=1000), None, None, ())
    slimmer = search.without_idle(of("abc", "first"))
    assert slimmer.names() == {"b", "c"} and estimated == ["bc"]
    whole = of("bc", "first")
    assert search.without_idle(whole) is whole and estimated == ["bc"]
    assert whole.criterion(1000) == pytest.approx(101.0 + 2 * whole.additions[0].penalty(1000))
