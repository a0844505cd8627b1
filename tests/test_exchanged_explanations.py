"""Which rivals an explanation may be exchanged for."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining.rivals import _is_same, _likelier, _tells


def explained(errors, *, cost=100.0, values=(2.0, 0.05), at_bound=(0, 0), is_log=(True, False)):
    """Return an explanation of two parameters, one on a logarithmic scale, that has one number beside."""
    fit = SimpleNamespace(
        simulator=SimpleNamespace(plan=SimpleNamespace(names=("R", "offset")), scaled=lambda x: np.asarray(x)),
        covariance=lambda: np.diag(np.square([*errors, 1.0])),
        estimates=np.array([*values, 7.0]), values=np.array(values), is_log=np.array([*is_log, False]),
        at_bound=np.array([*at_bound, 0]), cost=cost,
    )  # fmt: skip
    return SimpleNamespace(
        fit=fit, additions=(), names=lambda: {cost}, criterion=lambda *_: cost, evidence=lambda _: cost,
        excess=lambda _: 1.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("told", "errors", "at_bound"),
    [(2, (0.1, 0.01), (0, 0)), (1, (1.5, 0.01), (0, 0)), (1, (0.1, 0.06), (0, 0)), (1, (0.1, 0.01), (-1, 0)),
     (0, (np.inf, np.inf), (0, 0))],
)  # fmt: skip
def test_a_parameter_is_told_to_better_than_its_own_size_and_off_its_bounds(told, errors, at_bound):
    assert _tells(explained(errors, at_bound=at_bound)) == told


def test_an_explanation_is_exchanged_for_a_likelier_one_that_tells_as_much():
    """Of a real step, dry friction in the place of a current limit left R, K, L, J and B open, for 9 of z'z."""
    selection = SimpleNamespace(tests=SimpleNamespace(samples=1000))
    own, telling, open_one = (
        explained((0.1, 0.01)),
        explained((0.2, 0.02), cost=95.0),
        explained((9.0, 0.01), cost=91.0),
    )
    assert _likelier(selection, own, [open_one]) is None
    assert _likelier(selection, own, [open_one, telling]) is telling
    assert _likelier(selection, open_one, [own]) is None  # what tells more has to be likelier, too


@pytest.mark.parametrize(("there", "same"), [((2.0, 0.05), True), ((2.0, 0.05 + 1e-9), True), ((2.2, 0.05), False)])
def test_explanations_that_lie_at_one_bound_are_the_same(there, same):
    """A rounding at L's lower bound was a rival: "with L = 5.316e-08 instead of 5.316e-08", and all were doubtful."""
    at_bound = {"errors": (0.1, 0.0), "at_bound": (0, -1)}
    assert _is_same(explained(**at_bound), explained(values=there, **at_bound)) == same
    assert not _is_same(explained(**at_bound), explained(values=(2.0, 0.06), errors=(0.1, 0.001)))
