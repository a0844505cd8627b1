"""Where a first fit begins: near a motor's first estimates, where the FMU can be simulated there."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining.first_fit import FirstFit


@pytest.mark.parametrize("fails_below", [0.0, 1e-3])
def test_a_motor_is_held_near_its_first_estimates_unless_the_fmu_fails_there(fails_below, monkeypatch):
    """An FMU that fails where the data's first estimates are ended in an internal error: no residual was a number."""
    names, guess = ("R", "J"), {"R": 2.0, "J": 1e-5}

    def shown(candidates):
        fails = candidates[:, 1] < fails_below
        return np.where(fails[:, None, None], np.nan, np.ones((len(candidates), 4, 2)))

    base = SimpleNamespace(
        lower=np.array([1e-3, 1e-12]), upper=np.array([1e3, 1e2]), log=np.array([True, True]),
        plan=SimpleNamespace(names=names, guess=guess), shown=shown,
        values=lambda known: np.array([known[name] for name in names]),
    )  # fmt: skip
    monkeypatch.setattr(FirstFit, "_leaves_noise", lambda self, start: False)
    first = FirstFit(SimpleNamespace(base=base), (), np.ones(2), ())
    with first.held_near([np.array([2.0, 0.5])]):
        held = base.upper[1] < 0.5
    assert held == (fails_below == 0.0)
    assert base.upper[1] == 1e2
