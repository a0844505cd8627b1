"""Whether the effects that an estimate rests on are too seldom together, against least squares with and without."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining.addition import Addition
from estimator.explaining.effects.base import SELDOM, USUAL, Effect
from estimator.explaining.explanation import Explanation
from estimator.explaining.rarity import moves_without, seldom_together

NAMES = ("R", "K", "one", "other")


def explanation_of(sizes, priors, *, is_line=False, seed=1):
    """Return the fit of two parameters and of two effects' numbers by white noise of variance 1, and without each."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((200, 4))
    columns[:, 2:] += columns[:, :2]  # an effect that is left out moves its parameter
    y = columns @ [1.0, 2.0, *sizes] + rng.standard_normal(200)
    covariance = np.linalg.inv(columns.T @ columns)
    fit = SimpleNamespace(
        names=NAMES, free=NAMES, estimates=covariance @ columns.T @ y, is_log=np.zeros(4, dtype=bool),
        covariance_parts=lambda: (covariance, 0 * covariance), simulator=SimpleNamespace(neutral={}),
    )  # fmt: skip
    effects = [Effect(n, prior=p, is_line=is_line) for n, p in zip(NAMES[2:], priors, strict=True)]
    additions = tuple(Addition(e, e.name, 1, 0.0, free=(e.name,)) for e in effects)
    bare = [np.linalg.lstsq(np.delete(columns, k, axis=1), y, rcond=None)[0][:2] for k in (2, 3)]
    return Explanation(fit, additions), fit.estimates[:2] - bare, np.sqrt(np.diag(covariance)[:2])


def test_the_parameters_move_by_as_much_as_a_fit_without_the_effect_does():
    explanation, moves, _ = explanation_of((3.0, -0.5), (SELDOM, SELDOM))
    for addition, moved in zip(explanation.additions, moves, strict=True):
        assert moves_without(explanation.fit, addition, 2) == pytest.approx(-moved, rel=1e-9)


@pytest.mark.parametrize(
    ("priors", "sizes", "is_line", "names"),
    [
        ((SELDOM, SELDOM), (3.0, 3.0), False, ["one", "other"]),
        ((SELDOM, 0.5 * USUAL), (3.0, 3.0), False, ["one", "other"]),  # one in twenty
        ((SELDOM / 1000, USUAL), (3.0, 3.0), False, []),  # one of a thousand places: that makes it no more seldom
        ((SELDOM, USUAL), (3.0, 3.0), False, []),
        ((SELDOM, SELDOM), (3.0, 0.1), False, []),  # the parameters do not rest on the second
        ((SELDOM, SELDOM), (3.0, 3.0), True, []),  # nothing else makes lines
    ],
)
def test_seldom_effects_are_doubted_where_parameters_rest_on_them_together(priors, sizes, is_line, names):
    explanation, _, errors = explanation_of(sizes, priors, is_line=is_line)
    assert [a.name for a in seldom_together(explanation, errors)] == names


def test_what_is_chosen_is_taken_to_move_the_parameters():
    """Of a switch there is no derivative."""
    explanation, _, errors = explanation_of((3.0, 3.0), (SELDOM, SELDOM))
    switch = Addition(Effect("switch", prior=SELDOM), "switch", 1, 0.0)
    both = Explanation(explanation.fit, (explanation.additions[0], switch))
    assert [a.name for a in seldom_together(both, errors)] == ["one", "switch"]
