"""The search for effects: what it takes away again, by which noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining import rivals, selection
from estimator.explaining.addition import Addition
from estimator.explaining.effects import EFFECTS
from estimator.explaining.explanation import Explanation
from estimator.explaining.selection import Selection

COSTS = {"abc": 100.0, "bc": 101.0, "ac": 1100.0, "ab": 1100.0, "b": 1102.0, "c": 1102.0, "a": 2100.0, "": 3000.0}
UNLIMITED = SimpleNamespace(is_spent=lambda **part: False)
FREE = {
    "names": ("R",), "at_bound": (0,), "linear": (), "simulator": SimpleNamespace(nuisances=()),
    "whitener": SimpleNamespace(log_shared=0.0),
}  # fmt: skip


def test_what_is_idle_is_told_by_the_noise_of_the_whole_explanation(monkeypatch):
    """A noise that is estimated again takes in what a removal leaves: by it the next seems to cost nothing."""

    def of(names, noise):
        cost = COSTS[names] if noise == "first" else 50.0
        additions = tuple(Addition(EFFECTS[0], name, 1, 1.0) for name in names)
        return Explanation(SimpleNamespace(cost=cost, noise=noise, **FREE), additions)

    estimated = []

    def with_noise(explanation, differenced, *, again):
        estimated.append("".join(sorted(explanation.names())))
        return of(estimated[-1], "again")

    monkeypatch.setattr(selection, "wald", lambda fit, addition: 0.0)
    monkeypatch.setattr(
        selection, "without", lambda e, a, *, limit: of("".join(sorted(e.names() - {a.name})), e.fit.noise)
    )
    monkeypatch.setattr(selection, "with_noise", with_noise)
    search = Selection(SimpleNamespace(samples=1000), None, None, (), UNLIMITED)
    slimmer = search.without_idle(of("abc", "first"))
    assert slimmer.names() == {"b", "c"} and estimated == ["bc"]
    whole = of("bc", "first")
    assert search.without_idle(whole) is whole and estimated == ["bc"]
    assert whole.criterion(1000) == pytest.approx(101.0 + 2 * whole.additions[0].penalty(1000))


def test_where_the_recordings_are_not_explained_an_addition_has_to_explain_as_many_times_more(monkeypatch):
    costs = {"ab": 30_000.0, "a": 30_060.0, "b": 31_000.0, "": 40_000.0}

    def of(names):
        return Explanation(
            SimpleNamespace(cost=costs[names], **FREE), tuple(Addition(EFFECTS[0], n, 1, 1.0) for n in names)
        )

    monkeypatch.setattr(selection, "wald", lambda fit, addition: 0.0)
    monkeypatch.setattr(selection, "without", lambda e, a, *, limit: of("".join(sorted(e.names() - {a.name}))))
    monkeypatch.setattr(selection, "with_noise", lambda explanation, differenced, *, again: explanation)
    whole = of("ab")
    penalty = whole.additions[0].penalty(1000)
    assert penalty < 60 < 30 * penalty < 1000
    for samples, kept in ((1000, {"a"}), (30_000, {"a", "b"})):
        assert whole.excess(samples) == 30_000 / samples
        assert (
            Selection(SimpleNamespace(samples=samples), None, None, (), UNLIMITED).without_idle(whole).names() == kept
        )
    whole.fit.at_bound = (1,)  # what a bound makes of the residuals is not what the recording has
    assert whole.excess(1000) == 1.0


def test_a_rival_that_is_likelier_by_another_noise_than_its_own_takes_no_place(monkeypatch):
    """Each of two explanations may leave less by the other's noise: they would take turns."""
    costs = {"a": 100.0, "b": 90.0}

    def of(name, noise, size):
        fit = SimpleNamespace(cost=costs[name] + noise, **(FREE | {"whitener": WhitenerOf(size)}))
        return Explanation(fit, (Addition(EFFECTS[0], name, 1, 1.0),))

    class WhitenerOf:
        def __init__(self, log_size):
            self.log_size, self.present, self.log_shared = log_size, np.ones((3, 2), dtype=bool), 0.0

        def __call__(self, columns):
            return columns, self.log_size

    for log_size, kept in ((15.0, "a"), (-15.0, "b")):
        rival = of("b", 0.0, 0.0)
        again = of("b", 10.0, log_size)
        monkeypatch.setattr(rivals, "_others", lambda s, e, rival=rival: [rival] if e.names() == {"a"} else [])
        monkeypatch.setattr(rivals, "_fuller", lambda s, e, found: [])
        monkeypatch.setattr(rivals, "_tells", lambda e: 5)
        monkeypatch.setattr(Explanation, "evidence", Explanation.criterion)
        monkeypatch.setattr(rivals, "_nearest", lambda s, e, found: found)
        monkeypatch.setattr(rivals, "_without_absurd", lambda s, e, found: None)
        monkeypatch.setattr(rivals, "with_noise", lambda e, differenced, *, again: e)
        search = SimpleNamespace(
            tests=SimpleNamespace(samples=1000), differenced=None, effects=(), effort=UNLIMITED,
            grown=lambda e, effects, again=again: again, without_idle=lambda e: e, at_best=lambda e: e,
        )  # fmt: skip
        found, others = rivals.settled(search, of("a", 0.0, 0.0))
        assert found.names() == {kept} and [e.names() for e in others] == ([{"b"}] if kept == "a" else [])


def test_a_delay_of_a_channel_takes_the_place_of_one_of_all_from_as_late():
    """Beside a delay of all outputs that lies samples away, the tries of a channel's own lead to no fit."""
    places = (SimpleNamespace(name="delay", channel=""), SimpleNamespace(name="delay of i", channel="i"))
    fit = SimpleNamespace(
        simulator=SimpleNamespace(nuisances=places), free=("R", "delay"), value={"R": 2.0, "delay": 0.003}.get
    )
    effects = {e.name: e for e in EFFECTS}
    common = Addition(effects["delay"], "delay", 1, 1.0, free=("delay",))
    own = Addition(effects["delay of"], "delay of i", 1, 1.0, free=("delay of i",), starts=({"delay of i": 0.0005},))
    for one, other, name in ((common, own, "delay of i"), (own, common, "delay")):
        fit.value = {"R": 2.0, "delay": 0.003, "delay of i": 0.003}.get
        fit.free = ("R", one.name)
        assert rivals._as_late(Explanation(fit, (one,)), one, other).starts[-1] == {"R": 2.0, name: 0.003}


def test_what_explains_more_beside_an_explanation_takes_its_place(monkeypatch):
    """A score test at a kink, as of a delay of whole samples, tells too little; the refit of a rival tells it."""
    costs = {"a": 100.0, "ab": 50.0}

    def of(names):
        fit = SimpleNamespace(cost=costs[names], **(FREE | {"whitener": WHITENER}))
        return Explanation(fit, tuple(Addition(EFFECTS[0], name, 1, 1.0) for name in names))

    class Whitener:
        present, log_shared = np.ones((3, 2), dtype=bool), 0.0

        def __call__(self, columns):
            return columns, 0.0

    WHITENER = Whitener()
    monkeypatch.setattr(rivals, "_others", lambda s, e: [])
    monkeypatch.setattr(rivals, "_fuller", lambda s, e, found: [of("ab")] if e.names() == {"a"} else [])
    monkeypatch.setattr(rivals, "_tells", lambda e: 5)
    monkeypatch.setattr(Explanation, "evidence", Explanation.criterion)
    monkeypatch.setattr(rivals, "_nearest", lambda s, e, found: list(found))
    monkeypatch.setattr(rivals, "_without_absurd", lambda s, e, found: None)
    monkeypatch.setattr(rivals, "with_noise", lambda e, differenced, *, again: e)
    search = SimpleNamespace(
        tests=SimpleNamespace(samples=1000), differenced=None, effects=(), effort=UNLIMITED,
        grown=lambda e, effects: e, without_idle=lambda e: e, at_best=lambda e: e,
    )  # fmt: skip
    found, others = rivals.settled(search, of("a"))
    assert found.names() == {"a", "b"} and others == []


def test_what_another_addition_makes_no_sense_without_is_not_idle(monkeypatch):
    """Friction that is zero beside one that falls with the speed: without it that would be taken away as well."""
    nuisances = (SimpleNamespace(name="friction", needs=""), SimpleNamespace(name="falls", needs="friction"))
    additions = tuple(Addition(EFFECTS[0], name, 1, 1.0, free=(name,)) for name in ("friction", "falls"))
    fit = SimpleNamespace(cost=100.0, **(FREE | {"simulator": SimpleNamespace(nuisances=nuisances)}))
    monkeypatch.setattr(selection, "wald", lambda fit, addition: 0.0)
    monkeypatch.setattr(selection, "without", lambda e, a, *, limit: a.name)
    search = Selection(SimpleNamespace(samples=1000), None, None, (), UNLIMITED)
    assert list(search._slimmer(Explanation(fit, additions))) == ["falls"]
    assert list(search._slimmer(Explanation(fit, additions[:1]))) == ["friction"]
